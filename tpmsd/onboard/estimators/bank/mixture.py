"""Representation by a Gaussian mixture: the Gaussian-sum filter, the daemon's default.

In: movements and fixes. Out: a `Belief` of all wheels. Nothing is drawn.

The model is that of [Lundquist 2013, eqs 5-10]: rear wheels as inputs, radius errors that bend the
trajectory, GNSS fixes. Given the way and the turns, everything is so nearly linear that a Kalman filter
(state: `error_state`) is exact for practical purposes, so pose and radii are Rao-Blackwellised; only jumps of
the radii are hypotheses (`jump_hypotheses`).

Quantisation. The reading error of a counter is bounded: it does not add up from tick to tick. So it is part
of the measurements (once per block), not of the process noise as in (9c), where it would be a random walk.

Blocks. About once a second the rotation is held against the receiver (Doppler way), the bus's yaw rate where
it has shown to be one (`gyro_check`), and, front against rear, against the other wheels (`odometry_block`).
The front wheels are measurements of all radii jointly, so that left against right on the front axle steadies
the rear one where the receiver is poor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tpmsd.car.physics.grade import GradeTracker
from tpmsd.foundation.bounds import no_wider
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank import measurements
from tpmsd.onboard.estimators.bank.batched_kalman import Weights, square_weights
from tpmsd.onboard.estimators.bank.error_state import (
    BE,
    BN,
    FWD,
    GYRO,
    LAT,
    MU,
    PSI,
    SLIP,
    E,
    N,
    ProcessModel,
    TickMotion,
    initial_state,
)
from tpmsd.onboard.estimators.bank.jump_hypotheses import JUMPS, Bank, JumpHypotheses, radius_statement
from tpmsd.onboard.estimators.bank.kernel import KERNEL, BankKernel
from tpmsd.onboard.estimators.base import NIGHT_S, RadiusStatement
from tpmsd.onboard.estimators.belief import (
    Extrapolation,
    FilterCar,
    FixMeasurement,
    GatedTick,
    Moments,
    Movement,
    Pose,
    RolledTick,
    Saved,
    saved_covariance,
    saved_numbers,
    saved_radii,
    wrapped,
)
from tpmsd.onboard.estimators.odometry_block import Block, BlockBuilder
from tpmsd.onboard.estimators.pose_start import PoseStart
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix, Tick

NUISANCE_LIMIT = 10.0
"""No saved nuisance parameter is larger, in any of their units."""


@dataclass(frozen=True, slots=True)
class MixturePieces:
    """Pieces of a mixture belief."""

    changes: JumpHypotheses = JUMPS
    fix_weights: Weights = square_weights
    """Weights of positions, courses and Doppler speeds, by how they fit."""
    kernel: BankKernel = KERNEL
    """Kernel of the bank's arithmetic."""


