"""The box loses its power every ten seconds or so, in logical time: `python -m tests.faults.brown_out`.

In: how long, a seed. Out: what each life of the daemon made of it. Each life is a process of its own that
ends by SIGKILL at a random tick, with writes of the state under way or not; its clock begins in 1970, and
half of the lives set it right after some seconds. When the power stays on, two minutes before the drive's
end, a tyre goes soft.
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import signal
import sys
import tempfile
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from cantools.database import Database

from tests.faults.soak import PUNCTURE_S, START_S, Day, DayClock, configuration, day_daemon
from tpmsd.car.config.model import Config, MonitorConfig
from tpmsd.onboard.pipeline import Step
from tpmsd.onboard.sources.can.decoder import load_database

LIFE_S = (5.0, 15.0)
BOOT_S = 30.0
"""Since 1970, by a clock without a battery, when the daemon starts."""
SET_AFTER_S = 4.0
_DISK_S = 30.0
"""A write takes less, on any machine."""
STEADY_S = PUNCTURE_S + 30.0
"""Before the end of the drive, from which on the power stays on."""


@dataclass
class Life:
    """One process, from boot to the loss of power."""

    boot_s: float
    """Seconds since the drive's start."""
    length_s: float
    first_tick_s: float = float("inf")
    """After boot."""
    ticks: int = 0
    latest_s: float = 0.0
    """By so much at most a tick was made after the one before."""
    restored: float = -1.0
    """Share of the baseline at the first tick, ..."""
    learned: float = 0.0
    """... and at the end."""
    log: list[str] = field(default_factory=list)
    alarms: list[list[Any]] = field(default_factory=list)
    """(seconds since boot, kind, wheel, state)."""


class _Lines(logging.Handler):
    def __init__(self, lines: list[str]) -> None:
        super().__init__()
        self._lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        self._lines.append(record.getMessage())


def live(day: Day, config: Config, database: Database, life: Life, rights_clock: bool, out: int) -> None:
    """Run a daemon to the end of its life, then tell and be killed; never returns."""
    clock = day.clock
    wrong_by_s = BOOT_S - clock.now()
    clock.set_by(wrong_by_s)
    before_s = clock.monotonic()
    log = logging.getLogger("tests.brown_out")
    log.setLevel(logging.INFO)
    log.addHandler(_Lines(life.log))

    def watch(step: Step) -> None:
        nonlocal before_s, wrong_by_s
        # Logical time stands while a write is under way, whatever the disk takes; the last one may be cut.
        if writer.busy and clock.monotonic() - life.boot_s < life.length_s:
            writer._done.wait(_DISK_S)
        now_s = clock.monotonic()
        life.first_tick_s = min(life.first_tick_s, now_s - life.boot_s)
        life.latest_s, before_s = max(life.latest_s, now_s - before_s), now_s
        if life.ticks == 0:
            life.restored = step.report.learning_fraction
        life.ticks += 1
        life.alarms += [[now_s - life.boot_s, str(e.kind), e.wheel, e.state] for e in step.report.events]
        if rights_clock and now_s - life.boot_s > SET_AFTER_S:
            clock.set_by(-wrong_by_s)
            wrong_by_s = 0.0
        if now_s - life.boot_s >= life.length_s:
            life.learned = step.report.learning_fraction
            os.write(out, json.dumps(vars(life)).encode())
            os.kill(os.getpid(), signal.SIGKILL)

    daemon = day_daemon(day, config, database, watch, log)
    writer = daemon._state._writer
    daemon.run(life.length_s + 60.0)


