"""A bus that is full, and one that goes away: one daemon beside a car that drives at its own pace.

The tests follow one another on the same daemon; each looks at what changed in its own time.
"""

from __future__ import annotations

import contextlib
import signal
import socket
import statistics
import struct
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.hil.guest.play import wanted_ids
from tests.hil.guest.rig import (
    STATUS_ID,
    Daemon,
    decode,
    end,
    listening,
    run,
    running,
    simulating,
    wait_until,
)

BIT_RATE = 500_000
FRAME_BITS = 111
"""Of a classic frame with 8 bytes, with the pause after it and without stuff bits: what takes least."""
WATCH_S = 6.0
FLOOD = 12_000
"""Frames: twice what the greatest receive buffer holds."""
CAN_ERR_FLAG = 0x20000000
CRTL, BUS_ERROR, NO_ACK, BUS_OFF, RESTARTED = 0x004, 0x088, 0x020, 0x040, 0x100
RX_OVERFLOW, TX_PASSIVE, ACTIVE = 0x01, 0x20, 0x40
"""Of linux/can/error.h."""
WHEELS = "0B0"
"""The identifier of the rear wheels' message, as the simulator sends it."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("link")


@pytest.fixture(scope="module")
def car(folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The simulator, driving on vcan0."""
    pty = folder / "gnss"
    with simulating(
        folder / "car", "--duration", "200", "--route", "rural", "--live", "vcan0", "--pty", pty
    ) as it:
        wait_until(pty.exists, "the car drives")
        yield it


@pytest.fixture(scope="module")
def daemon(folder: Path, car: subprocess.Popen[bytes]) -> Iterator[Daemon]:
    with running(folder / "car", "--device", str(folder / "gnss")) as running_daemon:
        running_daemon.until(lambda status: status["can"]["frames"] > 100, "frames are read")
        yield running_daemon


