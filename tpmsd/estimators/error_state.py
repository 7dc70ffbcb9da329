"""The state of the Gaussian-sum filter, what is assumed of it beforehand, and how it moves with a tick.

In: rotation of the rear wheels. Out: mean and covariance of N hypotheses, propagated through [Lundquist
2013, eq. 7].

Beside pose and radii the state holds what confounds them and acts linearly; the names are those of the
effects in `physics.catalogue`, which describes each one's physics:

    LAT, LATV  gnss_latency: age of a position, and how much older the Doppler speed is
    TRK        track_width_error of the rear axle, relative, as a factor on the turn
    FWD        antenna_lever_arm, forward
    GYRO, GAIN yaw_rate_bias (rad/s) and yaw_rate_scale (minus 1) of the bus's yaw rate
    SLIP       longitudinal_slip of the driven axle, per acceleration
    LOAD       load_transfer_lateral: radius lost per lateral acceleration by the outer wheels
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from tpmsd.estimators.settings import SETTINGS
from tpmsd.physics.priors import (
    ANTENNA_FORWARD_M,
    DRIVE_SLIP_S2PM,
    FIX_AGE_S,
    GYRO_SCALE,
    GYRO_ZERO_RADPS,
    LATERAL_LOAD_S2,
    SPEED_AGE_S,
    TRACK_M,
)
from tpmsd.wheels import FloatArray

E, N, PSI, BE, BN, LAT, LATV, TRK, FWD, GYRO, GAIN, SLIP, LOAD, MU = range(14)
"""Places in the state; the radius errors (rl, rr[, fl, fr]) come last, from MU on."""

USUAL_TRACK_M = 1.5
"""By which an error of the track is made relative: tracks of cars lie within 10 % of it."""
PRIORS: Mapping[int, tuple[float, float]] = MappingProxyType(
    {
        LAT: (FIX_AGE_S.mean, FIX_AGE_S.std),
        LATV: (SPEED_AGE_S.mean, SPEED_AGE_S.std),
        TRK: (0.0, TRACK_M.std / USUAL_TRACK_M),
        FWD: (ANTENNA_FORWARD_M.mean, ANTENNA_FORWARD_M.std),
        GYRO: (GYRO_ZERO_RADPS.mean, GYRO_ZERO_RADPS.std),
        GAIN: (GYRO_SCALE.mean - 1.0, GYRO_SCALE.std),
        SLIP: (DRIVE_SLIP_S2PM.mean, DRIVE_SLIP_S2PM.std),
        LOAD: (LATERAL_LOAD_S2.mean, LATERAL_LOAD_S2.std),
    }
)
"""Mean and standard deviation of what confounds the radii: the effects' own."""


