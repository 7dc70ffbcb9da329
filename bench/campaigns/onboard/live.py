"""How the daemon keeps up with a full bus in real time: `make bench-live`.

In: nothing; a simulated car is played by a process of its own onto vcan0 where this machine has one, else
over a pair of sockets that carry the very packets of SocketCAN; the receiver is a pseudo terminal. Out: a
table, and JSON with `--json FILE`.

The bus is filled to 500 kbit/s with other frames. `filtered`: the kernel keeps those away from the daemon, as
it does on SocketCAN. `unfiltered`: each of them is read and thrown away, as with adapters that cannot filter.
Lateness is that of the tick's deadline; CPU time is that of the daemon's process. The CPU time of a thousand
frames is the difference between both, so it is that of frames which are of no use.

    python -m bench run live --seconds 15 --json live.json
    python -m bench run live --guest     on vcan0 of a User Mode Linux guest, as `make test-hil`

A guest has one processor for the car, the bus and the daemon, and its system calls cost several times as
much as the machine's own.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import errno
import logging
import os
import pty
import select
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
import tty
from pathlib import Path
from typing import Any

import numpy as np

from bench.places import REPO
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import CanConfig, Config
from tpmsd.offline.simulator.drive import DriveSpec, SimulatedDrive, simulate_drive
from tpmsd.onboard.daemon.bus_link import BusInterface, open_can
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.loop import Daemon
from tpmsd.onboard.sinks.sd_notify import Notifier
from tpmsd.onboard.sources.can.decoder import can_filters, load_database
from tpmsd.onboard.sources.can.live import LiveCan

CHANNEL = "vcan0"
FULL_BUS_FRAMES_PER_S = 4000
"""Classic frames of eight bytes at 500 kbit/s, stuffed bits included."""
RATES_HZ = (10.0, 50.0, 100.0)
FROM_S, WARM_S = 60.0, 3.0
FRAME = struct.Struct("=IB3x8s")


@dataclasses.dataclass(frozen=True)
class Row:
    """One run."""

    rate_hz: float
    bus: str
    ticks_per_s: float
    late_median_ms: float
    late_95_ms: float
    missed: int
    frames_per_s: float
    cpu_percent: float
    cpu_ms_per_tick: float
    cpu_ms_per_1000_frames: float | None = None


def drive(seconds: float) -> SimulatedDrive:
    """A car on a motorway, for as long as the longest run takes."""
    return simulate_drive(DriveSpec("motorway", FROM_S + seconds + 30.0, seed=2))


class PairBus:
    """One end of a pair of sockets, as python-can's SocketCAN bus."""

    def __init__(self, end: socket.socket) -> None:
        self.socket = end

    def fileno(self) -> int:
        """Its descriptor."""
        return self.socket.fileno()

    def recv(self, timeout: float | None = None) -> None:
        """Never used: the socket is read directly."""

    def send(self, msg: Any, timeout: float | None = None) -> None:
        """Nobody listens to the daemon's own frames."""

    def shutdown(self) -> None:
        """The pair is the benchmark's."""


