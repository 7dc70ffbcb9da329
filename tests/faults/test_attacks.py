"""Attacks on the bus and in the sky: no false deflation, and what blinds the monitor is a malfunction.

SECURITY.md has them as a table. The drive's tyres are sound unless a test says otherwise.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.faults.attack_changes import (
    clock_rate,
    clock_set,
    duplicated,
    early_stamps,
    exchanged,
    receiver_scaled,
    replayed_fixes,
    rotated_left,
    speed_scaled,
    turned,
    utc_jumps,
)
from tests.faults.attacks import ROUTE, Attack, played_items, played_ticks, summary, table, unattacked
from tests.faults.drives import FOUND, FROM_S, TO_S, Outcome, played
from tests.faults.test_wheels import impatient, tyre_alarms
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.monitor.records import WheelState
from tpmsd.onboard.timeline.tick import Tick

pytestmark = pytest.mark.usefixtures("method")


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
    return unattacked(ROUTE, method)


def test_an_honest_drive_is_quiet(honest: Outcome) -> None:
    """Nobody attacks: no alarm, no malfunction, and the wheels are monitored."""
    assert [] == honest.alarms
    assert {"monitoring"} == set(state_at(honest, 400.0))


def test_fixes_of_an_earlier_drive_are_not_believed(honest: Outcome) -> None:
    """The receiver replays, with fresh time, what it said two minutes ago, for 150 s: `malfunction` in
    40 s, which stands until a minute after; no tyre is accused, and the radii are what they were."""

    outcome = played_ticks(replayed_fixes)
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

    outcome = played_items(early_stamps)
    assert [("malfunction", None, "raised"), ("malfunction", None, "cleared")] == outcome.alarms
    assert 160.0 < outcome.when("malfunction") < 200.0
    assert 300.0 < outcome.when("malfunction", "cleared") < 345.0
    assert {"unavailable"} == set(state_at(outcome, 250.0))
    assert offset_mm(outcome, honest, 410.0) < 0.15


@pytest.mark.parametrize("share", [-0.03, 0.03])
def test_a_receiver_whose_speed_is_scaled_slowly_is_found_by_three_per_cent(
    share: float, honest: Outcome
) -> None:
    """Speeds scaled by 3 % within 200 s while positions stay: a malfunction before the scale is reached, no
    deflation, and radii that went with it by less than 1 of the 9.5 mm that it amounts to."""
    outcome = played_ticks(speed_scaled(share))
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


# Shorter drives, on which a tyre goes soft after the attack: it must be found, and nothing else.


@pytest.mark.parametrize("late_s", [0.0, 0.001, 0.009])
def test_frames_twice_within_milliseconds_change_nothing(late_s: float) -> None:
    """Each of the wheels' frames comes twice, 0 to 9 ms apart, from the middle of the drive on."""
    assert FOUND == played(duplicated(late_s, FROM_S, 1e9)).alarms


def test_frames_repeated_after_300_ms_are_a_malfunction_while_it_lasts() -> None:
    """Old counts come between the new ones: rejected, told, and the wheels are monitored again afterwards."""
    outcome = played(duplicated(0.3, FROM_S, TO_S), config=impatient)
    assert FOUND == tyre_alarms(outcome)
    raised = [alarm for alarm in outcome.alarms if alarm[0] == "malfunction" and alarm[2] == "raised"]
    cleared = [alarm for alarm in outcome.alarms if alarm[0] == "malfunction" and alarm[2] == "cleared"]
    assert 1 <= len(raised) == len(cleared)
    assert FROM_S < outcome.when("malfunction") < FROM_S + 12.0
    assert outcome.when("malfunction", "cleared") > TO_S - 5.0


