"""Ticks and estimates made by hand, so that the monitor can be tested without a filter."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tpmsd.car.config.model import MonitorConfig, VehicleConfig
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, MonitorReport
from tpmsd.onboard.sources.events import SourceFault
from tpmsd.onboard.timeline.tick import Tick

RADIUS_M = 0.316
VEHICLE = VehicleConfig(
    wheel_radius_m=(RADIUS_M,) * 4, track_rear_m=1.52, track_front_m=1.53, wheelbase_m=2.63
)
START_S = 1_700_000_000.0
ALL = (0, 1, 2, 3)
REAR = (2, 3)


def monitor(wheels: tuple[int, ...] = ALL, **settings: float) -> Monitor:
    return Monitor(VEHICLE, MonitorConfig(**settings), wheels)


@dataclass
class Player:
    """Plays stretches of driving into a monitor and keeps what it said."""

    monitor: Monitor
    dt_s: float = 0.5
    time_s: float = START_S
    informative_s: float = 0.0
    offset_m: Sequence[float] = (0.001, -0.0005, 0.0, 0.0015)
    """Radius minus nominal when all is well."""
    std_m: float = 1e-4
    reports: list[MonitorReport] = field(default_factory=list)
    index: int = 0

    def play(
        self,
        duration_s: float,
        change: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
        *,
        informative: bool = True,
        speed_mps: float = 20.0,
        gnss_age_s: float = 0.1,
        lost: Sequence[int] = (),
        faults: tuple[SourceFault, ...] = (),
        std_m: float | None = None,
        tyre_set: float = math.nan,
    ) -> list[AlarmEvent]:
        """`change`: relative to the radius; `lost`: wheels without signal; `tyre_set`: the car's number.
        The alarms raised and cleared."""
        events: list[AlarmEvent] = []
        wheels = self.monitor._wheels
        for _ in range(round(duration_s / self.dt_s)):
            self.index += 1
            self.time_s += self.dt_s
            self.informative_s += self.dt_s * informative
            rotation = np.full(4, math.nan)
            rotation[wheels] = speed_mps * self.dt_s / RADIUS_M
            rotation[list(lost)] = math.nan
            deviation = np.full(4, math.nan)
            deviation[wheels] = (np.array(self.offset_m) + np.array(change) * RADIUS_M)[wheels]
            covariance = np.full((4, 4), math.nan)
            own = np.eye(4) * (self.std_m if std_m is None else std_m) ** 2
            covariance[np.ix_(wheels, wheels)] = own[np.ix_(wheels, wheels)]
            tick = Tick(
                index=self.index,
                time_s=self.time_s,
                dt_s=self.dt_s,
                rotation_rad=rotation,
                rotation_std_rad=np.full(4, 0.05),
                host_time_s=self.time_s - 500.0,
                faults=faults,
                tyre_set=tyre_set,
            )
            estimate = RadiusEstimate(
                time_s=self.time_s,
                deviation_m=deviation,
                covariance_m2=covariance,
                noise_std_m=np.full(4, 1e-4),
                informative=informative,
                informative_s=self.informative_s,
                speed_mps=speed_mps,
                yaw_rate_radps=0.0,
                east_m=0.0,
                north_m=0.0,
                heading_rad=0.0,
                position_std_m=1.0,
                heading_std_rad=0.01,
                gnss_age_s=gnss_age_s,
                effective_particles=40.0,
            )
            report = self.monitor.update(tick, estimate)
            self.reports.append(report)
            events += report.events
        return events

    @property
    def last(self) -> MonitorReport:
        return self.reports[-1]

    def active(self) -> list[tuple[AlarmKind, str | None]]:
        return [(event.kind, event.wheel) for event in self.last.active]


def driven(seconds: float, wheels: tuple[int, ...] = ALL, **settings: float) -> Player:
    """A car that was driven so long with all in order: made once, each caller has one of its own."""
    once = _driven(seconds, wheels, tuple(settings.items()))
    return replace(once, monitor=copy.deepcopy(once.monitor), reports=list(once.reports))


@functools.cache
def _driven(seconds: float, wheels: tuple[int, ...], settings: tuple[tuple[str, float], ...]) -> Player:
    player = Player(monitor(wheels, **dict(settings)))
    assert [] == player.play(seconds)
    return player


def said(events: list[AlarmEvent]) -> list[tuple[str, str | None, str]]:
    return [(str(event.kind), event.wheel, event.state) for event in events]


def one(wheel: int, change: float) -> list[float]:
    return [change if k == wheel else 0.0 for k in range(4)]
