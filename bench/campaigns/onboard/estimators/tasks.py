"""Which runs the comparison consists of, and how one is done.

In: numbers of runs and particles. Out: `Task`s, and for each a row of plain numbers. Every method plays
the very same drives: a seed names receiver errors, road and phases of the counts; the filter's own draws
follow from it.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from bench.campaigns.onboard.estimators.limit import limit
from bench.campaigns.onboard.estimators.methods import (
    DEFAULT,
    SAMPLED,
    TEXTBOOK,
    Setting,
    available,
    build,
    heard,
    setting_of,
)
from bench.campaigns.onboard.estimators.play import Played, play, score
from bench.worlds.paper_drive import RL, SCENARIOS, TICK_S, Driven, drive

NUMBERS = (100, 500, 1000, 5000)
"""Particles, as in Figs 9 and 10."""
USUAL = 1000
RECEIVERS = ("white", "correlated")
LIMIT = "limit"
"""The method name of the smoother and filter that know the noise."""
SERIES_EVERY = 20
"""Figures draw every 20th tick."""


@dataclass(frozen=True)
class Task:
    """One run."""

    scenario: str
    receiver: str
    seed: int
    method: str
    particles: int
    """0: the method's own number, or none."""
    front: bool = False
    setting: Setting | None = None
    """None: as tuned."""

    @property
    def label(self) -> str:
        """For the progress line."""
        number = f" N={self.particles}" if self.particles else ""
        wheels = ", four wheels" if self.front else ""
        return f"{self.method}{number}{wheels}: {self.scenario}, {self.receiver}, seed {self.seed}"


@lru_cache(maxsize=2)
def driven(scenario: str, receiver: str, seed: int) -> Driven:
    """The drive of a task; neighbours in the plan share it."""
    return drive(SCENARIOS[scenario], receiver, seed)


def runs_of(particles: int, runs: int) -> int:
    """5000 particles take half of the time of all: they get half of the runs."""
    return max(1, runs // 2) if particles >= 5000 else runs


def plan(runs: int, receivers: tuple[str, ...] = RECEIVERS) -> list[Task]:
    """All runs: Figs 9 and 10 on the puncture, one number of particles elsewhere."""
    have, _ = available()
    out = []
    for receiver in receivers:
        for scenario in SCENARIOS:
            for method in have:
                numbers: tuple[int, ...] = (0,)
                if method in SAMPLED:
                    numbers = NUMBERS if scenario == "puncture" else (USUAL,)
                    if method == TEXTBOOK and scenario != "puncture" and receiver == "correlated":
                        numbers = (USUAL, NUMBERS[-1])
                for number in numbers:
                    out += [Task(scenario, receiver, s, method, number) for s in range(runs_of(number, runs))]
            out += [Task(scenario, receiver, s, DEFAULT, 0, True) for s in range(runs)]
            out += [Task(scenario, receiver, s, LIMIT, 0) for s in range(runs_of(NUMBERS[-1], runs))]

    def order(t: Task) -> tuple[Any, ...]:
        """Seed by seed, so that a run cut short has seen all; what takes longest and is in no ratio last."""
        dear = t.particles >= NUMBERS[-1] and t.method != TEXTBOOK
        return t.seed, dear, t.scenario, t.receiver, t.method, t.front, t.particles

    return sorted(out, key=order)


def perform(task: Task) -> dict[str, Any]:
    """Do one run; the row says what it was and how it went."""
    begun = time.monotonic()
    d = driven(task.scenario, task.receiver, task.seed)
    truth, place = d.offsets_m[:, RL:], d.pose[1:, :2]
    row: dict[str, Any] = asdict(task)
    if task.method == LIMIT:
        cpu = time.process_time()
        found = limit(d)
        cpu = time.process_time() - cpu
        for name, rear, cov in (
            ("causal", found.causal_m, found.causal_cov),
            ("smoother", found.smoothed_m, found.smoothed_cov),
        ):
            row[name] = score(Played(rear, cov, place, 0, cpu), truth, place, TICK_S).row()
        return row
    setting = task.setting or setting_of(task.method, task.receiver)
    estimator = build(task.method, setting, task.particles or None, task.seed, task.front)
    played = play(estimator, heard(d.ticks, setting))
    row |= score(played, truth, place, TICK_S).row()
    row["elapsed_s"] = time.monotonic() - begun
    if task.seed == 0 and task.particles in (0, USUAL):
        some = slice(None, None, SERIES_EVERY)
        row["series"] = {
            "difference_mm": _mm(played.rear_m[some, 0] - played.rear_m[some, 1]),
            "truth_mm": _mm(truth[some, 0] - truth[some, 1]),
            "left_mm": _mm(played.rear_m[some, 0]),
            "right_mm": _mm(played.rear_m[some, 1]),
        }
    return row


def _mm(values: np.ndarray[Any, np.dtype[np.float64]]) -> list[float]:
    return [round(1e3 * float(v), 4) for v in values]
