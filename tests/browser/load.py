"""Does looking on disturb the daemon? `python -m tests.browser.load --clients 200 --seconds 60`.

In: a daemon with a simulated car and `tpmsd web` in front of it, each a process of its own. Out: how late
the daemon's ticks are without a client and with many that follow the live page, the first of which never
reads.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

PATIENCE_S = 90.0
PERIOD_S = 0.1
"""Of the daemon's ticks, in real time: the car is not sped up."""


@dataclass(frozen=True)
class Load:
    """What was measured."""

    quiet_ms: tuple[float, float]
    """Median and 95th percentile of the ticks' lateness without a client."""
    loaded_ms: tuple[float, float]
    """The same with clients."""
    events: tuple[int, ...]
    """Updates that each reading client got."""


@contextlib.contextmanager
def process(*arguments: str | Path) -> Iterator[tuple[subprocess.Popen[str], queue.Queue[str]]]:
    """A program of this repository with its lines (both streams) in a queue; ended by all means."""
    running = subprocess.Popen(
        [sys.executable, "-m", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    lines: queue.Queue[str] = queue.Queue()
    assert running.stdout is not None
    stream = running.stdout
    threading.Thread(target=lambda: [lines.put(line) for line in stream], daemon=True).start()
    try:
        yield running, lines
    finally:
        running.kill()
        running.wait()


def line_with(lines: queue.Queue[str], word: str) -> str:
    """The next line that holds a word."""
    end = time.monotonic() + PATIENCE_S
    while (left := end - time.monotonic()) > 0:
        try:
            line = lines.get(timeout=left)
        except queue.Empty:
            break
        if word in line:
            return line
    raise AssertionError(f"no line with {word!r} within {PATIENCE_S:g} s")


def measure(folder: Path, clients: int, seconds: float) -> Load:
    """Both phases, `seconds` each."""
    car = ("tests.browser.car", folder, "3000", "1", "ticks")
    web = ("tpmsd", "web", "--config", folder / "vehicle.toml", "--port", "0")
    with contextlib.ExitStack() as stack:
        _, ticks = stack.enter_context(process(*car))
        line_with(ticks, "TICK")  # its configuration and socket are there
        _, said = stack.enter_context(process(*web))
        port = int(line_with(said, "http://").split()[0].rstrip("/").rpartition(":")[2])
        time.sleep(3.0)  # both have started
        begun = time.monotonic()
        time.sleep(seconds)
        changed = time.monotonic()
        events = asyncio.run(_follow(port, clients, seconds))
        ended = time.monotonic()
        stamps = _stamps(ticks)
    late_ms = 1e3 * lateness_s(stamps)
    quiet = late_ms[(stamps >= begun) & (stamps < changed)]
    loaded = late_ms[(stamps >= changed) & (stamps < ended)]
    return Load(_summary(quiet), _summary(loaded), events)


def lateness_s(stamps: np.ndarray) -> np.ndarray:
    """(n,) of ticks at a fixed period, against the earliest one of all."""
    late = stamps - PERIOD_S * np.round((stamps - stamps[0]) / PERIOD_S)
    return np.asarray(late - late.min())


async def _follow(port: int, clients: int, seconds: float) -> tuple[int, ...]:
    """Updates that each client got; one more client asks and never reads."""
    idle, writer = await asyncio.open_connection("127.0.0.1", port, limit=1024)
    writer.write(_request(port))
    counts = await asyncio.gather(*(_client(port, seconds) for _ in range(clients)))
    writer.close()
    del idle
    return tuple(counts)


async def _client(port: int, seconds: float) -> int:
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 22)
    writer.write(_request(port))
    count = 0
    try:
        async with asyncio.timeout(seconds):
            while line := await reader.readline():
                count += line == b"event: status\n"
    except TimeoutError:
        pass
    writer.close()
    return count


def _request(port: int) -> bytes:
    return f"GET /api/live HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode()


def _stamps(lines: queue.Queue[str]) -> np.ndarray:
    found = []
    while not lines.empty():
        word, _, rest = lines.get().partition(" ")
        if word == "TICK":
            found.append(float(rest))
    return np.array(found)


def _summary(late_ms: np.ndarray) -> tuple[float, float]:
    median, high = np.quantile(late_ms, [0.5, 0.95])
    return float(median), float(high)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=60.0)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        load = measure(Path(folder), args.clients, args.seconds)
    for name, (median, high) in (("no client", load.quiet_ms), (f"{args.clients} clients", load.loaded_ms)):
        print(f"{name}: ticks late by {median:.1f} ms in the median, {high:.1f} ms in 95 %")
    print(f"updates per client: {min(load.events)} to {max(load.events)} in {args.seconds:g} s")


if __name__ == "__main__":
    main()
