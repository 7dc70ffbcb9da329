"""Soft tyres as signals of the VSS, at a gRPC server made of the package's own protocol files."""

from __future__ import annotations

import logging
import socket
import time
from typing import Any

import pytest

from tests.interfaces.bridges.databroker import Databroker, databroker
from tests.interfaces.bridges.documents import WHEEL, alarm, document
from tpmsd.interfaces.bridges.summary import summarise
from tpmsd.interfaces.bridges.vss import VssBridge, pressure_low
from tpmsd.interfaces.bridges.vss_connection import RETRY_S, DatabrokerSettings
from tpmsd.interfaces.bridges.vss_names import IS_PRESSURE_LOW

LOG = logging.getLogger("tests.vss")
PATHS = list(IS_PRESSURE_LOW.values())


def wheels(state: str) -> dict[str, Any]:
    return {name: WHEEL | {"state": state} for name in ("fl", "fr", "rl", "rr")}


@pytest.mark.parametrize(
    ("said", "low"),
    [
        (document(), [False] * 4),
        (document(alarm(wheel="fr")), [False, True, False, False]),
        (document(alarm("slow_leak", "rl")), [False, False, True, False]),
        (document(alarm("radius_deviation", "rl")), [False] * 4),
        (document(alarm("malfunction", "rr")), [False, False, False, None]),
        (document(wheels=wheels("learning")), [None] * 4),
        (document(alarm(wheel="fl"), wheels=wheels("unavailable")), [True, None, None, None]),
    ],
)
def test_what_is_low(said: dict[str, Any], low: list[bool | None]) -> None:
    """An alarm of lost air is low, a wheel that is monitored without one is not, any other is not known."""
    assert low == list(pressure_low(summarise(said)).values())


def test_names_are_those_of_the_specification() -> None:
    """Row 1 is the front axle; one signal for each wheel."""
    assert "Vehicle.Chassis.Axle.Row1.Wheel.Left.Tire.IsPressureLow" == IS_PRESSURE_LOW["fl"]
    assert "Vehicle.Chassis.Axle.Row2.Wheel.Right.Tire.IsPressureLow" == IS_PRESSURE_LOW["rr"]
    assert 4 == len(set(PATHS))


def test_values_are_written_when_they_change_and_every_period() -> None:
    """Four values at first, one for an alarm, four again after the period; without a daemon none is known."""
    broker = Databroker()
    with databroker(broker) as port:
        bridge = VssBridge(DatabrokerSettings("localhost", port), LOG, period_s=10.0)
        bridge.step(document(), 0.0)
        bridge.step(document(), 1.0)
        assert [(path, False) for path in PATHS] == broker.written
        bridge.step(document(alarm()), 2.0)
        assert (PATHS[2], True) == broker.written[4]
        bridge.step(document(alarm()), 10.0)
        assert 9 == len(broker.written)
        bridge.step(document() | {"time": None}, 11.0)
        assert [False, False, True, False] == broker.by_wheel()
        bridge.step(None, 12.0)
        assert [None] * 4 == broker.by_wheel()
        bridge.run([document()])
    assert [None] * 4 == broker.by_wheel()


def test_a_databroker_that_was_away_receives_all(caplog: pytest.LogCaptureFixture) -> None:
    """While nobody answers that is said once; afterwards all values are there, an alarm of the time between
    too."""
    caplog.set_level(logging.INFO)
    with socket.create_server(("localhost", 0)) as probe:
        port = probe.getsockname()[1]
    bridge = VssBridge(DatabrokerSettings("localhost", port), LOG)
    bridge.step(document(alarm()), 0.0)
    bridge.step(document(alarm()), 2.0)
    now_s, broker, began_s = 4.0, Databroker(), time.monotonic()
    with databroker(broker, port):
        while len(broker.written) < 4 and time.monotonic() < began_s + 30.0:
            now_s += RETRY_S
            bridge.step(document(alarm(), alarm(wheel="fl")), now_s)
            time.sleep(0.05)
    assert [True, False, True, False] == broker.by_wheel()
    assert "the databroker does not take values (unavailable); trying again" == caplog.messages[0]
    assert "the databroker takes values again" == caplog.messages[-1]


def test_a_signal_that_is_not_in_the_specification_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    """A databroker that has only one of the signals gets that; each of the others is named once."""
    broker = Databroker({PATHS[3]: "bool"})
    with databroker(broker) as port:
        bridge = VssBridge(DatabrokerSettings("localhost", port), LOG)
        for now_s in (0.0, 20.0):
            bridge.step(document(alarm(wheel="rr")), now_s)
    assert [(PATHS[3], True)] * 2 == broker.written
    assert [f"the databroker does not know {path}: left out" for path in PATHS[:3]] == caplog.messages


def test_a_token_is_sent_and_a_missing_one_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    """A databroker that asks for a token takes values with it, and refuses them without."""
    broker = Databroker(token="s3cret")
    with databroker(broker) as port:
        VssBridge(DatabrokerSettings("localhost", port), LOG).step(document(), 0.0)
        assert [] == broker.written
        VssBridge(DatabrokerSettings("localhost", port, token="s3cret"), LOG).step(document(), 0.0)
    assert 4 == len(broker.written)
    assert ["the databroker does not take values (unauthenticated); trying again"] == caplog.messages
