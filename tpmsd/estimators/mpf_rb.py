"""MPF-RB, the daemon's default: a marginalized particle filter that computes what is linear.

In: `Tick`s. Out: `RadiusEstimate`s. Vectorised over particles, seeded.

The model is paper 000's, (5)-(10): rear wheels as inputs, radius errors that bend the trajectory, GNSS fixes.
What differs from `mpf_pn` is what is sampled and what is computed. Given the way and the turns, everything is
so nearly linear that a Kalman filter per particle (state: `error_state`) is exact for practical purposes.
Sampled is only what is not linear: *whether and when a wheel's radius suddenly changed*. A particle is a
history of such changes, its weight the probability of that history: so a puncture is followed within seconds,
and a quiet drive keeps a sharp posterior. The histories are enumerated rather than drawn, and the least
probable dropped (Fearnhead and Clifford 2003, J. R. Statist. Soc. B 65(4), on particle filters with discrete
states).

Quantisation. The reading error of a counter is bounded: it does not add up from tick to tick. So it is part
of the measurements (once per block), not of the process noise as in (9c), where it would be a random walk.

Blocks. About once a second the rotation is held against the receiver (Doppler way), the bus's yaw rate where
it has shown to be one (`gyro_check`), and, front against rear, against the other wheels (`odometry_block`).
The front wheels' paths are those of `mpf_pn`; here they are measurements of all radii jointly, so that
left against right on the front axle steadies the rear one where the receiver is poor.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from tpmsd.bounds import no_wider
from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators import error_state as state
from tpmsd.estimators import measurements
from tpmsd.estimators.base import RadiusEstimate, checked_radii
from tpmsd.estimators.batched_kalman import Weights, scalar_update, square_weights, symmetrise
from tpmsd.estimators.error_state import BE, BN, FWD, GYRO, LAT, MU, PSI, SLIP, E, Motion, N, ProcessModel
from tpmsd.estimators.fix_gate import FIX_WEIGHTS
from tpmsd.estimators.motion_gate import MotionGate
from tpmsd.estimators.odometry_block import Block, BlockBuilder
from tpmsd.estimators.pose_keeper import COAST_LIMIT_S, COAST_YAW_STD, Pose, PoseKeeper
from tpmsd.estimators.pose_start import PoseStart
from tpmsd.estimators.resampling import effective_number
from tpmsd.physics.grade import GradeTracker
from tpmsd.timeline.tick import Fix, Tick
from tpmsd.wheels import FloatArray

DEFAULT_PARTICLES = 40
CHANGE_RATE_PER_S = 1.0 / 3600.0
"""Prior rate of sudden changes of one wheel's radius."""
CHANGE_STD = 0.008
"""Size of a supposed change, relative to the radius."""
CHANGE_HEADING_STD = 0.05
"""Heading error that a change may have caused before it was supposed, rad."""
RESTLESS = ((1.0, 0.1), (0.15, 0.895), (4.0, 0.005))
"""Levels of the wheels' own drift, relative to `error_state`'s, and their prior probabilities. The first is
that of a filter with few particles."""
LEVEL_FLOOR = math.log(0.003)
"""Least weight of each level, relative to the best history."""
SLOW_YAW_TAU_S = 3.0
FIX_INTERVAL_S = 0.45
"""Positions and courses are used at most this often: between, their errors are the same."""
UNUSED = -1e9
"""Log-weight of a particle that holds no history yet."""


