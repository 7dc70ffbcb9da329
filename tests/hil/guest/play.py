"""Recorded traffic for a bus that is not ours to pace: logs for `canplayer`, sentences for a pseudo terminal.

In: a drive folder. Out: candump lines at another pace or in another form; a receiver; what a recording holds,
to be compared with what was played.
"""

from __future__ import annotations

import contextlib
import gzip
import math
import os
import pty
import re
import select
import shutil
import socket
import subprocess
import threading
import time
import tomllib
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cantools

from tests.hil.guest.rig import PROMPT, end

_STAMP = re.compile(r"\((\d+\.\d+)\) (.*)$")


def stamped(file: Path) -> Iterator[tuple[float, str]]:
    """Time and rest of each line of can.log(.gz) or gnss.nmea; lines that are damaged are left out."""
    with file.open("rb") as packed, gzip.open(packed) if file.suffix == ".gz" else packed as lines:
        for raw in lines:
            line = raw.decode("ascii", "replace").rstrip()
            match = _STAMP.match(line)
            if match is not None:
                yield float(match[1]), match[2]


def can_log(drive: Path) -> Path:
    """The drive's can.log, packed or not."""
    return next(path for path in (drive / "can.log", drive / "can.log.gz") if path.exists())


def write_log(
    target: Path, drive: Path, seconds: float, pace: float, change: Callable[[str], str] = lambda rest: rest
) -> int:
    """The first `seconds` of a drive for canplayer at `pace` times its speed; the number of frames."""
    count, start_s = 0, None
    with target.open("w", encoding="ascii") as out:
        for time_s, rest in stamped(can_log(drive)):
            start_s = time_s if start_s is None else start_s
            if time_s - start_s > seconds:
                break
            out.write(f"({start_s + (time_s - start_s) / pace:.6f}) {change(rest)}\n")
            count += 1
    return count


def frames_of(log: Path) -> list[tuple[int, bytes]]:
    """Identifier (29-bit ones with bit 31) and data of each data frame of a log, in its order."""
    frames = []
    for _, rest in stamped(log):
        identifier, _, data = rest.split()[1].partition("#")
        # Behind the second # of CAN FD stands a digit of flags.
        data = data[2:] if data.startswith("#") else data
        frames.append((int(identifier, 16) | (len(identifier) > 3) << 31, bytes.fromhex(data)))
    return frames


def sentences_of(drive: Path, from_s: float = -math.inf, to_s: float = math.inf) -> list[str]:
    """What the receiver said in that time since the first frame, without the daemon's own marks."""
    start_s = next(iter(stamped(can_log(drive))))[0]
    lines = [rest for time_s, rest in stamped(drive / "gnss.nmea") if from_s <= time_s - start_s <= to_s]
    return [line for line in lines if not line.startswith("$PTPMSD")]


def wanted_ids(drive: Path) -> set[int]:
    """The identifiers of the messages that the car's configuration names, by its DBC."""
    signals = tomllib.loads((drive / "vehicle.toml").read_text())["can"]["signals"]
    database: Any = cantools.database.load_file(drive / "bus.dbc")
    return {database.get_message_by_name(signal.split(".")[0]).frame_id for signal in signals.values()}


def span_s(log: Path) -> float:
    """From the first line to the last."""
    times = [time_s for time_s, _ in stamped(log)]
    return times[-1] - times[0]


@contextlib.contextmanager
def canplaying(log: Path, *assignments: str) -> Iterator[subprocess.Popen[bytes]]:
    """`canplayer` with that log; `vcan0=can0` puts onto vcan0 what was recorded on can0."""
    process = subprocess.Popen([*PROMPT, "canplayer", "-I", str(log), "-g", "1", *assignments])
    try:
        yield process
    finally:
        end(process)


def first_frame(channel: str) -> socket.socket:
    """A socket on which the next frame of that bus can be waited for."""
    sock = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    sock.bind((channel,))
    return sock


class Receiver:
    """A pseudo terminal that says what a recorded receiver said, from the first frame on the bus on."""

    def __init__(self, drive: Path, channel: str, seconds: float, pace: float) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        start_s = next(iter(stamped(can_log(drive))))[0]
        self._lines = [
            ((time_s - start_s) / pace, line.encode("ascii", "replace") + b"\r\n")
            for time_s, line in stamped(drive / "gnss.nmea")
            if 0.0 <= time_s - start_s <= seconds
        ]
        self._bus = first_frame(channel)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._speak, daemon=True)
        self._thread.start()

    def _speak(self) -> None:
        while not self._stop.is_set() and not select.select([self._bus], [], [], 0.1)[0]:
            pass
        began_s = time.monotonic()
        for due_s, line in self._lines:
            while (ahead_s := began_s + due_s - time.monotonic()) > 0.0:
                if self._stop.wait(ahead_s):
                    return
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, line)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._bus.close()
        os.close(self._master)
        os.close(self._slave)


def copy_car(drive: Path, folder: Path, channel: str, *, fd: bool = False, more: str = "") -> Path:
    """The car of a drive on another channel: its vehicle.toml and DBC in `folder`."""
    folder.mkdir()
    text = (drive / "vehicle.toml").read_text("utf-8")
    text, found = re.subn(
        r"^channel = .*$", f'channel = "{channel}"' + ("\nfd = true" if fd else ""), text, flags=re.M
    )
    assert found == 1, text
    text = re.sub(r"^interface = .*$", 'interface = "socketcan"', text, flags=re.M)
    (folder / "vehicle.toml").write_text(text + more, "utf-8")
    shutil.copy(drive / "bus.dbc", folder / "bus.dbc")
    return folder


def cut(drive: Path, folder: Path, seconds: float) -> Path:
    """The first `seconds` of a drive as a drive of its own."""
    folder.mkdir()
    for name in ("vehicle.toml", "bus.dbc"):
        shutil.copy(drive / name, folder / name)
    start_s = next(iter(stamped(can_log(drive))))[0]
    for source, name in ((can_log(drive), "can.log"), (drive / "gnss.nmea", "gnss.nmea")):
        with (folder / name).open("w", encoding="utf-8") as out:
            for time_s, rest in stamped(source):
                if time_s - start_s <= seconds:
                    out.write(f"({time_s:.6f}) {rest}\n")
    return folder
