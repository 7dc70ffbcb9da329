"""Which tyres have lost radius? A comparison of hypotheses over all wheels at once.

In: the change of the radii against the baseline with its covariance. Out: for each wheel the probability that
it is deflated, and how large the loss is.

Model: change = nuisance + noise - s * (1 on the wheels of subset S), with s > 0 the loss common to the
subset's wheels. Nuisance are the harmless changes that every drive brings, by the way they act (physics
catalogue): all wheels together (centrifugal growth, warm-up), axle against axle (drive slip, load), side
against side (camber, cross-load), and each wheel's own. A hypothesis is a subset S; its likelihood is
averaged over a grid of losses, so larger subsets and freer losses pay for their freedom. Because all wheels
are judged together, a common growth is not taken for a loss and the right wheel is named. A single wheel may
also have become larger: else the one beside it would seem to have shrunk.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np

from tpmsd.monitor.settings import JUDGE
from tpmsd.wheels import FloatArray

LOSS_GRID = np.geomspace(*JUDGE.losses)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the comparison says."""

    deflated: FloatArray
    """(d,) probability that the wheel has lost more than the threshold."""
    none: float
    """Probability that no wheel has lost anything."""
    loss_m: FloatArray
    """(d,) expected loss of each wheel, m."""
    beyond: FloatArray
    """(s,) probability that each of `subsets`, and no other, has lost more than the threshold."""
    suspicion: float
    """Log-likelihood ratio of the best loss beyond the threshold to none at all, whatever its prior, by the
    likeliest account."""
    chances: FloatArray
    """(h,) posterior probability of each of `hypotheses_of`."""
    gains: FloatArray
    """(h,) log-likelihood of each at its best loss, less that of none, by the likeliest account."""
    best_loss_m: FloatArray
    """(d,) loss of each wheel in the most probable hypothesis with a loss, by the likeliest account."""
    accounts: FloatArray
    """(n,) posterior probability of each account of the change."""


def compare(
    change_m: FloatArray,
    covariance_m2: FloatArray,
    radius_m: FloatArray,
    threshold: float,
    log_ratios: FloatArray | None = None,
    one_alone: bool = False,
) -> Verdict:
    """Posterior over all subsets and losses by one account of the change.

    change_m (d,), covariance_m2 (d, d) of change including nuisance; for the rest see `compare_accounts`.
    """
    alone = np.zeros(1)
    return compare_accounts(
        change_m[None], covariance_m2[None], alone, radius_m, threshold, log_ratios, one_alone
    )


def compare_accounts(
    change_m: FloatArray,
    covariance_m2: FloatArray,
    log_weight: FloatArray,
    radius_m: FloatArray,
    threshold: float,
    log_ratios: FloatArray | None = None,
    one_alone: bool = False,
) -> Verdict:
    """Posterior over all subsets and losses, and over accounts of the change.

    change_m (n, d), covariance_m2 (n, d, d) of change including nuisance, log_weight (n,) of each account
    if nothing is lost, radius_m (d,) nominal; threshold relative. log_ratios (s,): log likelihood ratio of
    each of `subsets` to none lost by other, independent evidence; None if there is none. It shifts the
    posterior, not the suspicion. one_alone: only losses of one wheel are considered; where an axle may be of
    any size, others cannot be told from them.
    """
    d = radius_m.size
    whitener = np.linalg.inv(np.linalg.cholesky(covariance_m2))
    seen = np.einsum("nij,nj->ni", whitener, change_m)
    members, weights = _hypotheses(d)
    white = (members * radius_m) @ whitener.transpose(0, 2, 1)
    # Log-likelihood of a loss less that of none: a parabola over the size of the loss.
    slope = -np.einsum("ni,nsi->ns", seen, white)[:, :, None]
    curvature = np.einsum("nsi,nsi->ns", white, white)[:, :, None]
    fit = LOSS_GRID * (slope - 0.5 * LOSS_GRID * curvature)
    logs = log_weight[:, None, None] + fit + np.log(weights / LOSS_GRID.size)[:, None]
    lost = slice(2**d - 1)
    if log_ratios is not None:
        logs[:, lost] += log_ratios[:, None]
    if one_alone:
        logs[:, d:] = -np.inf  # subsets come by size
    log_none = log_weight + math.log1p(-float(weights.sum()))
    top = max(float(logs.max()), float(log_none.max()))
    posterior, weight_none = np.exp(logs - top), np.exp(log_none - top)
    total = float(weight_none.sum() + posterior.sum())
    posterior, weight_none = posterior / total, weight_none / total
    accounts = weight_none + posterior.sum(axis=(1, 2))
    best = int(accounts.argmax())
    likeliest = fit[best]
    of_best, size = np.unravel_index(int(posterior[best, lost].argmax()), likeliest[lost].shape)
    found = posterior.sum(axis=0)
    none_lost = float(weight_none.sum() + found[lost.stop :].sum())
    of_losses, members = found[lost], members[lost]
    beyond = threshold <= LOSS_GRID
    large = of_losses[:, beyond].sum(axis=1)
    # Sums of rounded shares may exceed 1 by the last bit; a saved probability may not.
    return Verdict(
        deflated=np.minimum(large @ members, 1.0),
        none=none_lost,
        loss_m=(of_losses @ LOSS_GRID) @ members * radius_m,
        beyond=large,
        suspicion=float(likeliest[lost][:, beyond].max()),
        chances=found.sum(axis=1),
        gains=likeliest.max(axis=1),
        best_loss_m=members[of_best] * LOSS_GRID[size] * radius_m,
        accounts=accounts,
    )


def subsets(d: int) -> list[tuple[int, ...]]:
    """All subsets of d wheels but the empty one, in the order in which they are compared."""
    return [c for size in range(1, d + 1) for c in itertools.combinations(range(d), size)]


def hypotheses_of(d: int) -> list[tuple[tuple[int, ...], str]]:
    """What may have happened to d wheels, in the order of `Verdict.chances`: which wheels, `loss` or
    `larger`."""
    larger = [((wheel,), "larger") for wheel in range(d)] if d > 2 else []
    return [(members, "loss") for members in subsets(d)] + larger


@functools.cache
def _hypotheses(d: int) -> tuple[FloatArray, FloatArray]:
    """What may have happened to d wheels, (h, d): 1 for those that lost, all subsets first; -1 for one that
    is larger, where there are others to tell that by. And their prior probabilities (h,).
    """
    found = subsets(d)
    members = [[float(wheel in subset) for wheel in range(d)] for subset in found]
    priors = [JUDGE.prior_by_size[len(subset) - 1] for subset in found]
    if d > 2:
        members += (-np.eye(d)).tolist()
        priors += [JUDGE.prior_larger] * d
    return np.array(members), np.array(priors)
