"""Links at their limits: what never ends, what is closed, and what is said when."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import pytest

from tests.onboard.daemon.fakes import FakeBus, wheels_frame
from tests.onboard.daemon.test_links import FRAME, LOG, link_of
from tpmsd.car.config.model import GnssConfig
from tpmsd.onboard.daemon.bus_link import READ_AT_ONCE, READS_AT_ONCE, _is_up
from tpmsd.onboard.daemon.link import STABLE_S, Link
from tpmsd.onboard.daemon.receiver_link import READS_AT_ONCE as RECEIVER_READS
from tpmsd.onboard.daemon.receiver_link import ReceiverLink, configured_receiver
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.gnss.gpsd_json import WATCH
from tpmsd.onboard.sources.gnss.net_live import TcpReceiver
from tpmsd.onboard.sources.gnss.serial_live import ReceiverGone, SerialReceiver

HINT = "error-passive: most frames are damaged (wiring, termination or bit rate)"
PASSIVE = wheels_frame(1.0)._replace(
    is_error=True, arbitration_id=0x04, data=bytes((0, 0x20, 0, 0, 0, 0, 130, 0))
)


@pytest.mark.parametrize(("flags", "up"), [("0x1003", True), ("0x1002", False), ("0x40c1", True), ("", True)])
def test_an_interface_is_down_by_its_lowest_flag_alone(tmp_path: Path, flags: str, up: bool) -> None:
    """IFF_UP of the kernel, hexadecimal; what cannot be read is left to the opening."""
    (tmp_path / "can7").mkdir()
    (tmp_path / "can7" / "flags").write_text(f"{flags}\n")

    assert (up, True) == (_is_up("can7", tmp_path), _is_up("can8", tmp_path))


class EndlessBus(FakeBus):
    """A bus that always has more."""

    def __init__(self) -> None:
        super().__init__()
        self.reads = 0

    def read(self, limit: int = READ_AT_ONCE) -> list[CanFrame]:
        self.reads += 1
        return [wheels_frame(1.0)] * limit


def test_a_bus_without_end_is_left_after_a_hundred_thousand_frames() -> None:
    """The loop goes on with what was read."""
    bus = EndlessBus()
    link = link_of(bus)
    link.service(0.0)

    assert 100_000 == READS_AT_ONCE * READ_AT_ONCE == len(link.read(1.0)) == link.counts["frames"]
    assert 100 == bus.reads


def test_a_queue_that_is_full_is_said_at_its_begin_and_at_its_end(caplog: pytest.LogCaptureFixture) -> None:
    """One line each way, whatever is sent in between."""
    caplog.set_level(logging.INFO)
    bus = FakeBus()
    link = link_of(bus)
    link.service(0.0)
    for bus.full in (False, True, True, False, False, True):
        link.send([FRAME, FRAME], 1.0)

    full, again = (
        "CAN fake: the transmit queue is full: nobody acknowledges",
        "CAN fake: frames are being sent again",
    )
    assert [full, again, full] == caplog.messages


def test_every_frame_for_a_bus_that_is_down_is_counted() -> None:
    """Before it was ever opened, and from the frame on at which it goes down."""
    bus = FakeBus()
    link = link_of(bus)
    link.send([FRAME] * 3, 0.0)
    assert {"tx_down": 3} == link.counts
    link.service(0.0)
    bus.is_up = False
    link.send([FRAME] * 3, 0.1)

    assert {"tx_down": 6} == link.counts


def test_a_bus_that_is_closed_is_forgotten() -> None:
    """No hint, no descriptor, another generation; it may be opened again."""
    bus = FakeBus()
    link = link_of(bus)
    link.service(0.0)
    bus.waiting = [wheels_frame(1.0), PASSIVE]
    link.read(1.0)
    assert (HINT, True, math.inf, 1) == (link.hint, link.is_open, link.next_try_s, link.generation)
    link.close()
    assert ("", False, 2, 1) == (link.hint, link.is_open, link.generation, bus.closed)
    link.close()
    assert (3, 1) == (link.generation, bus.closed)
    link.service(1.1)
    assert link.is_open


def test_a_hint_is_logged_once_in_sixty_seconds(caplog: pytest.LogCaptureFixture) -> None:
    """A controller at its limit that comes and goes: at 0, 60 and 120 s."""
    bus = FakeBus()
    link = link_of(bus)
    link.service(0.0)
    active = PASSIVE._replace(data=bytes((0, 0x40, 0, 0, 0, 0, 90, 0)))
    reported = []
    for now_s in (0.0, 59.9, 60.0, 61.0, 119.9, 120.0):
        for error in (PASSIVE, active):
            bus.waiting = [error, wheels_frame(now_s)]
            link.read(now_s)
        reported.append(len(caplog.messages))

    assert [1, 1, 2, 2, 2, 3] == reported


def test_remote_frames_alone_are_a_sign_of_life() -> None:
    """After a bus-off any frame that is no error shows that the controller takes part again."""
    bus = FakeBus()
    link = link_of(bus)
    link.service(0.0)
    bus.waiting = [wheels_frame(1.0)._replace(is_error=True, arbitration_id=0x40)]
    link.read(1.0)
    link.service(1.2)
    bus.waiting = [wheels_frame(1.3)._replace(is_remote=True)]

    assert [] == link.read(1.3)
    assert not link.is_down


def test_a_link_that_was_never_opened_is_due_at_once() -> None:
    """Neither open nor down, and not waited for."""
    link = Link("label", LOG)

    assert (False, False, -math.inf, 0, 0, "") == (
        link.is_open,
        link.is_down,
        link.next_try_s,
        link.downs,
        link.generation,
        link.reason,
    )


def test_another_reason_is_said_while_it_is_down(caplog: pytest.LogCaptureFixture) -> None:
    """The same one is not; the reason is gone once it is back."""
    caplog.set_level(logging.INFO)
    receiver = Line([])
    link = ReceiverLink(receiver, "receiver x", LOG)
    for receiver.refuses in ("no such device", "no such device", "no permission"):
        link.service(max(0.0, link.next_try_s))
    assert (1, "no permission") == (link.downs, link.reason)
    receiver.refuses = ""
    link.service(1.5)
    link.read(3.5, 3.5)

    assert "" == link.reason
    assert [
        "receiver x: no such device; trying again until it is back",
        "receiver x: still down: no permission",
        "receiver x: is back after 3.5 s",
    ] == caplog.messages


class Line:
    """A receiver's line with prepared bytes; empty ones mean that nothing is there."""

    def __init__(self, pieces: list[bytes], repeat: bytes = b"") -> None:
        self.pieces, self.repeat, self.refuses = pieces, repeat, ""
        self.reads = self.opened = self.closed = 0
        self.gone = False

    def open(self) -> None:
        if self.refuses:
            raise ReceiverGone("x", self.refuses)
        self.opened += 1

    def fileno(self) -> int:
        if self.gone:
            raise ReceiverGone("x", "gone")
        return 17

    def read(self) -> bytes:
        self.reads += 1
        return self.pieces.pop(0) if self.pieces else self.repeat

    def close(self) -> None:
        self.closed += 1


