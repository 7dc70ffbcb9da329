"""Bus and receiver: missing, gone and back; what is sent and what is not."""

from __future__ import annotations

import logging
import os
import time
from itertools import pairwise
from pathlib import Path

import pytest

from tests.onboard.daemon.fakes import FakeBus, wheels_frame
from tpmsd.car.config.model import AlarmsConfig, CanConfig, GnssConfig
from tpmsd.offline.simulator.live import PtyPort
from tpmsd.onboard.daemon.bus_link import BusLink, open_can, own_filters, reset_filters
from tpmsd.onboard.daemon.receiver_link import ReceiverLink, configured_receiver, configured_stream
from tpmsd.onboard.sinks.can_frames import OutFrame
from tpmsd.onboard.sources.can.live import CanDown
from tpmsd.onboard.sources.gnss.net_live import TcpReceiver, UdpReceiver
from tpmsd.onboard.sources.gnss.serial_live import SerialReceiver
from tpmsd.onboard.sources.gnss.stream import GpsdStream, NmeaStream

LOG = logging.getLogger("tests.links")
FRAME = OutFrame(0x6F0, False, bytes(8))
CONFIG = CanConfig({}, Path("bus.dbc"))


def link_of(bus: FakeBus) -> BusLink:
    return BusLink(lambda: bus.opener()(CONFIG, None, "fake"), "CAN fake", LOG)


@pytest.mark.parametrize(
    ("config", "receiver", "stream"),
    [
        (GnssConfig(device="/dev/gnss"), SerialReceiver, NmeaStream),
        (GnssConfig(), SerialReceiver, NmeaStream),
        (GnssConfig(source="tcp://localhost:1"), TcpReceiver, NmeaStream),
        (GnssConfig(source="udp://localhost:1"), UdpReceiver, NmeaStream),
        (GnssConfig(source="gpsd://localhost"), TcpReceiver, GpsdStream),
    ],
)
def test_each_source_has_its_receiver(config: GnssConfig, receiver: type, stream: type) -> None:
    """A serial line, a stream over TCP or datagrams over UDP; gpsd alone speaks its own language."""
    assert (receiver, stream) == (type(configured_receiver(config)), type(configured_stream(config)))


@pytest.mark.parametrize(("extended", "mask"), [(False, 0x7FF), (True, 0x1FFFFFFF)])
def test_filters_let_only_the_configured_identifiers_through(extended: bool, mask: int) -> None:
    """What is sent and a request for a reset, each with all its bits; without a request no filter."""
    alarms = AlarmsConfig(alarm_id=0x123, reset_id=0x456, extended_ids=extended)
    assert [{"can_id": 0x123, "can_mask": mask, "extended": extended}] == own_filters(alarms)
    assert [{"can_id": 0x456, "can_mask": mask, "extended": extended}] == reset_filters(alarms)
    assert [] == reset_filters(AlarmsConfig())


def test_nothing_is_dropped_by_a_bus_that_was_never_open() -> None:
    """The kernel's count is zero before the first opening."""
    assert 0 == link_of(FakeBus()).dropped


def test_a_missing_bus_is_tried_again_with_growing_pauses(caplog: pytest.LogCaptureFixture) -> None:
    """Tries come after 0.2, 0.4, 0.8 ... seconds, at most 5 apart; the log has one line for all."""
    bus = FakeBus()
    bus.is_up = False
    link, now_s, tries = link_of(bus), 0.0, [0.0]
    link.service(now_s)
    while now_s < 30.0:
        now_s = link.next_try_s
        link.service(now_s)
        tries.append(now_s)

    waits = [round(later - earlier, 6) for earlier, later in pairwise(tries)]
    assert [0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0] == waits[:7]
    assert link.is_down
    assert 1 == link.downs
    assert ["CAN fake: Network is down; trying again until it is back"] == caplog.messages


def test_a_bus_that_comes_back_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    """Down counts until frames come again; then one line says so, and the next failure waits 0.2 s again."""
    caplog.set_level(logging.INFO)
    bus = FakeBus()
    link = link_of(bus)
    link.service(0.0)
    assert [] == link.read(0.1)
    assert not link.is_down

    bus.is_up = False
    assert [] == link.read(1.0)
    assert link.is_down
    bus.is_up = True
    link.service(1.2)
    assert link.is_open
    assert link.is_down
    bus.waiting = [wheels_frame(1.3)]
    assert 1 == len(link.read(1.3))

    assert not link.is_down
    assert 1 == bus.closed
    assert [
        "CAN fake: Network is down; trying again until it is back",
        "CAN fake: is back after 0.3 s",
    ] == caplog.messages
    bus.is_up = False
    link.read(2.0)
    assert 2.2 == link.next_try_s


def test_a_silent_bus_is_well_again_too() -> None:
    """A car that sleeps sends nothing: after two seconds open without an error the bus counts as back."""
    bus = FakeBus()
    bus.is_up = False
    link = link_of(bus)
    link.service(0.0)
    bus.is_up = True
    link.service(0.2)
    link.read(1.0)
    assert link.is_down
    link.read(2.3)

    assert not link.is_down


