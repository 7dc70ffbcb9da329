"""The host's clock is set, and the processor is taken away: no alarm is lost, none is false."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest

from tests.faults.drives import FOUND, Item, played
from tests.onboard.daemon.fakes import DrivingBus, LeapingClock, car, listening
from tpmsd.onboard.pipeline import Step

pytestmark = pytest.mark.usefixtures("method")

DECADES_S = 20 * 365.25 * 86400.0


@pytest.mark.parametrize("step_s", [-3600.0, 3600.0, -DECADES_S, DECADES_S, "from 1970"])
def test_a_clock_that_is_set_costs_three_ticks(step_s: float | str) -> None:
    """At second 75 of the drive all stamps step by an hour, by decades, or from 1970 to today: told, half a
    second of rotation lost at most, none false."""

    def stepped(items: list[Item], start_s: float) -> list[Item]:
        after_s = step_s if isinstance(step_s, float) else 0.0
        before_s = 0.0 if isinstance(step_s, float) else 30.0 - start_s
        return [
            i._replace(time_s=i.time_s + (after_s if i.time_s - start_s > 75.0 else before_s)) for i in items
        ]

    outcome = played(stepped)

    assert FOUND == outcome.alarms
    assert outcome.blind(0.0, 1e9) <= 0.6
    if isinstance(step_s, str):
        step_s = outcome.start_s - 30.0
    if step_s < 0.0:
        assert 1 == outcome.faults[("clock", "step_back")]
        assert outcome.counts["clock_step"] >= 4
    else:
        assert step_s - 5.0 < max(step.tick.gap_s for step in outcome.steps) < step_s + 1.0
    lost_s = 150.0 - sum(step.tick.dt_s for step in outcome.steps)
    assert lost_s < 2.0


@pytest.mark.parametrize("without_s", [5.0, 59.0])
def test_seconds_without_the_processor_lose_no_frame(tmp_path: Path, without_s: float) -> None:
    """What the kernel kept is read afterwards with its own stamps: every tick is made, none is blind."""
    config, database = car(tmp_path)
    clock = LeapingClock()
    steps: list[Step] = []

    def watch(step: Step) -> None:
        steps.append(step)
        if len(steps) == 30:
            clock.leapt_s += without_s

    daemon = listening(
        config, database, clock, DrivingBus(clock.now).opener(), watch, log=logging.getLogger("tests.faults")
    )
    daemon.run(20.0 + without_s)

    times = np.array([step.tick.time_s for step in steps])
    assert np.allclose(0.1, np.diff(times), atol=1e-6)
    assert 0.0 == max(step.tick.gap_s for step in steps)
    assert all(np.all(np.isfinite(step.tick.rotation_rad)) for step in steps[20:-1])
    assert 10 * without_s - 2 <= daemon.document()["missed_deadlines"] <= 10 * without_s + 2
    assert 0 == daemon.document()["can"]["faults"].get("too_late", 0)