def feed(descriptor: int, line: int, seconds: float, ids: list[int]) -> None:
    """Play the drive, in the process of its own.

    `descriptor`: of the bus, negative for the real one; `line`: of the receiver's end of the serial line;
    `ids`: what passes the filter, empty for everything.
    """
    with contextlib.suppress(PermissionError):
        # A car does not wait for the daemon, also where both share one processor.
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    made = drive(seconds)
    origin_s = float(made.truth()["start_host_s"]) + FROM_S
    if descriptor < 0:
        bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        bus.bind((CHANNEL,))
    else:
        bus = socket.socket(fileno=descriptor)
    bus.setblocking(False)
    filler = FRAME.pack(0x123, 8, bytes(range(8)))
    frames = made.frames
    times = frames.time_s - origin_s
    start = int(np.searchsorted(times, 0.0))
    filler_per_s = FULL_BUS_FRAMES_PER_S - (len(times) - start) / (times[-1] - 0.0)
    # On a real bus the kernel filters; here what it would keep away is not sent.
    passes = descriptor < 0 or not ids
    sent_filler = 0
    lines = [(entry.time_s - origin_s, entry.text) for entry in made.nmea]
    lines = [entry for entry in lines if entry[0] >= 0.0]
    print("ready", flush=True)
    sys.stdin.readline()
    begun = time.monotonic()
    while (now := time.monotonic() - begun) < seconds:
        while start < len(times) and times[start] <= now:
            number = int(frames.frame_id[start])
            if passes or number in ids:
                put(bus, FRAME.pack(number, 8, frames.data[start].tobytes()))
            start += 1
        if passes:
            while sent_filler < filler_per_s * now:
                put(bus, filler)
                sent_filler += 1
        while lines and lines[0][0] <= now:
            with contextlib.suppress(BlockingIOError):
                os.write(line, lines.pop(0)[1].encode("ascii") + b"\r\n")
        time.sleep(0.001)


def put(bus: socket.socket, packet: bytes) -> None:
    """Send, or wait a moment for room: a bus takes no more than it can carry."""
    while True:
        try:
            bus.send(packet)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.ENOBUFS):
                raise
            select.select([], [bus], [], 0.001)
        else:
            return