def test_a_receiver_without_end_is_left_after_64_reads() -> None:
    """The loop goes on with the lines that were completed."""
    line = Line([], b"$GNRMC,x\r\n")
    link = ReceiverLink(line, "x", LOG)
    link.service(0.0)

    assert 64 == RECEIVER_READS == len(link.read(0.0, 0.0)) == line.reads == link.sentences


def test_a_receiver_is_closed_once_and_has_a_descriptor_while_it_is_there() -> None:
    """Before and after there is none, nor if the line has just gone; each change is another generation."""
    line = Line([])
    link = ReceiverLink(line, "x", LOG)
    assert (None, 0) == (link.fileno(), link.generation)
    link.service(0.0)
    link.service(0.0)
    assert (17, 1, 1) == (link.fileno(), link.generation, line.opened)
    line.gone = True
    assert link.fileno() is None
    link.close()
    link.close()

    assert (False, 2, 1) == (link.is_open, link.generation, line.closed)


def test_a_suspicion_is_said_again_after_lines_have_come(caplog: pytest.LogCaptureFixture) -> None:
    """Once while it lasts, and once more when the line is wrong again."""
    noise, lines = b"\xf0\x81\x92\xa3" * 250, b"$GNRMC,x\r\n" * 3
    line = Line([noise, b"", noise, b"", noise, b"", lines, b"", *[noise, b""] * 3])
    link = ReceiverLink(line, "x", LOG)
    link.service(0.0)
    reported = []
    for now_s in range(7):
        link.read(float(now_s), float(now_s))
        reported.append((bool(link.hint), len(caplog.messages)))

    assert (True, 1) == reported[2]
    assert (False, 1) == reported[3]
    assert (True, 2) == reported[6]


