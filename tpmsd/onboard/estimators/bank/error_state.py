"""The state of the Gaussian-sum filter, what is assumed of it beforehand, and how it moves with a tick.

In: rotation of the rear wheels. Out: mean and covariance of N hypotheses, propagated through [Lundquist
2013, eq. 7].

Arrays are (N, n) and (N, n, n), but the hypotheses lie side by side in memory (`side_by_side`): what is done
to one place of the state is then done to all hypotheses in one pass over neighbouring numbers.

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
from typing import NamedTuple

import numpy as np

from tpmsd.car.physics.priors import (
    ANTENNA_FORWARD_M,
    DRIVE_SLIP_S2PM,
    FIX_AGE_S,
    GYRO_SCALE,
    GYRO_ZERO_RADPS,
    LATERAL_LOAD_S2,
    SPEED_AGE_S,
    TRACK_M,
)
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.settings import SETTINGS

E, N, PSI, BE, BN, LAT, LATV, TRK, FWD, GYRO, GAIN, SLIP, LOAD, MU = range(14)
"""Places in the state; the radius errors (rl, rr[, fl, fr]) come last, from MU on."""

TYPICAL_TRACK_M = 1.5
"""Track by which its error is made relative, m: tracks of cars lie within 10 % of it."""
PRIORS: Mapping[int, tuple[float, float]] = MappingProxyType(
    {
        LAT: (FIX_AGE_S.mean, FIX_AGE_S.std),
        LATV: (SPEED_AGE_S.mean, SPEED_AGE_S.std),
        TRK: (0.0, TRACK_M.std / TYPICAL_TRACK_M),
        FWD: (ANTENNA_FORWARD_M.mean, ANTENNA_FORWARD_M.std),
        GYRO: (GYRO_ZERO_RADPS.mean, GYRO_ZERO_RADPS.std),
        GAIN: (GYRO_SCALE.mean - 1.0, GYRO_SCALE.std),
        SLIP: (DRIVE_SLIP_S2PM.mean, DRIVE_SLIP_S2PM.std),
        LOAD: (LATERAL_LOAD_S2.mean, LATERAL_LOAD_S2.std),
    }
)
"""Mean and standard deviation of what confounds the radii: the effects' own."""


def side_by_side(count: int, *shape: int) -> FloatArray:
    """Return zeros of shape (count, *shape) of which the first axis is the fastest in memory."""
    return np.moveaxis(np.zeros((*shape, count)), -1, 0)


