"""Synthetic drives for the tests of the report package: ticks, estimates and reports by hand, without a
filter.

In: what shall happen. Out: a filled `ReplayRecorder`, whose numbers the tests know in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from tpmsd.car.config.model import MonitorConfig, VehicleConfig
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.report.replay_recorder import ReplayRecorder
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, MonitorReport, WheelReport, WheelState
from tpmsd.onboard.sources.events import SourceFault
from tpmsd.onboard.timeline.tick import Fix, Tick

START_S = 1_719_820_800.0
NOMINAL_M = 0.316
VEHICLE = VehicleConfig(
    wheel_radius_m=(NOMINAL_M,) * 4, track_rear_m=1.52, track_front_m=1.53, wheelbase_m=2.63
)
MONITOR = MonitorConfig(learn_s=60.0, deflation_percent=0.35, deviation_percent=0.8)
OFFSET_M = np.array([0.0011, -0.0006, 0.0004, 0.0017])
"""Baseline of each wheel: radius minus nominal before anything happens."""


@dataclass
class Drive:
    """What happens, as functions of the drive time in seconds."""

    duration_s: float = 600.0
    dt_s: float = 0.1
    speed_mps: Callable[[float], float] = lambda t: 20.0
    change_m: Callable[[float], Sequence[float]] = lambda t: (0.0, 0.0, 0.0, 0.0)
    std_m: Callable[[float], float] = lambda t: 1e-4 + 5e-3 * math.exp(-t / 8)
    state: Callable[[float, str], WheelState] = lambda t, wheel: (
        WheelState.LEARNING if t < 60 else WheelState.MONITORING
    )
    informative: Callable[[float], bool] = lambda t: True
    has_fix: Callable[[float], bool] = lambda t: True
    faults: dict[int, tuple[SourceFault, ...]] = field(default_factory=dict)
    """Tick index -> faults."""
    events: dict[int, tuple[AlarmEvent, ...]] = field(default_factory=dict)
    pauses: dict[int, float] = field(default_factory=dict)
    """Tick index -> seconds without ticks before it."""
    max_points: int = 20_000
    name: str = "evening-drive"

    def record(self) -> ReplayRecorder:
        """Play it into a recorder."""
        recorder = ReplayRecorder(self.name, VEHICLE, MONITOR, max_points=self.max_points)
        age = math.inf
        elapsed = informative_s = 0.0
        active: list[AlarmEvent] = []
        for index in range(round(self.duration_s / self.dt_s)):
            pause = self.pauses.get(index, 0.0)
            elapsed += pause + self.dt_s
            age = 0.0 if self.has_fix(elapsed) else age + pause + self.dt_s
            informative_s += self.dt_s if self.informative(elapsed) else 0.0
            events = self.events.get(index, ())
            for event in events:
                active = [a for a in active if (a.kind, a.wheel) != (event.kind, event.wheel)]
                if event.state == "raised":
                    active.append(event)
            recorder.add(
                self._tick(index, elapsed, pause),
                self._estimate(elapsed, age, informative_s),
                self._report(elapsed, tuple(active), events, informative_s),
            )
        return recorder

    def _tick(self, index: int, elapsed: float, pause: float) -> Tick:
        time_s = START_S + elapsed
        fixes = (Fix(time_s, 1.0, 0.0, 0.0, 1.0),) if self.has_fix(elapsed) else ()
        return Tick(
            index=index,
            time_s=time_s,
            dt_s=self.dt_s,
            rotation_rad=np.zeros(4),
            rotation_std_rad=np.zeros(4),
            fixes=fixes,
            gap_s=pause,
            faults=self.faults.get(index, ()),
        )

    def _estimate(self, elapsed: float, age: float, informative_s: float) -> RadiusEstimate:
        return RadiusEstimate(
            time_s=START_S + elapsed,
            deviation_m=OFFSET_M + np.asarray(self.change_m(elapsed)),
            covariance_m2=np.eye(4) * self.std_m(elapsed) ** 2,
            noise_std_m=np.full(4, 1e-3),
            informative=self.informative(elapsed),
            informative_s=informative_s,
            speed_mps=self.speed_mps(elapsed),
            yaw_rate_radps=0.0,
            east_m=120.0,
            north_m=-45.0,
            heading_rad=0.5,
            position_std_m=0.8,
            heading_std_rad=0.01,
            gnss_age_s=age,
            effective_particles=200.0,
        )

    def _report(
        self,
        elapsed: float,
        active: tuple[AlarmEvent, ...],
        events: tuple[AlarmEvent, ...],
        informative_s: float,
    ) -> MonitorReport:
        wheels = []
        std = self.std_m(elapsed)
        for index, wheel in enumerate(WHEELS):
            state = self.state(elapsed, wheel)
            change = float(self.change_m(elapsed)[index])
            known = state != WheelState.UNAVAILABLE
            learned = known and state != WheelState.LEARNING
            threshold = NOMINAL_M * MONITOR.deflation_percent / 100
            probability = 0.5 * math.erfc((change + threshold) / (std * math.sqrt(2)))
            wheels.append(
                WheelReport(
                    wheel=wheel,
                    state=state,
                    deviation_m=float(OFFSET_M[index]) + change if known else math.nan,
                    std_m=std if known else math.nan,
                    change_m=change if learned else math.nan,
                    change_std_m=std if learned else math.nan,
                    deflation_probability=probability if learned else math.nan,
                    deviation_probability=0.0 if learned else math.nan,
                )
            )
        fraction = min(1.0, informative_s / MONITOR.learn_s)
        return MonitorReport(START_S + elapsed, tuple(wheels), active, events, fraction)


def alarm(
    at_s: float,
    kind: AlarmKind = AlarmKind.DEFLATION,
    wheel: str | None = "rl",
    state: str = "raised",
    deviation_m: float = -0.00111,
    reason: str = "radius down 1.51 mm from its baseline",
) -> AlarmEvent:
    """An alarm at this drive time."""
    assert state in ("raised", "cleared")
    return AlarmEvent(
        time_s=START_S + at_s,
        kind=kind,
        wheel=wheel,
        state="raised" if state == "raised" else "cleared",
        deviation_m=deviation_m,
        std_m=0.0001,
        probability=0.995,
        reason=reason,
    )


def puncture(max_points: int = 20_000) -> Drive:
    """Rear left loses 2.2 mm from 300 s on over 60 s; a tunnel at 420 to 450 s; a stop at 100 to 130 s."""

    def change(t: float) -> tuple[float, float, float, float]:
        loss = -0.0022 * min(1.0, max(0.0, (t - 300) / 60))
        return (4e-5 * math.sin(t / 20), 5e-5 * math.cos(t / 25), loss, 3e-5 * math.sin(t / 17 + 1))

    def speed(t: float) -> float:
        return 0.0 if 100 <= t < 130 else 21.0 + 4 * math.sin(t / 60)

    def state(t: float, wheel: str) -> WheelState:
        if t < 60:
            return WheelState.LEARNING
        return WheelState.ALARM if wheel == "rl" and t >= 341.2 else WheelState.MONITORING

    return Drive(
        change_m=change,
        speed_mps=speed,
        state=state,
        informative=lambda t: not 100 <= t < 130,
        has_fix=lambda t: t >= 3 and not 420 <= t < 450,
        faults={
            2000: (SourceFault(START_S + 200, "can", "lost"), SourceFault(START_S + 200, "gnss", "checksum"))
        }
        | {k: (SourceFault(START_S + k / 10, "can", "lost"),) for k in range(4500, 4520)},
        events={3411: (alarm(341.2),)},
        max_points=max_points,
        name="evening-drive",
    )
