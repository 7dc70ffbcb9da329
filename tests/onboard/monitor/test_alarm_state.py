"""Hysteresis as a state machine: nothing on one reading, no flapping, no alarm for ever."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.monitor.alarms.alarm_state import Hysteresis

READINGS = st.lists(
    st.tuples(st.one_of(st.floats(0.0, 1.0), st.sampled_from([0.0, 1.0, math.nan])), st.floats(0.1, 30.0)),
    max_size=80,
)


def made(raise_hold_s: float = 5.0, clear_hold_s: float = 60.0) -> Hysteresis:
    return Hysteresis(0.99, 0.2, raise_hold_s, clear_hold_s)


def test_raised_after_the_hold_and_cleared_after_the_other() -> None:
    """With a reading a second: raised with the reading that completes 5 s, cleared with that of 60 s."""
    alarm = made()
    turned = [alarm.update(1.0, 1.0) for _ in range(8)]
    assert [None] * 5 + ["raised"] + [None] * 2 == turned
    turned = [alarm.update(0.0, 1.0) for _ in range(61)]
    assert [None] * 60 + ["cleared"] == turned
    assert not alarm.active


def test_one_reading_never_raises_however_long_it_stands_for() -> None:
    """A first reading beyond the threshold only begins the hold, be it an hour's."""
    alarm = made()
    assert alarm.update(1.0, 3600.0) is None
    assert not alarm.active


def test_a_dip_begins_the_hold_anew() -> None:
    """Four seconds up, one down, four up: not raised."""
    alarm = made()
    readings = [1.0] * 5 + [0.5] + [1.0] * 5
    assert [None] * 11 == [alarm.update(p, 1.0) for p in readings]


def test_between_the_thresholds_nothing_changes() -> None:
    """A standing alarm stays while its probability is between both thresholds, and so does its absence."""
    alarm = made()
    assert all(alarm.update(0.6, 10.0) is None for _ in range(100))
    for _ in range(10):
        alarm.update(1.0, 1.0)
    assert alarm.active
    assert all(alarm.update(0.6, 10.0) is None for _ in range(100))
    assert alarm.active


def test_both_thresholds_themselves_count() -> None:
    """0.99 raises and 0.2 clears; the next number on the other side of each does neither."""
    for raising, changes in ((0.99, ["raised"]), (math.nextafter(0.99, 0.0), [])):
        alarm = made()
        assert changes == [turned for turned in (alarm.update(raising, 1.0) for _ in range(20)) if turned]
    for clearing, changes in ((0.2, ["cleared"]), (math.nextafter(0.2, 1.0), [])):
        alarm = made()
        alarm.active = True
        assert changes == [turned for turned in (alarm.update(clearing, 10.0) for _ in range(20)) if turned]


@settings(derandomize=True, deadline=None, max_examples=300)
@given(READINGS, st.floats(0.5, 20.0), st.floats(0.5, 90.0))
def test_no_sequence_flaps(readings: list[tuple[float, float]], raise_s: float, clear_s: float) -> None:
    """Each change follows at least two readings in a row beyond its threshold, which last for its hold, and
    changes alternate."""
    alarm = made(raise_s, clear_s)
    changes: list[str] = []
    since: list[tuple[float, float]] = []
    for probability, elapsed in readings:
        wanted = probability <= 0.2 if alarm.active else probability >= 0.99
        since = [*since, (probability, elapsed)] if wanted else []
        was_active = alarm.active
        turned = alarm.update(probability, elapsed)
        if turned is None:
            assert was_active == alarm.active
            continue
        changes.append(turned)
        assert len(since) >= 2
        assert sum(e for _, e in since[1:]) >= (clear_s if was_active else raise_s) - 1e-6
        since = []
    assert ["raised", "cleared"] * (len(changes) // 2) + ["raised"] * (len(changes) % 2) == changes
    assert alarm.active == (len(changes) % 2 == 1)


@settings(derandomize=True, deadline=None)
@given(READINGS)
def test_every_alarm_can_be_cleared_and_raised_again(readings: list[tuple[float, float]]) -> None:
    """From wherever a history ends, lasting health clears, and a lasting fault raises."""
    alarm = made()
    for probability, elapsed in readings:
        alarm.update(probability, elapsed)
    for _ in range(63):
        alarm.update(0.0, 1.0)
    assert not alarm.active
    for _ in range(8):
        alarm.update(1.0, 1.0)
    assert alarm.active


def test_the_longer_of_two_holds_raises_and_clearing_has_its_own() -> None:
    """`min_hold_s` lengthens the hold of an alarm, never shortens it, and does not delay clearing."""
    for min_s, raised_at in ((0.0, 5), (2.0, 5), (9.0, 9)):
        alarm = made()
        turned = [alarm.update(1.0, 1.0, min_s) for _ in range(12)]
        assert raised_at == turned.index("raised")
    alarm = made(clear_hold_s=3.0)
    turned = [alarm.update(1.0, 1.0) for _ in range(6)]
    turned = [alarm.update(0.0, 1.0, 1000.0) for _ in range(5)]
    assert 3 == turned.index("cleared")