@contextlib.contextmanager
def cangen(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(["cangen", "vcan0", "-i", *arguments])
    try:
        yield process
    finally:
        end(process)


def inject(*errors: tuple[int, int]) -> None:
    """Error frames as a controller's driver would raise them: class (linux/can/error.h) and data[1]."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        raw.bind(("vcan0",))
        for error, detail in errors:
            data = bytes((0, detail, 0, 0, 0, 0, 130, 0))
            raw.send(struct.pack("=IB3x8s", CAN_ERR_FLAG | error, len(data), data))


def packets(channel: str) -> int:
    """Frames that the kernel has delivered on a channel."""
    rows = (line.split() for line in Path("/proc/net/dev").read_text("ascii").splitlines())
    return next(int(row[2]) for row in rows if row[0] == f"{channel}:")


def test_a_full_bus_costs_no_tick_and_no_frame(daemon: Daemon, tmp_path: Path) -> None:
    """With 500 kbit/s of other traffic: ten ticks a second, every frame of the car, nothing dropped."""
    rates = []
    # With the flags in the mask: else extended identifiers that end alike are heard, too.
    own = [f"{identifier:03X}:C00007FF" for identifier in sorted(wanted_ids(daemon.folder))]
    with (
        listening("vcan0", tmp_path / "heard", *own) as listener,
        cangen("-g", "10", "-c", "45", "-I", "3A5", "-L", "8"),
        cangen("-g", "10", "-c", "45", "-e", "-L", "8"),
    ):
        time.sleep(0.5)
        heard = [len(listener.frames())]
        before, began_s = daemon.status(), time.monotonic()
        heard.append(len(listener.frames()))
        while time.monotonic() < began_s + WATCH_S:
            count, then_s = packets("vcan0"), time.monotonic()
            time.sleep(0.5)
            rates.append((packets("vcan0") - count) / (time.monotonic() - then_s))
        heard.append(len(listener.frames()))
        after, took_s = daemon.status(), time.monotonic() - began_s
        heard.append(len(listener.frames()))

    assert statistics.median(rates) * FRAME_BITS >= BIT_RATE
    assert (after["ticks"] - before["ticks"]) / took_s == pytest.approx(10.0, rel=0.1)
    # 170 frames a second are what the simulated car sends; one that is held up leaves some of them out.
    assert (heard[3] - heard[1]) / took_s > 100.0
    # Each status is of a moment while it was asked for.
    counted = after["can"]["frames"] - before["can"]["frames"]
    assert 0.98 * (heard[2] - heard[1]) <= counted <= 1.02 * (heard[3] - heard[0])
    assert "ok" == after["can"]["state"]
    assert {"dropped_by_kernel", "jump", "too_late"}.isdisjoint(after["can"]["faults"])


def test_error_frames_are_counted_by_what_they_say(daemon: Daemon) -> None:
    """Each kind in the status, error-passive in words until it ends; ticks and the wheels' frames go on."""
    before = daemon.status()
    inject((CRTL, TX_PASSIVE), *20 * [(BUS_ERROR, 0)], *7 * [(NO_ACK, 0)], (CRTL, RX_OVERFLOW))
    said = daemon.until(
        lambda status: status["can"]["faults"].get("controller_overflow"), "errors are counted"
    )
    later = daemon.until(lambda status: status["ticks"] > said["ticks"] + 20, "ticks go on")
    inject((CRTL, ACTIVE))
    well = daemon.until(lambda status: not status["can"]["detail"], "the controller is well again")

    expected = {
        "error_frames": 29,
        "error_passive": 1,
        "bus_error": 20,
        "not_acknowledged": 7,
        "controller_overflow": 1,
    }
    faults = said["can"]["faults"]
    assert expected == {name: faults[name] - before["can"]["faults"].get(name, 0) for name in expected}
    assert "ok" == said["can"]["state"] == later["can"]["state"] == well["can"]["state"]
    assert said["can"]["detail"].startswith("error-passive")
    assert later["can"]["frames"] > said["can"]["frames"] + 100
    assert "jump" not in later["can"]["faults"]
    assert 1 == daemon.log().count("error-passive")


def test_bus_off_is_said_and_ends_with_the_cars_frames(daemon: Daemon, car: subprocess.Popen[bytes]) -> None:
    """A controller that is off hears nothing: a bus that is down, one log line each way, no restart."""
    lines = len(daemon.log().splitlines())
    car.send_signal(signal.SIGSTOP)
    try:
        inject((BUS_OFF, 0))
        down = daemon.until(lambda status: status["can"]["state"] == "down", "the bus is off")
        # Restarted by the kernel, and off again: nothing that was heard says that it is well.
        inject((RESTARTED, 0), (BUS_OFF, 0))
        daemon.until(lambda status: status["ticks"] > down["ticks"] + 30, "ticks go on")
        still = daemon.status()
    finally:
        car.send_signal(signal.SIGCONT)
    up = daemon.until(lambda status: status["can"]["state"] == "ok", "the bus is back")
    daemon.until(lambda status: status["can"]["frames"] > up["can"]["frames"] + 100, "frames are read")
    reported = [line for line in daemon.log().splitlines()[lines:] if "CAN vcan0" in line]

    assert "bus-off: the controller has switched itself off" == down["can"]["detail"]
    assert ("down", down["can"]["faults"]["down"]) == (still["can"]["state"], still["can"]["faults"]["down"])
    assert "" == up["can"]["detail"]
    assert 1 == sum("bus-off" in line and "trying again until it is back" in line for line in reported)
    assert 1 == sum("is back after" in line for line in reported)
    assert daemon.process.poll() is None


def test_an_overflow_of_the_receive_buffer_is_counted_and_survived(daemon: Daemon) -> None:
    """A daemon that got no time to read says how many frames the kernel dropped, and goes on."""
    before = daemon.status()
    daemon.process.send_signal(signal.SIGSTOP)
    try:
        run("cangen", "vcan0", "-i", "-g", "0", "-n", str(FLOOD), "-I", WHEELS, "-L", "8")
    finally:
        daemon.process.send_signal(signal.SIGCONT)
    after = daemon.until(lambda status: status["can"]["faults"].get("dropped_by_kernel"), "drops are counted")
    read = after["can"]["frames"] - before["can"]["frames"]

    assert 0 < after["can"]["faults"]["dropped_by_kernel"] <= FLOOD + 170 * 30
    assert read < FLOOD
    later = daemon.until(lambda status: status["ticks"] > after["ticks"] + 20, "ticks go on")
    assert "ok" == later["can"]["state"]


def test_an_interface_that_is_down_is_said_and_waited_for(daemon: Daemon) -> None:
    """Down: a state, one log line, ticks go on. Up: frames again without a restart."""
    lines = len(daemon.log().splitlines())
    run("ip", "link", "set", "vcan0", "down")
    down = daemon.until(lambda status: status["can"]["state"] == "down", "the bus is down")
    daemon.until(lambda status: status["ticks"] > down["ticks"] + 10, "ticks go on")
    run("ip", "link", "set", "vcan0", "up")
    up = daemon.until(lambda status: status["can"]["state"] == "ok", "the bus is back")
    daemon.until(lambda status: status["can"]["frames"] > up["can"]["frames"] + 100, "frames are read")
    reported = [line for line in daemon.log().splitlines()[lines:] if "CAN vcan0" in line]

    assert down["can"]["detail"]
    assert 1 == sum("trying again until it is back" in line for line in reported)
    assert 1 == sum("is back after" in line for line in reported)


def test_an_interface_that_is_deleted_is_taken_up_when_it_is_made_again(
    daemon: Daemon, tmp_path: Path
) -> None:
    """Another interface of the same name: the daemon reads it and talks on it."""
    run("ip", "link", "del", "vcan0")
    gone = daemon.until(lambda status: status["can"]["state"] == "down", "the bus is gone")
    time.sleep(1.0)
    run("ip", "link", "add", "dev", "vcan0", "type", "vcan")
    run("ip", "link", "set", "vcan0", "mtu", "72", "up")
    with (
        listening("vcan0", tmp_path / "heard", "6F0:7FF") as listener,
        cangen("-g", "20", "-I", WHEELS, "-L", "8"),
    ):
        daemon.until(lambda status: status["can"]["frames"] > gone["can"]["frames"] + 50, "frames are read")
        wait_until(lambda: len(listener.frames(STATUS_ID)) >= 6, "the daemon talks")
        pages = {row["StatusPage"] for row in decode(listener.frames(STATUS_ID))}

    assert 3 == len(pages)
    assert "is back after" in daemon.log()


def test_it_ends_in_order_after_all_that(daemon: Daemon) -> None:
    """SIGTERM: exit code 0, the state saved, never a traceback."""
    assert 0 == daemon.stop()
    assert daemon.state.is_file()
    assert "Traceback" not in daemon.log()
