"""The live interface on python-can's virtual bus, and SocketCAN's packets over a socket that is alike."""

from __future__ import annotations

import select
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from tests.onboard.sources_can.build import COUNTERS_DBC, config, database, four
from tpmsd.car.config.model import CanConfig
from tpmsd.onboard.sources.can.decoder import can_filters
from tpmsd.onboard.sources.can.live import CanDown, LiveCan, unpack_socketcan

VIRTUAL = CanConfig({}, Path("bus.dbc"), interface="virtual", channel="live-test")


@pytest.fixture
def other() -> Iterator[can.BusABC]:
    """Another node of the virtual bus."""
    with can.Bus(interface="virtual", channel="live-test") as bus:
        yield bus


@pytest.fixture
def live(other: can.BusABC) -> Iterator[LiveCan]:
    """The interface under test, with the filters of four counters."""
    opened = LiveCan(VIRTUAL, can_filters(config(four("count")), database(COUNTERS_DBC)))
    yield opened
    opened.close()


def message(identifier: int, data: bytes = b"\x01", **more: bool) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False, **more)


def test_frames_are_read_without_waiting(other: can.BusABC, live: LiveCan) -> None:
    """An idle bus gives nothing at once; then frames come in order, at most as many as asked for."""
    began = time.monotonic()
    assert [] == live.read()
    assert time.monotonic() - began < 0.2

    for number in range(5):
        other.send(message(0xB0, bytes([number])))
    assert [b"\0", b"\1", b"\2"] == [frame.data for frame in live.read(3)]
    rest = live.read(3)
    assert [b"\3", b"\4"] == [frame.data for frame in rest]
    assert (0xB0, "live-test", False) == (rest[0].arbitration_id, rest[0].channel, rest[0].is_extended)
    assert time.time() == pytest.approx(rest[0].time_s, abs=5.0)


def test_unneeded_frames_do_not_hide_needed_ones(other: can.BusABC, live: LiveCan) -> None:
    """Filters hold also where the backend has none, and one call reads past all that they reject."""
    for identifier in [0x100] * 50 + [0xB0] + [0x101] * 50 + [0xB0]:
        other.send(message(identifier))
    other.send(can.Message(arbitration_id=0xB0, is_extended_id=True))

    assert [0xB0, 0xB0] == [frame.arbitration_id for frame in live.read()]


def test_error_frames_come_through(other: can.BusABC, live: LiveCan) -> None:
    """They have no identifier to filter by, and tell of the bus's health."""
    other.send(can.Message(is_error_frame=True))

    assert [True] == [frame.is_error for frame in live.read()]


def test_what_is_sent_arrives(other: can.BusABC, live: LiveCan) -> None:
    """Standard, extended and, beyond eight bytes, CAN FD frames."""
    assert live.send(0x6F0, b"\x01\x02")
    assert live.send(0x18FEF4FE, bytes(8), extended=True)
    assert live.send(0x6F1, bytes(12))
    received = [other.recv(0.0) for _ in range(3)]

    assert [(0x6F0, False, False, 2), (0x18FEF4FE, True, False, 8), (0x6F1, False, True, 12)] == [
        (m.arbitration_id, m.is_extended_id, m.is_fd, len(m.data)) for m in received if m is not None
    ]


def test_the_virtual_bus_has_no_descriptor(live: LiveCan) -> None:
    """So the caller polls."""
    assert live.fileno() is None


def test_a_closed_interface_is_down(live: LiveCan) -> None:
    """Reading, sending and closing again are all defined."""
    live.close()
    live.close()

    assert live.fileno() is None
    with pytest.raises(CanDown, match="live-test: is closed"):
        live.read()
    with pytest.raises(CanDown, match="live-test: is closed"):
        live.send(1, b"")


def test_a_bus_that_fails_is_down_with_the_reason(other: can.BusABC) -> None:
    """Whatever python-can raises becomes a CanDown, which is an OSError, of one line."""
    bus = can.Bus(interface="virtual", channel="live-test")
    live = LiveCan(VIRTUAL, bus=bus)
    bus.shutdown()

    with pytest.raises(OSError, match="CAN live-test: Cannot operate on a closed bus"):
        live.read()
    with pytest.raises(CanDown, match="CAN live-test: Cannot operate on a closed bus"):
        live.send(1, b"")


def test_a_bad_datagram_is_skipped_and_counted() -> None:
    """A datagram that holds no frame takes no bus down; what comes after it is read."""

    class Network:
        """A udp_multicast bus that hears two strangers between its frames."""

        def __init__(self) -> None:
            bad = can.CanOperationError("could not unpack received message")
            self.waiting: list[can.Message | can.CanOperationError] = [message(1), bad, bad, message(2)]

        def recv(self, timeout: float | None = None) -> can.Message | None:
            if not self.waiting:
                return None
            first = self.waiting.pop(0)
            if isinstance(first, can.CanOperationError):
                raise first
            return first

        def send(self, msg: can.Message, timeout: float | None = None) -> None: ...

        def shutdown(self) -> None: ...

        def fileno(self) -> int:
            return -1

    live = LiveCan(VIRTUAL, bus=Network())
    assert [1, 2] == [frame.arbitration_id for frame in live.read()]
    assert 2 == live.malformed


@pytest.mark.parametrize(
    ("interface", "channel"), [("nonsense", "can0"), ("socketcan", "nocan9"), ("serial", "/dev/nothing-here")]
)
def test_an_interface_that_cannot_be_opened_is_down(interface: str, channel: str) -> None:
    """A missing backend, kernel interface or device is told in one line."""
    with pytest.raises(CanDown) as caught:
        LiveCan(CanConfig({}, Path("bus.dbc"), interface=interface, channel=channel))

    assert str(caught.value).startswith(f"CAN {channel}: cannot be opened with {interface}: ")
    assert "\n" not in str(caught.value)


