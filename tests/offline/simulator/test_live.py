"""The live player: what is sent, when, and how it ends."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
import serial

from tests.offline.simulator.drives import straight
from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.offline.simulator.drive import DriveSpec, SimulatedDrive, simulate_drive
from tpmsd.offline.simulator.live import LivePlayer, PtyPort
from tpmsd.offline.simulator.receiver import ReceiverSpec

_channels = itertools.count()


@pytest.fixture(scope="module")
def drive() -> SimulatedDrive:
    """Ten seconds on a straight."""
    return simulate_drive(DriveSpec(receiver=ReceiverSpec(rate_hz=5.0)), straight(20.0, 10.0))


@pytest.fixture
def buses() -> Iterator[tuple[can.BusABC, can.BusABC]]:
    """Two ends of a virtual bus that keeps the senders' time stamps."""
    channel = f"live-{next(_channels)}"
    with (
        can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) as near,
        can.Bus(interface="virtual", channel=channel) as far,
    ):
        yield near, far


def received(bus: can.BusABC) -> list[can.Message]:
    """All frames that wait."""
    return list(iter(lambda: bus.recv(0), None))


def test_every_frame_and_sentence_is_played_in_order(
    drive: SimulatedDrive, buses: tuple[can.BusABC, can.BusABC]
) -> None:
    """Frames carry the drive's host time; the terminal's reader gets every sentence, CR LF and all."""
    near, far = buses
    got: list[bytes] = []
    with PtyPort() as port:
        reader = serial.Serial(port.path, 115200, timeout=0.5)
        collect = threading.Thread(target=lambda: got.extend(reader.readline() for _ in drive.nmea))
        collect.start()
        stats = LivePlayer(drive, near, port, speedup=20.0).play()
        collect.join(5.0)
        reader.close()
    frames = received(far)

    assert (len(drive.frames), len(drive.nmea), 0) == (stats.frames, stats.sentences, port.dropped_bytes)
    assert drive.frames.time_s.tolist() == [frame.timestamp for frame in frames]
    assert [row.tobytes() for row in drive.frames.data] == [bytes(frame.data) for frame in frames]
    assert [line.text.encode() + b"\r\n" for line in drive.nmea] == got


def test_the_pace_is_that_of_the_drive_times_the_speed_up(
    drive: SimulatedDrive, buses: tuple[can.BusABC, can.BusABC]
) -> None:
    """Ten seconds at twentyfold take half a second, by deadlines that do not add up their delays."""
    begin = time.monotonic()
    LivePlayer(drive, buses[0], speedup=20.0).play()

    assert 0.49 <= time.monotonic() - begin < 1.0


def test_the_players_clock_is_the_drives_host_clock(
    drive: SimulatedDrive, buses: tuple[can.BusABC, can.BusABC]
) -> None:
    """Before playing it stands at the start; then it runs at the speed-up, on the monotonic clock given."""
    seconds = iter([100.0] + [1e9] * 10_000)
    player = LivePlayer(drive, buses[0], speedup=4.0, monotonic=lambda: next(seconds))
    start = drive.spec.clocks.start_utc_s

    assert start == player.now()
    player.play()
    assert pytest.approx(start + 4.0 * (1e9 - 100.0)) == player.now()


def test_a_player_that_was_held_up_sends_what_is_current(
    drive: SimulatedDrive, buses: tuple[can.BusABC, can.BusABC]
) -> None:
    """Half a second away: of each message the newest frame due by then; all others before and after."""
    near, far = buses
    times, ids = drive.frames.time_s, drive.frames.frame_id
    start_s = drive.spec.clocks.start_utc_s
    gone_s, back_s = 3.0, 3.5
    now_s = 0.0

    def monotonic() -> float:
        """Passes with every look, and jumps once."""
        nonlocal now_s
        now_s = back_s if gone_s < now_s < back_s else now_s + 2e-4
        return now_s

    player = LivePlayer(drive, near, monotonic=monotonic, newest_only=True)
    player._stop.wait = lambda timeout=None: False  # type: ignore[method-assign]
    stats = player.play()
    sent = [(frame.timestamp - start_s, frame.arbitration_id) for frame in received(far)]
    due = list(zip((times - start_s).tolist(), ids.tolist(), strict=True))
    held_up = [one for one in due if gone_s + 1e-3 < one[0] < back_s - 0.05]
    newest = {number: max(t for t, i in due if i == number and t < back_s) for number in set(ids.tolist())}

    assert len(due) == stats.frames + stats.overtaken
    assert not set(held_up) & set(sent)
    # The clock goes on while what was missed is left out.
    around = (gone_s, back_s + 0.1)
    assert [one for one in due if not around[0] < one[0] < around[1]] == [
        one for one in sent if not around[0] < one[0] < around[1]
    ]
    for number, newest_s in newest.items():
        assert any(i == number and newest_s - 1e-3 < t < around[1] for t, i in sent), number


