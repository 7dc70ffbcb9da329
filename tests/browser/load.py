"""Does looking on disturb the daemon? `python -m tests.browser.load --clients 200 --seconds 60`.

In: a daemon with a simulated car and `tpmsd web` in front of it, each a process of its own. Out: how late
the daemon's ticks are without a client and with many that follow the live page, the first of which never
reads. Both are measured in turns (without, with, with, without, ...), so that other work on the machine
meets both alike; what is printed is the change from each stretch to its neighbour.
"""

from __future__ import annotations

import argparse
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
class Round:
    """Two stretches side by side: median and 95th percentile of the ticks' lateness, in ms."""

    quiet_ms: tuple[float, float]
    """Without a client."""
    loaded_ms: tuple[float, float]
    """With clients."""


@dataclass(frozen=True)
class Load:
    """What was measured."""

    rounds: tuple[Round, ...]
    events: tuple[int, ...]
    """Updates that each reading client got in one stretch."""

    def ratios(self, quantile: int) -> np.ndarray:
        """(rounds,) lateness with clients over that without: 0 for the median, 1 for the 95th percentile."""
        return np.array([one.loaded_ms[quantile] / one.quiet_ms[quantile] for one in self.rounds])

    def differences_ms(self, quantile: int) -> np.ndarray:
        """(rounds,) lateness with clients minus that without."""
        return np.array([one.loaded_ms[quantile] - one.quiet_ms[quantile] for one in self.rounds])


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

    def forward() -> None:
        for line in stream:
            lines.put(line)

    threading.Thread(target=forward, daemon=True).start()
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


def measure(folder: Path, clients: int, seconds: float, rounds: int) -> Load:
    """Each round has a stretch without clients and one with them, of `seconds` each."""
    car = ("tests.browser.car", folder, "3000", "1", "ticks")
    web = ("tpmsd", "web", "--config", folder / "vehicle.toml", "--port", "0")
    spans: list[dict[bool, tuple[float, float]]] = []
    events: list[int] = []
    with contextlib.ExitStack() as stack:
        _, ticks = stack.enter_context(process(*car))
        line_with(ticks, "TICK")  # its configuration and socket are there
        _, said = stack.enter_context(process(*web))
        port = line_with(said, "http://").split()[0].rstrip("/").rpartition(":")[2]
        time.sleep(3.0)  # both have started
        for k in range(rounds):
            spans.append({})
            for loaded in (False, True) if k % 2 == 0 else (True, False):
                with contextlib.ExitStack() as visit:
                    if loaded:
                        visitors = ("tests.browser.visitors", port, str(clients), str(seconds + 1.0))
                        _, counts = visit.enter_context(process(*visitors))
                        line_with(counts, "CONNECTED")
                    begun = time.monotonic()
                    time.sleep(seconds)
                    spans[-1][loaded] = (begun, time.monotonic())
                    if loaded:
                        events += map(int, line_with(counts, "UPDATES").split()[1:])
                time.sleep(1.0)  # the server has seen them go
        stamps, late_s = _ticks(ticks)

    def stretch(begun: float, ended: float) -> tuple[float, float]:
        return _summary(1e3 * late_s[(stamps >= begun) & (stamps < ended)])

    measured = tuple(Round(stretch(*one[False]), stretch(*one[True])) for one in spans)
    return Load(measured, tuple(events))


def _ticks(lines: queue.Queue[str]) -> tuple[np.ndarray, np.ndarray]:
    """(n,) when each tick was done (monotonic, s), and how late within its period (s)."""
    found = []
    while not lines.empty():
        line = lines.get()
        if line.startswith("TICK "):
            found.append(float(line.split()[1]))
    done = np.array(found)
    return done, lateness_s(done)


def lateness_s(done: np.ndarray) -> np.ndarray:
    """(n,) since the deadline, which is where the widest span of the period without any tick ends."""
    phase = done % PERIOD_S
    ordered = np.sort(phase)
    gaps = np.diff(ordered, append=ordered[0] + PERIOD_S)
    deadline = ordered[(int(np.argmax(gaps)) + 1) % ordered.size]
    return np.asarray((phase - deadline) % PERIOD_S)


def _summary(late_ms: np.ndarray) -> tuple[float, float]:
    median, high = np.quantile(late_ms, [0.5, 0.95])
    return float(median), float(high)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each stretch")
    parser.add_argument("--rounds", type=int, default=4, help="pairs of stretches, without and with clients")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        load = measure(Path(folder), args.clients, args.seconds, args.rounds)
    print(f"lateness of ticks (ms), median and 95 %: without a client, with {args.clients}")
    for one in load.rounds:
        print("  {:.2f} {:.2f}   {:.2f} {:.2f}".format(*one.quiet_ms, *one.loaded_ms))
    for k, name in enumerate(("median", "95 %")):
        ratios, more = load.ratios(k), load.differences_ms(k)
        print(
            f"{name}: {np.median(ratios):.2f} times ({ratios.min():.2f} to {ratios.max():.2f}),"
            f" {np.mean(more):+.2f} ms with a standard error of {_standard_error(more):.2f}"
        )
    print(f"updates per client: {min(load.events)} to {max(load.events)} in {args.seconds:g} s")


def _standard_error(values: np.ndarray) -> float:
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")


if __name__ == "__main__":
    main()