class Measured(Daemon):
    """A daemon that keeps its lateness."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.late_s: list[float] = []

    def _report_lag(self, late_s: float) -> None:
        self.late_s.append(late_s)
        super()._report_lag(late_s)


def has_vcan() -> bool:
    """Whether this machine has a SocketCAN interface of that name."""
    return hasattr(socket, "AF_CAN") and Path("/sys/class/net", CHANNEL).exists()


def run(config: Config, line: int, seconds: float, filtered: bool) -> Row:
    """One run of the daemon in real time."""
    database = load_database(config.can.dbc)
    ids = [entry["can_id"] for entry in can_filters(config, database)] if filtered else []
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in (ours, theirs):
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 20)
    real = has_vcan()

    def open_bus(can: CanConfig, filters: list[dict[str, Any]] | None, channel: str) -> BusInterface:
        if real:
            return open_can(can, filters if filtered else None, channel)
        return LiveCan(can, bus=PairBus(ours))

    total_s = WARM_S + seconds + 2.0
    command = [sys.executable, "-m", "bench", "run", "live", "--feed", str(-1 if real else theirs.fileno())]
    command += ["--line", str(line), "--seconds", str(total_s), "--ids", ",".join(map(str, ids))]
    log = logging.getLogger("bench")
    log.setLevel(logging.CRITICAL + 1)
    marks: list[tuple[float, float, int, int]] = []
    began: list[float] = []

    def mark() -> None:
        frames = daemon.document()["can"]["frames"]
        marks.append((time.monotonic(), time.process_time(), daemon.ticks, frames))

    def watch(step: Any) -> None:
        elapsed_s = time.monotonic() - began[0]
        if not marks and elapsed_s >= WARM_S:
            mark()
            daemon.late_s.clear()
        elif len(marks) == 1 and elapsed_s >= WARM_S + seconds:
            mark()
            daemon.stop("measured")

    daemon = Measured(config, database, Clock(), Notifier(None), open_bus=open_bus, on_step=watch, log=log)
    feeder = subprocess.Popen(
        command,
        pass_fds=(line,) if real else (line, theirs.fileno()),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert feeder.stdin is not None and feeder.stdout is not None
    try:
        feeder.stdout.readline()
        feeder.stdin.write("go\n")
        feeder.stdin.flush()
        began.append(time.monotonic())
        missed_before = daemon.missed_deadlines
        daemon.run(total_s)
        missed = daemon.missed_deadlines - missed_before
    finally:
        feeder.kill()
        feeder.communicate()
        ours.close()
        theirs.close()
    (t0, cpu0, ticks0, frames0), (t1, cpu1, ticks1, frames1) = marks
    ticks, wall_s, cpu_s = ticks1 - ticks0, t1 - t0, cpu1 - cpu0
    late = sorted(daemon.late_s)
    return Row(
        config.filter.rate_hz,
        "filtered" if filtered else "unfiltered",
        ticks / wall_s,
        1e3 * statistics.median(late),
        1e3 * late[int(0.95 * (len(late) - 1))],
        missed,
        (frames1 - frames0) / wall_s,
        100.0 * cpu_s / wall_s,
        1e3 * cpu_s / ticks,
    )


def table(rows: list[Row]) -> str:
    """The rows as text."""
    out = [
        "rate    bus         ticks/s late: median      95 %  missed   frames/s     CPU    per tick"
        "   per 1000 frames"
    ]
    for row in rows:
        frames = "" if row.cpu_ms_per_1000_frames is None else f"{row.cpu_ms_per_1000_frames:6.1f} ms"
        out.append(
            f"{row.rate_hz:4.0f} Hz {row.bus:10s} {row.ticks_per_s:8.2f} {row.late_median_ms:11.2f} ms "
            f"{row.late_95_ms:6.1f} ms {row.missed:6d} {row.frames_per_s:10.0f} {row.cpu_percent:5.1f} % "
            f"{row.cpu_ms_per_tick:8.2f} ms   {frames}"
        )
    return "\n".join(out)


def longest_s(seconds: float) -> float:
    """How long all runs of so many seconds may take on a slow machine."""
    return 6 * 4 * (WARM_S + seconds)


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--seconds", type=float, default=15.0, help="of each run")
    parser.add_argument("--guest", action="store_true", help="on vcan0 of a User Mode Linux guest")
    for hidden in ("--feed", "--line", "--ids"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)


def main(args: argparse.Namespace) -> dict[str, Any] | int:
    """Measure and print."""
    if args.feed is not None:
        ids = [int(number) for number in args.ids.split(",") if number]
        feed(int(args.feed), int(args.line), args.seconds, ids)
        return 0
    if args.guest:  # the guest belongs to the tests of the bus and the service
        command = [sys.executable, "-m", "tests.hil.live_bench", f"--seconds={args.seconds:g}"]
        command += [] if args.json is None else [f"--json={args.json}"]
        return subprocess.run(command, cwd=REPO, check=False).returncode
    bus = (
        f"SocketCAN {CHANNEL}" if has_vcan() else "a pair of sockets with SocketCAN's packets (no vcan here)"
    )
    print(f"bus: {bus}, {FULL_BUS_FRAMES_PER_S} frames a second; {os.cpu_count()} CPUs", file=sys.stderr)
    rows: list[Row] = []
    line, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(line, False)
    with tempfile.TemporaryDirectory(prefix="tpmsd-live-") as name:
        folder = Path(name)
        made = drive(10.0)
        text = made.configuration("socketcan", CHANNEL, os.ttyname(slave))
        text += '\n[status]\nsocket = "status.sock"\n\n[state]\nfile = "state.json"\n'
        (folder / "vehicle.toml").write_text(text, encoding="utf-8")
        (folder / "bus.dbc").write_text(made.dbc, encoding="utf-8")
        config = load_config(folder)
        for rate_hz in RATES_HZ:
            used = dataclasses.replace(config, filter=dataclasses.replace(config.filter, rate_hz=rate_hz))
            quiet = run(used, line, args.seconds, filtered=True)
            full = run(used, line, args.seconds, filtered=False)
            more = (full.frames_per_s - quiet.frames_per_s) / 1000.0
            share_ms = 10.0 * (full.cpu_percent - quiet.cpu_percent) / more if more > 0.0 else None
            rows += [quiet, dataclasses.replace(full, cpu_ms_per_1000_frames=share_ms)]
    print(table(rows))
    return {"bus": bus, "rows": [dataclasses.asdict(row) for row in rows]}
