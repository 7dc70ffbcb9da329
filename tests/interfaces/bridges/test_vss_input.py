"""Values of a databroker on a bus: subscribed to, handed on, come back to, and what is said of them."""

from __future__ import annotations

import contextlib
import logging
import signal
import threading
from collections.abc import Iterator

import can
import pytest

from tests.beside import beside
from tests.connect.servers import free_port, wait_for
from tests.interfaces.bridges.databroker import Databroker, databroker
from tpmsd.interfaces.bridges import vss_input
from tpmsd.interfaces.bridges.can_wire import CanWire, link_kind
from tpmsd.interfaces.bridges.vss_connection import DatabrokerSettings
from tpmsd.interfaces.bridges.vss_frames import VssFrame, vss_dbc
from tpmsd.interfaces.bridges.vss_input import VssInput
from tpmsd.interfaces.cli import bridge as bridge_command
from tpmsd.interfaces.cli.main import main

LOG = logging.getLogger("tests.vss")
WHEELS = [f"Vehicle.Chassis.Axle.Row{row}.Wheel.{side}.Speed" for row in (1, 2) for side in ("Left", "Right")]
FL, FR, RL, RR = WHEELS
SPEEDS = dict.fromkeys(WHEELS, "float")
PATIENCE_S = 30.0


class Wire(CanWire):
    """A bus that keeps what is put on it."""

    def __init__(self) -> None:
        super().__init__("virtual", "unused", LOG)
        self.sent: list[VssFrame] = []

    def send(self, frame: VssFrame) -> bool:
        self.sent.append(frame)
        return True


@contextlib.contextmanager
def listening(bridge: VssInput, broker: Databroker, port: int = 0) -> Iterator[None]:
    """The bridge has subscribed; at the end the databroker goes, and the bridge has noticed."""

    def work(over: threading.Event) -> None:
        while not over.is_set():
            bridge.listen()
            over.wait(0.1)

    with contextlib.ExitStack() as server:
        server.enter_context(databroker(broker, port))
        with beside(work):
            wait_for("a subscription", lambda: broker.subscribers, PATIENCE_S)
            yield
            server.close()


def kmh(frames: list[VssFrame]) -> list[tuple[int, float]]:
    """Identifier and value of frames of wheel speeds."""
    return [(frame.identifier, int.from_bytes(frame.data, "little", signed=True) * 1e-4) for frame in frames]


def bridge_to(port: int) -> tuple[VssInput, Wire]:
    wire = Wire()
    return VssInput(DatabrokerSettings("localhost", port), wire, LOG), wire


def test_what_is_written_is_handed_on_and_nothing_else(caplog: pytest.LogCaptureFixture) -> None:
    """Values that were there before are not sent, each that is written is, the same one again too; signals
    that the databroker has not are named once."""
    caplog.set_level(logging.INFO)
    port, broker = free_port(), Databroker({FL: "float", RL: "float"})
    broker.write({FL: 10.0})
    bridge, wire = bridge_to(port)
    with listening(bridge, broker, port):
        for values in ({FL: 50.0, RL: 51.0}, {FL: 50.0}, {RL: None}, {FL: 52.0}):
            broker.write(values)
        wait_for("the last", lambda: 4 <= len(wire.sent), PATIENCE_S)

    assert sorted([(0x6C0, 50.0), (0x6C2, 51.0)]) == sorted(kmh(wire.sent[:2]))
    assert [(0x6C0, 50.0), (0x6C0, 52.0)] == kmh(wire.sent[2:])
    assert {"values sent": 4, "that has no value": 1} == bridge.counts
    assert caplog.messages[0].startswith(f"not at the databroker, or not ours to read: {FR}, {RR}, ")
    assert "the databroker gives no values (" in caplog.messages[-1]


def test_a_databroker_that_was_away_is_subscribed_to_again(caplog: pytest.LogCaptureFixture) -> None:
    """After a restart values go on; that it was away is said once, as that it is back."""
    caplog.set_level(logging.INFO)
    port = free_port()
    bridge, wire = bridge_to(port)
    for speed in (50.0, 60.0):
        broker = Databroker(SPEEDS)
        with listening(bridge, broker, port):
            broker.write({FR: speed})
            wait_for("the value", lambda s=speed: (0x6C1, s) in kmh(wire.sent), PATIENCE_S)  # type: ignore[misc]

    assert [(0x6C1, 50.0), (0x6C1, 60.0)] == kmh(wire.sent)
    assert 1 == sum("the databroker gives values" == message for message in caplog.messages)


