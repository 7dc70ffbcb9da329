"""The JSON document: the public format, and nothing that JSON does not know."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from tests.offline.report.drives import MONITOR, OFFSET_M, START_S, VEHICLE, Drive, alarm, puncture
from tpmsd.offline.report.replay_document import replay_document
from tpmsd.offline.report.replay_recorder import ReplayRecorder
from tpmsd.onboard.monitor.records import AlarmKind, WheelState

STATES = {"unavailable", "learning", "monitoring", "alarm"}
KINDS = {"radius_deviation", "deflation", "malfunction"}


def through_json(drive: Drive, elapsed_s: float = 2.0) -> dict[str, Any]:
    """What a program reads that parses the file strictly."""
    text = json.dumps(replay_document(drive.record().result(elapsed_s)), allow_nan=False)
    document: dict[str, Any] = json.loads(text)
    return document


def test_the_document_has_the_public_keys_with_numbers() -> None:
    """Every key of the public format is there, of the right type, for every wheel and alarm."""
    document = through_json(puncture())

    assert isinstance(document["duration_s"], float)
    assert isinstance(document["realtime_factor"], float)
    assert ["fl", "fr", "rl", "rr"] == list(document["wheels"])
    for wheel in document["wheels"].values():
        assert isinstance(wheel["deviation_mm"], float)
        assert isinstance(wheel["std_mm"], float)
        assert wheel["state"] in STATES
    for entry in document["alarms"]:
        assert isinstance(entry["time"], float)
        assert isinstance(entry["deviation_mm"], float)
        assert entry["kind"] in KINDS
        assert entry["wheel"] in document["wheels"]
        assert entry["state"] in {"raised", "cleared"}


def test_numbers_are_those_of_the_drive() -> None:
    """Millimetres, seconds and host times of a puncture known in closed form."""
    document = through_json(puncture(), 2.5)

    assert 600.0 == pytest.approx(document["duration_s"], abs=1e-5)
    assert 240.0 == pytest.approx(document["realtime_factor"])
    assert (OFFSET_M[2] - 0.0022) * 1e3 == pytest.approx(document["wheels"]["rl"]["deviation_mm"])
    assert -2.2 == pytest.approx(document["wheels"]["rl"]["change_mm"])
    assert 0.3142 == pytest.approx(document["wheels"]["rl"]["radius_m"])
    assert "alarm" == document["wheels"]["rl"]["state"]
    (entry,) = document["alarms"]
    assert ("deflation", "rl", "raised") == (entry["kind"], entry["wheel"], entry["state"])
    assert START_S + 341.2 == entry["time"]
    assert 341.2 == pytest.approx(entry["drive_time_s"], abs=1e-5)
    assert -1.11 == pytest.approx(entry["deviation_mm"])
    assert document["alarms"] == document["active_alarms"]
    assert {"can lost": 21, "gnss checksum": 1} == document["faults"]


def test_wheels_that_never_were_on_the_bus_are_named_apart() -> None:
    """A car with the rear pair alone has two wheels in the document, and two that are unavailable."""
    document = through_json(
        Drive(
            duration_s=90.0,
            state=lambda t, wheel: WheelState.MONITORING if wheel[0] == "r" else WheelState.UNAVAILABLE,
        )
    )

    assert ["rl", "rr"] == list(document["wheels"])
    assert ["fl", "fr"] == document["unavailable"]


def test_what_nobody_knows_is_null() -> None:
    """NaN and infinity become null, so that a strict parser reads the file."""
    lamp = alarm(12.0, AlarmKind.MALFUNCTION, None, deviation_m=math.nan)
    document = through_json(Drive(duration_s=20.0, events={120: (lamp,)}), math.nan)

    assert document["realtime_factor"] is None
    assert document["wheels"]["fl"]["change_mm"] is None
    assert document["wheels"]["fl"]["monitored_from"] is None
    assert document["alarms"][0]["deviation_mm"] is None
    assert document["alarms"][0]["wheel"] is None


def test_an_empty_drive_has_a_document() -> None:
    """No tick at all gives a document without wheels and alarms."""
    document = replay_document(ReplayRecorder("empty", VEHICLE, MONITOR).result(math.nan))

    json.dumps(document, allow_nan=False)
    assert ({}, [], 0.0) == (document["wheels"], document["alarms"], document["duration_s"])
    assert document["pose"] is None