def initial_state(count: int, nominal_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Prior mean (count, n) and covariance (count, n, n); nominal_m (d,) in the order rl, rr[, fl, fr]."""
    wheels = nominal_m.size
    mean = np.zeros((count, MU + wheels))
    covariance = np.zeros((count, MU + wheels, MU + wheels))
    for place, (value, std) in PRIORS.items():
        mean[:, place] = value
        covariance[:, place, place] = std**2
    # A guessed nominal is wrong for all wheels alike; wheels differ among themselves by half as much.
    radii = np.outer(nominal_m, nominal_m) * SETTINGS.radius_prior**2
    covariance[:, MU:, MU:] = radii * (SETTINGS.common_prior + (1.0 - SETTINGS.common_prior) * np.eye(wheels))
    return mean, covariance


def drift_covariance(wheels: int) -> FloatArray:
    """(d, d) growth of the radii's covariance per second."""
    out = np.eye(wheels) * SETTINGS.drift_own_m**2 + np.ones((wheels, wheels)) * SETTINGS.drift_common_m**2
    if wheels == 4:
        axle = np.array([1.0, 1.0, -1.0, -1.0])
        out += np.outer(axle, axle) * SETTINGS.drift_axle_m**2
    return out


@dataclass(frozen=True, slots=True)
class Motion:
    """One tick as the process model sees it."""

    dt_s: float
    rear_rad: FloatArray
    """(2,) rotation of rl and rr."""
    accel_long_mps2: float
    accel_lat_mps2: float
    informative: bool
    horizontal: float = 1.0
    """Way over the map per way along the road (`grade`)."""
    witness_turn_rad: float | None = None
    """The tick's turn as something smoother than the wheels' reading tells it, for TRK; None: the wheels'."""
    steered_curvature: float | None = None
    """Curvature by the steering, eq. (38c), where it replaces the wheels' turn."""


class ProcessModel:
    """Moves all hypotheses through a tick, in arrays that it keeps."""

    def __init__(self, nominal_m: FloatArray, track_rear_m: float, driven_rear: bool) -> None:
        self._nominal = nominal_m
        self._track = track_rear_m
        self._driven_rear = driven_rear
        self._wheels = nominal_m.size
        self.drift = drift_covariance(self._wheels)
        self._drift_common = np.full((self._wheels, self._wheels), SETTINGS.drift_common_m**2)
        self._drift_own = self.drift - self._drift_common
        size = MU + self._wheels
        self._fade, self._noise = np.ones((size, size)), np.zeros((size, size))
        self._bend = np.zeros((0, 3, size))

    def drift_at(self, levels: FloatArray) -> FloatArray:
        """(N, n, n) growth of the covariance per second by the radii's drift at levels (N, d) of each wheel,
        which are relative to `drift_own_m` and `drift_axle_m`; `drift_common_m` follows the lowest of them
        down to `calm_common` only and never up."""
        common = np.clip(levels.min(axis=1), SETTINGS.calm_common, 1.0)[:, None, None]
        own = levels[:, :, None] * levels[:, None, :]
        out = np.zeros((levels.shape[0], *self._noise.shape))
        out[:, MU:, MU:] = own * self._drift_own + np.square(common) * self._drift_common
        return out

    def way_and_turn(self, mean: FloatArray, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """(N,) way of the rear axle's middle and turn of each hypothesis, eqs (6a), (6b)."""
        left, right = float(motion.rear_rad[0]), float(motion.rear_rad[1])
        rolled_left = left * (self._nominal[0] + mean[:, MU])
        rolled_right = right * (self._nominal[1] + mean[:, MU + 1])
        way = (rolled_left + rolled_right) * (0.5 * motion.horizontal)
        if self._driven_rear:
            way *= 1.0 - mean[:, SLIP] * motion.accel_long_mps2
        if motion.steered_curvature is not None:
            return way, way * motion.steered_curvature
        turn = (rolled_right - rolled_left) * (1.0 + mean[:, TRK])
        turn /= self._track
        turn += mean[:, LOAD] * self.load_turn(motion)
        return way, turn

    def load_turn(self, motion: Motion) -> float:
        """Turn per LOAD: in a left turn the right radius shrinks and the left one grows, so the wheels show
        too much of it."""
        return -motion.accel_lat_mps2 * float(motion.rear_rad[0] + motion.rear_rad[1]) / self._track

    def propagate(
        self,
        mean: FloatArray,
        covariance: FloatArray,
        motion: Motion,
        position_std_m: float,
        drift: FloatArray | None = None,
    ) -> tuple[float, float]:
        """Move mean (N, n) and covariance (N, n, n) through eq. (7), heading at mid-step, in place; mean way
        and turn of the tick.

        `drift` (N, n, n): growth of the covariance per second of each hypothesis (`drift_at`); None: that at
        level 1.
        """
        count = mean.shape[0]
        if self._bend.shape[0] != count:
            self._bend = np.zeros((count, *self._bend.shape[1:]))
        way, turn = self.way_and_turn(mean, motion)
        middle = turn * 0.5
        middle += mean[:, PSI]
        cos, sin = np.cos(middle), np.sin(middle)
        bend = self._pose_by_state(way, turn, cos, sin, motion)
        mean[:, E] += way * cos
        mean[:, N] += way * sin
        mean[:, PSI] += turn
        decay = math.exp(-motion.dt_s / SETTINGS.bias_tau_s)
        mean[:, BE : BN + 1] *= decay
        mean_way, mean_turn = float(way.sum()) / count, float(turn.sum()) / count
        # F P F' with F = I + B, of which only the pose's rows hold anything: P + B P in those rows, then
        # (P + B P) B' in their first columns; the other rows of the first columns are these, mirrored.
        pose = covariance[:, : PSI + 1, :]
        pose += np.matmul(bend, covariance)
        pose[:, :, : PSI + 1] += np.matmul(pose, bend.swapaxes(1, 2))
        covariance[:, PSI + 1 :, : PSI + 1] = pose[:, :, PSI + 1 :].swapaxes(1, 2)
        # The receiver's slow error fades; over all places at once, for that is one pass through memory.
        fade, noise = self._fade, self._noise
        fade[BE : BN + 1] = fade[:, BE : BN + 1] = decay
        fade[BE : BN + 1, BE : BN + 1] = decay**2
        covariance *= fade
        self._set_noise(noise, motion, abs(mean_way), mean_turn)
        noise[BE, BE] = noise[BN, BN] = position_std_m**2 * (1.0 - decay**2)
        covariance += noise
        covariance += (
            self.drift_at(np.ones((count, self._wheels))) if drift is None else drift
        ) * motion.dt_s
        return mean_way, mean_turn

    def _pose_by_state(
        self, way: FloatArray, turn: FloatArray, cos: FloatArray, sin: FloatArray, motion: Motion
    ) -> FloatArray:
        """(N, 3, n) derivative of the tick's change of E, N, PSI by the state."""
        out = self._bend
        across_east, across_north = -way * sin, way * cos
        out[:, E, PSI], out[:, N, PSI] = across_east, across_north
        by_wheels = motion.steered_curvature is None
        for k, sign in enumerate((-1.0, 1.0)):
            angle = float(motion.rear_rad[k])
            half, turned = 0.5 * angle * motion.horizontal, sign * angle / self._track * by_wheels
            out[:, E, MU + k] = half * cos + (0.5 * turned) * across_east
            out[:, N, MU + k] = half * sin + (0.5 * turned) * across_north
            out[:, PSI, MU + k] = turned
        if self._driven_rear:
            slip = way * -motion.accel_long_mps2
            out[:, E, SLIP], out[:, N, SLIP] = slip * cos, slip * sin
        # The wheels' own reading error here would be taken for a track (errors in variables).
        witness = turn if motion.witness_turn_rad is None else motion.witness_turn_rad
        out[:, PSI, TRK] = witness if by_wheels else 0.0
        out[:, PSI, LOAD] = self.load_turn(motion) if by_wheels else 0.0
        return out

    def _set_noise(self, out: FloatArray, motion: Motion, distance: float, turn: float) -> None:
        """What a tick adds to the covariance of every hypothesis (n, n), but for BE, BN and the radii."""
        rough = not motion.informative
        out[E, E] = out[N, N] = (
            SETTINGS.way_noise**2 * distance + (SETTINGS.rough_way * distance) ** 2 * rough
        )
        heading = SETTINGS.turn_noise**2 * distance + (SETTINGS.turn_relative * turn) ** 2
        out[PSI, PSI] = heading + (SETTINGS.rough_turn * distance / self._track) ** 2 * rough
        out[LAT, LAT] = SETTINGS.latency_drift**2 * motion.dt_s
        out[GYRO, GYRO] = SETTINGS.gyro_drift**2 * motion.dt_s
