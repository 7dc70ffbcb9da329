"""A receiver that needs most of a second to say one epoch."""

from __future__ import annotations

import pytest

from tpmsd.onboard.sources.events import GnssFix, RotationSample
from tpmsd.onboard.timeline.tick import Fix, Tick
from tpmsd.onboard.timeline.timeline import Timeline

SPOKEN_S = 0.85
"""From the first sentence of an epoch to the end of its burst: 9600 baud with many satellites in view."""


def _drive(timeline: Timeline, seconds: int) -> list[Tick]:
    """Wheels at 50 Hz; a fix each second that is handed over when its burst is over."""
    ticks: list[Tick] = []
    for step in range(seconds * 50):
        now = 1000.0 + step / 50
        for wheel in range(4):
            ticks += timeline.add(RotationSample(now, wheel, 40.0 * step / 50, 0.1, 0))
        since = (step / 50) % 1.0
        if abs(since - SPOKEN_S) < 0.011 and step > 50:
            arrival = now - SPOKEN_S
            north = 52.0 + (arrival - 1000.0) * 1e-4
            ticks += timeline.add(
                GnssFix(arrival, 1.7e9 + arrival - 0.05, north, 13.0, 50.0, 1, 1.0, 1.5, 11.1, 0.0)
            )
    return ticks


def test_a_late_epoch_is_no_step_of_the_clock() -> None:
    """The fix bears the time of its first sentence, older than what the bus said since."""
    timeline = Timeline(10.0)
    _drive(timeline, 30)
    assert timeline.counts["clock_steps"] == 0


def test_the_holdback_grows_to_what_the_receiver_needs() -> None:
    """After the first epochs every fix finds its tick, at the time at which it was valid."""
    timeline = Timeline(10.0)
    ticks = _drive(timeline, 40)
    fixes: list[Fix] = [fix for tick in ticks for fix in tick.fixes]
    assert timeline.counts["late_fixes"] <= 2
    assert len(fixes) >= 35
    for tick in ticks:
        for fix in tick.fixes:
            assert tick.time_s - tick.dt_s <= fix.time_s <= tick.time_s
            assert fix.time_s % 1.0 == pytest.approx(0.0, abs=0.03) or fix.time_s % 1.0 > 0.97


def test_a_fast_receiver_keeps_the_short_holdback() -> None:
    """Ticks come half a second late, not more, where the receiver says an epoch at once."""
    timeline = Timeline(10.0)
    last = 0.0
    for step in range(1000):
        now = 1000.0 + step / 50
        ticks = timeline.add(RotationSample(now, 2, 40.0 * step / 50, 0.1, 0))
        if step % 50 == 0:
            ticks += timeline.add(GnssFix(now, 1.7e9 + now, 52.0, 13.0, 50.0, 1, 1.0, 1.5, 0.0, 0.0))
        last = ticks[-1].time_s if ticks else last
    assert now - last < 0.6


def test_the_tick_that_waits_is_due_when_the_longer_holdback_is_over() -> None:
    """From the fix on that made the holdback grow, ticks come that much behind their ends, and no later."""
    timeline = Timeline(10.0)
    ticks = _drive(timeline, 3)
    now_s = 1003.0
    before = len(ticks)
    while len(ticks) == before:
        now_s += 1.0 / 1024.0
        ticks += timeline.advance(now_s)
    late_s = now_s - ticks[-1].time_s

    assert len(ticks) == before + 1
    assert late_s == pytest.approx(timeline.due_s - ticks[-1].time_s - 0.1, abs=2.0 / 1024.0)
    grown = Timeline(10.0)
    for step in range(100):
        grown.add(RotationSample(1000.0 + step / 50, 2, step / 50, 0.1, 0))
    end_s = grown.due_s
    grown.add(GnssFix(1001.3, 1.7e9 + 1001.25, 52.0, 13.0, 50.0, 1, 1.0, 1.5, 0.0, 0.0))
    assert 0.05 < grown.due_s - end_s < 0.4
