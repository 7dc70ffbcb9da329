"""What `mpf-rb`'s 95 % intervals of left against right cover with other levels of drift than its own.

    python -m bench run drift-levels --seeds 300,301,302,303 --jobs 2

Its histories differ in how much the wheels' radii drift of themselves. Here each history has a level for each
wheel, and the ladders of levels are others; and what is stated of all histories is held against what fewer of
them would state. `docs/bench-estimators.md` has the figures. Nothing of this is in the program.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bench.campaigns.estimators.methods import DEFAULT, Setting, config_of
from bench.campaigns.estimators.play import EVERY, LEVEL, SETTLE_S
from bench.campaigns.estimators.tasks import driven
from bench.worlds.paper_drive import RL, TICK_S
from tpmsd.config.model import Config
from tpmsd.estimators import error_state, mpf_rb
from tpmsd.estimators.odometry_block import Block

Array = NDArray[np.float64]
Ladder = tuple[tuple[float, float], ...]
"""Levels of all wheels alike, relative to `error_state`'s drift, and their prior probabilities."""


@dataclass(frozen=True)
class Variant:
    """A set of levels."""

    name: str
    ladder: Ladder
    wheel: tuple[float, float, float] | None = None
    """Level of one wheel that drifts alone, that of the others, and the prior of each such history."""

    def levels(self, wheels: int) -> list[tuple[Array, float]]:
        """Level (d,) of each wheel and prior probability of each kind of history."""
        out = [(np.full(wheels, level), chance) for level, chance in self.ladder]
        if self.wheel is not None:
            own, rest, chance = self.wheel
            for wheel in range(wheels):
                levels = np.full(wheels, rest)
                levels[wheel] = own
                out.append((levels, chance))
        return out


_CALM: Ladder = ((1.0, 0.1), (0.15, 0.295), (0.03, 0.6), (4.0, 0.005))
VARIANTS = (
    Variant("the program's", mpf_rb.RESTLESS),
    Variant("calm", _CALM),
    Variant(
        "fine ladder",
        ((1.0, 0.1), (0.4, 0.1), (0.15, 0.3), (0.05, 0.2), (0.015, 0.2), (0.005, 0.095), (4.0, 0.005)),
    ),
    Variant("per wheel", ((1.0, 0.1), (0.15, 0.895)), (4.0, 0.15, 0.005)),
    Variant("per wheel, calm", _CALM, (4.0, 0.03, 0.003)),
)
TRIM = 0.02
"""The least probable histories that are left out hold this probability at most."""