def test_error_frames_are_counted_and_kept_back() -> None:
    """Error and remote frames carry no signals: they are counted or left out."""
    bus = FakeBus()
    good = wheels_frame(1.0)
    bus.waiting = [good, good._replace(is_error=True), good._replace(is_remote=True)]
    link = link_of(bus)
    link.service(0.0)

    assert [good] == link.read(1.0)
    assert {"frames": 3, "error_frames": 1} == link.counts


def test_bus_off_is_a_bus_that_is_down_until_frames_come(caplog: pytest.LogCaptureFixture) -> None:
    """A controller that switched itself off is tried again; that it can be opened proves nothing."""
    bus = FakeBus()
    good = wheels_frame(1.0)
    bus.waiting = [good, good._replace(is_error=True, arbitration_id=0x40)]
    link = link_of(bus)
    link.service(0.0)

    assert [good] == link.read(1.0)
    assert (True, "bus-off: the controller has switched itself off") == (link.is_down, link.reason)
    link.service(1.2)
    link.read(9.0)
    assert link.is_down
    bus.waiting = [good]
    link.read(9.1)
    assert not link.is_down
    assert ["CAN fake: bus-off: the controller has switched itself off; trying again until it is back"] == [
        record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING
    ]


def test_a_restarted_controller_is_no_bus_that_is_down() -> None:
    """Where the kernel restarts the controller, frames follow the error, and nothing is reopened."""
    bus = FakeBus()
    good = wheels_frame(1.0)
    bus.waiting = [good._replace(is_error=True, arbitration_id=0x40), good]
    link = link_of(bus)
    link.service(0.0)

    assert [good] == link.read(1.0)
    assert not link.is_down


def test_a_bus_off_that_comes_again_and_again_is_said_once(caplog: pytest.LogCaptureFixture) -> None:
    """Error frames are no sign of life: one warning, and tries that grow further apart."""
    caplog.set_level(logging.INFO)
    bus = FakeBus()
    off = wheels_frame(1.0)._replace(is_error=True, arbitration_id=0x40)
    link, now_s, tries = link_of(bus), 0.0, []
    link.service(0.0)
    while now_s < 20.0:
        bus.waiting = [off]
        assert [] == link.read(now_s)
        tries.append(link.next_try_s)
        now_s = link.next_try_s
        link.service(now_s)

    assert [0.2, 0.4, 0.8, 1.6, 3.2, 5.0] == [
        round(later - earlier, 6) for earlier, later in pairwise([0.0, *tries])
    ][:6]
    assert 1 == link.downs
    assert len(tries) == link.error_counts["bus_off"]
    assert 1 == len(caplog.messages)


def test_a_controller_at_its_limit_is_reported_and_taken_back(caplog: pytest.LogCaptureFixture) -> None:
    """Error-passive is a hint in the status and a log line once a minute until error-active."""
    bus = FakeBus()
    good = wheels_frame(1.0)
    passive = good._replace(is_error=True, arbitration_id=0x04, data=bytes((0, 0x20, 0, 0, 0, 0, 130, 0)))
    active = passive._replace(data=bytes((0, 0x40, 0, 0, 0, 0, 90, 0)))
    link = link_of(bus)
    link.service(0.0)
    hints = []
    for now_s in (100.0, 101.0, 160.5):
        for error in (passive, active):
            bus.waiting = [good, error, good]
            assert [good, good] == link.read(now_s)
            hints.append(link.hint)

    assert 3 * ["error-passive: most frames are damaged (wiring, termination or bit rate)", ""] == hints
    assert {"error_passive": 3, "error_active": 3} == link.error_counts
    assert 2 == sum("error-passive" in message for message in caplog.messages)
    assert not link.is_down


def test_error_frames_of_another_backend_are_only_counted() -> None:
    """Where identifiers of error frames mean nothing that is known, nothing is read into them."""
    bus = FakeBus()
    bus.waiting = [wheels_frame(1.0)._replace(is_error=True, arbitration_id=0x44)]
    link = BusLink(lambda: bus.opener()(CONFIG, None, "fake"), "CAN fake", LOG, error_classes=False)
    link.service(0.0)
    link.read(1.0)

    assert (1, {}, False) == (link.counts["error_frames"], link.error_counts, link.is_down)


def test_a_burst_is_read_to_its_end() -> None:
    """Frames that piled up during a pause are all read at once, so that none is late for the others."""
    bus = FakeBus()
    bus.waiting = [wheels_frame(0.001 * k) for k in range(4321)]
    link = link_of(bus)
    link.service(0.0)

    assert 4321 == len(link.read(5.0))