def lived(day: Day, config: Config, database: Database, life: Life, rights_clock: bool) -> Life:
    """One life in a process of its own; what it told."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            live(day, config, database, life, rights_clock, writing)
        finally:
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        reported = pipe.read()
    _, status = os.waitpid(child, 0)
    if os.waitstatus_to_exitcode(status) != -signal.SIGKILL:
        raise RuntimeError(f"the daemon that was started at {life.boot_s:.0f} s ended by itself: {status}")
    return Life(**json.loads(reported))


def brown_out(seconds: float, seed: int, folder: Path) -> list[Life]:
    """A drive of so many seconds; its lives, the last of which is the one with steady power."""
    clock = DayClock(START_S)
    day = Day(folder, seed, 1, clock, seconds)
    day.next_leg()
    day.hold()
    config = configuration(folder, f"interval_s = {INTERVAL_S}\n")
    database, rng, lives = load_database(config.can.dbc), np.random.default_rng(seed), []
    steady_s = seconds - STEADY_S
    while True:
        boot_s = clock.monotonic()
        last = boot_s >= steady_s
        length_s = seconds - boot_s - 1.0 if last else float(rng.uniform(*LIFE_S))
        lives.append(lived(day, config, database, Life(boot_s, length_s), bool(rng.integers(2))))
        if last:
            return lives
        # What came meanwhile was for the process that is gone.
        end_s = boot_s + length_s
        while clock.monotonic() < end_s:
            clock.to_real(end_s - clock.monotonic())
        while day.frames(end_s, 1000):
            pass
        day.sentences(end_s)


def main() -> int:
    """An hour of it; 1 if something is not as it should be."""
    parser = argparse.ArgumentParser(description="loss of power every ten seconds, in logical time")
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tpmsd-brown-out-") as folder:
        lives = brown_out(args.seconds, args.seed, Path(folder))
    print(f"{len(lives) - 1} losses of power in {lives[-1].boot_s:.0f} s")
    print(f"first tick at the latest {max(life.first_tick_s for life in lives):.2f} s after the start")
    print(f"between two ticks at most {max(life.latest_s for life in lives):.2f} s")
    print(f"learned: {[round(life.learned, 2) for life in lives]}")
    print(f"alarms with steady power: {lives[-1].alarms}")
    wrong = problems(lives)
    for problem in wrong:
        print(f"WRONG: {problem}")
    return 1 if wrong else 0


INTERVAL_S = 2.0
LOST_S = INTERVAL_S + 1.0
"""What a loss of power may cost: the time since the last write, and the one that it cuts."""
FIRST_TICK_S, BETWEEN_S = 2.0, 1.0
"""Bounds of lateness, the second also where the clock is set."""
DAMAGED = ("set aside", "starting without", "learning again", "not saved", "trying again later")


def problems(lives: list[Life]) -> list[str]:
    """What is not as it should be, one line each."""
    wrong: list[str] = []
    for before, after in pairwise(lives):
        if after.learned < before.learned - 1e-9:
            wrong.append(f"at {after.boot_s:.0f} s: learned {after.learned:.3f}, {before.learned:.3f} before")
        if after.restored < before.learned - LOST_S / MonitorConfig().learn_s - 1e-9:
            wrong.append(
                f"at {after.boot_s:.0f} s: restored {after.restored:.3f} of {before.learned:.3f} learned"
            )
    for life in lives:
        said = [line for line in life.log if any(words in line for words in DAMAGED)]
        wrong += [f"at {life.boot_s:.0f} s: {line}" for line in said]
        if life.first_tick_s > FIRST_TICK_S or life.latest_s > BETWEEN_S:
            wrong.append(f"at {life.boot_s:.0f} s: late, {life.first_tick_s:.2f} and {life.latest_s:.2f} s")
    if lives[-1].learned < 1.0:
        wrong.append(f"learned {lives[-1].learned:.2f} of the baseline")
    return wrong + wrong_alarms(lives)


def wrong_alarms(lives: list[Life]) -> list[str]:
    """Alarms of tyres other than the deflation of the rear right one in the last life, a line each."""
    wrong: list[str] = []
    tyres = [
        (kind, wheel, state)
        for life in lives
        for _, kind, wheel, state in life.alarms
        if kind != "malfunction"
    ]
    if tyres[:1] != [("deflation", "rr", "raised")] or any(wheel != "rr" for _, wheel, _ in tyres):
        wrong.append(f"alarms of tyres: {tyres}")
    if any(kind != "malfunction" for life in lives[:-1] for _, kind, _, _ in life.alarms):
        wrong.append("an alarm of a tyre before it was soft")
    return wrong


if __name__ == "__main__":
    sys.exit(main())
