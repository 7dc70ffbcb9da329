"""Frames that the daemon sends beside its alarms: for which bus, when, and what is said of them."""

from __future__ import annotations

import logging
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tests.onboard.daemon.fakes import car, wheels_frame
from tests.onboard.daemon.test_obd import ANSWER, may_ask
from tpmsd.car.config.load import load_config
from tpmsd.onboard.daemon.own_frames import OwnFrames
from tpmsd.onboard.pipeline import Step
from tpmsd.onboard.sources.can.decoder import load_database

LOG = logging.getLogger("tests.own_frames")
ANSWERS = wheels_frame(1.0)._replace(arbitration_id=ANSWER, data=bytes.fromhex("03410d48aaaaaaaa"))


def own(folder: Path, obd: str = "speed = true", more: str = "") -> OwnFrames:
    """The frames of a car with the buses 0 and 1, which is asked for its speed."""
    car(folder, '[can.buses]\nbody = "second"\n' + more)
    config = load_config(may_ask(folder, obd, "[0x7DF, 0x3D1]"))
    return OwnFrames(config, load_database(config.can.dbc), LOG)


def at(speed_mps: float) -> Step:
    """A step whose estimate is of this speed."""
    return cast(Step, SimpleNamespace(estimate=SimpleNamespace(speed_mps=speed_mps)))


@pytest.mark.parametrize(("bus", "number"), [("", 0), ('\nbus = "body"', 1)])
def test_answers_count_on_the_bus_that_is_asked_alone(tmp_path: Path, bus: str, number: int) -> None:
    """Filters, requests and answers are of one bus; the other is neither asked nor heard."""
    frames = own(tmp_path, f"speed = true{bus}")
    assert [2, 0] == [len(frames.filters(one)) for one in (number, 1 - number)]
    frames.received(number, [wheels_frame(1.0)], 0.0)
    frames.received(1 - number, [ANSWERS], 1.0)
    assert 0 == frames.status({})["obd"]["answered"]
    frames.received(number, [ANSWERS], 3.0)
    assert (1, 72) == tuple(frames.status({})["obd"][key] for key in ("answered", "speed_kmh"))
    assert {number: 1} == {bus: len(sent) for bus, sent in frames.speed_request(3.0, None).items()}


@pytest.mark.parametrize(("last", "asked"), [(None, 0), (at(2.0), 0), (at(2.01), 1)])
def test_a_car_moves_beyond_two_metres_a_second(tmp_path: Path, last: Step | None, asked: int) -> None:
    """A minute after the bus woke up only one that moves is asked."""
    frames = own(tmp_path)
    for now_s in range(0, 101, 10):
        frames.received(0, [wheels_frame(float(now_s))], float(now_s))

    assert asked == len(frames.speed_request(100.0, last)[0])


def test_a_tester_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A warning with the reason; of frames of others there is none."""
    frames = own(tmp_path)
    caplog.clear()
    request = ANSWERS._replace(arbitration_id=0x7DF)
    frames.received(0, [wheels_frame(1.0), request, request, ANSWERS], 1.0)

    assert ["[obd] the car is asked no more: another node sends 0x7DF"] == caplog.messages
    assert 1 == frames.status({})["obd"]["answered"]


def test_the_status_says_what_is_configured(tmp_path: Path) -> None:
    """Nothing without outputs and questions; else the counts with what the monitor makes of the answers."""
    nothing = own(tmp_path / "0", "speed = false")
    assert ({}, [], []) == (
        nothing.status({"wheels_agree": True}),
        nothing.filters(0),
        nothing.speed_request(9.0, None)[0],
    )
    nothing.received(0, [ANSWERS], 1.0)
    assert {} == nothing.status({})
    status: dict[str, Any] = own(tmp_path / "1").status({"wheels_agree": True})
    assert ["obd"] == list(status)
    assert status["obd"]["wheels_agree"]
