"""Resets and sets of tyres: learning again, and what a soft tyre does to it."""

from __future__ import annotations

import json
import math

import pytest

from tests.onboard.monitor.drives import ALL, RADIUS_M, Player, driven, monitor, one, said
from tpmsd.onboard.monitor.records import AlarmKind, LearningReport, MonitorReport, WheelState
from tpmsd.onboard.monitor.settings import TYRE_SETS

SOFT = 0.006
"""A little more than 25 % of the pressure."""


def learned(seconds: float = 200.0) -> Player:
    return driven(seconds)


def learning(report: MonitorReport) -> LearningReport:
    assert report.learning is not None
    return report.learning


def test_a_reset_learns_anew_and_then_counts() -> None:
    """With tyres in order (say, pumped up a little) the new radii are learned and become normal."""
    player = learned()
    assert (True, "learning default again; it will be compared with what was normal before") == (
        player.monitor.reset()
    )
    player.play(10.0, [0.001] * 4)
    assert {WheelState.LEARNING} == {wheel.state for wheel in player.last.wheels}
    assert "learning" == learning(player.last).reset
    assert [] == player.play(70.0, [0.001] * 4)
    assert ("accepted", "default is learned again") == (
        learning(player.last).reset,
        learning(player.last).reset_reason,
    )
    assert {WheelState.MONITORING} == {wheel.state for wheel in player.last.wheels}
    assert all(abs(wheel.change_m) < 1e-4 for wheel in player.last.wheels)


@pytest.mark.parametrize("wheel", range(4))
def test_a_reset_with_a_soft_tyre_is_noticed_and_refused(wheel: int) -> None:
    """A tyre that went soft at a standstill, and a driver who resets before driving: refused, with a reason,
    the old baseline counts, and the alarm is raised."""
    name = ("fl", "fr", "rl", "rr")[wheel]
    player = learned()
    assert player.monitor.reset()[0]
    events = player.play(90.0, one(wheel, -SOFT))
    report = learning(player.last)
    assert "refused" == report.reset
    assert f"{name} had a smaller radius than before" in report.reset_reason
    assert ("deflation", name, "raised") in said(events)
    assert 1.0 == player.last.learning_fraction


def test_a_reset_while_an_alarm_stands_is_refused_at_once() -> None:
    """The best-known misuse: an alarm, and the button pressed to be rid of it."""
    player = learned()
    player.play(60.0, one(2, -SOFT))
    taken, reason = player.monitor.reset()
    assert (False, True) == (taken, "the alarm of rl is active" in reason)
    player.play(30.0, one(2, -SOFT))
    assert (AlarmKind.DEFLATION, "rl") in player.active()
    assert "refused" == learning(player.last).reset


def test_another_set_does_not_hide_a_soft_tyre_either() -> None:
    """Naming a set that is not known keeps the alarm standing until it is decided; the soft tyre is found."""
    player = learned()
    player.play(60.0, one(2, -SOFT))
    assert player.monitor.reset("winter")[0]
    events = player.play(90.0, one(2, -SOFT))
    assert [] == said(events)
    assert (AlarmKind.DEFLATION, "rl") in player.active()
    assert ("refused", "default") == (learning(player.last).reset, learning(player.last).tyres)


def test_four_other_tyres_are_learned_though_they_are_smaller() -> None:
    """Winter tyres 1 % smaller all round, put on after a puncture: the alarm is taken back with a reason."""
    player = learned()
    player.play(60.0, one(2, -SOFT))
    assert player.monitor.reset("winter")[0]
    events = player.play(90.0, [-0.01, -0.0102, -0.0098, -0.01])
    taken = [event for event in events if event.kind is AlarmKind.DEFLATION]
    assert [("deflation", "rl", "cleared")] == said(taken)
    assert "taken back by a reset" in taken[0].reason
    assert ("accepted", "winter") == (learning(player.last).reset, learning(player.last).tyres)
    assert [] == player.active()


