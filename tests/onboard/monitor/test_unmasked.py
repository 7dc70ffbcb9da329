"""Losses beside another change: what all wheels or an axle do hides no tyre, and is named itself.

Estimates as a filter gives them, with errors that last for its memory and the covariance of these errors, go
straight to a monitor that has learned the car on a first drive.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.onboard.monitor.drives import ALL, RADIUS_M, VEHICLE
from tpmsd.car.config.model import MonitorConfig
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.monitor import Monitor
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind
from tpmsd.onboard.timeline.tick import Tick

COMMON_M, OWN_M = 3e-4, 1.2e-4
"""Standard deviations of an estimate: what all wheels have in common, and each its own."""
MEMORY_S = 25.0
GROWTH_M = 1.0e-3
"""At 32 m/s."""
NIGHT_S = 40_000.0
COVARIANCE_M2 = np.full((4, 4), COMMON_M**2) + np.eye(4) * OWN_M**2
FIFTH_M = -0.0046 * RADIUS_M
"""A loss of 20 % of the pressure."""


@dataclass
class Drives:
    """One car on drives of its own noise, a tick a second."""

    monitor: Monitor
    rng: np.random.Generator
    time_s: float = 1_700_000_000.0
    index: int = 0

    def drive(
        self,
        duration_s: float,
        change_m: Sequence[float],
        lost_m: Sequence[float] = (0.0,) * 4,
        at_s: float = 0.0,
        since_s: float = 0.0,
    ) -> list[AlarmEvent]:
        """A drive after a night, all wheels off by `change_m` from `since_s` on, and by `lost_m` more from
        `at_s` on. The alarms, timed from its beginning."""
        self.time_s += NIGHT_S
        begun, events = self.time_s, []
        root, decay = np.linalg.cholesky(COVARIANCE_M2), math.exp(-1.0 / MEMORY_S)
        error = root @ self.rng.standard_normal(4)
        for second in range(round(duration_s)):
            self.time_s += 1.0
            self.index += 1
            error = decay * error + math.sqrt(1.0 - decay**2) * root @ self.rng.standard_normal(4)
            speed = 22.0 + 7.0 * math.sin(second / 70.0)
            radii = GROWTH_M * (speed / 32.0) ** 2 + (second >= since_s) * np.array(change_m) + error
            radii = radii + (second >= at_s) * np.array(lost_m)
            report = self.monitor.update(self._tick(speed), self._estimate(radii, speed))
            events += [event for event in report.events if event.kind is not AlarmKind.MALFUNCTION]
        return [_since(event, begun) for event in events]

    def _tick(self, speed_mps: float) -> Tick:
        turned = np.full(4, speed_mps / RADIUS_M)
        return Tick(
            index=self.index,
            time_s=self.time_s,
            dt_s=1.0,
            rotation_rad=turned,
            rotation_std_rad=np.full(4, 0.05),
            host_time_s=self.time_s,
        )

    def _estimate(self, deviation_m: FloatArray, speed_mps: float) -> RadiusEstimate:
        return RadiusEstimate(
            time_s=self.time_s,
            deviation_m=deviation_m,
            covariance_m2=COVARIANCE_M2.copy(),
            noise_std_m=np.full(4, 1e-4),
            informative=True,
            informative_s=float(self.index),
            speed_mps=speed_mps,
            yaw_rate_radps=0.0,
            east_m=0.0,
            north_m=0.0,
            heading_rad=0.0,
            position_std_m=1.0,
            heading_std_rad=0.01,
            gnss_age_s=0.1,
            effective_particles=40.0,
        )


def _since(event: AlarmEvent, begun_s: float) -> AlarmEvent:
    return replace(event, time_s=event.time_s - begun_s)


@functools.cache
def _first_drive() -> Drives:
    drives = Drives(Monitor(VEHICLE, MonitorConfig(), ALL), np.random.default_rng(1))
    assert [] == drives.drive(1500.0, (0.0,) * 4)
    return drives


def learned(seed: int) -> Drives:
    """A car that was driven for 25 minutes with all tyres in order, at a new start."""
    first = _first_drive()
    monitor = Monitor(VEHICLE, MonitorConfig(), ALL)
    monitor.restore(first.monitor.snapshot())
    return Drives(monitor, np.random.default_rng(seed), first.time_s, first.index)


def raised(events: list[AlarmEvent], kind: AlarmKind) -> dict[str, float]:
    """Wheels and the time of their first alarm of this kind."""
    out: dict[str, float] = {}
    for event in events:
        if event.kind is kind and event.state == "raised" and event.wheel is not None:
            out.setdefault(event.wheel, event.time_s)
    return out


@pytest.mark.parametrize("seed", [10])
@pytest.mark.parametrize("larger", [0.016, 0.028])
@pytest.mark.parametrize("wheel", [0, 3])
def test_a_tyre_that_loses_air_while_all_are_larger_is_named(seed: int, larger: float, wheel: int) -> None:
    """All four radii are 1.6 or 2.8 % larger (other tyres, or a receiver that scales), and after five minutes
    one tyre loses 20 %: within two minutes that tyre is named, and no other."""
    lost = [FIFTH_M * (k == wheel) for k in range(4)]
    events = learned(seed).drive(460.0, [larger * RADIUS_M] * 4, lost, 300.0)
    found = raised(events, AlarmKind.DEFLATION)
    assert [WHEELS[wheel]] == list(found)
    assert 300.0 < found[WHEELS[wheel]] < 420.0


@pytest.mark.parametrize("seed", [12])
@pytest.mark.parametrize("axle", [(0, 1), (2, 3)])
def test_a_tyre_of_an_axle_that_is_larger_is_named(seed: int, axle: tuple[int, int]) -> None:
    """One axle is 8 mm larger, and after five minutes its left tyre loses 27 %: that one is named within two
    minutes, and no other."""
    larger = [8e-3 * (k in axle) for k in range(4)]
    lost = [1.4 * FIFTH_M * (k == axle[0]) for k in range(4)]
    found = raised(learned(seed).drive(460.0, larger, lost, 300.0), AlarmKind.DEFLATION)
    assert [WHEELS[axle[0]]] == list(found)
    assert 300.0 < found[WHEELS[axle[0]]] < 420.0


@pytest.mark.parametrize("seed", [13])
@pytest.mark.parametrize("larger_m", [5e-3, 9e-3, 12e-3])
@pytest.mark.parametrize("wheels", [(0, 1, 2, 3), (0, 1), (2, 3)])
def test_wheels_of_another_size_deviate_the_surer_the_larger_they_are(
    seed: int, larger_m: float, wheels: tuple[int, ...]
) -> None:
    """All four, or an axle, are 5 to 12 mm larger (the limit is 2.5 mm): a deviation of these wheels within
    ten minutes, and no deflation of any."""
    events = learned(seed).drive(600.0, [larger_m * (k in wheels) for k in range(4)])
    assert {WHEELS[k] for k in wheels} == set(raised(events, AlarmKind.RADIUS_DEVIATION))
    assert {} == raised(events, AlarmKind.DEFLATION)


@pytest.mark.parametrize(("larger_m", "wheel"), [((5e-3,) * 4, 1), ((8e-3, 8e-3, 0.0, 0.0), 0)])
def test_a_size_that_comes_on_the_way_hides_no_loss(larger_m: tuple[float, ...], wheel: int) -> None:
    """All four or the front axle become larger after three minutes, without a stop, and a tyre loses air six
    minutes later: these wheels deviate, and that tyre and no other is named within two minutes."""
    lost = [1.3 * FIFTH_M * (k == wheel) for k in range(4)]
    events = learned(21).drive(640.0, larger_m, lost, 540.0, since_s=180.0)
    assert {WHEELS[k] for k in range(4) if larger_m[k]} == set(raised(events, AlarmKind.RADIUS_DEVIATION))
    found = raised(events, AlarmKind.DEFLATION)
    assert [WHEELS[wheel]] == list(found)
    assert 540.0 < found[WHEELS[wheel]] < 640.0


@pytest.mark.parametrize("seed", [14])
def test_a_loss_beside_a_new_tyre_is_named(seed: int) -> None:
    """fl is a new tyre, 6 mm larger, and after five minutes rr loses 20 %: rr is named, and no other."""
    events = learned(seed).drive(460.0, (6e-3, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, FIFTH_M), 300.0)
    assert ["rr"] == list(raised(events, AlarmKind.DEFLATION))


@pytest.mark.parametrize("larger_m", [3e-3, 4e-3])
def test_a_larger_wheel_delays_no_loss_of_another(larger_m: float) -> None:
    """rl is 3 to 4 mm larger, and after five minutes rr loses 20 %: it is named within a minute, for the size
    of rl is known from what the drive has shown before."""
    lost = (0.0, 0.0, 0.0, FIFTH_M)
    events = learned(32).drive(360.0, (0.0, 0.0, larger_m, 0.0), lost, 300.0)
    assert ["rr"] == list(raised(events, AlarmKind.DEFLATION))


@pytest.mark.parametrize("seed", [15])
def test_a_sound_car_names_nothing(seed: int) -> None:
    """Another drive in order raises no alarm."""
    assert [] == learned(seed).drive(1200.0, (0.0,) * 4)