def test_a_player_stops_at_once(drive: SimulatedDrive, buses: tuple[can.BusABC, can.BusABC]) -> None:
    """stop() ends the thread within a fraction of a second, with most of the drive not played."""
    player = LivePlayer(drive, buses[0])
    player.start()
    time.sleep(0.1)
    player.stop()

    assert player.join(1.0)
    assert 0 < player.stats.frames < len(drive.frames) / 2


def test_a_bus_that_is_down_loses_frames_and_the_drive_goes_on(drive: SimulatedDrive) -> None:
    """A frame that the bus refuses is counted; the player carries on to the end."""

    class DownBus(can.BusABC):
        """Refuses every frame."""

        def __init__(self) -> None:
            super().__init__(channel="down")

        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            raise can.CanOperationError("network is down")

    with DownBus() as bus:
        stats = LivePlayer(drive, bus, speedup=1000.0).play()

    assert (0, len(drive.frames)) == (stats.frames, stats.send_errors)


def test_what_kills_the_thread_is_raised_by_join(drive: SimulatedDrive) -> None:
    """An unexpected failure of the bus is raised where the thread is joined."""

    class BrokenBus(can.BusABC):
        """Fails in a way nobody foresaw."""

        def __init__(self) -> None:
            super().__init__(channel="broken")

        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            raise ZeroDivisionError

    with BrokenBus() as bus:
        player = LivePlayer(drive, bus, speedup=1000.0)
        player.start()
        with pytest.raises(ZeroDivisionError):
            player.join(5.0)


def test_a_line_that_nobody_reads_drops_and_does_not_block() -> None:
    """Without a reader the terminal's buffer fills, and the rest is counted as dropped."""
    with PtyPort() as port:
        for _ in range(100):
            port.write(b"x" * 1000)
        assert 50_000 < port.dropped_bytes <= 100_000


def test_a_link_points_to_the_terminal_while_it_is_open(tmp_path: Path) -> None:
    """The link is made (over a stale one) and taken away."""
    link = tmp_path / "gnss"
    link.symlink_to("/nowhere")
    with PtyPort(link) as port:
        assert Path(port.path) == link.readlink()
    assert not link.is_symlink()


def test_a_link_never_overwrites_a_file(tmp_path: Path) -> None:
    """A file of that name stays, and the reason is one line."""
    (tmp_path / "gnss").write_text("precious")
    with pytest.raises(TpmsdError, match=r"gnss: cannot be made a link to /dev/pts/\d+: File exists"):
        PtyPort(tmp_path / "gnss")

    assert "precious" == (tmp_path / "gnss").read_text()


def test_a_reader_that_comes_and_goes_finds_the_line_open() -> None:
    """A second reader gets what is written after the first has left."""
    with PtyPort() as port:
        serial.Serial(port.path, 115200).close()
        reader = serial.Serial(port.path, 115200, timeout=1.0)
        port.write(b"$GNRMC\r\n")
        assert b"$GNRMC\r\n" == reader.readline()
        reader.close()


@pytest.mark.parametrize("speedup", [0.0, -1.0, float("nan"), 1e9])
def test_speed_ups_that_cannot_be(drive: SimulatedDrive, speedup: float) -> None:
    """A speed-up is between a hundredth and ten thousand."""
    with (
        can.Bus(interface="virtual", channel="never") as bus,
        pytest.raises(ConfigError, match=r"is outside 0\.01 to 10000"),
    ):
        LivePlayer(drive, bus, speedup=speedup)
