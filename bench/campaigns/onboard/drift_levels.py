"""What the Gaussian sum's 95 % intervals of left against right cover with other process-noise levels than
its own.

    python -m bench run drift-levels --seeds 300,301,302,303 --jobs 2

Its hypotheses differ in how much the wheels' radii drift of themselves. Here the ladders of levels are
others; and what is stated of all hypotheses is held against what fewer of them would state.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bench.campaigns.onboard.estimators.methods import ALL, DEFAULT, config_of
from bench.campaigns.onboard.estimators.play import EVERY, LEVEL, SETTLE_S
from bench.campaigns.onboard.estimators.tasks import driven
from bench.worlds.paper_drive import RL, TICK_S
from tpmsd.onboard.estimators.bank.error_state import MU
from tpmsd.onboard.estimators.bank.jump_hypotheses import JUMPS, Bank, JumpHypotheses
from tpmsd.onboard.estimators.bank.mixture import MixtureBelief, MixturePieces
from tpmsd.onboard.estimators.build import build_filter
from tpmsd.onboard.estimators.table import TABLE

Array = NDArray[np.float64]
_OLD = ((1.0, 0.1), (0.15, 0.895), (4.0, 0.005))
_FINE = ((1.0, 0.1), (0.15, 0.3), (0.04, 0.3), (0.01, 0.28), (4.0, 0.005))
VARIANTS: dict[str, JumpHypotheses] = {
    "the program's": JUMPS,
    "three levels": JumpHypotheses(levels=_OLD, alone=None),
    "three levels, or one wheel alone": JumpHypotheses(levels=_OLD, alone=(4.0, 0.15, 0.0035)),
    "fine ladder": JumpHypotheses(levels=_FINE, alone=None),
    "fine ladder, or one wheel alone": JumpHypotheses(levels=_FINE, alone=(4.0, 0.04, 0.0035)),
}
TRIM = 0.02
"""The least probable hypotheses that are left out hold this probability at most."""


def variances(bank: Bank) -> tuple[float, float, float]:
    """Of left against right: by all hypotheses; by those that hold all but `TRIM`; by the best one."""
    weights = bank.weights()
    own = bank.mean[:, MU] - bank.mean[:, MU + 1]
    rear = bank.covariance[:, MU : MU + 2, MU : MU + 2]
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
    config = config_of(DEFAULT, None, front, ALL)
    row = TABLE[DEFAULT]
    assert isinstance(row.pieces, MixturePieces)
    row = replace(row, pieces=replace(row.pieces, changes=VARIANTS[name]))
    rng = np.random.default_rng(1)
    estimator = build_filter(config.vehicle, config.gnss, config.filter, rng, front, row)
    belief = estimator.belief
    assert isinstance(belief, MixtureBelief)
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
            stated.append(variances(belief.bank))
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
                    tasks = [(scenario, front, variant, seed) for seed in seeds]
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
                        f"| {where} | {variant} | {rmse:.4f} | {std:.3f} | {' | '.join(cells)} |",
                        flush=True,
                    )
    return 0