class FullBus:
    """A bus whose transmit queue is full."""

    def recv(self, timeout: float | None = None) -> can.Message | None:
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("Transmit buffer full")

    def shutdown(self) -> None:
        pass

    def fileno(self) -> int:
        return -1


def test_a_full_transmit_queue_is_not_a_bus_that_went_down() -> None:
    """Where nobody acknowledges, frames cannot be sent; reading goes on."""
    live = LiveCan(VIRTUAL, bus=FullBus())

    assert live.send(1, b"") is False
    assert [] == live.read()
    assert live.fileno() is None


class DatagramBus:
    """SocketCAN's socket as far as it is used here: one packet a frame, kernel time stamps, drop count.

    Loopback datagrams have the same socket options as raw CAN sockets, so this runs on any kernel.
    """

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.peer.connect(self.socket.getsockname())

    def put(self, identifier: int, data: bytes, fd: bool = False) -> None:
        packet = struct.pack("=IBBBB", identifier, len(data), 0, 0, 0) + data.ljust(64 if fd else 8, b"\0")
        self.peer.send(packet)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        raise AssertionError("the socket is read directly")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("Failed to transmit: Network is down", 100)

    def shutdown(self) -> None:
        self.socket.close()
        self.peer.close()

    def fileno(self) -> int:
        return self.socket.fileno()


@pytest.fixture
def datagrams() -> Iterator[DatagramBus]:
    bus = DatagramBus()
    yield bus
    bus.shutdown()


def test_kernel_frames_are_unpacked_with_their_time_stamps(datagrams: DatagramBus) -> None:
    """Standard, extended, remote, error and FD frames as linux/can.h lays them out; readable by select."""
    live = LiveCan(VIRTUAL, bus=datagrams)
    # The kernel begins to stamp on arrival a while after the first socket asked for it; until then the stamp
    # is that of the reading.
    for _ in range(100):
        datagrams.put(0x0B0, b"")
        time.sleep(0.03)
        if time.time() - live.read()[0].time_s > 0.02:
            break
    sent_s = time.time()
    datagrams.put(0x0B0, b"\x01\x02\x03")
    datagrams.put(0x98FEF100, b"\x04")
    datagrams.put(0x400000B1, b"")
    datagrams.put(0x20000004, bytes(8))
    datagrams.put(0x123, bytes(range(20)), fd=True)

    last_s = time.time()

    descriptor = live.fileno()
    assert descriptor is not None
    assert [descriptor] == select.select([descriptor], [], [], 5.0)[0]
    time.sleep(0.05)  # the kernel's stamps are those of arrival, not of reading
    frames = live.read()
    assert [
        (0xB0, False, False, False, False, b"\x01\x02\x03"),
        (0x18FEF100, True, False, False, False, b"\x04"),
        (0xB1, False, False, False, True, b""),
        (4, False, False, True, False, bytes(8)),
        (0x123, False, True, False, False, bytes(range(20))),
    ] == [(f.arbitration_id, f.is_extended, f.is_fd, f.is_error, f.is_remote, f.data) for f in frames]
    assert all(sent_s - 0.01 <= frame.time_s <= last_s + 0.01 for frame in frames)
    assert [] == live.read()
    assert 0 == live.dropped


def test_frames_that_the_kernel_drops_are_counted(datagrams: DatagramBus) -> None:
    """What does not fit into the receive buffer is known by number as soon as the next frame is read."""
    live = LiveCan(VIRTUAL, bus=datagrams)
    datagrams.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
    for number in range(200):
        datagrams.put(number, bytes(8))
    kept = len(live.read())
    datagrams.put(0x7FF, bytes(8))
    assert 1 == len(live.read())

    assert 0 < kept < 200
    assert 200 - kept == live.dropped


def test_the_receive_buffer_is_enlarged(datagrams: DatagramBus) -> None:
    """As far as the kernel allows."""
    before = datagrams.socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    datagrams.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
    LiveCan(VIRTUAL, bus=datagrams)

    assert before <= datagrams.socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def test_a_link_that_goes_down_is_reported_after_its_frames(datagrams: DatagramBus) -> None:
    """Frames read before the failure are handed over; the next call raises."""
    live = LiveCan(VIRTUAL, bus=datagrams)
    datagrams.put(0xB0, b"\x01")
    datagrams.peer.send(b"no frame")

    assert [0xB0] == [frame.arbitration_id for frame in live.read()]
    datagrams.socket.close()
    with pytest.raises(CanDown, match="Bad file descriptor"):
        live.read()
    with pytest.raises(CanDown, match="Network is down"):
        live.send(1, b"")


@pytest.mark.parametrize("packet", [b"", bytes(15), bytes(17), bytes(71)])
def test_a_packet_of_another_size_is_no_frame(packet: bytes) -> None:
    """Only the two sizes of linux/can.h are."""
    assert unpack_socketcan(packet, 0.0, "can0") is None


def test_a_network_bus_without_its_package_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without msgpack the line says which extra of tpmsd brings it."""

    def without(**_: object) -> None:
        raise can.CanInterfaceNotImplementedError("msgpack not installed")

    monkeypatch.setattr("can.Bus", without)
    with pytest.raises(CanDown, match=r"pip install 'tpmsd\[multicast\]'"):
        LiveCan(CanConfig({}, Path("bus.dbc"), interface="udp_multicast", channel="239.74.163.2"))