def test_a_value_that_cannot_be_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    """Of a signal that has another type there, or no number, nothing is sent; a line says so, once."""
    port, broker = free_port(), Databroker(SPEEDS | {FL: "string"})
    bridge, wire = bridge_to(port)
    with listening(bridge, broker, port):
        for text in ("50", "51"):
            broker.write({FL: text, FR: float("nan"), RL: 20.0})
        wait_for("the last", lambda: 2 <= len(wire.sent), PATIENCE_S)

    assert [(0x6C2, 20.0)] * 2 == kmh(wire.sent)
    assert [
        f"a value of {FL} is of another type or form: not sent (said once)",
        f"a value of {FR} is out of range: not sent (said once)",
    ] == sorted(message for message in caplog.messages if "not sent" in message)


def test_a_silent_subscription_is_given_up(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A connection from which nothing comes any more is ended by the bridge; one that speaks is not."""
    monkeypatch.setattr(vss_input, "SILENCE_S", 1.0)
    port, broker = free_port(), Databroker(SPEEDS)
    bridge, wire = bridge_to(port)
    with databroker(broker, port):
        thread = threading.Thread(target=bridge.listen)
        thread.start()
        wait_for("a subscription", lambda: broker.subscribers, PATIENCE_S)
        for k in range(6):
            broker.write({FL: float(k)})
            wait_for("the value", lambda k=k: len(wire.sent) > k, PATIENCE_S)  # type: ignore[misc]
            thread.join(0.25)
        assert thread.is_alive()
        thread.join(PATIENCE_S)

        assert not thread.is_alive()
    assert "the databroker gives no values (silent for 1 s); trying again" == caplog.messages[-1]


def test_a_subscription_that_ends_in_order_is_said(caplog: pytest.LogCaptureFixture) -> None:
    """A databroker that ends a subscription without an error is one that gives no values."""
    broker = Databroker(SPEEDS)
    broker.ends_subscriptions = True
    with databroker(broker) as port:
        bridge_to(port)[0].listen()

    assert ["the databroker gives no values (it has ended the subscription); trying again"] == caplog.messages


def test_a_databroker_without_wheels_is_no_source(caplog: pytest.LogCaptureFixture) -> None:
    """A position alone is of no use, and that is said."""
    with databroker(Databroker({"Vehicle.CurrentLocation.Latitude": "double"})) as port:
        bridge_to(port)[0].listen()

    assert "the databroker has no wheel speed; trying again" == caplog.messages[-1]


def test_frames_go_on_a_bus_that_comes_late(caplog: pytest.LogCaptureFixture) -> None:
    """While the bus cannot be opened frames are lost and that is said once; python-can reads what is sent."""
    wire = CanWire("no-such-backend", "x", LOG)
    assert not wire.send(VssFrame(0x6C0, b"1234"))
    assert not wire.send(VssFrame(0x6C0, b"1234"))
    assert 1 == len(caplog.messages)
    wire = CanWire("virtual", "tests.vss", LOG)
    with can.Bus(interface="virtual", channel="tests.vss") as ear:
        assert wire.send(VssFrame(0x6C1, b"1234"))
        received = ear.recv(5.0)
    wire.close()

    assert received is not None
    assert (0x6C1, b"1234", False) == (received.arbitration_id, bytes(received.data), received.is_extended_id)


def test_only_virtual_interfaces_are_written_to(capsys: pytest.CaptureFixture[str]) -> None:
    """A SocketCAN interface that exists and is no vcan is refused; `lo` stands for hardware here."""
    assert ("", None) == (link_kind("lo"), link_kind("nosuch0"))
    assert 2 == main(["bridge", "vss", "--databroker", "localhost", "--input", "lo"])
    assert "lo is no virtual CAN interface" in capsys.readouterr().err


def test_the_dbc_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    """`--print-dbc` needs nothing else, and prints the file as it is."""
    assert 0 == main(["bridge", "vss", "--print-dbc"])
    assert vss_dbc() == capsys.readouterr().out


def test_a_signal_while_a_frame_is_sent_is_no_failure_of_the_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    """SIGTERM comes in the middle of a send: it ends the bridge, and the bus is not taken for lost."""
    wire = CanWire("virtual", "tests.vss", LOG)
    wire.open()
    monkeypatch.setattr(
        can.interfaces.virtual.VirtualBus, "send", lambda *_: signal.raise_signal(signal.SIGTERM)
    )

    with pytest.raises(bridge_command._Stop), bridge_command._until_signalled(None):
        wire.send(VssFrame(1, b"1"))
    wire.close()
