"""Real drives from end to end: believable radii, the public JSON, and no alarm of any kind."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tpmsd.car.config.load import load_config
from tpmsd.interfaces.cli.replay import replay
from tpmsd.offline.report.replay_document import replay_document
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.onboard.monitor.records import WheelState

DRIVES = ("rav4-suburb-60s", "van-motorway-a", "van-motorway-b", "van-oval")


@pytest.fixture(scope="module", params=["gaussian-sum", "mpf-pn"])
def method(request: pytest.FixtureRequest) -> str:
    """The filter."""
    name: str = request.param
    return name


@pytest.fixture(scope="module", params=DRIVES)
def result(request: pytest.FixtureRequest, recordings: Path, method: str) -> ReplayResult:
    """A recording, replayed once per filter for all tests of it."""
    config = load_config(recordings / request.param)
    return replay(recordings / request.param, replace(config, filter=replace(config.filter, method=method)))


@pytest.fixture(scope="module")
def document(result: ReplayResult) -> dict[str, Any]:
    """What `tpmsd replay --json` says of it."""
    found: dict[str, Any] = json.loads(json.dumps(replay_document(result), allow_nan=False))
    return found


def test_the_document_is_the_public_one(document: dict[str, Any]) -> None:
    """The keys and types of the public format are there, for the wheels that the bus has."""
    wheels = {"rl", "rr"} if document["drive"].startswith("van") else {"fl", "fr", "rl", "rr"}
    assert wheels == set(document["wheels"])
    for entry in document["wheels"].values():
        assert isinstance(entry["deviation_mm"], float)
        assert isinstance(entry["std_mm"], float)
        assert entry["std_mm"] > 0.0
        assert entry["state"] in set(WheelState)
    assert isinstance(document["alarms"], list)
    assert document["realtime_factor"] > 1.0  # on a machine that does much else; 38 and more alone


def test_nothing_was_wrong_with_the_car(document: dict[str, Any]) -> None:
    """No pressure was changed and no sensor failed in any of these drives: no alarm of any kind."""
    assert [] == document["alarms"]
    assert [] == document["active_alarms"]


def test_every_drive_ends_monitored(document: dict[str, Any]) -> None:
    """Each drive is long enough to learn a baseline, and each of its wheels is monitored at the end."""
    assert {"monitoring"} == {entry["state"] for entry in document["wheels"].values()}


def test_duration_and_distance(document: dict[str, Any]) -> None:
    """The drive is as long as its log, and its way what the vehicle's speeds allow."""
    seconds = {"rav4-suburb-60s": 60, "van-motorway-a": 569, "van-motorway-b": 590, "van-oval": 175}
    metres = {"rav4-suburb-60s": 1015, "van-motorway-a": 12_880, "van-motorway-b": 12_880, "van-oval": 1790}
    assert seconds[document["drive"]] == pytest.approx(document["duration_s"], abs=2.0)
    assert metres[document["drive"]] == pytest.approx(document["distance_m"], rel=0.01)


def test_radii_are_believable(document: dict[str, Any]) -> None:
    """The van rolls on 310 to 320 mm, left and right within 4 mm of each other; the other car, whose speeds
    hold its maker's radius, on 345 to 350 mm."""
    radii = {wheel: 1e3 * entry["radius_m"] for wheel, entry in document["wheels"].items()}
    if document["drive"].startswith("van"):
        assert all(310.0 < radius < 320.0 for radius in radii.values())
        assert abs(radii["rl"] - radii["rr"]) < 4.0
    else:
        assert all(345.0 < radius < 350.0 for radius in radii.values())
        assert max(radii.values()) - min(radii.values()) < 1.5


def test_radii_are_known_while_there_is_something_to_learn(result: ReplayResult) -> None:
    """At the last informative tick each wheel is known to a millimetre; a car park tells nothing."""
    last = int(np.flatnonzero(result.informative)[-1])
    std_m = result.std_m[last]
    assert all(std_m[np.isfinite(std_m)] < 1e-3)
    assert np.isfinite(std_m).sum() >= 2


def test_the_vans_tyres_are_equal_on_the_motorway(result: ReplayResult) -> None:
    """At the end of the motorway (the last time above 20 m/s) left and right differ by less than 2 mm; the
    filter is sure of each to a millimetre."""
    if not result.drive.startswith("van-motorway"):
        return
    fast = result.speed_mps > 20.0
    assert fast.sum() > 100
    left, right = result.deviation_m[fast, 2][-1], result.deviation_m[fast, 3][-1]
    assert abs(left - right) < 2e-3
    assert all(result.std_m[fast, wheel][-1] < 1e-3 for wheel in (2, 3))
