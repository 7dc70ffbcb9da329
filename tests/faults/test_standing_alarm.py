"""An alarm is active while one fault after the other befalls bus, receiver, clock and daemon."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest

from tests.faults.drives import Item, drive, with_method
from tpmsd.onboard.monitor.records import AlarmKind
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame

STANDS_S = 130.0
"""The loss of second 105 has been reported by then."""
SILENT_S = (135.0, 165.0)
DARK_S = (175.0, 205.0)
SET_S, SET_BY_S = 215.0, 3600.0
RESTARTED_S = 230.0
END_S = 320.0


def _received(items: tuple[Item, ...]) -> Iterator[Item]:
    """What is left of the drive: no frame for 30 s, no fix for 30 s, a clock that is set by an hour."""
    start_s = items[0].time_s
    for item in items:
        at_s = item.time_s - start_s
        frame = isinstance(item, CanFrame)
        silent, dark = (a <= at_s < b for a, b in (SILENT_S, DARK_S))
        if not (silent if frame else dark):
            yield item._replace(time_s=item.time_s + (SET_BY_S if at_s >= SET_S else 0.0))


@pytest.fixture(scope="module")
def steps(method: str) -> list[Step]:
    """The steps from the time on at which the alarm is active."""
    config, items = drive(duration_s=END_S)
    config = with_method(config)
    database = load_database(config.can.dbc)
    pipeline, restarted = Pipeline(config, database), False
    start_s, out = items[0].time_s, []
    for item in _received(items):
        if not restarted and item.time_s - start_s - SET_BY_S >= RESTARTED_S:
            saved, restarted = json.loads(json.dumps(pipeline.snapshot())), True
            pipeline = Pipeline(config, database)
            pipeline.restore(saved)
        if isinstance(item, CanFrame):
            out += pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
        else:
            out += pipeline.on_sentence(item.time_s, item.line)
    assert restarted
    return [step for step in out + pipeline.finish() if step.tick.host_time_s - start_s >= STANDS_S]


def test_an_alarm_that_stood_stands_through_every_fault(steps: list[Step]) -> None:
    """Bus silence, GNSS outage, a clock set by an hour and a restart: the deflation is in every report."""
    without = [
        step.tick.host_time_s - steps[0].tick.host_time_s
        for step in steps
        if (AlarmKind.DEFLATION, "rl") not in [(alarm.kind, alarm.wheel) for alarm in step.report.active]
    ]
    assert [] == without


def test_no_fault_names_another_wheel_or_clears(steps: list[Step]) -> None:
    """Tyre alarms neither come nor go by a fault: of all events none is of another wheel, none clears."""
    said = [
        (str(event.kind), event.wheel, event.state)
        for step in steps
        for event in step.report.events
        if event.kind is not AlarmKind.MALFUNCTION
    ]
    assert [] == [one for one in said if one[1] != "rl" or one[2] != "raised"]
