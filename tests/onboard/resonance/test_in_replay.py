"""What a replay says of the resonance: a report beside the alarms, which it never changes."""

from __future__ import annotations

import dataclasses
import math

from tests.offline.report.drives import puncture
from tests.onboard.timeline.events import Samples
from tpmsd.offline.report.replay_document import replay_document
from tpmsd.onboard.resonance.watch import ResonanceState, ResonanceStatus
from tpmsd.onboard.sources.events import RotationSample
from tpmsd.onboard.timeline.timeline import Timeline


def test_the_timeline_shows_every_sample_once() -> None:
    """An observer sees all rotation samples, in order, and the ticks are those without it."""
    seen: list[RotationSample] = []
    watched, alone = Timeline(10.0), Timeline(10.0)
    watched.observe_rotations(Samples(seen))
    samples = [RotationSample(number * 0.01, 0, number * 0.5, 0.0, 0) for number in range(500)]
    ticks = [[tick.rotation_rad[0] for s in samples for tick in line.add(s)] for line in (watched, alone)]

    assert samples == seen
    assert len(ticks[0]) > 30
    assert ticks[0][1:] == ticks[1][1:]


def test_the_document_has_a_line_per_wheel() -> None:
    """State, reason, frequency with its standard deviation, and the log ratio; unknown numbers are null."""
    on = ResonanceStatus(ResonanceState.MONITORING, "", 36.5, 0.4, 37.5, 1.25)
    off = ResonanceStatus(ResonanceState.OFF, "sampled at 10 Hz")
    result = dataclasses.replace(puncture().record().result(1.0), resonance=(off, off, on, off))
    document = replay_document(result)["resonance"]

    assert {
        "state": "monitoring",
        "reason": "",
        "frequency_hz": 36.5,
        "std_hz": 0.4,
        "baseline_hz": 37.5,
        "log_ratio_soft": 1.25,
    } == document["rl"]
    assert "sampled at 10 Hz" == document["rr"]["reason"]
    assert document["rr"]["frequency_hz"] is None
    assert all(math.isfinite(entry["log_ratio_soft"]) for entry in document.values())


def test_where_nobody_looked_there_is_nothing() -> None:
    """A result without statuses has an empty object."""
    assert {} == replay_document(puncture().record().result(1.0))["resonance"]