def test_what_cannot_be_sent_is_counted(caplog: pytest.LogCaptureFixture) -> None:
    """A full queue and a bus that is down lose frames, not the daemon; each is said once."""
    bus = FakeBus()
    link = link_of(bus)
    link.send([FRAME], 0.0)
    link.service(0.0)
    link.send([FRAME], 0.1)
    bus.full = True
    link.send([FRAME, FRAME], 0.2)
    bus.full = False
    link.send([FRAME], 0.3)
    bus.is_up = False
    link.send([FRAME, FRAME], 0.4)

    assert {"sent": 2, "tx_full": 2, "tx_down": 3} == link.counts
    assert link.is_down
    assert [
        "CAN fake: the transmit queue is full: nobody acknowledges",
        "CAN fake: Network is down; trying again until it is back",
    ] == [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_frames_dropped_by_the_kernel_add_up_over_openings() -> None:
    """The kernel counts from each opening; the daemon's count goes on."""
    bus = FakeBus()
    link = link_of(bus)
    link.service(0.0)
    bus.dropped = 7
    bus.is_up = False
    link.read(0.1)
    bus.is_up, bus.dropped = True, 0
    link.service(1.0)
    bus.dropped = 2

    assert 9 == link.dropped


def test_malformed_datagrams_add_up_over_openings() -> None:
    """As the frames that the kernel dropped."""
    bus = FakeBus()
    link = link_of(bus)
    link.service(0.0)
    bus.malformed, bus.is_up = 3, False
    link.read(0.1)
    bus.is_up, bus.malformed = True, 0
    link.service(1.0)
    bus.malformed = 1

    assert 4 == link.malformed


def test_an_interface_that_is_not_there_is_a_bus_that_is_down() -> None:
    """Opening what does not exist ends in one line, whatever this machine's kernel can do."""
    with pytest.raises(CanDown, match="no-such-can"):
        open_can(CONFIG, None, "no-such-can")


def test_an_interface_that_is_up_is_not_called_down(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the interface's own flag says that it is down; what else is wrong has its own reason."""
    for up in (True, False):
        monkeypatch.setattr("tpmsd.onboard.daemon.bus_link._is_up", lambda channel, up=up: up)
        with pytest.raises(CanDown) as reported:
            open_can(CONFIG, None, "no-such-can")
        assert up == ("the interface is down" not in str(reported.value))


def receiver(device: str) -> ReceiverLink:
    return ReceiverLink(configured_receiver(GnssConfig(device)), f"receiver {device}", LOG)


def read_for(link: ReceiverLink, stamp_s: float, patience_s: float = 2.0) -> list[tuple[float, bytes]]:
    """What a link reads within a moment."""
    end_s = time.monotonic() + patience_s
    lines: list[tuple[float, bytes]] = []
    while not lines and link.is_open and time.monotonic() < end_s:
        lines = link.read(stamp_s, stamp_s)
        time.sleep(0.002)
    return lines


def test_a_sentence_bears_the_time_of_its_first_byte() -> None:
    """A sentence that comes in two pieces is stamped with the first; the next one with its own."""
    with PtyPort() as port:
        link = receiver(port.path)
        link.service(0.0)
        port.write(b"$GNRMC,first")
        time.sleep(0.02)
        assert [] == link.read(1.0, 1.0)
        port.write(b"half\r\n$GNGGA,whole\r\n$GNVTG,be")
        lines = read_for(link, 1.5)
        port.write(b"gun\r\n")
        lines += read_for(link, 1.7)
        link.close()

    assert [(1.0, b"$GNRMC,firsthalf"), (1.5, b"$GNGGA,whole"), (1.5, b"$GNVTG,begun")] == lines


def test_an_unplugged_receiver_is_found_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """When the line goes away that is said once; when it is there again, sentences come as before."""
    caplog.set_level(logging.INFO)
    device = tmp_path / "gnss"
    link = receiver(str(device))
    link.service(0.0)
    assert link.is_down
    with PtyPort(device) as port:
        link.service(0.2)
        port.write(b"$GNRMC,one\r\n")
        assert [(0.3, b"$GNRMC,one")] == read_for(link, 0.3)
        port.write(b"$GNRMC,cut")
        time.sleep(0.02)
        link.read(0.4, 0.4)
    read_for(link, 1.0)
    assert link.is_down
    assert link.fileno() is None
    with PtyPort(device) as port:
        link.service(link.next_try_s)
        port.write(b"off\r\n$GNRMC,two\r\n")
        assert [(5.0, b"$GNRMC,two")] == read_for(link, 5.0)
    assert not link.is_down
    link.close()

    assert [
        f"receiver {device}: no such device; trying again until it is back",
        f"receiver {device}: is back after 0.3 s",
        f"receiver {device}: unplugged, or its driver has failed; trying again until it is back",
        f"receiver {device}: is back after 4.0 s",
    ] == caplog.messages


def test_a_wrong_baud_rate_is_suspected_aloud(caplog: pytest.LogCaptureFixture) -> None:
    """Bytes without a sentence get one line that says what they may come from."""
    with PtyPort() as port:
        link = receiver(port.path)
        link.service(0.0)
        for round_number in range(6):
            port.write(os.urandom(600).replace(b"$", b"#"))
            time.sleep(0.01)
            link.read(float(round_number), float(round_number))
        link.close()

    assert [f"receiver {port.path}: bytes but no sentence: wrong baud rate?"] == caplog.messages
