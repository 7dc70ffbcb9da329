"""Attacks on the bus and in the sky: no false deflation, and what blinds the monitor is a malfunction.

SECURITY.md has them as a table. The drive's tyres are sound unless a test says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.faults.attacks import played_items, played_ticks
from tests.faults.drives import Item, Outcome
from tpmsd.onboard.monitor.records import WheelState
from tpmsd.onboard.sources.can_frame import CanFrame
from tpmsd.onboard.timeline.tick import Tick

pytestmark = pytest.mark.usefixtures("method")
RATE_HZ = 10


def state_at(outcome: Outcome, time_s: float) -> list[str]:
    step = min(outcome.steps, key=lambda step: abs(step.tick.time_s - outcome.start_s - time_s))
    return [str(wheel.state) for wheel in step.report.wheels]


def offset_mm(one: Outcome, other: Outcome, time_s: float) -> float:
    """The largest difference of radii between two plays at a time."""
    at = [
        min(play.steps, key=lambda step: abs(step.tick.time_s - play.start_s - time_s)).estimate.deviation_m
        for play in (one, other)
    ]
    return 1e3 * float(np.max(np.abs(at[0] - at[1])))


@pytest.fixture(scope="module")
def honest(method: str) -> Outcome:
    return played_ticks(lambda ticks, start_s: ticks)


def test_an_honest_drive_is_quiet(honest: Outcome) -> None:
    """Nobody attacks: no alarm, no malfunction, and the wheels are monitored."""
    assert [] == honest.alarms
    assert {"monitoring"} == set(state_at(honest, 400.0))


def test_fixes_of_an_earlier_drive_are_not_believed(honest: Outcome) -> None:
    """The receiver replays, with fresh time, what it said two minutes ago, for 150 s: `malfunction` in
    40 s, which stands until a minute after; no tyre is accused, and the radii are what they were."""

    def change(ticks: list[Tick], start_s: float) -> list[Tick]:
        out, behind = list(ticks), 120 * RATE_HZ
        for k in range(150 * RATE_HZ, 300 * RATE_HZ):
            old = ticks[k - behind]
            later_s = ticks[k].time_s - old.time_s
            fixes = tuple(replace(fix, time_s=fix.time_s + later_s) for fix in old.fixes)
            out[k] = replace(ticks[k], fixes=fixes)
        return out

    outcome = played_ticks(change)
    assert [("malfunction", None, "raised"), ("malfunction", None, "cleared")] == outcome.alarms
    assert 150.0 < outcome.when("malfunction") < 190.0
    assert outcome.when("malfunction", "cleared") > 350.0
    assert {"unavailable"} == set(state_at(outcome, 250.0))
    assert {"monitoring"} == set(state_at(outcome, 410.0))
    assert offset_mm(outcome, honest, 410.0) < 0.15


def test_stamps_that_jump_are_a_malfunction(honest: Outcome) -> None:
    """Frames stamped 0.3 s too early every other five seconds make all radii seem larger by 2 mm: from the
    twentieth second on nothing is judged, after thirty more it is a malfunction, and it ends with the
    attack."""

    def change(items: list[Item], start_s: float) -> list[Item]:
        return [
            item._replace(time_s=item.time_s - 0.3)
            if isinstance(item, CanFrame)
            and 120.0 <= item.time_s - start_s < 300.0
            and int((item.time_s - start_s) / 5.0) % 2
            else item
            for item in items
        ]

    outcome = played_items(change)
    assert [("malfunction", None, "raised"), ("malfunction", None, "cleared")] == outcome.alarms
    assert 160.0 < outcome.when("malfunction") < 200.0
    assert 300.0 < outcome.when("malfunction", "cleared") < 345.0
    assert {"unavailable"} == set(state_at(outcome, 250.0))
    assert offset_mm(outcome, honest, 410.0) < 0.15


def _scaled(share: float) -> Callable[[list[Tick], float], list[Tick]]:
    def change(ticks: list[Tick], start_s: float) -> list[Tick]:
        out = []
        for tick in ticks:
            by = 1.0 + share * min(max((tick.time_s - start_s - 100.0) / 200.0, 0.0), 1.0)
            out.append(replace(tick, fixes=tuple(replace(f, speed_mps=f.speed_mps * by) for f in tick.fixes)))
        return out

    return change


@pytest.mark.parametrize("share", [-0.03, 0.03])
def test_a_receiver_whose_speed_is_scaled_slowly_is_found_by_three_per_cent(
    share: float, honest: Outcome
) -> None:
    """Speeds scaled by 3 % within 200 s while positions stay: a malfunction before the scale is reached, no
    deflation, and radii that went with it by less than 1 of the 9.5 mm that it amounts to."""
    outcome = played_ticks(_scaled(share))
    assert [("malfunction", None, "raised")] == outcome.alarms
    assert 100.0 < outcome.when("malfunction") < 300.0
    assert {"unavailable"} == set(state_at(outcome, 400.0))
    assert offset_mm(outcome, honest, 410.0) < 1.0


def test_one_rear_wheel_lost_leaves_no_wheel_monitored() -> None:
    """The rear left counter is silent and the front right tyre goes soft: `malfunction` of the wheel and of
    the rear pair in 30 s, told as what it is and not as an outage of the receiver; the other three wheels
    are not said to be monitored."""

    def change(ticks: list[Tick], start_s: float) -> list[Tick]:
        out = []
        for tick in ticks:
            rotation = tick.rotation_rad.copy()
            if tick.time_s - start_s > 60.0:
                rotation[2] = math.nan
            if tick.time_s - start_s > 200.0:
                rotation[1] *= 1.02
            out.append(replace(tick, rotation_rad=rotation))
        return out

    outcome = played_ticks(change)
    assert {("malfunction", None, "raised"), ("malfunction", "rl", "raised")} == set(outcome.alarms)
    assert not any("no usable fix" in reason for reason in outcome.reasons)
    assert {str(WheelState.UNAVAILABLE)} == set(state_at(outcome, 300.0))
