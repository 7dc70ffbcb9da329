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
    ALL,
    DEFAULT,
    INPUTS,
    POSITIONS,
    SAMPLED,
    TEXTBOOK,
    available,
    build,
)
from bench.campaigns.onboard.estimators.play import Played, nees_four, play, score
from bench.worlds.paper_drive import RL, SCENARIOS, TICK_S, Driven, drive

NUMBERS = (100, 500, 1000, 5000)
"""Particles, as in Figs 9 and 10."""
USUAL = 500
"""Number of particles in tables with one such number; half of what AUG-PF needs in the paper's Fig 9."""
RECEIVERS = ("white", "correlated")
LIMIT = "limit"
"""The method name of the smoother and filter that know the noise."""
COSTLY = (TEXTBOOK, "aug-pf")
"""Methods that are run with the most particles, on a quarter of the seeds."""
FOUR = (DEFAULT, "mpf-pn")
"""Methods that are run on four wheels too."""
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
    inputs: str = POSITIONS
    """A key of `INPUTS`."""

    @property
    def label(self) -> str:
        """For the progress line."""
        number = f" N={self.particles}" if self.particles else ""
        wheels = ", four wheels" if self.front else ""
        what = f"{self.scenario}, {self.receiver}, {self.inputs}"
        return f"{self.method}{number}{wheels}: {what}, seed {self.seed}"


@lru_cache(maxsize=2)
def driven(scenario: str, receiver: str, seed: int) -> Driven:
    """The drive of a task; neighbours in the plan share it."""
    return drive(SCENARIOS[scenario], receiver, seed)


def numbers_of(method: str, scenario: str, inputs: str) -> tuple[int, ...]:
    """Particles of a method's runs in a cell: Figs 9 and 10 are of the puncture by positions."""
    if method not in SAMPLED:
        return (0,)
    return NUMBERS if scenario == "puncture" and inputs == POSITIONS else (USUAL,)


def cell(scenario: str, receiver: str, seed: int, inputs: str, most: bool) -> list[Task]:
    """The runs of all methods on one drive by some inputs; `most`: also those of the most particles."""
    out = [
        Task(scenario, receiver, seed, method, number, False, inputs)
        for method in available()[0]
        if inputs == POSITIONS or method != TEXTBOOK
        for number in numbers_of(method, scenario, inputs)
        if number < NUMBERS[-1] or (method in COSTLY and most)
    ]
    if inputs == ALL:
        numbers = {method: USUAL if method in SAMPLED else 0 for method in FOUR}
        out += [Task(scenario, receiver, seed, method, n, True, ALL) for method, n in numbers.items()]
    return out


def plan(runs: int, receivers: tuple[str, ...] = RECEIVERS) -> list[Task]:
    """All runs, seed by seed: every scenario by positions, and with correlated errors by all there is; the
    puncture with each measurement added; both of the product's filters on four wheels too."""
    out = []
    for seed in range(runs):
        for receiver in receivers:
            for scenario in SCENARIOS:
                out.append(Task(scenario, receiver, seed, LIMIT, 0))
                for inputs in INPUTS:
                    if inputs == POSITIONS or (
                        receiver != "white" and (inputs == ALL or scenario == "puncture")
                    ):
                        out += cell(scenario, receiver, seed, inputs, seed < runs // 4 + 1)
    return sorted(out, key=lambda t: (t.seed, t.particles >= NUMBERS[-1]))


def perform(task: Task, d: Driven | None = None) -> dict[str, Any]:
    """Do one run, on `d` in place of the task's drive if given; the row says what it was and how it went."""
    begun = time.monotonic()
    d = driven(task.scenario, task.receiver, task.seed) if d is None else d
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
    estimator = build(task.method, task.particles or None, task.seed, task.front, task.inputs)
    played = play(estimator, d.ticks)
    row |= score(played, truth, place, TICK_S).row()
    row["nees_four"] = nees_four(played, d.offsets_m, TICK_S)
    if played.stated is not None:
        row["stated"] = score(played.stated, truth, place, TICK_S).row()
        row["stated"]["nees_four"] = nees_four(played.stated, d.offsets_m, TICK_S)
    row["elapsed_s"] = time.monotonic() - begun
    if task.seed == 0 and task.particles in (0, USUAL) and task.inputs == POSITIONS:
        some = slice(None, None, SERIES_EVERY)
        row["series"] = {
            "difference_mm": _mm(played.rear_m[some, 0] - played.rear_m[some, 1]),
            "truth_mm": _mm(truth[some, 0] - truth[some, 1]),
            "left_mm": _mm(played.rear_m[some, 0]),
            "right_mm": _mm(played.rear_m[some, 1]),
            "left_noise_mm": _mm(played.noise_m[some, 0]),
            "right_noise_mm": _mm(played.noise_m[some, 1]),
            "east_m": np.round(played.place[some, 0], 1).tolist(),
            "north_m": np.round(played.place[some, 1], 1).tolist(),
        }
    return row


def _mm(values: np.ndarray[Any, np.dtype[np.float64]]) -> list[float]:
    return [round(1e3 * float(v), 4) for v in values]