class MixtureBelief:
    """A `Belief`."""

    takes_blocks = False

    def __init__(self, car: FilterCar, pieces: MixturePieces, count: int, bank: Bank | None = None) -> None:
        """`bank` None: that of the pieces' jump hypotheses."""
        self._car, self._pieces, self._kernel = car, pieces, pieces.kernel
        self._process = ProcessModel(car.nominal_m, car.geometry.track_rear_m, car.driven_rear)
        self._noise_std = np.sqrt(np.diag(self._process.drift))
        self._grade = GradeTracker()
        self._blocks = BlockBuilder(list(car.order), car.nominal_m, car.geometry)
        self.bank = pieces.changes.begin(count, car.nominal_m) if bank is None else bank
        self._drift = self._process.drift_at(self.bank.level)
        self._radii = np.zeros(car.nominal_m.size)
        """Radius errors at the end of the last tick."""
        self._position_std_m = SETTINGS.position_std_m
        self._informative = False
        self._next_wheel = 0
        self._slow_yaw_rate = 0.0
        """The wheels' by the present radii, smoothed over `SETTINGS.slow_yaw_s`."""
        self._gyro_bias = 0.0
        self._stated: RadiusStatement | None = None
        self._expected: tuple[Fix, FloatArray, FloatArray, FloatArray, FloatArray] | None = None
        """A fix with the antenna's position and its rows, between its judgement and its use."""

    # -- motion ---------------------------------------------------------------------------------------------

    def predict(self, movement: Movement) -> tuple[float, float]:
        """Propagate all hypotheses through a tick; return its distance (m) and turn (rad)."""
        if isinstance(movement, RolledTick):
            self._informative = movement.gated.informative
            return self._predict_rolling(movement)
        self._informative = False
        if isinstance(movement, Extrapolation):
            return self._predict_extrapolation(movement)
        return 0.0, 0.0

    def _predict_rolling(self, rolling: RolledTick) -> tuple[float, float]:
        """Propagate by the wheels' rotation; return the mean distance (m) and turn (rad)."""
        gated, tick = rolling.gated, rolling.gated.tick
        rear = rolling.angle_rad[:2]
        by_gyro = gated.gyro_trusted and math.isfinite(tick.yaw_rate_radps)
        # The wheels' is smoothed: one that does not hold this tick's reading error.
        yaw_rate = tick.yaw_rate_radps - self._gyro_bias if by_gyro else self._slow_yaw_rate
        self._grade.move(rolling.distance_m)
        motion = TickMotion(
            dt_s=tick.dt_s,
            rear_rad=rear,
            accel_long_mps2=gated.accel_mps2,
            accel_lat_mps2=gated.speed_mps * yaw_rate,
            informative=gated.informative,
            horizontal=self._grade.horizontal,
            independent_heading_change_rad=yaw_rate * tick.dt_s,
            lateral_known=by_gyro,
            steered_curvature=rolling.curvature,
        )
        travel, turn = self._kernel.propagate(
            self._process, self.bank, motion, self._position_std_m, self._drift
        )
        # By the present radii: with nominal ones a bend would be seen wherever left and right differ.
        slow = 1.0 - math.exp(-tick.dt_s / SETTINGS.slow_yaw_s)
        self._slow_yaw_rate += slow * (turn / tick.dt_s - self._slow_yaw_rate)
        return travel, turn

    def _predict_extrapolation(self, last: Extrapolation) -> tuple[float, float]:
        """Propagate by the last speed and yaw rate; return the distance (m) and turn (rad)."""
        self._blocks.reset()
        dt_s, mean, covariance = last.dt_s, self.bank.mean, self.bank.covariance
        travel, turn = last.speed_mps * dt_s, last.yaw_rate_radps * dt_s
        mean[:, E] += travel * np.cos(mean[:, PSI])
        mean[:, N] += travel * np.sin(mean[:, PSI])
        mean[:, PSI] += turn
        own = (SETTINGS.extrapolation_speed_std_mps * dt_s) ** 2 + (
            travel * SETTINGS.extrapolation_speed_share
        ) ** 2
        covariance[:, E, E] += own
        covariance[:, N, N] += own
        covariance[:, PSI, PSI] += SETTINGS.extrapolation_yaw_std**2 * dt_s
        return travel, turn

    # -- fixes ----------------------------------------------------------------------------------------------

    def _present_motion(self, measurement: FixMeasurement) -> measurements.Present:
        """Return the motion at a fix, as the measurement models take it."""
        return measurements.Present(measurement.speed_mps, measurement.yaw_rate_radps, *self._car.antenna_m)

    def distance(self, measurement: FixMeasurement) -> tuple[float, float]:
        """Return the distance from the mixture's mean; the variance is the position's within the hypotheses
        and the fix's.
        """
        fix, bank = measurement.fix, self.bank
        self._expected = (
            fix,
            *self._kernel.antenna_position(bank, fix, measurement.tick, self._present_motion(measurement)),
        )
        _, east, north, _, _ = self._expected
        weights = bank.weights()
        off = math.hypot(fix.east_m - float(weights @ east), fix.north_m - float(weights @ north))
        own = float(weights @ (bank.covariance[:, E, E] + bank.covariance[:, N, N]))
        return off, own + fix.position_std_m**2

    def update(self, measurement: FixMeasurement) -> None:
        """Correct the hypotheses by position and course of a fix."""
        fix, tick, now, bank = measurement.fix, measurement.tick, self._present_motion(measurement), self.bank
        weights = self._pieces.fix_weights
        self._position_std_m = fix.position_std_m
        if measurement.by_position:
            self._correct_position(measurement, now, weights)
        if math.isfinite(fix.heading_rad) and now.speed_mps > SETTINGS.course_speed_mps:
            reading, interval_s = self._reading_heading(tick), min(measurement.interval_s, 2.0)
            self._correct(measurements.course(bank.mean, fix, tick, now, reading, interval_s), weights)

    def _correct_position(
        self, measurement: FixMeasurement, now: measurements.Present, weights: Weights
    ) -> None:
        """Correct the hypotheses by a fix's east, then by its north."""
        fix, tick, bank = measurement.fix, measurement.tick, self.bank
        variance = measurements.position_variance(fix, now)
        expected, self._expected = self._expected, None
        if expected is None or expected[0] is not fix:
            expected = fix, *self._kernel.antenna_position(bank, fix, tick, now)
        _, east, _, row, _ = expected
        self._correct(measurements.Scalar(fix.east_m - east, row, variance), weights)
        _, north, _, row = self._kernel.antenna_position(bank, fix, tick, now)
        self._correct(measurements.Scalar(fix.north_m - north, row, variance), weights)

    def _reading_heading(self, tick: Tick) -> float:
        """Return the counters' reading error at one instant as an error of heading, rad.

        Half of a tick's variance.
        """
        std_rad, radius_m = tick.rotation_std_rad.tolist(), self._car.nominal_m.tolist()
        rolls = [std_rad[wheel] * radius_m[index] for index, wheel in enumerate(self._car.order[:2])]
        known = [roll for roll in rolls if roll == roll]
        return math.hypot(*known) / math.sqrt(2.0) / self._car.geometry.track_rear_m

    def _correct(self, scalar: measurements.Scalar, weights: Weights = square_weights) -> None:
        """Correct all hypotheses by a measurement; in ticks that are not informative, the radii and the
        states that act on them stay as they are."""
        frozen = None if self._informative else SLIP
        self._kernel.update(self.bank, scalar, frozen, weights)

    def correct_by_block(self, block: Block, bias_rad2: float) -> None:
        """Do nothing: `finish_tick` makes blocks of all wheels, by the present radii."""

    # -- blocks of odometry ---------------------------------------------------------------------------------

    def finish_tick(self, gated: GatedTick) -> None:
        """Add the tick to the block of odometry; correct by the block that it completes."""
        tick = gated.tick
        for fix in tick.fixes:
            self._blocks.add_fix(fix, tick)
            self._grade.update(fix.up_m)
        block = self._blocks.add(tick, gated.informative, self._radii, gated.accel_mps2)
        if block is None:
            return
        if block.informative:
            self.bank.since_s += block.duration_s
            self._propose_changes(block, gated.gyro_trusted)
            self._correct_by_own_block(block, gated.gyro_trusted)
        self._kernel.symmetrise(self.bank)
        self.bank.rescale()
        self._stated = radius_statement(self.bank, self._kernel)

    def _propose_changes(self, block: Block, gyro_trusted: bool) -> None:
        """Branch off hypotheses of a change within the block."""
        changes = self._pieces.changes
        changes.keep_levels(self.bank, block.duration_s)
        nominal = self._car.nominal_m
        self._next_wheel = changes.branch(self.bank, block.duration_s, nominal, self._next_wheel)
        self._drift = self._process.drift_at(self.bank.level)

    def _correct_by_own_block(self, block: Block, gyro_trusted: bool) -> None:
        """Correct by a block: Doppler distance and yaw rate against the rear wheels, front wheels against
        rear."""
        car, mean = self._car, self.bank.mean
        if math.isfinite(block.doppler_distance_m):
            scalar = measurements.doppler_distance(
                mean, block, car.nominal_m, car.antenna_m[1], self._grade.horizontal, car.driven_rear
            )
            self._correct(scalar, self._pieces.fix_weights)
        turn = self._slow_yaw_rate * block.duration_s
        if gyro_trusted and math.isfinite(block.gyro_heading_change_rad):
            self._gyro_bias = float(self.bank.weights() @ mean[:, GYRO])
            turn = block.gyro_heading_change_rad - self._gyro_bias * block.duration_s
            self._correct(measurements.gyro_turn(mean, block, car.geometry.track_rear_m, turn))
        driven = float(car.driven_front) - float(car.driven_rear)
        for index, front in enumerate(block.front, start=2):
            if front is not None:
                self._correct(measurements.front_wheel(mean, block, front, index, driven, turn))

    # -- the pose found and lost ----------------------------------------------------------------------------

    def forget_pose(self) -> None:
        """Drop blocks and grade, which cannot be continued over a gap."""
        self._blocks.reset()
        self._grade.reset()

    def set_pose(self, start: PoseStart, measurement: FixMeasurement) -> None:
        """Set every hypothesis' pose to that of the fixes, uncorrelated with the radii."""
        fix, mean, covariance = start.fix, self.bank.mean, self.bank.covariance
        forward, left = self._car.antenna_m
        weights = self.bank.weights()
        late_s = (1.0 - fix.fraction) * measurement.tick.dt_s + float(weights @ mean[:, LAT])
        ahead = late_s * measurement.speed_mps - forward - float(weights @ mean[:, FWD])
        cos, sin = math.cos(start.heading_rad), math.sin(start.heading_rad)
        east, north = fix.east_m + ahead * cos + left * sin, fix.north_m + ahead * sin - left * cos
        reset = [E, N, PSI, BE, BN]
        mean[:, reset] = [east, north, start.heading_rad, 0.0, 0.0]
        covariance[:, reset, :] = 0.0
        covariance[:, :, reset] = 0.0
        slow = fix.position_std_m**2
        # The slow part of the fix's error is in the bias, so the pose carries it with opposite sign.
        for pose, bias in ((E, BE), (N, BN)):
            covariance[:, pose, pose] = slow + SETTINGS.white_position_m**2
            covariance[:, bias, bias] = slow
            covariance[:, pose, bias] = covariance[:, bias, pose] = -slow
        covariance[:, PSI, PSI] = start.heading_std_rad**2
        self._position_std_m = fix.position_std_m

    # -- out ------------------------------------------------------------------------------------------------

    def _mixture_moments(self, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return mean (n,) and covariance (n, n) of the state over the mixture."""
        state, spread = self.bank.mean.T, self.bank.covariance.transpose(1, 2, 0)
        size = len(state)
        mean = state @ weights
        off = state - mean[:, None]
        within = (spread.reshape(size * size, -1) @ weights).reshape(size, size)
        return mean, within + (off * weights) @ off.T

    def moments(self) -> Moments:
        """Return the moments of all hypotheses together."""
        said = self._kernel.summary(self.bank)
        self._radii = said.mean[MU:]
        east, north, heading = said.mean[: PSI + 1].tolist()
        pose = Pose(
            east_m=east,
            north_m=north,
            heading_rad=wrapped(heading),
            position_std_m=math.sqrt(max((said.east_m2 + said.north_m2) / 2, 0.0)),
            heading_std_rad=math.sqrt(max(said.heading_rad2, 0.0)),
        )
        return Moments(self._radii, said.radii_m2, self._noise_std, pose, said.effective, stated=self._stated)

    def snapshot(self) -> dict[str, Any]:
        """Return mean and covariance of all states but the pose, as plain numbers."""
        mean, cov = self._mixture_moments(self.bank.weights())
        radii, others = slice(MU, None), slice(LAT, MU)
        return {
            "mean_m": mean[radii].tolist(),
            "covariance_m2": cov[radii, radii].tolist(),
            "nuisance": mean[others].tolist(),
            "nuisance_covariance": cov[others, others].tolist(),
        }

    def restore(self, saved: Saved, since_s: float = NIGHT_S) -> None:
        """Restore a saved belief. Covariances are widened by the drift of `since_s` seconds, to those of the
        prior at most: radii may have changed meanwhile, and the receiver may be another one.
        """
        mean, covariance = saved_radii(saved, self._car.nominal_m)
        size = MU - LAT
        nuisance = saved_numbers(saved, "nuisance", (size,), NUISANCE_LIMIT)
        nuisance_m2 = saved_covariance(saved, "nuisance_covariance", size, NUISANCE_LIMIT**2)
        bank = self.bank
        most = np.diag(initial_state(1, self._car.nominal_m)[1][0])
        bank.mean[:, MU:] = self._radii = mean
        bank.covariance[:, MU:, MU:] = no_wider(covariance + self._process.drift * since_s, most[MU:])
        bank.mean[:, LAT:MU] = nuisance
        bank.covariance[:, LAT:MU, LAT:MU] = no_wider(nuisance_m2 * (1.0 + since_s / NIGHT_S), most[LAT:MU])
