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
from dataclasses import dataclass

import numpy as np

from tpmsd.estimators.settings import SETTINGS
from tpmsd.wheels import FloatArray

E, N, PSI, BE, BN, LAT, LATV, TRK, FWD, GYRO, GAIN, SLIP, LOAD, MU = range(14)
"""Places in the state; the radius errors (rl, rr[, fl, fr]) come last, from MU on."""
BENDS = [PSI, TRK, SLIP, LOAD, MU, MU + 1]
"""What moves the pose in a tick."""


def initial_state(count: int, nominal_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Prior mean (count, n) and covariance (count, n, n); nominal_m (d,) in the order rl, rr[, fl, fr]."""
    wheels = nominal_m.size
    mean = np.zeros((count, MU + wheels))
    covariance = np.zeros((count, MU + wheels, MU + wheels))
    priors = (
        (LAT, *SETTINGS.latency_prior_s),
        (LATV, *SETTINGS.velocity_lag_prior_s),
        (TRK, 0.0, SETTINGS.track_prior),
        (FWD, 0.0, SETTINGS.forward_prior_m),
        (GYRO, 0.0, SETTINGS.gyro_prior_radps),
        (GAIN, 0.0, SETTINGS.gain_prior),
        (SLIP, *SETTINGS.slip_prior),
        (LOAD, 0.0, SETTINGS.load_prior_s2),
    )
    for place, value, std in priors:
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
    teaches: bool
    horizontal: float = 1.0
    """Way over the map per way along the road (`grade`)."""
    witness_turn_rad: float | None = None
    """The tick's turn as something smoother than the wheels' reading tells it, for TRK; None: the wheels'."""
    steered_curvature: float | None = None
    """Curvature by the steering, eq. (38c), where it replaces the wheels' turn."""


class ProcessModel:
    """Moves all particles through a tick."""

    def __init__(self, nominal_m: FloatArray, track_rear_m: float, driven_rear: bool) -> None:
        self._nominal = nominal_m
        self._track = track_rear_m
        self._driven_rear = driven_rear
        self._wheels = nominal_m.size
        self.drift = drift_covariance(self._wheels)
        self._drift_common = np.full((self._wheels, self._wheels), SETTINGS.drift_common_m**2)
        self._drift_own = self.drift - self._drift_common

    def drift_at(self, levels: FloatArray) -> FloatArray:
        """(N, d, d) growth of the radii's covariance per second at levels (N,), which are relative to
        `drift_own_m` and `drift_axle_m`; `drift_common_m` follows them down
        to `calm_common` only and never up."""
        own, common = levels[:, None, None], np.clip(levels, SETTINGS.calm_common, 1.0)[:, None, None]
        return np.asarray(np.square(own) * self._drift_own + np.square(common) * self._drift_common)

    def way_and_turn(self, mean: FloatArray, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """(N,) way of the rear axle's middle and turn of each particle, eqs (6a), (6b)."""
        roll = motion.rear_rad * (self._nominal[:2] + mean[:, MU : MU + 2])
        way = (roll[:, 0] + roll[:, 1]) / 2 * motion.horizontal
        if self._driven_rear:
            way *= 1.0 - mean[:, SLIP] * motion.accel_long_mps2
        if motion.steered_curvature is not None:
            return way, way * motion.steered_curvature
        turn = (roll[:, 1] - roll[:, 0]) / self._track * (1.0 + mean[:, TRK])
        return way, turn + mean[:, LOAD] * self.load_turn(motion)

    def load_turn(self, motion: Motion) -> float:
        """Turn per LOAD: in a left turn the right radius shrinks and the left one grows, so the wheels show
        too much of it."""
        return -motion.accel_lat_mps2 * float(motion.rear_rad.sum()) / self._track

    def propagate(
        self,
        mean: FloatArray,
        covariance: FloatArray,
        motion: Motion,
        position_std_m: float,
        drift: FloatArray | None = None,
    ) -> tuple[FloatArray, float, float]:
        """Move mean (in place) and covariance (returned) through eq. (7), heading at mid-step.

        `drift` (N, d, d): growth of the radii's covariance per second, of each particle; None: `drift`.

        Returns the covariance and the mean way and turn of the tick.
        """
        way, turn = self.way_and_turn(mean, motion)
        middle = mean[:, PSI] + turn / 2
        cos, sin = np.cos(middle), np.sin(middle)
        mean[:, E] += way * cos
        mean[:, N] += way * sin
        mean[:, PSI] += turn
        decay = math.exp(-motion.dt_s / SETTINGS.bias_tau_s)
        mean[:, BE : BN + 1] *= decay
        mean_way, mean_turn = float(way.sum()) / way.size, float(turn.sum()) / turn.size
        noise = self._noise(motion, abs(mean_way), mean_turn)
        noise[BE] = noise[BN] = position_std_m**2 * (1.0 - decay**2)
        # F P F' row by row: only the pose's rows of F hold anything beside the diagonal. The other rows of
        # its first columns are these, mirrored.
        bend = self._pose_by_bends(way, turn, cos, sin, motion)
        out = covariance.copy()
        out[:, BE : BN + 1, :] *= decay
        out[:, :, BE : BN + 1] *= decay
        pose = out[:, : PSI + 1, :]
        pose += bend @ out.take(BENDS, axis=1)
        pose[:, :, : PSI + 1] += pose[:, :, BENDS] @ bend.swapaxes(1, 2)
        out[:, PSI + 1 :, : PSI + 1] = pose[:, :, PSI + 1 :].swapaxes(1, 2)
        np.einsum("ijj->ij", out)[:] += noise
        out[:, MU:, MU:] += (self.drift if drift is None else drift) * motion.dt_s
        return out, mean_way, mean_turn

    def _pose_by_bends(
        self, way: FloatArray, turn: FloatArray, cos: FloatArray, sin: FloatArray, motion: Motion
    ) -> FloatArray:
        """(N, 3, 6) derivative of the tick's change of E, N, PSI by the states `BENDS`."""
        out = np.zeros((way.size, 3, len(BENDS)))
        east, north, heading = out[:, E], out[:, N], out[:, PSI]
        psi, trk, slip, load = range(4)
        east[:, psi] = -way * sin
        north[:, psi] = way * cos
        by_wheels = motion.steered_curvature is None
        for k, sign in enumerate((-1.0, 1.0)):
            half = motion.rear_rad[k] / 2 * motion.horizontal
            bend = sign * motion.rear_rad[k] / self._track * by_wheels
            east[:, load + 1 + k] = half * cos - way * sin * bend / 2
            north[:, load + 1 + k] = half * sin + way * cos * bend / 2
            heading[:, load + 1 + k] = bend
        if self._driven_rear:
            east[:, slip] = -way * motion.accel_long_mps2 * cos
            north[:, slip] = -way * motion.accel_long_mps2 * sin
        if by_wheels:
            # The wheels' own reading error here would be taken for a track (errors in variables).
            heading[:, trk] = turn if motion.witness_turn_rad is None else motion.witness_turn_rad
            heading[:, load] = self.load_turn(motion)
        return out

    def _noise(self, motion: Motion, distance: float, turn: float) -> FloatArray:
        """(n,) what a tick adds to the variances."""
        out = np.zeros(MU + self._wheels)
        rough = not motion.teaches
        out[E] = out[N] = SETTINGS.way_noise**2 * distance + (SETTINGS.rough_way * distance) ** 2 * rough
        out[PSI] = SETTINGS.turn_noise**2 * distance + (SETTINGS.turn_relative * turn) ** 2
        out[PSI] += (SETTINGS.rough_turn * distance / self._track) ** 2 * rough
        out[LAT] = SETTINGS.latency_drift**2 * motion.dt_s
        out[GYRO] = SETTINGS.gyro_drift**2 * motion.dt_s
        return out
