"""The daemon's clock and its deadlines."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.daemon.fakes import HandClock
from tpmsd.foundation.errors import ConfigError
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.deadlines import Deadlines, PeriodicTask


def test_at_scale_1_the_clock_is_the_hosts_with_its_steps() -> None:
    """At scale 1 logical time is the host's time, also when that is set."""
    wall, monotonic = HandClock(1.7e9), HandClock(50.0)
    clock = Clock(wall=wall, monotonic=monotonic)

    wall.now_s += 3600.0
    monotonic.now_s += 2.0

    assert 1.7e9 + 3600.0 == clock.now()
    assert 2.0 == clock.monotonic()
    assert (1.7e9 + 3600.0, 2.0) == clock.read()
    assert 1.6e9 == clock.from_host(1.6e9)
    assert 2.0 == clock.to_real(2.0)


def test_a_faster_clock_runs_from_its_creation() -> None:
    """At scale 20 one real second is twenty logical ones, for stamps of the host as for the clock itself."""
    wall, monotonic = HandClock(1.7e9), HandClock(50.0)
    clock = Clock(20.0, wall=wall, monotonic=monotonic)

    wall.now_s += 3.0
    monotonic.now_s += 3.0

    assert 1.7e9 + 60.0 == clock.now()
    assert 60.0 == clock.monotonic()
    assert clock.now() == clock.from_host(wall.now_s)
    assert 0.5 == clock.to_real(10.0)


def test_a_clock_can_begin_at_any_time() -> None:
    """A drive of long ago is played on the clock of that day."""
    wall, monotonic = HandClock(1.7e9), HandClock(50.0)
    clock = Clock(2.0, start_s=1000.0, wall=wall, monotonic=monotonic)

    monotonic.now_s += 1.5

    assert 1003.0 == clock.now()


def test_both_readings_are_of_one_instant() -> None:
    """A process that is held up between the two readings takes them again."""
    wall, held_up_s = HandClock(1.7e9), iter([0.0, 0.0, 5.0, 5.0, 5.0])
    clock = Clock(wall=wall, monotonic=lambda: next(held_up_s))

    assert (1.7e9, 5.0) == clock.read()


@pytest.mark.parametrize("scale", [0.0, -1.0, 1e6, float("nan")])
def test_absurd_speeds_are_refused(scale: float) -> None:
    """A speed-up that is none is a wrong usage."""
    with pytest.raises(ConfigError):
        Clock(scale)


def test_the_rate_does_not_drift() -> None:
    """Ticks that are each taken late by some milliseconds still come to one per period over an hour."""
    deadlines, now_s, taken = Deadlines(0.1, 0.0), 0.0, 0
    while now_s < 3600.0:
        now_s = deadlines.next_s + 0.007  # the wait ends late, and the work takes its time
        assert deadlines.due_lateness_s(now_s) == pytest.approx(0.007, abs=1e-9)
        taken += 1

    assert 36000 == taken
    assert 0 == deadlines.missed


def test_missed_deadlines_are_counted_and_not_made_up_for() -> None:
    """After a pause of 0.57 s one late tick is taken, five are counted as missed, and the phase is kept."""
    deadlines = Deadlines(0.1, 10.0)

    assert deadlines.due_lateness_s(10.09) is None
    assert deadlines.due_lateness_s(10.67) == pytest.approx(0.57)
    assert 5 == deadlines.missed
    assert deadlines.next_s == pytest.approx(10.7)


@settings(derandomize=True, deadline=None)
@given(
    period_s=st.sampled_from([0.01, 0.1, 1.0]), waits=st.lists(st.floats(0.0, 5.0), min_size=1, max_size=50)
)
def test_every_deadline_is_either_taken_or_missed(period_s: float, waits: list[float]) -> None:
    """However the loop is held up, taken and missed add up to the deadlines that have passed."""
    deadlines, now_s = Deadlines(period_s, 0.0), 0.0
    for wait_s in waits:
        now_s += wait_s
        while deadlines.due_lateness_s(now_s) is not None:
            pass

    passed = deadlines.taken + deadlines.missed
    assert deadlines.next_s > now_s
    assert deadlines.next_s - period_s <= now_s + 1e-9
    assert passed == round(deadlines.next_s / period_s) - 1


def test_something_now_and_then_makes_no_bursts() -> None:
    """What is due once a second is done once after a pause, then a second later."""
    every = PeriodicTask(1.0)

    assert [True, False, True, False, True] == [every.due(t) for t in (0.0, 0.9, 7.5, 8.4, 8.5)]


@pytest.mark.parametrize(("took_s", "looks"), [(0.0005, 2), (0.002, 10)])
def test_two_readings_a_millisecond_apart_are_of_one_instant(took_s: float, looks: int) -> None:
    """Those further apart are taken again, five times at most: a process may be held up each time."""
    times = [0.0]

    def monotonic() -> float:
        times.append(times[-1] + took_s)
        return times[-1]

    clock = Clock(wall=HandClock(1.7e9), monotonic=monotonic)
    before = len(times)
    now_s, monotonic_s = clock.read()
    assert (1.7e9, looks) == (now_s, len(times) - before)
    assert looks * took_s == pytest.approx(monotonic_s)


@pytest.mark.parametrize(("scale", "refused"), [(0.1, False), (0.09, True), (1000.0, False), (1000.1, True)])
def test_time_runs_at_a_tenth_to_a_thousand_times_its_speed(scale: float, refused: bool) -> None:
    """Both bounds are still good, and the line names them."""
    if not refused:
        assert scale == Clock(scale).scale
        return
    with pytest.raises(ConfigError, match=rf"speed-up {scale:g} is outside 0\.1 to 1000"):
        Clock(scale)


def test_a_clock_with_a_begin_does_not_follow_the_hosts() -> None:
    """At scale 1, too, it runs on from there, and stamps of the host come with it."""
    wall, monotonic = HandClock(1.7e9), HandClock(50.0)
    clock = Clock(start_s=0.0, wall=wall, monotonic=monotonic)
    wall.now_s += 3600.0  # set by a person
    monotonic.now_s += 2.0

    assert (2.0, (2.0, 2.0), 5.0) == (clock.now(), clock.read(), clock.from_host(1.7e9 + 5.0))


def test_a_tick_is_due_at_its_deadline_itself() -> None:
    """Not late at all, the first one period behind the start; a second later is one too late by a period."""
    deadlines = Deadlines(0.5, 10.0)
    assert [None, 0.0, None, 0.25, None] == [
        deadlines.due_lateness_s(t) for t in (10.25, 10.5, 10.75, 11.25, 11.25)
    ]
    assert (2, 0, 11.5) == (deadlines.taken, deadlines.missed, deadlines.next_s)
    assert 0.5 == deadlines.due_lateness_s(12.0)
    assert (3, 1, 12.5) == (deadlines.taken, deadlines.missed, deadlines.next_s)