def test_a_source_is_opened_as_it_is_configured() -> None:
    """Path and baud rate of a serial line; gpsd alone is greeted, with its WATCH."""
    serial = configured_receiver(GnssConfig(device="/dev/gnss", baud=9600))
    assert isinstance(serial, SerialReceiver)
    assert ("/dev/gnss", 9600) == (serial.device, serial.baud)
    none = configured_receiver(GnssConfig())
    assert isinstance(none, SerialReceiver)
    assert "" == none.device
    greetings = {}
    for source in ("gpsd://localhost:2947", "tcp://localhost:2947"):
        line = configured_receiver(GnssConfig(source=source))
        assert isinstance(line, TcpReceiver)
        greetings[source[:4]] = line._greeting
    assert {"gpsd": WATCH, "tcp:": b""} == greetings


def test_each_opening_and_each_failure_is_a_generation() -> None:
    """Descriptors of before are told from those of now, whatever their numbers."""
    link = Link("label", LOG)
    seen = [link.generation]
    for now_s in (0.0, 10.0):
        link._note_opened(now_s)
        seen.append(link.generation)
        link._note_failure(now_s + 1.0, "gone")
        seen.append(link.generation)

    assert [0, 1, 2, 3, 4] == seen


def test_a_link_that_was_well_again_needs_no_data_the_next_time() -> None:
    """Behind a bus-off only data shows that the bus is well; behind a plug that was pulled a quiet while
    does, also where a bus-off was before it and is over."""
    link = Link("CAN x", LOG)
    link._note_opened(0.0)
    link._note_failure(1.0, "bus-off", until_data=True)
    link._note_opened(2.0)
    link._note_working(2.0 + STABLE_S, False)
    assert link.is_down
    link._note_working(20.0, True)
    assert not link.is_down
    link._note_failure(30.0, "unplugged")
    link._note_opened(31.0)
    link._note_working(32.9, False)  # two seconds are a while
    assert link.is_down
    link._note_working(33.0, False)
    assert (False, "") == (link.is_down, link.reason)


def test_a_link_waits_from_its_failure_and_begins_with_short_pauses_again(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The pauses double up to five seconds; data ends that, and the log tells how long it was down."""
    caplog.set_level(logging.INFO)
    link = Link("label", LOG)
    waits = []
    for _ in range(7):
        link._note_failure(100.0, "gone")
        waits.append(round(link.next_try_s - 100.0, 9))
    assert [0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0] == waits
    link._note_opened(110.0)
    assert (math.inf, True, True, 1) == (link.next_try_s, link.is_open, link.is_down, link.downs)
    link._note_working(110.5, True)
    link._note_failure(200.0, "gone")

    assert (200.2, 2) == (pytest.approx(link.next_try_s), link.downs)
    down = "label: gone; trying again until it is back"
    assert [down, "label: is back after 10.5 s", down] == caplog.messages