class ByWheel(mpf_rb.MpfRb):
    """`mpf-rb` whose histories have a level of drift for each wheel."""

    def __init__(self, config: Config, front: bool, variant: Variant) -> None:
        super().__init__(config.vehicle, config.gnss, config.filter, np.random.default_rng(1), front)
        self._kinds = variant.levels(self._wheels)
        self._kind = np.zeros(self._log_weights.size, dtype=np.intp)
        self._level = np.ones((self._log_weights.size, self._wheels))
        self._log_weights[:] = mpf_rb.UNUSED
        for kind, (levels, chance) in enumerate(self._kinds):
            self._kind[kind], self._level[kind], self._log_weights[kind] = kind, levels, math.log(chance)
        self._own = error_state.drift_covariance(self._wheels) - error_state.DRIFT_COMMON**2
        self._process.drift_at = lambda levels: self._grown()  # type: ignore[method-assign]
        self._drift = self._grown()

    def _grown(self) -> Array:
        """As `ProcessModel.drift_at`, which it is where all wheels have the same level."""
        common = np.clip(self._level.min(axis=1), error_state.CALM_COMMON, 1.0) * error_state.DRIFT_COMMON
        grown = self._level[:, :, None] * self._level[:, None, :] * self._own
        return np.asarray(grown + np.square(common)[:, None, None])

    def _suppose_drift(self) -> None:
        best = int(np.argmax(self._log_weights))
        least = self._log_weights[best] + mpf_rb.LEVEL_FLOOR
        for kind, (levels, _) in enumerate(self._kinds):
            if np.any(self._log_weights[self._kind == kind] >= least):
                continue
            child = int(np.argmin(self._log_weights))
            self._mean[child], self._cov[child] = self._mean[best], self._cov[best]
            self._kind[child], self._level[child], self._log_weights[child] = kind, levels, least

    def _suppose_changes(self, block: Block) -> None:
        order = np.argsort(self._log_weights)
        best, children = order[-1], order[: min(self._wheels, order.size // 4)]
        super()._suppose_changes(block)
        self._kind[children], self._level[children] = self._kind[best], self._level[best]

    def variances(self) -> tuple[float, float, float]:
        """Of left against right: by all histories; by those that hold all but `TRIM`; by the best one."""
        weights = self._weights()
        own = self._mean[:, error_state.MU] - self._mean[:, error_state.MU + 1]
        rear = self._cov[:, error_state.MU : error_state.MU + 2, error_state.MU : error_state.MU + 2]
        within = rear[:, 0, 0] + rear[:, 1, 1] - 2 * rear[:, 0, 1]
        mean = float(weights @ own)
        squares = within + np.square(own - mean)
        order = np.argsort(-weights)
        kept = order[: int(np.searchsorted(np.cumsum(weights[order]), 1.0 - TRIM)) + 1]
        trimmed = float(weights[kept] @ squares[kept] / weights[kept].sum())
        return float(weights @ squares), trimmed, float(squares[order[0]])


def one(task: tuple[str, bool, str, int]) -> tuple[Array, Array, Array]:
    """Errors of left against right at all settled ticks; those at every `EVERY`th, with three variances."""
    scenario, front, name, seed = task
    drive = driven(scenario, "correlated", seed)
    variant = next(v for v in VARIANTS if v.name == name)
    estimator = ByWheel(config_of(DEFAULT, Setting(), None, front), front, variant)
    settled = round(SETTLE_S / TICK_S)
    errors, few, stated = [], [], []
    for k, tick in enumerate(drive.ticks):
        estimate = estimator.step(tick)
        if k < settled:
            continue
        off = estimate.deviation_m[RL:] - drive.offsets_m[k, RL:]
        errors.append(off[0] - off[1])
        if (k - settled) % EVERY == 0:
            few.append(off[0] - off[1])
            stated.append(estimator.variances())
    return np.array(errors), np.array(few), np.array(stated)


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--seeds", default="300,301,302,303", metavar="LIST")
    parser.add_argument("--scenarios", default="balanced,unbalanced,puncture,lively", metavar="LIST")
    parser.add_argument("--jobs", type=int, default=1, metavar="N")


def main(args: argparse.Namespace) -> int:
    """Print a table."""
    seeds = [int(seed) for seed in args.seeds.split(",")]
    print("| drives | variant | RMSE mm | stated mm | NEES, coverage % | 2 % trimmed | best history |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    bound = float(chi2.ppf(LEVEL, 1))
    with ProcessPoolExecutor(args.jobs) as pool:
        for scenario in args.scenarios.split(","):
            for front in (False, True):
                for variant in VARIANTS:
                    tasks = [(scenario, front, variant.name, seed) for seed in seeds]
                    errors, few, stated = (np.concatenate(c) for c in zip(*pool.map(one, tasks), strict=True))
                    nees = np.square(few)[:, None] / stated
                    cells = [
                        f"{np.mean(nees[:, k]):.2f}, {100 * np.mean(nees[:, k] <= bound):.1f}"
                        for k in range(3)
                    ]
                    rmse = 1e3 * math.sqrt(float(np.mean(np.square(errors))))
                    std = 1e3 * math.sqrt(float(np.mean(stated[:, 0])))
                    where = f"{scenario}, {'four wheels' if front else 'rear pair'}"
                    print(
                        f"| {where} | {variant.name} | {rmse:.4f} | {std:.3f} | {' | '.join(cells)} |",
                        flush=True,
                    )
    return 0
