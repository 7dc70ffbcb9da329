"""A bus that is full, and one that goes away: one daemon beside a car that drives at its own pace.

The tests follow one another on the same daemon; each looks at what changed in its own time.
"""

from __future__ import annotations

import contextlib
import signal
import statistics
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

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
WHEELS = "0B0"
"""The identifier of the rear wheels' message, as the simulator sends it."""


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    folder = tmp_path_factory.mktemp("link")
    car, pty = folder / "car", folder / "gnss"
    with simulating(car, "--duration", "200", "--route", "rural", "--live", "vcan0", "--pty", pty):
        wait_until(pty.exists, "the car drives")
        with running(car, "--device", str(pty)) as running_daemon:
            running_daemon.until(lambda status: status["can"]["frames"] > 100, "frames are read")
            yield running_daemon


@contextlib.contextmanager
def cangen(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(["cangen", "vcan0", "-i", *arguments])
    try:
        yield process
    finally:
        end(process)


def packets(channel: str) -> int:
    """Frames that the kernel has delivered on a channel."""
    rows = (line.split() for line in Path("/proc/net/dev").read_text("ascii").splitlines())
    return next(int(row[2]) for row in rows if row[0] == f"{channel}:")


def test_a_full_bus_costs_no_tick_and_no_frame(daemon: Daemon) -> None:
    """With 500 kbit/s of other traffic: ten ticks a second, every frame of the wheels, nothing dropped."""
    rates = []
    with (
        cangen("-g", "10", "-c", "30", "-I", "3A5", "-L", "8"),
        cangen("-g", "10", "-c", "30", "-e", "-L", "8"),
    ):
        time.sleep(0.5)
        before, began_s = daemon.status(), time.monotonic()
        while time.monotonic() < began_s + WATCH_S:
            count, then_s = packets("vcan0"), time.monotonic()
            time.sleep(0.5)
            rates.append((packets("vcan0") - count) / (time.monotonic() - then_s))
        after, took_s = daemon.status(), time.monotonic() - began_s

    assert statistics.median(rates) * FRAME_BITS >= BIT_RATE
    assert (after["ticks"] - before["ticks"]) / took_s == pytest.approx(10.0, rel=0.1)
    # 170 frames a second are what the simulated car sends.
    assert (after["can"]["frames"] - before["can"]["frames"]) / took_s == pytest.approx(170.0, rel=0.1)
    assert "ok" == after["can"]["state"]
    assert {"dropped_by_kernel", "jump", "too_late"}.isdisjoint(after["can"]["faults"])


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
    told = [line for line in daemon.log().splitlines()[lines:] if "CAN vcan0" in line]

    assert down["can"]["detail"]
    assert 1 == sum("trying again until it is back" in line for line in told)
    assert 1 == sum("is back after" in line for line in told)


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
