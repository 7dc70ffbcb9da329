"""Plays ticks into an estimator and scores what it says of the rear wheels.

In: an estimator, ticks, the truth. Out: `Played`, `Score`.

Divergence. The paper does not define it. Here a run has diverged if
- an estimate is not a finite number, or
- the filter gave its pose up, or its position is more than `LOST_M` off for more than `LOST_S`: with fixes
  of 1.5 m five times a second all the way, only a filter whose particles are all in the wrong place does
  that. The paper's filters had no way back from there; ours find the pose again, so the loss is counted,
  not its consequences; or
- the left-right difference is more than `WRONG_M` off for more than `WRONG_S`, after settling: twice the
  whole puncture, for longer than any window of the fastest forgetting.
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bench.worlds.paper_drive import RL, RR
from tpmsd.onboard.estimators.base import Estimator
from tpmsd.onboard.timeline.tick import Tick

Array = NDArray[np.float64]
REAR = (RL, RR)
SETTLE_S = 120.0
"""From here on an estimate counts: the first two minutes hold a stop and the search for the pose."""
LOST_M = 30.0
LOST_S = 10.0
WRONG_M = 5e-3
WRONG_S = 60.0
EVERY = 50
"""Coverage and NEES look at every 50th tick: neighbours say the same."""
LEVEL = 0.95


@dataclass(frozen=True)
class Played:
    """What an estimator said, tick by tick."""

    rear_m: Array
    """(n, 2) radius minus nominal of rl and rr."""
    covariance_m2: Array
    """(n, 2, 2)"""
    place: Array
    """(n, 2) east, north."""
    lost: int
    """How often the pose was given up."""
    cpu_s: float
    noise_m: Array = field(default_factory=lambda: np.full((0, 2), math.nan))
    """(n, 2) square roots of the rear wheels' Sigma."""
    all_m: Array | None = None
    """(n, 4) all wheels, where all are estimated, ..."""
    all_covariance_m2: Array | None = None
    """(n, 4, 4) ... and their covariance; every `EVERY`th tick of the settled ones is looked at."""
    stated: Played | None = None
    """The same by `RadiusEstimate.stated`, where the filter has it."""


def play(estimator: Estimator, ticks: list[Tick]) -> Played:
    """Step through all ticks."""
    count = len(ticks)
    rear, place = np.empty((count, 2)), np.empty((count, 2))
    covariance = np.empty((count, 2, 2))
    noise = np.empty((count, 2))
    four, four_cov = np.empty((count, 4)), np.empty((count, 4, 4))
    stated, stated_cov = np.full((count, 4), np.nan), np.full((count, 4, 4), np.nan)
    begun = time.process_time()
    for k, tick in enumerate(ticks):
        estimate = estimator.step(tick)
        rear[k] = estimate.deviation_m[RL:]
        covariance[k] = estimate.covariance_m2[RL:, RL:]
        noise[k] = estimate.noise_std_m[RL:]
        four[k], four_cov[k] = estimate.deviation_m, estimate.covariance_m2
        place[k] = estimate.east_m, estimate.north_m
        if estimate.stated is not None:
            stated[k], stated_cov[k] = estimate.stated.mean_m, estimate.stated.covariance_m2
    cpu_s = time.process_time() - begun
    counts: dict[str, int] = getattr(estimator, "counts", {})
    lost = counts.get("lost_pose", 0)
    out = Played(rear, covariance, place, lost, cpu_s, noise)
    if np.all(np.isfinite(four_cov[-1])):
        out = replace(out, all_m=four, all_covariance_m2=four_cov)
    if not np.all(np.isfinite(stated[-1, RL:])):
        return out
    two = replace(out, rear_m=stated[:, RL:], covariance_m2=stated_cov[:, RL:, RL:])
    if out.all_m is not None:
        two = replace(two, all_m=stated, all_covariance_m2=stated_cov)
    return replace(out, stated=two)