@pytest.mark.parametrize("pair", [(0, 2), (2, 3)], ids=["left", "rear"])
def test_exchanged_counters_hide_no_loss(pair: tuple[int, int]) -> None:
    """From the middle of the drive on two counters stand in each other's place, as if the wheels had changed
    places, and one of them loses air: nothing tells which wheel a counter is of, so a wheel that is sound may
    be accused as well; but one of the two is."""
    accused = {wheel for _, wheel, _ in tyre_alarms(played(exchanged(*pair, FROM_S)))}
    assert accused & {WHEELS[one] for one in pair}


@pytest.mark.parametrize("step_s", [-3600.0, -0.5, 0.5, 3600.0])
def test_a_host_clock_that_steps_changes_no_alarm(step_s: float) -> None:
    """All stamps step in the middle of the drive."""
    assert FOUND == played(clock_set(step_s, FROM_S)).alarms


@pytest.mark.parametrize("bus_alone", [False, True], ids=["host", "bus"])
@pytest.mark.parametrize("ppm", [-500.0, 500.0])
def test_a_clock_that_runs_wrong_changes_no_alarm(ppm: float, bus_alone: bool) -> None:
    """500 ppm, of all stamps or of the bus alone: the loss is found, and nothing else."""
    assert FOUND == played(clock_rate(ppm, bus_alone)).alarms


@pytest.mark.parametrize("step_s", [-3600.0, -1.0, 1.0, 3600.0])
def test_utc_that_jumps_changes_no_alarm(step_s: float) -> None:
    """The receiver's time is off for good from the middle of the drive on; -1 s is a leap second taken up
    late."""
    outcome = played(utc_jumps(step_s, FROM_S))
    assert FOUND == outcome.alarms
    assert 751 == outcome.counts["gnss.fixes"]


@pytest.mark.parametrize("share", [-0.003, 0.003])
def test_the_stated_radius_holds_what_a_receivers_scale_does(share: float, honest: Outcome) -> None:
    """Speeds and positions scaled alike by 0.3 % move all radii by as much, 0.95 mm, and nothing tells: no
    alarm, and each radius is off by no more than three of the standard deviations that are stated."""
    outcome = played_ticks(receiver_scaled(share))
    assert [] == outcome.alarms
    off_m = outcome.steps[-1].estimate.deviation_m - honest.steps[-1].estimate.deviation_m
    stated_m = np.array([wheel.std_m for wheel in outcome.steps[-1].report.wheels])
    assert np.allclose(share * 0.316, off_m, atol=1e-4)
    assert np.all(np.abs(off_m) < 3.0 * stated_m)
    assert np.all(stated_m < 0.6e-3)


def test_the_command_prints_the_table(capsys: pytest.CaptureFixture[str], method: str) -> None:
    """An attack that holds and one that fools the filter: a row each, and the number of those that broke the
    rule."""
    soft = Attack("a soft tyre", ticks=turned([1.0, 1.0, 1.02, 1.0], 200.0))
    assert 1 == table([method], ["rural"], [Attack("nothing", ticks=turned([1.0] * 4)), soft])
    printed = capsys.readouterr().out
    nothing, broken = printed.splitlines()[2:]
    assert f"| nothing | rural | `{method}` | - | - | yes | 0.00 mm, 0.0 std |  |" == nothing
    assert "deflation rl" in broken
    assert broken.endswith("BROKEN |")
    assert summary(printed)[2].startswith("| a soft tyre | 1 | 1 (deflation rl")
    assert summary(printed)[2].endswith("| 1 |")
    assert "No alarm, and radii off: nothing (at most 0.00 mm, 0.0 std)." == summary(printed)[-1]


def test_tyres_that_changed_places_without_a_reset_are_reported_as_a_loss() -> None:
    """A tyre that is 1 mm smaller than the one before it at its place is announced as one that lost air: the
    radii do not tell why. The driver is told within the drive, so that a set can be named (`tpmsd reset`)."""
    outcome = played_ticks(rotated_left, "motorway")
    assert ("deflation", "rl", "raised") in outcome.alarms
    assert ("deflation", "fl", "raised") not in outcome.alarms
