"""The frame of every estimator: gates, the search for the pose, extrapolation without wheels, and what
survives a restart.

In: `Tick`s. Out: `RadiusEstimate`s. What rotations and fixes say of the radii is the `Belief`'s, which is
made of pieces (`table`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tpmsd.car.config.model import FilterConfig, VehicleConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.base import NIGHT_S, RadiusEstimate, RadiusStatement
from tpmsd.onboard.estimators.belief import (
    Belief,
    Extrapolation,
    FilterCar,
    FixMeasurement,
    GatedTick,
    Moments,
    RolledTick,
    Standstill,
    saved_numbers,
)
from tpmsd.onboard.estimators.frame_measurements import FrameBlocks, NamedMeasurements
from tpmsd.onboard.estimators.gates.fix_gate import FixGate
from tpmsd.onboard.estimators.gates.motion_gate import MotionGate
from tpmsd.onboard.estimators.gates.position_accuracy import PositionAccuracy
from tpmsd.onboard.estimators.gates.reversing import ReverseWatch
from tpmsd.onboard.estimators.pose_start import PoseFinder
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix, Tick

LONGEST_S = 1e9
"""No car has driven for longer: thirty years."""


@dataclass(frozen=True, slots=True)
class Gates:
    """Gates of a filter: what it leaves out."""

    ticks: bool = True
    """True if only gentle driving above the speed limit is informative; else every tick is."""
    fixes: bool = True
    """True if fixes far off or at a standstill are left out; else every fix is used."""
    fix_interval_s: float = 0.0
    """Least time between two fixes that are used."""
    printed_steering: bool = False
    """True where (38c) is taken as printed: below the speed limit by the tick's own speed the steering
    determines the turn, in every tick and by delta_F in place of its tangent."""


GATED = Gates()


class RadiusFilter:
    """An `Estimator` of any belief."""

    def __init__(
        self,
        car: FilterCar,
        vehicle: VehicleConfig,
        settings: FilterConfig,
        gate: MotionGate,
        gates: Gates,
        belief: Belief,
    ) -> None:
        """`belief` as it is before the first tick."""
        self._car = car
        self._grid = np.ix_(car.order, car.order)
        self._order = list(car.order)
        self._back = np.argsort(self._order) if len(car.order) == 4 else None
        """Index of each of the four wheels is in the filter's order; None if not all are."""
        if self._back is not None:
            self._flat = (4 * self._back[:, None] + self._back).ravel()
        self._unknown_m, self._unknown_m2 = np.full(4, np.nan), np.full((4, 4), np.nan)
        self._noise: tuple[FloatArray, FloatArray] | None = None
        """Noise of the belief, which as a rule is always the same array, and that of four wheels."""
        self._steering_ratio = vehicle.steering_ratio
        self._settings = settings
        self._gate = gate
        self._gates = gates
        self.belief = belief
        self._fix_gate = FixGate()
        self._accuracy = PositionAccuracy()
        self._finder = PoseFinder()
        self._received = NamedMeasurements(settings.measurements)
        self._blocks = FrameBlocks(car) if belief.takes_blocks else None
        self._reverse = ReverseWatch()
        self._located = False
        self._informative_s = 0.0
        self._last_fix_s = self._last_used_s = -math.inf
        self._extrapolated_s = 0.0
        self._speed, self._yaw_rate = 0.0, 0.0
        self._steady_yaw_rate = 0.0
        """Yaw rate by the present radii, smoothed."""
        self._stated: tuple[RadiusStatement | None, RadiusStatement | None] = (None, None)
        """Last statement of the belief, and that of four wheels."""
        self.counts: dict[str, int] = {"fixes": 0, "rejected_fixes": 0, "lost_pose": 0}

    def step(self, tick: Tick) -> RadiusEstimate:
        """Advance by one tick; never raises on odd input."""
        tick = self._received.select(tick)
        if tick.gap_s > SETTINGS.extrapolation_limit_s:
            self._lose_pose()
        gated = self._take_rotation(tick)
        for fix in tick.fixes:
            self._take_fix(self._accuracy.with_judged_std(fix), tick)
        if self._blocks is not None:
            held = self._blocks.update(gated)
            if held is not None and self._located:
                self.belief.correct_by_block(*held)
        self.belief.finish_tick(gated)
        return self._estimate(gated, self.belief.moments())

    # -- motion ---------------------------------------------------------------------------------------------

    def _take_rotation(self, tick: Tick) -> GatedTick:
        """Predict by the wheels' rotation, or by extrapolation without it; return the tick with the gates'
        decisions."""
        angle = tick.rotation_rad[self._order]
        left, right = angle[:2].tolist()
        if not (math.isfinite(left) and math.isfinite(right)):
            self._extrapolate(tick.dt_s)
            return self._make_gated_tick(tick, False)
        self._extrapolated_s = 0.0
        travel, turn = self._car.virtual_motion(left, right)
        self._reverse.update_speed(travel / tick.dt_s, tick.dt_s)
        if self._reverse.backward:
            angle, travel, turn = -angle, -travel, -turn
        gentle = self._gate.update(tick, travel / tick.dt_s, turn / tick.dt_s)
        gated = self._make_gated_tick(tick, gentle or not self._gates.ticks)
        if travel == 0.0 and self._gates.ticks:
            self._set_standstill()
            self.belief.predict(Standstill())
            return self._make_gated_tick(tick, False)
        judged = self._located and tick.time_s - self._last_fix_s < SETTINGS.changes_judged_s
        curvature = self._steered_curvature(tick, travel, gated.informative)
        travel, turn = self.belief.predict(RolledTick(gated, angle, travel, turn, curvature, judged))
        self._speed, self._yaw_rate = travel / tick.dt_s, turn / tick.dt_s
        share = 1.0 - math.exp(-tick.dt_s / SETTINGS.steady_s)
        self._steady_yaw_rate += share * (self._yaw_rate - self._steady_yaw_rate)
        self._gate.check_gyro(tick, self._steady_yaw_rate)
        if gated.informative:
            self._informative_s += tick.dt_s
        return gated

    def _make_gated_tick(self, tick: Tick, informative: bool) -> GatedTick:
        """Return the tick with the gate's present motion."""
        gate = self._gate
        return GatedTick(tick, informative, gate.speed_mps, gate.accel_mps2, gate.gyro_trusted)

    def _steered_curvature(self, tick: Tick, distance_m: float, informative: bool) -> float | None:
        """Return the curvature by the steering at low speed, 1/m [Lundquist 2013, eq. 38c]; None where the
        turn is taken from the wheels."""
        steering, printed = tick.steering_wheel_angle_rad, self._gates.printed_steering
        if self._steering_ratio is None or not math.isfinite(steering) or (informative and not printed):
            return None
        speed_mps = distance_m / tick.dt_s if printed else self._gate.speed_mps
        if not speed_mps < self._settings.min_speed_mps:
            return None
        front_rad = steering / self._steering_ratio
        bend = front_rad if printed else math.tan(front_rad)
        return bend / self._car.geometry.wheelbase_m

    def _set_standstill(self) -> None:
        """Set the last speed and yaw rates to 0."""
        self._speed = self._yaw_rate = self._steady_yaw_rate = 0.0

    def _extrapolate(self, dt_s: float) -> None:
        """Predict by the last speed and yaw rate, for rear rotation is missing; give the pose up after a
        while."""
        self._extrapolated_s += dt_s
        if self._extrapolated_s <= SETTINGS.extrapolation_limit_s:
            self.belief.predict(Extrapolation(dt_s, self._speed, self._steady_yaw_rate))
            return
        if self._located:
            self._lose_pose()
        self._set_standstill()  # no longer known

    # -- fixes, the pose found and lost ---------------------------------------------------------------------

    def _take_fix(self, fix: Fix, tick: Tick) -> None:
        """Find the pose by a fix, or correct the belief by it."""
        moving = self._speed > SETTINGS.moving_mps
        interval_s = fix.time_s - self._last_used_s
        by_position = self._received.position
        measurement = FixMeasurement(fix, tick, self._speed, self._yaw_rate, interval_s, by_position)
        if not self._located:
            if self._extrapolated_s == 0.0:  # else a pose is of no use before the wheels turn again
                self._try_to_start_pose(measurement, self._speed > SETTINGS.start_speed_mps)
            return
        if self._reverse.undecided:
            self._reverse.compare_course(fix, self.belief.moments().pose.heading_rad)
        if self._gates.fixes:
            if not moving or interval_s < self._gates.fix_interval_s:
                if not self._fix_gate.rejecting:
                    self._last_fix_s = max(self._last_fix_s, fix.time_s)
                return
            self._last_used_s = fix.time_s
            verdict = "use"
            if by_position:
                verdict = self._fix_gate.judge(*self.belief.distance(measurement), fix.time_s)
            if verdict != "use":
                self.counts["rejected_fixes"] += 1
                if verdict == "lost":
                    self._lose_pose()
                    self._try_to_start_pose(measurement, True)
                return
        self.counts["fixes"] += 1
        self._last_fix_s = self._last_used_s = fix.time_s
        self.belief.update(measurement)

    def _try_to_start_pose(self, measurement: FixMeasurement, moving: bool) -> None:
        """Set the pose if this fix completes one."""
        start = self._finder.update(measurement.fix, moving)
        if start is None:
            return
        self.belief.set_pose(start, measurement)
        self._located = True
        self._last_fix_s = self._last_used_s = measurement.fix.time_s

    def _lose_pose(self) -> None:
        """Drop the pose and keep what was learned of the radii."""
        self._located = False
        self._finder.reset()
        self._gate.reset()
        self._fix_gate.reset()
        if self._blocks is not None:
            self._blocks.reset()
        self.belief.forget_pose()
        self.counts["lost_pose"] += 1

    # -- out, and what survives a restart -------------------------------------------------------------------

    def _estimate(self, gated: GatedTick, said: Moments) -> RadiusEstimate:
        """Return the estimate at the end of a tick from the belief's moments."""
        if self._noise is None or self._noise[0] is not said.noise_std_m:
            self._noise = said.noise_std_m, self._expand_vector(said.noise_std_m)
        found, pose, time_s = self._located, said.pose, gated.tick.time_s
        return RadiusEstimate(
            time_s=time_s,
            deviation_m=self._expand_vector(said.mean_m),
            covariance_m2=self._expand_matrix(said.covariance_m2),
            noise_std_m=self._noise[1],
            informative=gated.informative,
            informative_s=self._informative_s,
            speed_mps=self._speed,
            yaw_rate_radps=self._yaw_rate,
            east_m=pose.east_m if found else math.nan,
            north_m=pose.north_m if found else math.nan,
            heading_rad=pose.heading_rad if found else math.nan,
            position_std_m=pose.position_std_m if found else math.inf,
            heading_std_rad=pose.heading_std_rad if found else math.inf,
            gnss_age_s=time_s - self._last_fix_s,
            effective_particles=said.effective,
            ancestors=said.ancestors,
            between_std_m=said.between_std_m,
            stated=self._in_wheel_order(said.stated),
        )

    def _in_wheel_order(self, stated: RadiusStatement | None) -> RadiusStatement | None:
        """Return the statement with arrays (4,), (4, 4) in the order of all wheels, cached; None for None."""
        if stated is not self._stated[0]:
            assert stated is not None
            mean_m, covariance_m2 = (
                self._expand_vector(stated.mean_m),
                self._expand_matrix(stated.covariance_m2),
            )
            self._stated = stated, RadiusStatement(mean_m, covariance_m2, stated.change_probability)
        return self._stated[1]

    def _expand_vector(self, values: FloatArray) -> FloatArray:
        """Return values (d,) of the filter's wheels as (4,); NaN for a wheel that is not estimated."""
        if self._back is not None:
            return values.take(self._back)
        out = self._unknown_m.copy()
        out[self._order] = values
        return out

    def _expand_matrix(self, matrix: FloatArray) -> FloatArray:
        """Return a matrix (d, d) of the filter's wheels as (4, 4); NaN for wheels that are not estimated."""
        if self._back is not None:
            return matrix.take(self._flat).reshape(4, 4)
        out = self._unknown_m2.copy()
        out[self._grid] = matrix
        return out

    def snapshot(self) -> dict[str, Any]:
        """Return what was learned, as plain numbers."""
        return {
            "order": list(self._car.order),
            "nominal_m": self._car.nominal_m.tolist(),
            **self.belief.snapshot(),
            "informative_s": self._informative_s,
        }

    def restore(self, saved: dict[str, Any], since_s: float = NIGHT_S) -> None:
        """Restore a snapshot of the same car of `since_s` seconds of driving ago; ValueError, and nothing
        changed, if it is another's."""
        nominal = self._car.nominal_m
        if saved.get("order") != list(self._car.order) or not np.allclose(
            saved_numbers(saved, "nominal_m", nominal.shape, 10.0), nominal
        ):
            raise ValueError("the saved radii belong to another set of wheels or nominal radii")
        informative_s = float(saved_numbers(saved, "informative_s", (), LONGEST_S))
        self.belief.restore(saved, since_s)
        self._informative_s = informative_s