@dataclass(frozen=True)
class Score:
    """One run; lengths in metres."""

    rmse_difference_m: float
    """Of mu3 - mu4, rl minus rr, as in Figs 5 to 9."""
    rmse_radius_m: float
    """Of each rear wheel's own radius, both wheels together."""
    cover_difference: float
    """Share of the looked-at ticks whose 95 % interval holds the truth."""
    cover_radius: float
    nees_difference: float
    """Mean of error^2 / variance; 1 if the filter knows its error."""
    nees_pair: float
    """Mean of e' P^-1 e over the pair; 2 if so."""
    diverged: str
    """Why, or empty."""
    cpu_ms: float
    """Processor time per tick."""

    def row(self) -> dict[str, Any]:
        """As plain numbers."""
        return asdict(self)


def longest(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    padded = np.concatenate([[0], flags.astype(np.int8), [0]])
    edges = np.diff(padded)
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return int((ends - begins).max(initial=0))


def divergence(played: Played, truth_m: Array, place: Array | None, tick_s: float) -> str:
    """Why a run counts as diverged; empty if it does not. `place` None: no truth of the place."""
    settled = round(SETTLE_S / tick_s)
    if not np.all(np.isfinite(played.rear_m)) or not np.all(np.isfinite(played.covariance_m2)):
        return "not finite"
    if played.lost:
        return "pose given up"
    if place is not None:
        off = np.hypot(*(played.place - place).T)
        if longest(off > LOST_M) * tick_s > LOST_S:  # NaN, before the first pose, is no loss
            return "place lost"
    wrong = np.abs(difference(played.rear_m) - difference(truth_m))[settled:] > WRONG_M
    return "radius lost" if longest(wrong) * tick_s > WRONG_S else ""


def difference(rear_m: Array) -> Array:
    """mu3 - mu4: left minus right."""
    return np.asarray(rear_m[..., 0] - rear_m[..., 1])


def nees_four(played: Played, truth_m: Array, tick_s: float) -> float:
    """Mean over the looked-at ticks of e' P^-1 e over all wheels, truth (n, 4); 4 if the filter knows its
    error. NaN where not all are estimated."""
    if played.all_m is None or played.all_covariance_m2 is None:
        return math.nan
    some = slice(round(SETTLE_S / tick_s), None, EVERY)
    error = (played.all_m - truth_m)[some]
    solved = np.linalg.solve(played.all_covariance_m2[some], error[:, :, None])[:, :, 0]
    return float(np.einsum("ki,ki->k", error, solved).mean())


def score(
    played: Played, truth_m: Array, place: Array | None, tick_s: float, settle_s: float = SETTLE_S
) -> Score:
    """Hold a run against the truth: truth_m (n, 2), place (n, 2)."""
    settled = slice(round(settle_s / tick_s), None)
    error = (played.rear_m - truth_m)[settled]
    off = difference(error)
    few, few_cov = error[::EVERY], played.covariance_m2[settled][::EVERY]
    few_off = off[::EVERY]
    variance = few_cov[:, 0, 0] + few_cov[:, 1, 1] - 2 * few_cov[:, 0, 1]
    own = np.einsum("kii->ki", few_cov)
    with np.errstate(divide="ignore", invalid="ignore"):
        nees = few_off**2 / variance
        single = few**2 / own
        # e' P^-1 e of 2 x 2, in terms of sum and difference: no inverse of a nearly singular matrix
        total = few_cov[:, 0, 0] + few_cov[:, 1, 1] + 2 * few_cov[:, 0, 1]
        cross = few_cov[:, 0, 0] - few_cov[:, 1, 1]
        s, d = few.sum(axis=1), few_off
        pair = (variance * s**2 - 2 * cross * s * d + total * d**2) / (total * variance - cross**2)
    bound = float(chi2.ppf(LEVEL, 1))
    return Score(
        rmse_difference_m=math.sqrt(float(np.mean(off**2))),
        rmse_radius_m=math.sqrt(float(np.mean(error**2))),
        cover_difference=float(np.mean(nees <= bound)),
        cover_radius=float(np.mean(single <= bound)),
        nees_difference=float(np.mean(nees)),
        nees_pair=float(np.mean(pair)),
        diverged=divergence(played, truth_m, place, tick_s),
        cpu_ms=1e3 * played.cpu_s / max(len(played.rear_m), 1),
    )
