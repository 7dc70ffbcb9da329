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

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.settings import JUDGE

LOSS_GRID = np.geomspace(*JUDGE.losses)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the comparison says."""

    deflated: FloatArray
    """(d,) probability that the wheel is deflated: a loss from the threshold on counts in full, a smaller one
    by its share of it (`severity`)."""
    none: float
    """Probability that no wheel has lost anything."""
    loss_m: FloatArray
    """(d,) expected loss of each wheel, m."""
    beyond: FloatArray
    """(s,) the same that the wheels of each of `subsets`, and no other, are."""
    larger: FloatArray
    """(d,) probability that the wheel, and no other, is larger than was learned."""
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


@dataclass(frozen=True, slots=True)
class Comparison:
    """What changes of d tyres are held against."""

    radius_m: FloatArray
    """(d,) nominal."""
    threshold: float
    """Loss, relative to the radius, beyond which a tyre is deflated."""
    log_ratios: FloatArray | None = None
    """(s,) log likelihood ratio of each of `subsets` to none lost by other, independent evidence; None if
    there is none. It shifts the posterior, not the suspicion."""
    one_alone: bool = False
    """Whether only losses of one wheel are considered: where an axle may be of any size, others cannot be
    told from them."""

    def of(self, change_m: FloatArray, covariance_m2: FloatArray) -> Verdict:
        """Posterior over all subsets and losses by one account of the change: change_m (d,), covariance_m2
        (d, d) of change including nuisance."""
        return self.of_each(change_m[None], covariance_m2[None])[0]

    def of_each(self, change_m: FloatArray, covariance_m2: FloatArray) -> list[Verdict]:
        """The same of k changes, each by itself: (k, d), (k, d, d)."""
        return self._verdicts(change_m[:, None], covariance_m2[:, None], np.zeros(1))

    def of_accounts(self, change_m: FloatArray, covariance_m2: FloatArray, log_weight: FloatArray) -> Verdict:
        """Posterior over n accounts of one change as well: change_m (n, d), covariance_m2 (n, d, d) including
        nuisance, log_weight (n,) of each account if nothing is lost."""
        return self._verdicts(change_m[None], covariance_m2[None], log_weight)[0]

    def _verdicts(
        self, change_m: FloatArray, covariance_m2: FloatArray, log_weight: FloatArray
    ) -> list[Verdict]:
        """Of k changes by n accounts each: (k, n, d), (k, n, d, d), (n,)."""
        d = self.radius_m.size
        _, weights, log_shares = _hypotheses(d)
        fit = self._fit(change_m.reshape(-1, d), covariance_m2.reshape(-1, d, d))
        fit = fit.reshape(*change_m.shape[:2], *fit.shape[1:])
        logs = log_weight[:, None, None] + fit + log_shares[:, None]
        if self.log_ratios is not None:
            logs[:, :, : 2**d - 1] += self.log_ratios[:, None]
        if self.one_alone:
            logs[:, :, d:] = -np.inf  # subsets come by size
        log_none = log_weight + math.log1p(-float(weights.sum()))
        top = np.maximum(np.maximum.reduce(logs, axis=(1, 2, 3)), np.maximum.reduce(log_none))
        posterior, none = np.exp(logs - top[:, None, None, None]), np.exp(log_none - top[:, None])
        total = np.add.reduce(none, axis=1) + np.add.reduce(posterior, axis=(1, 2, 3))
        posterior, none = posterior / total[:, None, None, None], none / total[:, None]
        return [self._verdict(*one) for one in zip(fit, posterior, none, strict=True)]

    def _fit(self, change_m: FloatArray, covariance_m2: FloatArray) -> FloatArray:
        """(m, h, losses) log-likelihood of a loss less that of none, a parabola over the size of the loss, by
        m accounts (m, d), (m, d, d)."""
        whitener = np.linalg.inv(np.linalg.cholesky(covariance_m2))
        seen = np.einsum("nij,nj->ni", whitener, change_m)
        white = (_hypotheses(self.radius_m.size)[0] * self.radius_m) @ whitener.transpose(0, 2, 1)
        slope = -np.einsum("ni,nsi->ns", seen, white)[:, :, None]
        curvature = np.einsum("nsi,nsi->ns", white, white)[:, :, None]
        return np.asarray(LOSS_GRID * (slope - 0.5 * LOSS_GRID * curvature))

    def _verdict(self, fit: FloatArray, posterior: FloatArray, none: FloatArray) -> Verdict:
        """Of one change: log-likelihoods and posterior (n, h, losses), and that of nothing lost (n,)."""
        d = self.radius_m.size
        lost, members = slice(2**d - 1), _hypotheses(d)[0][: 2**d - 1]
        accounts = none + np.add.reduce(posterior, axis=(1, 2))
        best = int(accounts.argmax())
        likeliest = fit[best]
        of_best, size = divmod(int(posterior[best, lost].argmax()), LOSS_GRID.size)
        found = np.add.reduce(posterior)
        of_losses = found[lost]
        beyond = int(LOSS_GRID.searchsorted(self.threshold))
        chances = np.add.reduce(found, axis=1)
        large = of_losses @ severity(self.threshold)
        # Sums of rounded shares may exceed 1 by the last bit; a saved probability may not.
        return Verdict(
            deflated=np.minimum(large @ members, 1.0),
            none=float(np.add.reduce(none) + found[lost.stop :].sum()),
            loss_m=(of_losses @ LOSS_GRID) @ members * self.radius_m,
            beyond=large,
            larger=chances[lost.stop :] if d > 2 else np.zeros(d),
            suspicion=float(np.maximum.reduce(likeliest[lost, beyond:], axis=None)),
            chances=chances,
            gains=np.maximum.reduce(likeliest, axis=1),
            best_loss_m=members[of_best] * LOSS_GRID[size] * self.radius_m,
            accounts=accounts,
        )


@functools.cache
def severity(threshold: float) -> FloatArray:
    """(grid,) how much of a deflation each loss of the grid is, for a relative threshold: 1 from it on, below
    it loss over threshold.

    An alarm without any loss is a false one; to name a tyre that has lost four fifths of the threshold is
    hardly one. So what is not known of the size of a certain loss weighs less than whether there is one.
    """
    return np.minimum(LOSS_GRID / threshold, 1.0)


def subsets(d: int) -> list[tuple[int, ...]]:
    """All subsets of d wheels but the empty one, in the order in which they are compared."""
    return [c for size in range(1, d + 1) for c in itertools.combinations(range(d), size)]


def hypotheses_of(d: int) -> list[tuple[tuple[int, ...], str]]:
    """What may have happened to d wheels, in the order of `Verdict.chances`: which wheels, `loss` or
    `larger`."""
    larger = [((wheel,), "larger") for wheel in range(d)] if d > 2 else []
    return [(members, "loss") for members in subsets(d)] + larger


@functools.cache
def _hypotheses(d: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What may have happened to d wheels, (h, d): 1 for those that lost, all subsets first; -1 for one that
    is larger, where there are others to tell that by. And their prior probabilities (h,), and the logarithms
    of each loss's share of them (h,).
    """
    found = subsets(d)
    members = [[float(wheel in subset) for wheel in range(d)] for subset in found]
    priors = [JUDGE.prior_by_size[len(subset) - 1] for subset in found]
    if d > 2:
        members += (-np.eye(d)).tolist()
        priors += [JUDGE.prior_larger] * d
    weights = np.array(priors)
    return np.array(members), weights, np.log(weights / LOSS_GRID.size)