def test_each_set_keeps_its_baseline() -> None:
    """Back to the tyres of before: nothing is learned again, and a soft one among them is found."""
    player = learned()
    player.monitor.reset("winter")
    player.play(120.0, [-0.01] * 4)
    taken, reason = player.monitor.reset("default")
    assert (True, "changed to default, as learned before") == (taken, reason)
    player.play(5.0)
    assert ("default", "winter") == learning(player.last).sets
    assert {WheelState.MONITORING} == {wheel.state for wheel in player.last.wheels}
    assert ("deflation", "fr", "raised") in said(player.play(60.0, one(1, -SOFT)))


@pytest.mark.parametrize("name", ["", "Winter", "../x", "a" * 25, "a b", "ü"])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    """Names go into files and sentences: small letters, digits, _ and -."""
    player = learned(60.0)
    taken, reason = player.monitor.reset(name)
    assert (False, True) == (taken, "no name of a set" in reason)


def test_sets_are_not_without_end() -> None:
    """Eight sets are kept; a ninth is refused."""
    player = learned(60.0)
    for number in range(7):
        assert player.monitor.reset(f"set{number}")[0]
        player.play(70.0)
    taken, reason = player.monitor.reset("one-more")
    assert (False, True) == (taken, "8 sets of tyres" in reason)


def test_an_undecided_reset_survives_a_restart() -> None:
    """Switching the ignition off and on does not help a soft tyre through a reset."""
    player = learned()
    player.monitor.reset()
    player.play(20.0, one(0, -SOFT))
    fresh = monitor(ALL)
    fresh.restore(json.loads(json.dumps(player.monitor.snapshot(), allow_nan=False)))
    after = Player(fresh, time_s=player.time_s + 60.0)
    after.play(10.0, one(0, -SOFT))
    assert 0.3 < after.last.learning_fraction < 0.8  # goes on where it was
    after.play(80.0, one(0, -SOFT))
    assert "refused" == learning(after.last).reset


def test_a_reset_before_anything_was_learned_is_no_question() -> None:
    """There is nothing to compare with: learning begins again, and counts."""
    player = Player(monitor(ALL))
    player.play(20.0)
    assert (True, "learning default again") == player.monitor.reset()
    player.play(60.0)
    assert {WheelState.MONITORING} == {wheel.state for wheel in player.last.wheels}


def test_pressure_is_reported_with_its_uncertainty() -> None:
    """A loss of 0.46 % of the radius is told as 20 % of the pressure, within what it claims to know."""
    player = learned()
    events = player.play(60.0, one(3, -0.0046))
    alarm = next(event for event in events if event.kind is AlarmKind.DEFLATION)
    assert abs(alarm.pressure_loss - 0.20) < 2.0 * alarm.pressure_loss_std
    assert 0.02 < alarm.pressure_loss_std < 0.15
    assert "% of its pressure" in alarm.reason
    wheel = player.last.wheels[3]
    assert (True, True) == (math.isfinite(wheel.pressure_loss), wheel.pressure_loss_std > 0.0)
    assert abs(player.last.wheels[0].pressure_loss) < 0.1
    assert 0.316 == RADIUS_M


@pytest.mark.parametrize("names", [(None,), ("winter", "default"), ("a", "b", "c", "d", "e", "f")])
def test_resets_without_end_do_not_blind_the_monitor(names: tuple[str | None, ...]) -> None:
    """Whoever asks for a reset every 40 s, for the same set or for others in turn, hides no puncture: it is
    announced within a minute of driving, for the baseline of before judges until a new one is ready."""
    player = learned()
    for number in range(5):
        player.monitor.reset(names[number % len(names)])
        assert [] == player.play(40.0)
    events = []
    for number in range(2):
        player.monitor.reset(names[(number + 5) % len(names)])
        events += player.play(30.0, one(2, -0.01))
    assert ("deflation", "rl", "raised") in said(events)


def test_a_leak_is_not_reset_away_minute_by_minute() -> None:
    """A tyre that loses 2 % in 20 minutes while a reset is asked for every minute: each step is small against
    the last, but resets are rationed, so the tyre is found."""
    player = learned()
    player.dt_s = 2.0
    events = []
    for minute in range(25):
        player.monitor.reset()
        events += player.play(60.0, one(1, -0.02 * min(minute / 20.0, 1.0)))
    assert ("deflation", "fr", "raised") in said(events)