class MpfRb(PoseKeeper):
    """The estimator; `step` takes one tick and gives one estimate."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        rng: np.random.Generator,
        front: bool,
        gate: MotionGate | None = None,
    ) -> None:
        """`front`: whether the bus has the front wheels too. `rng` is not drawn from: histories are
        enumerated. `gate` None: the one that `settings` name."""
        super().__init__(vehicle, gnss, settings, front, gate)
        self._driven_rear = vehicle.driven_axle in ("rear", "all")
        self._driven_front = vehicle.driven_axle in ("front", "all")
        self._process = ProcessModel(self._nominal, vehicle.track_rear_m, self._driven_rear)
        self._noise_std = np.sqrt(np.diag(self._process.drift))
        self._fix_weights = FIX_WEIGHTS[settings.fix_weights]
        self._grade = GradeTracker()
        self._blocks = BlockBuilder(self._order, self._nominal, self._geometry)
        count = settings.particles or DEFAULT_PARTICLES
        self._mean, self._cov = state.initial_state(count, self._nominal)
        self._log_weights = np.full(count, UNUSED)
        self._restless = np.ones(count)
        self._begin_histories(range(min(len(RESTLESS), max(count // 8, 1))))
        self._drift = self._process.drift_at(self._restless)
        self._radii = np.zeros(self._wheels)
        """Radius errors at the end of the last tick."""
        self._position_std_m = state.DEFAULT_POSITION_STD_M
        self._teaches = False
        self._last_used_s = -math.inf
        self._next_wheel = 0
        self._slow_yaw_rate = 0.0
        """The wheels' by the present radii, smoothed over `SLOW_YAW_TAU_S`."""
        self._gyro_bias = 0.0

    # -- one tick -------------------------------------------------------------------------------------------

    def step(self, tick: Tick) -> RadiusEstimate:
        """Advance by one tick; never raises on odd input."""
        if tick.gap_s > COAST_LIMIT_S:
            self._lose_pose()
        teaches = self._teaches = self._move(tick)
        for fix in tick.fixes:
            self._take_fix(fix, tick)
        block = self._blocks.add(tick, teaches, self._radii, self._gate.accel_mps2)
        if block is not None:
            if block.teaches:
                self._suppose_drift()
                self._suppose_changes(block)
                self._learn(block)
            self._drift = self._process.drift_at(self._restless)
            symmetrise(self._cov)
            self._log_weights -= self._log_weights.max()
            np.maximum(self._log_weights, UNUSED, out=self._log_weights)
        return self._estimate(tick, teaches)

    def _move(self, tick: Tick) -> bool:
        """Propagate all particles through the tick; whether it may teach the radii."""
        rear = tick.rotation_rad[self._order[:2]]
        if not (math.isfinite(rear[0]) and math.isfinite(rear[1])):
            self._coast(tick.dt_s)
            return False
        self._coasting_s = 0.0
        virtual_way, virtual_turn = self._virtual_motion(rear)
        speed = virtual_way / tick.dt_s
        teaches = self._gate.update(tick, speed, virtual_turn / tick.dt_s)
        if virtual_way == 0.0:
            self._take_stand()
            return False
        gate = self._gate
        curvature = None if teaches else self._steered_curvature(tick)
        yaw_rate = self._witnessed_yaw_rate(tick)
        accel_lat = gate.speed_mps * yaw_rate
        self._grade.move(speed * tick.dt_s)
        horizontal = self._grade.horizontal
        witness = yaw_rate * tick.dt_s
        motion = Motion(tick.dt_s, rear, gate.accel_mps2, accel_lat, teaches, horizontal, witness, curvature)
        std = self._position_std_m
        self._cov, way, turn = self._process.propagate(self._mean, self._cov, motion, std, self._drift)
        self._take_motion(way, turn, tick.dt_s)
        # By the present radii: with nominal ones a bend would be seen wherever left and right differ.
        slow = 1.0 - math.exp(-tick.dt_s / SLOW_YAW_TAU_S)
        self._slow_yaw_rate += slow * (self._rate[1] - self._slow_yaw_rate)
        if teaches:
            self._informative_s += tick.dt_s
        return teaches

    def _witnessed_yaw_rate(self, tick: Tick) -> float:
        """Yaw rate that does not hold this tick's reading error: the gyro's, else the wheels' smoothed."""
        if self._gate.gyro_trusted and math.isfinite(tick.yaw_rate_radps):
            return tick.yaw_rate_radps - self._gyro_bias
        return self._slow_yaw_rate

    def _drift_on(self, dt_s: float) -> None:
        self._blocks.reset()
        speed, yaw_rate = self._rate[0], self._steady_yaw_rate
        mean = self._mean
        mean[:, E] += speed * dt_s * np.cos(mean[:, PSI])
        mean[:, N] += speed * dt_s * np.sin(mean[:, PSI])
        mean[:, PSI] += yaw_rate * dt_s
        self._cov[:, [E, N], [E, N]] += dt_s**2 + (speed * dt_s * 0.1) ** 2
        self._cov[:, PSI, PSI] += COAST_YAW_STD**2 * dt_s

    # -- fixes ----------------------------------------------------------------------------------------------

    def _take_fix(self, fix: Fix, tick: Tick) -> None:
        """Hold the particles against position and course."""
        self._blocks.add_fix(fix, tick)
        self._grade.update(fix.up_m)
        moving = self._rate[0] > 0.5
        if not self._found(fix, tick, moving):
            return
        if not moving or fix.time_s - self._last_used_s < FIX_INTERVAL_S:
            # At a standstill correlated fixes would only sharpen a wrong position.
            if not self._fix_gate.refusing:
                self._last_fix_s = max(self._last_fix_s, fix.time_s)
            return
        interval_s = min(fix.time_s - self._last_used_s, 2.0)
        self._last_used_s = fix.time_s
        self._position_std_m = fix.position_std_m
        now = measurements.Present(*self._rate, *self._antenna)
        east, north, east_row, north_row = measurements.antenna_position(self._mean, fix, tick, now)
        weights = self._weights()
        off = math.hypot(fix.east_m - float(weights @ east), fix.north_m - float(weights @ north))
        own = float(weights @ (self._cov[:, E, E] + self._cov[:, N, N]))
        if self._refused(fix, tick, off, own + fix.position_std_m**2):
            return
        variance = measurements.position_variance(fix, now)
        self._update(measurements.Scalar(fix.east_m - east, east_row, variance), self._fix_weights)
        _, north, _, north_row = measurements.antenna_position(self._mean, fix, tick, now)
        self._update(measurements.Scalar(fix.north_m - north, north_row, variance), self._fix_weights)
        if math.isfinite(fix.heading_rad) and now.speed_mps > self._settings.min_speed_mps / 2:
            reading = self._reading_heading(tick)
            course = measurements.course(self._mean, fix, tick, now, reading, interval_s)
            self._update(course, self._fix_weights)

    def _reading_heading(self, tick: Tick) -> float:
        """The counters' reading error at one instant (half of a tick's variance) as an error of heading,
        rad."""
        rolls = tick.rotation_std_rad[self._order[:2]] * self._nominal[:2]
        return math.hypot(*np.nan_to_num(rolls)) / math.sqrt(2.0) / self._geometry.track_rear_m

    def _pose_lost(self) -> None:
        self._blocks.reset()
        self._grade.reset()

    def _place(self, start: PoseStart, tick: Tick) -> None:
        """Set every particle's pose to what the fixes tell, uncorrelated with the radii."""
        fix = start.fix
        forward, left = self._antenna
        weights = self._weights()
        late_s = (1.0 - fix.fraction) * tick.dt_s + float(weights @ self._mean[:, LAT])
        ahead = late_s * self._rate[0] - forward - float(weights @ self._mean[:, FWD])
        cos, sin = math.cos(start.heading_rad), math.sin(start.heading_rad)
        east, north = fix.east_m + ahead * cos + left * sin, fix.north_m + ahead * sin - left * cos
        anew = [E, N, PSI, BE, BN]
        self._mean[:, anew] = [east, north, start.heading_rad, 0.0, 0.0]
        self._cov[:, anew, :] = 0.0
        self._cov[:, :, anew] = 0.0
        slow = fix.position_std_m**2
        # The slow part of the fix's error is in the bias, so the pose carries it with opposite sign.
        for pose, bias in ((E, BE), (N, BN)):
            self._cov[:, pose, pose] = slow + measurements.WHITE_POSITION_STD_M**2
            self._cov[:, bias, bias] = slow
            self._cov[:, pose, bias] = self._cov[:, bias, pose] = -slow
        self._cov[:, PSI, PSI] = start.heading_std_rad**2
        self._position_std_m = fix.position_std_m
        self._last_used_s = fix.time_s

    # -- radii ----------------------------------------------------------------------------------------------

    def _begin_histories(self, first: Iterable[int]) -> None:
        """Give these particles the levels of drift, by their prior."""
        for particle in first:
            self._restless[particle], chance = RESTLESS[particle]
            self._log_weights[particle] = math.log(chance)

    def _suppose_drift(self) -> None:
        """Keep one history of each level of drift in play, with at least a share of the best one's weight.

        What a level has lost beyond that it has lost with radii of its own; it begins again at the best ones.
        """
        if self._log_weights.size < 8 * len(RESTLESS):
            return
        best = int(np.argmax(self._log_weights))
        least = self._log_weights[best] + LEVEL_FLOOR
        for level, _ in RESTLESS:
            if np.any(self._log_weights[self._restless == level] >= least):
                continue
            child = int(np.argmin(self._log_weights))
            self._mean[child] = self._mean[best]
            self._cov[child] = self._cov[best]
            self._restless[child] = level
            self._log_weights[child] = least

    def _suppose_changes(self, block: Block) -> None:
        """For each wheel, one history branches off the best: this wheel has just changed.

        The branches take the places of the least probable particles, with the prior probability of a change
        in this block as their weight; how much has changed is left to the Kalman filter. A branch allows for
        some heading error too, for a rear wheel that changed has turned the heading before anyone supposed
        it.
        """
        order = np.argsort(self._log_weights)
        best = order[-1]
        chance = math.log(CHANGE_RATE_PER_S * block.duration_s)
        # The wheels take turns when particles are few.
        for child in order[: min(self._wheels, order.size // 4)]:
            wheel = self._next_wheel
            self._next_wheel = (wheel + 1) % self._wheels
            self._mean[child] = self._mean[best]
            self._cov[child] = self._cov[best]
            self._cov[child, MU + wheel, MU + wheel] += (CHANGE_STD * self._nominal[wheel]) ** 2
            self._cov[child, PSI, PSI] += CHANGE_HEADING_STD**2
            self._restless[child] = self._restless[best]
            self._log_weights[child] = self._log_weights[best] + chance

    def _learn(self, block: Block) -> None:
        """Doppler way and yaw rate against the rear wheels, front wheels against rear."""
        if math.isfinite(block.doppler_way_m):
            left = self._antenna[1]
            scalar = measurements.doppler_way(
                self._mean, block, self._nominal, left, self._grade.horizontal, self._driven_rear
            )
            self._update(scalar, self._fix_weights)
        turn = self._slow_yaw_rate * block.duration_s
        if self._gate.gyro_trusted and math.isfinite(block.gyro_turn_rad):
            self._gyro_bias = float(self._weights() @ self._mean[:, GYRO])
            turn = block.gyro_turn_rad - self._gyro_bias * block.duration_s
            self._update(measurements.gyro_turn(self._mean, block, self._geometry.track_rear_m, turn))
        driven = float(self._driven_front) - float(self._driven_rear)
        for place, front in enumerate(block.front, start=2):
            if front is not None:
                self._update(measurements.front_wheel(self._mean, block, front, place, driven, turn))

    # -- particles ------------------------------------------------------------------------------------------

    def _update(self, scalar: measurements.Scalar, weights: Weights = square_weights) -> None:
        """Update all particles; in ticks that may not teach, the radii and what acts on them stay as they
        are."""
        frozen = None if self._teaches else SLIP
        self._log_weights += scalar_update(
            self._mean, self._cov, scalar.innovation, scalar.row, scalar.variance, frozen, weights
        )

    def _weights(self) -> FloatArray:
        weights = np.exp(self._log_weights - self._log_weights.max())
        return np.asarray(weights / weights.sum())

    def _moments(self, places: slice, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and covariance of these places of the state over the mixture."""
        own = self._mean[:, places]
        mean = weights @ own
        centred = own - mean
        within = self._cov[:, places][:, :, places].reshape(weights.size, -1)
        size = mean.size
        return mean, (weights @ within).reshape(size, size) + (centred * weights[:, None]).T @ centred

    def _estimate(self, tick: Tick, teaches: bool) -> RadiusEstimate:
        weights = self._weights()
        self._radii, radii_m2 = self._moments(slice(MU, None), weights)
        own = self._mean[:, : PSI + 1]
        east, north, heading = centre = weights @ own
        within = np.einsum("ijj->ij", self._cov[:, : PSI + 1, : PSI + 1])
        variance = np.maximum(weights @ (within + np.square(own - centre)), 0.0)
        pose = Pose(
            east_m=float(east),
            north_m=float(north),
            heading_rad=math.remainder(float(heading), 2 * math.pi),
            position_std_m=math.sqrt((variance[E] + variance[N]) / 2),
            heading_std_rad=math.sqrt(variance[PSI]),
        )
        effective = effective_number(weights)
        return self._radius_estimate(tick, teaches, (self._radii, radii_m2), self._noise_std, pose, effective)

    # -- what survives a restart ----------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Mean and covariance of everything but the pose, as plain numbers."""
        mean, cov = self._moments(slice(LAT, None), self._weights())
        radii, others = slice(MU - LAT, None), slice(0, MU - LAT)
        return {
            "order": list(self._order),
            "nominal_m": self._nominal.tolist(),
            "mean_m": mean[radii].tolist(),
            "covariance_m2": cov[radii, radii].tolist(),
            "nuisance": mean[others].tolist(),
            "nuisance_covariance": cov[others, others].tolist(),
            "informative_s": self._informative_s,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up a snapshot of the same car; ValueError if it does not fit.

        The radii may have changed while the car stood, and the receiver may be another: the saved covariances
        are widened by what a night can do.
        """
        mean, cov = checked_radii(saved, self._order, self._nominal)
        informative_s = float(saved["informative_s"])
        nuisance = np.asarray(saved["nuisance"], dtype=np.float64)
        nuisance_cov = np.asarray(saved["nuisance_covariance"], dtype=np.float64)
        size = MU - LAT
        if nuisance.shape != (size,) or nuisance_cov.shape != (size, size):
            raise ValueError("the saved nuisance parameters have another shape")
        if not (np.all(np.isfinite(nuisance)) and np.all(np.isfinite(nuisance_cov))):
            raise ValueError("the saved nuisance parameters are not finite")
        self._mean[:, MU:] = self._radii = mean
        most = np.diag(state.initial_state(1, self._nominal)[1][0])
        self._cov[:, MU:, MU:] = no_wider(cov + self._process.drift * 1000.0, most[MU:])
        self._mean[:, LAT:MU] = nuisance
        self._cov[:, LAT:MU, LAT:MU] = no_wider(nuisance_cov * 2.0, most[LAT:MU])
        self._informative_s = informative_s
