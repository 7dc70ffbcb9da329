"""What every estimator does alike about the pose: find it by fixes, coast without wheels, lose it.

In: ticks and fixes. Out: a base class that keeps wheels, geometry and gates, and the frame of one tick. How
particles or sigma points move and what they learn is the subclass's.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators.base import RadiusEstimate
from tpmsd.estimators.fix_gate import FixGate
from tpmsd.estimators.motion_gate import MotionGate
from tpmsd.estimators.pose_start import PoseFinder, PoseStart
from tpmsd.estimators.slip_gate import make_gate
from tpmsd.physics.kinematics import Geometry
from tpmsd.timeline.tick import Fix, Tick
from tpmsd.wheels import FL, FR, RL, RR, FloatArray

COAST_LIMIT_S = 3.0
"""Without rear rotation the pose is carried on for this long."""
STEADY_S = 0.5
"""Smoothing of the yaw rate that the pose is carried on with. At 10 Hz one count of 48 is 0.3 rad/s, so that
of a single tick, held for half a second, turns the car by 0.15 rad that it never turned."""
COAST_YAW_STD = 0.1
"""What the heading may do meanwhile, rad per sqrt(s): a bend that begins or ends, what smoothing leaves."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Where the middle of the rear axle is believed to be, and how surely."""

    east_m: float
    north_m: float
    heading_rad: float
    position_std_m: float
    heading_std_rad: float


class PoseKeeper(ABC):
    """Base of the estimators: the car, the gates, and whether the pose is known."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        front: bool,
        gate: MotionGate | None = None,
    ) -> None:
        """`front`: whether the bus has the front wheels. `gate` None: the one that `settings` name."""
        self._order = [RL, RR, FL, FR] if front else [RL, RR]
        self._wheels = len(self._order)
        self._grid = np.ix_(self._order, self._order)
        self._nominal = np.array([vehicle.wheel_radius_m[i] for i in self._order])
        self._geometry = Geometry(vehicle.track_front_m, vehicle.track_rear_m, vehicle.wheelbase_m)
        self._steering_ratio = vehicle.steering_ratio
        self._antenna = (gnss.antenna_forward_m, gnss.antenna_left_m)
        self._settings = settings
        self._gate = gate or make_gate(settings, vehicle)
        self._fix_gate = FixGate()
        self._finder = PoseFinder()
        self._located = False
        self._informative_s = 0.0
        self._last_fix_s = -math.inf
        self._coasting_s = 0.0
        self._rate = (0.0, 0.0)
        self._steady_yaw_rate = 0.0
        """By the present radii, smoothed over `STEADY_S`."""
        self.counts: dict[str, int] = {"fixes": 0, "refused_fixes": 0, "lost_pose": 0}

    @abstractmethod
    def _place(self, start: PoseStart, tick: Tick) -> None:
        """Set the pose to what the fixes tell; the radii stay."""

    @abstractmethod
    def _drift_on(self, dt_s: float) -> None:
        """Carry the pose through a tick without rear rotation, less sure after it."""

    def _pose_lost(self) -> None:  # noqa: B027  (most have nothing to drop)
        """What a subclass drops when the pose is given up."""

    # -- motion ---------------------------------------------------------------------------------------------

    def _virtual_motion(self, rear_rad: FloatArray) -> tuple[float, float]:
        """Way and turn of a tick by nominal radii, eq. (4) times T."""
        roll = rear_rad * self._nominal[:2]
        return float(roll[0] + roll[1]) / 2, float(roll[1] - roll[0]) / self._geometry.track_rear_m

    def _steered_curvature(self, tick: Tick) -> float | None:
        """Curvature by the steering at low speed, eq. (38c); None where the wheels tell the turn."""
        steering = tick.steering_wheel_angle_rad
        slow = self._gate.speed_mps < self._settings.min_speed_mps
        if not slow or self._steering_ratio is None or not math.isfinite(steering):
            return None
        return math.tan(steering / self._steering_ratio) / self._geometry.wheelbase_m

    def _take_motion(self, way_m: float, turn_rad: float, dt_s: float) -> None:
        """Take what a tick's wheels say by the present radii."""
        self._rate = (way_m / dt_s, turn_rad / dt_s)
        share = 1.0 - math.exp(-dt_s / STEADY_S)
        self._steady_yaw_rate += share * (self._rate[1] - self._steady_yaw_rate)

    def _take_stand(self) -> None:
        """Take that the wheels did not turn."""
        self._rate = (0.0, 0.0)
        self._steady_yaw_rate = 0.0

    def _coast(self, dt_s: float) -> None:
        """No rear rotation: go on as before, ever less sure; give the pose up after a while."""
        self._coasting_s += dt_s
        if self._coasting_s <= COAST_LIMIT_S:
            self._drift_on(dt_s)
            return
        if self._located:
            self._lose_pose()
        self._take_stand()  # no longer known

    # -- the pose found and lost ----------------------------------------------------------------------------

    def _found(self, fix: Fix, tick: Tick, moving: bool) -> bool:
        """Whether the pose is known; if not, this fix may complete it for the next."""
        if self._located:
            return True
        if self._coasting_s == 0.0:  # else a pose is of no use before the wheels turn again
            self._try_to_place(fix, tick, moving)
        return False

    def _try_to_place(self, fix: Fix, tick: Tick, moving: bool) -> None:
        start = self._finder.update(fix, moving)
        if start is None:
            return
        self._place(start, tick)
        self._located = True
        self._last_fix_s = fix.time_s

    def _refused(self, fix: Fix, tick: Tick, off_m: float, variance_m2: float) -> bool:
        """Whether a fix `off_m` from its expectation is left out; if the receiver insists, the pose is found
        anew."""
        verdict = self._fix_gate.judge(off_m, variance_m2, fix.time_s)
        if verdict == "use":
            self.counts["fixes"] += 1
            self._last_fix_s = fix.time_s
            return False
        self.counts["refused_fixes"] += 1
        if verdict == "lost":
            self._lose_pose()
            self._try_to_place(fix, tick, True)
        return True

    def _lose_pose(self) -> None:
        """Give the pose up and keep what was learned of the radii."""
        self._located = False
        self._finder.reset()
        self._gate.reset()
        self._fix_gate.reset()
        self._pose_lost()
        self.counts["lost_pose"] += 1

    # -- out ------------------------------------------------------------------------------------------------

    def _radius_estimate(
        self,
        tick: Tick,
        informative: bool,
        radii: tuple[FloatArray, FloatArray],
        noise_std_m: FloatArray,
        pose: Pose,
        effective_particles: float,
    ) -> RadiusEstimate:
        """The estimate of mean and covariance of the radii in this filter's order of wheels."""
        deviation, full, noise = np.full(4, np.nan), np.full((4, 4), np.nan), np.full(4, np.nan)
        deviation[self._order] = radii[0]
        full[self._grid] = radii[1]
        noise[self._order] = noise_std_m
        found = self._located
        return RadiusEstimate(
            time_s=tick.time_s,
            deviation_m=deviation,
            covariance_m2=full,
            noise_std_m=noise,
            informative=informative,
            informative_s=self._informative_s,
            speed_mps=self._rate[0],
            yaw_rate_radps=self._rate[1],
            east_m=pose.east_m if found else math.nan,
            north_m=pose.north_m if found else math.nan,
            heading_rad=pose.heading_rad if found else math.nan,
            position_std_m=pose.position_std_m if found else math.inf,
            heading_std_rad=pose.heading_std_rad if found else math.inf,
            gnss_age_s=tick.time_s - self._last_fix_s,
            effective_particles=effective_particles,
        )