def initial_state(count: int, nominal_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the prior mean (count, n) and covariance (count, n, n); nominal_m (d,) in the order rl, rr[, fl,
    fr]."""
    wheels = nominal_m.size
    mean = side_by_side(count, MU + wheels)
    covariance = side_by_side(count, MU + wheels, MU + wheels)
    for index, (value, std) in PRIORS.items():
        mean[:, index] = value
        covariance[:, index, index] = std**2
    # A guessed nominal is wrong for all wheels alike; wheels differ among themselves by half as much.
    radii = np.outer(nominal_m, nominal_m) * SETTINGS.radius_prior**2
    covariance[:, MU:, MU:] = radii * (SETTINGS.common_prior + (1.0 - SETTINGS.common_prior) * np.eye(wheels))
    return mean, covariance


def drift_covariance(wheels: int) -> FloatArray:
    """Return the (d, d) growth of the radii's covariance per second, m^2."""
    out = np.eye(wheels) * SETTINGS.drift_own_m**2 + np.ones((wheels, wheels)) * SETTINGS.drift_common_m**2
    if wheels == 4:
        axle = np.array([1.0, 1.0, -1.0, -1.0])
        out += np.outer(axle, axle) * SETTINGS.drift_axle_m**2
    return out


@dataclass(frozen=True, slots=True)
class TickMotion:
    """One tick as the process model sees it."""

    dt_s: float
    rear_rad: FloatArray
    """(2,) rotation of rl and rr."""
    accel_long_mps2: float
    accel_lat_mps2: float
    informative: bool
    horizontal: float = 1.0
    """Way over the map per way along the road (`grade`)."""
    independent_heading_change_rad: float | None = None
    """The tick's turn as something smoother than the wheels' reading tells it, for TRK; None: the wheels'."""
    lateral_known: bool = True
    """True if `accel_lat_mps2` is another instrument's; else it is the wheels', smoothed and late by seconds,
    and serves for derivatives alone.
    """
    steered_curvature: float | None = None
    """Curvature by the steering, eq. (38c), where it replaces the wheels' turn."""


class _PoseDerivative(NamedTuple):
    """Derivative B (N, 3, n) of a tick's change of E, N, PSI by the state: its entries that are not zero."""

    across: FloatArray
    """(2, N) of E and N by PSI."""
    by_radius: FloatArray
    """(2, 2, N) of E and N by each rear radius, which comes first."""
    by_slip: FloatArray | None
    """(2, N) of E and N by SLIP, where the rear axle is driven."""
    by_track: FloatArray | float = 0.0
    """(N,) of PSI by TRK, or of all hypotheses alike."""
    by_load: FloatArray | None = None
    """(3,) of PSI by LOAD and the rear radii, of all hypotheses alike; None where steering tells the turn."""
    share: FloatArray | float = 1.0
    """(N,) by which each hypothesis multiplies `by_load` (`ProcessModel._turn_fraction`)."""

    def add_to(self, rows: FloatArray) -> None:
        """Add B times `rows` (n, k, N) to them, in place."""
        position, heading = rows[E : N + 1], rows[PSI]
        position += self.across[:, None] * heading
        for by_radius, radius in zip(self.by_radius, rows[MU : MU + 2], strict=True):
            position += by_radius[:, None] * radius
        if self.by_slip is not None:
            position += self.by_slip[:, None] * rows[SLIP]
        if self.by_load is not None:
            together = rows[LOAD : MU + 2]  # LOAD, then the rear radii
            heading += self.share * (self.by_load @ together.reshape(3, -1)).reshape(heading.shape)
            heading += self.by_track * rows[TRK]


class _OfLength:
    """Noise of ticks of one length: as a rule that of all."""

    def __init__(self, dt_s: float, track_m: float) -> None:
        self.dt_s = dt_s
        self.decay = math.exp(-dt_s / SETTINGS.bias_tau_s)
        """Share of the receiver's slow error that is left after a tick."""
        self.gentle, self.rough = (
            (
                *(SETTINGS.path_noise**2, SETTINGS.rough_path**2 * rough),
                *(SETTINGS.turn_noise**2, SETTINGS.turn_relative**2),
                (SETTINGS.rough_turn / track_m) ** 2 * rough,
                *(SETTINGS.latency_drift**2 * dt_s, SETTINGS.gyro_drift**2 * dt_s),
            )
            for rough in (0.0, 1.0)
        )
        """Variances that `ProcessModel.kernel_constants` returns from `path_noise` on, of informative ticks
        and of others."""


class ProcessModel:
    """Moves all hypotheses through a tick."""

    def __init__(self, nominal_m: FloatArray, track_rear_m: float, driven_rear: bool) -> None:
        self._rear_m = nominal_m[:2, None].copy()
        """(2, 1) nominal radii of the pair that rolls."""
        self._track = track_rear_m
        self._driven_rear = driven_rear
        self._wheels = nominal_m.size
        self.drift = drift_covariance(self._wheels)
        self._drift_own = self.drift - SETTINGS.drift_common_m**2
        self._rear = tuple(nominal_m[:2].tolist())
        self._of_length = _OfLength(math.nan, track_rear_m)

    def drift_at(self, levels: FloatArray) -> FloatArray:
        """Return the (N, d, d) growth of the radii's covariance per second at levels (N, d) of each wheel,
        which are relative to `drift_own_m` and `drift_axle_m`; `drift_common_m` follows the lowest of them
        down to `calm_common` only and never up."""
        level = np.ascontiguousarray(levels.T)
        common = np.minimum(np.maximum(np.minimum.reduce(level), SETTINGS.calm_common), 1.0)
        own = level[:, None] * level * self._drift_own[:, :, None]
        own += np.square(common) * SETTINGS.drift_common_m**2
        return own.transpose(2, 0, 1)

    def travel_and_turn(self, mean: FloatArray, motion: TickMotion) -> tuple[FloatArray, FloatArray]:
        """Return the (N,) distance (m) of the rear axle's middle and turn (rad) by each hypothesis, eqs (6a),
        (6b)."""
        state = mean.T
        left, right = (state[MU : MU + 2] + self._rear_m) * motion.rear_rad[:, None]
        travel = (left + right) * (0.5 * motion.horizontal)
        if self._driven_rear:
            travel *= 1.0 - state[SLIP] * motion.accel_long_mps2
        if motion.steered_curvature is not None:
            return travel, travel * motion.steered_curvature
        turn = (right - left) * (1.0 + state[TRK])
        turn /= self._track
        if motion.lateral_known:
            turn += state[LOAD] * self.load_turn(motion)
        else:
            turn *= self._turn_fraction(state, motion)
        return travel, turn

    def _turn_fraction(self, state: FloatArray, motion: TickMotion) -> FloatArray:
        """Return the (N,) car's turn over the wheels' turn, where no other signal tells the car's: by a_y = v
        * turn / dt `load_turn` is proportional to the turn itself."""
        factor: FloatArray = 1.0 + state[LOAD] * self.load_gain(motion)
        return np.reciprocal(np.maximum(factor, SETTINGS.min_load_factor))

    def load_gain(self, motion: TickMotion) -> float:
        """Return the excess of the wheels' turn over the car's, as a fraction of the car's turn, per unit of
        LOAD."""
        # Plain numbers: for two of them numpy takes ten times as long, and this is asked every tick.
        (left_rad, right_rad), (left_m, right_m) = motion.rear_rad.tolist(), self._rear
        distance_m = (left_rad * left_m + right_rad * right_m) / 2.0
        return float(distance_m * (left_rad + right_rad) / (self._track * motion.dt_s**2))

    def load_turn(self, motion: TickMotion) -> float:
        """Return the excess of the wheels' turn over the car's, rad per unit of LOAD: in a left turn the
        right radius shrinks and the left one grows."""
        return -motion.accel_lat_mps2 * float(motion.rear_rad[0] + motion.rear_rad[1]) / self._track

    def propagate(
        self,
        mean: FloatArray,
        covariance: FloatArray,
        motion: TickMotion,
        position_std_m: float,
        drift: FloatArray | None = None,
        noise_factor: FloatArray | float = 1.0,
    ) -> tuple[float, float]:
        """Move mean (N, n) and covariance (N, n, n) through a tick by eq. (7), heading at mid-step, in place;
        return the mean distance (m) and turn (rad) of the tick.

        `drift` (N, d, d): growth of the radii's covariance per second of each hypothesis (`drift_at`); None:
        that at level 1. `noise_factor` (N,): on the variances of way and heading that grow with the way.
        """
        count = mean.shape[0]
        state, spread = mean.T, covariance.transpose(1, 2, 0)
        share = 1.0 if motion.lateral_known else self._turn_fraction(state, motion)
        travel, turn = self.travel_and_turn(mean, motion)
        middle = turn * 0.5
        middle += state[PSI]
        along = np.empty((2, count))
        np.cos(middle, out=along[0])
        np.sin(middle, out=along[1])
        step = along * travel
        # F P F' with F = I + B, of which only the pose's rows hold anything: P + B P in those rows, then
        # (P + B P) B' in their first columns; the other rows of the first columns are these, mirrored, and so
        # is the pose's own half, in which both orders of the sums are rounded differently.
        bend = self._pose_derivative(along, step, travel, turn, motion, share)
        pose = spread[: PSI + 1]
        bend.add_to(spread)
        bend.add_to(pose.swapaxes(0, 1))
        spread[PSI + 1 :, : PSI + 1] = pose[:, PSI + 1 :].swapaxes(0, 1)
        for row in range(PSI):
            spread[row, row + 1 : PSI + 1] = spread[row + 1 : PSI + 1, row]
        state[E : N + 1] += step
        state[PSI] += turn
        # The receiver's slow error fades.
        decay = math.exp(-motion.dt_s / SETTINGS.bias_tau_s)
        state[BE : BN + 1] *= decay
        spread[BE : BN + 1] *= decay
        spread[:, BE : BN + 1] *= decay
        mean_travel, mean_turn = float(np.add.reduce(travel)) / count, float(np.add.reduce(turn)) / count
        noise = np.zeros((GYRO + 1, np.size(noise_factor)))
        self._set_tick_noise(noise, motion, abs(mean_travel), mean_turn, noise_factor)
        noise[BE : BN + 1] = position_std_m**2 * (1.0 - decay**2)
        diagonal = np.einsum("iij->ij", spread)
        diagonal[: GYRO + 1] += noise
        if drift is None:
            drift = self.drift_at(np.ones((count, self._wheels)))
        spread[MU:, MU:] += drift.transpose(1, 2, 0) * motion.dt_s
        return mean_travel, mean_turn

    def kernel_constants(self, motion: TickMotion, position_std_m: float) -> tuple[float, ...]:
        """Return the numbers of a tick that the compiled `propagate` takes, in the order of `struct motion`
        in `_bank.c`; NaN where there is no independent yaw rate or no steering, or where the lateral
        acceleration is known."""
        nan, dt_s, track_m = math.nan, motion.dt_s, self._track
        if self._of_length.dt_s != dt_s:
            self._of_length = _OfLength(dt_s, track_m)
        decay = self._of_length.decay
        left_m, right_m = self._rear
        left_rad, right_rad = motion.rear_rad.tolist()
        return (
            *(left_m, right_m, left_rad, right_rad, 0.5 * motion.horizontal),
            motion.accel_long_mps2 if self._driven_rear else 0.0,
            -motion.accel_lat_mps2 * (left_rad + right_rad) / track_m,
            nan if motion.lateral_known else self.load_gain(motion),
            SETTINGS.min_load_factor,
            track_m,
            nan if motion.independent_heading_change_rad is None else motion.independent_heading_change_rad,
            nan if motion.steered_curvature is None else motion.steered_curvature,
            decay,
            *(self._of_length.gentle if motion.informative else self._of_length.rough),
            position_std_m**2 * (1.0 - decay**2),
            dt_s,
        )

    def _pose_derivative(
        self,
        along: FloatArray,
        step: FloatArray,
        travel: FloatArray,
        turn: FloatArray,
        motion: TickMotion,
        share: FloatArray | float,
    ) -> _PoseDerivative:
        """Return the derivative of a tick's pose change by the state; along (2, N): cosine and sine of the
        heading at mid-step, step (2, N): distance along it, share: of `_PoseDerivative`."""
        by_wheels = motion.steered_curvature is None
        across = np.empty_like(step)
        np.negative(step[1], out=across[0])
        across[1] = step[0]
        left, right = motion.rear_rad.tolist()
        by_travel = motion.rear_rad * (0.5 * motion.horizontal)
        turned = [-left / self._track, right / self._track] if by_wheels else [0.0, 0.0]
        by_radius = by_travel[:, None, None] * along
        if by_wheels:
            by_radius += np.array(turned)[:, None, None] * (0.5 * share * across)
        by_slip = along * (travel * -motion.accel_long_mps2) if self._driven_rear else None
        if not by_wheels:
            return _PoseDerivative(across, by_radius, by_slip)
        # The wheels' own reading error here would be taken for a track (errors in variables).
        by_track = (
            turn if motion.independent_heading_change_rad is None else motion.independent_heading_change_rad
        )
        return _PoseDerivative(
            across, by_radius, by_slip, by_track, np.array([self.load_turn(motion), *turned]), share
        )

    def _set_tick_noise(
        self, out: FloatArray, motion: TickMotion, distance: float, turn: float, factor: FloatArray | float
    ) -> None:
        """Set the variances (GYRO + 1, N or 1) that a tick adds to the hypotheses' states, except those of BE
        and BN."""
        rough = not motion.informative
        along = SETTINGS.path_noise**2 * distance * factor
        out[E : N + 1] = along + (SETTINGS.rough_path * distance) ** 2 * rough
        heading = SETTINGS.turn_noise**2 * distance * factor + (SETTINGS.turn_relative * turn) ** 2
        out[PSI] = heading + (SETTINGS.rough_turn * distance / self._track) ** 2 * rough
        out[LAT] = SETTINGS.latency_drift**2 * motion.dt_s
        out[GYRO] = SETTINGS.gyro_drift**2 * motion.dt_s