def test_resets_are_rationed_and_the_ration_comes_back() -> None:
    """Three resets of the same set at once, then none until ten minutes have passed; the refusal says so."""
    player = learned()
    for _ in range(3):
        assert player.monitor.reset()[0]
        player.play(70.0)
        assert "accepted" == learning(player.last).reset
    taken, reason = player.monitor.reset()
    assert (False, True) == (taken, "too many resets in a short time" in reason)
    player.play(600.0, informative=False)
    assert player.monitor.reset()[0]


def test_a_restart_fills_up_no_ration() -> None:
    """Three resets, then switching off and on: the next one is refused as it would have been without."""
    player = learned()
    for _ in range(3):
        assert player.monitor.reset()[0]
        player.play(70.0)
    fresh = monitor(ALL)
    fresh.restore(json.loads(json.dumps(player.monitor.snapshot(), allow_nan=False)))
    taken, reason = fresh.reset()
    assert (False, True) == (taken, "too many resets in a short time" in reason)
    Player(fresh, time_s=player.time_s + 60.0).play(600.0, informative=False)
    assert fresh.reset()[0]


@pytest.mark.parametrize("saved", [math.nan, math.inf, -1.0, 10.1, "3", None, True])
def test_a_ration_that_is_none_is_no_state(saved: object) -> None:
    """A number beyond what the ration holds, or something else, is refused with the rest of the state."""
    sets = learned(60.0).monitor._sets
    document = sets.to_json() | {"allowance": saved}
    with pytest.raises(ValueError, match="saved"):
        sets.restore(document)


def test_a_state_without_a_ration_is_an_older_one() -> None:
    """A state of an earlier version has no ration: it is full."""
    sets = learned(60.0).monitor._sets
    document = sets.to_json()
    del document["allowance"]
    sets.restore(document)
    assert TYRE_SETS.allowance == sets.to_json()["allowance"]


def test_a_set_that_is_being_learned_is_not_begun_again() -> None:
    """Asked again while it learns: taken, and the learning goes on where it was."""
    player = learned()
    player.monitor.reset()
    player.play(40.0)
    before = player.last.learning_fraction
    assert player.monitor.reset()[0]
    player.play(player.dt_s)
    assert player.last.learning_fraction >= before > 0.5


def test_a_reset_that_is_not_decided_is_a_malfunction() -> None:
    """Ten minutes of driving above 40 km/h without information: the reset still waits, and that is said."""
    player = learned()
    player.monitor.reset()
    assert [] == player.play(590.0, informative=False)
    events = player.play(20.0, informative=False)
    assert {("malfunction", None, "raised")} == set(said(events))
    assert any("a reset waits" in event.reason for event in events)
    events = player.play(120.0)
    assert 2 == said(events).count(("malfunction", None, "cleared"))


def test_the_car_says_which_set_is_mounted() -> None:
    """Another number is another set with a baseline of its own; the first is taken up again with its own."""
    player = learned()
    assert [] == player.play(100.0, [-0.004] * 4, tyre_set=2.0)
    assert ("set-2", "accepted") == (learning(player.last).tyres, learning(player.last).reset)
    player.play(10.0, tyre_set=0.0)
    assert "default" == learning(player.last).tyres
    assert {WheelState.MONITORING} == {wheel.state for wheel in player.last.wheels}
    assert all(abs(wheel.change_m) < 1e-4 for wheel in player.last.wheels)


@pytest.mark.parametrize("number", [math.nan, 2.5, -1.0])
def test_what_is_no_number_of_a_set_changes_none(number: float) -> None:
    """Neither silence nor fractions, which a switch within a tick makes, nor signal-not-available."""
    player = learned()
    player.play(20.0, tyre_set=number)
    assert ("default", "none") == (learning(player.last).tyres, learning(player.last).reset)
    player.play(3.0, tyre_set=3.0)
    assert "default" == learning(player.last).tyres
