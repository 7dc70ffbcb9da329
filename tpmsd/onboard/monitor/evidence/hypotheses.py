"""Comparison of hypotheses over all wheels at once: which tyres have lost radius.

In: the change of the radii against the baseline with its covariance. Out: for each wheel the probability that
it is deflated, and how large the loss is.

Model: change = nuisance + noise - s * (1 on the wheels of subset S), with s > 0 the loss common to the
subset's wheels. Nuisance are the nuisance changes that every drive brings, by the way they act (physics
catalogue): all wheels together (centrifugal growth, warm-up), axle against axle (drive slip, load), side
against side (camber, cross-load), and each wheel's own. A hypothesis is a subset S; its likelihood is
averaged over a grid of losses, so larger subsets and freer losses pay for their freedom. Because all wheels
are judged together, a common growth is not taken for a loss and the right wheel is named. A single wheel may
also have become larger: else the one beside it would seem to have shrunk.

Beside any of these wheels may be of another size (`evidence.sizes`), which hides no loss.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.evidence.kernel import compiled
from tpmsd.onboard.monitor.evidence.probability import normal_cdf
from tpmsd.onboard.monitor.evidence.sizes import SizeHypotheses, TyreSizeChange, subsets, unchanged_sizes
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, JUDGE

LOSS_GRID = np.geomspace(*JUDGE.losses)
NEGLIGIBLE = math.exp(-DRIVE_EVIDENCE.negligible_nats)
"""Probability below which a hypothesis adds nothing to a deviation."""


@dataclass(frozen=True, slots=True)
class Table:
    """Logarithms of the joint posterior, but for one constant, by r rows of sizes and s subsets; -inf for
    what was left out."""

    none: FloatArray
    """(r,) nothing lost."""
    larger: FloatArray
    """(d,) the wheel is larger by any amount, nothing else; -inf where that is not compared."""
    lost: FloatArray
    """(r, s)"""
    large: FloatArray
    """(r, s) weighed by `severity`."""

    @classmethod
    def from_logs(
        cls,
        row: NDArray[np.intp],
        none: FloatArray,
        logs: FloatArray,
        threshold: float,
        shape: tuple[int, int],
    ) -> Table:
        """Return the table of n changes of the rows `row` (n,): logs of nothing lost (n,) and of each
        hypothesis and loss of them (n, h, losses); `shape`: r and s."""
        r, s = shape
        shift = np.maximum(np.maximum.reduce(logs, axis=(1, 2)), none)
        shift = np.where(np.isfinite(shift), shift, -1e300)
        scaled = np.exp(logs - shift[:, None, None])
        top = np.full(r, -1e300)
        np.maximum.at(top, row, shift)
        plain = np.add.reduce(scaled, axis=2)
        large = scaled[:, :s] @ severity(threshold)
        parts = np.concatenate([plain, large], axis=1)
        of_row = (row == np.arange(r)[:, None]) * np.exp(shift - top[row])
        with np.errstate(divide="ignore"):
            found = np.log(of_row @ parts) + top[:, None]
        intact = np.full(r, -np.inf)
        np.logaddexp.at(intact, row, none)
        return cls(intact, np.max(found[:, s:-s], axis=0), found[:, :s], found[:, -s:])

    @property
    def log_total(self) -> float:
        """Log of the sum of all entries: the normalising constant."""
        return float(np.logaddexp.reduce([*self.none, *self.larger, *self.lost.ravel()]))

    @property
    def lost_probability(self) -> float:
        """Probability that any wheel has lost radius."""
        return float(np.exp(np.logaddexp.reduce(self.lost, axis=None) - self.log_total))


@dataclass(frozen=True, slots=True)
class Verdict:
    """Posterior probabilities of d wheels' losses and of s sets of wheels of another size."""

    deflated: FloatArray
    """(d,) probability that the wheel is deflated: a loss from the threshold on counts in full, a smaller one
    by its share of it (`severity`)."""
    none: float
    """Probability that no wheel has lost anything."""
    loss_m: FloatArray
    """(d,) expected loss of each wheel, m."""
    off: FloatArray
    """(s,) probability that these wheels are larger or smaller by more than the limit."""
    suspicion: float
    """Log-likelihood ratio of the best loss beyond the threshold to none at all, whatever its prior, by the
    likeliest change hypothesis."""
    gains: FloatArray
    """(h,) log-likelihood of a loss of each of `subsets`, then of each single wheel that is larger, at its
    best size, less that of none, by the likeliest change hypothesis."""
    best_loss_m: FloatArray
    """(d,) loss of each wheel in the most probable hypothesis with a loss, by the likeliest change
    hypothesis.
    """
    change_hypotheses: FloatArray
    """(n,) posterior probability of each change hypothesis of the change."""
    intact: FloatArray
    """(n,) the same with nothing lost."""
    table: Table
    """Joint posterior by rows of sizes, for `evidence.posterior`."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of changes of d tyres with the hypotheses."""

    radius_m: FloatArray
    """(d,) nominal."""
    threshold: float
    """Loss, relative to the radius, beyond which a tyre is deflated."""
    log_ratios: FloatArray | None = None
    """(s,) log likelihood ratio of each of `subsets` to none lost by other, independent evidence; None if
    there is none. It shifts the posterior, not the suspicion."""
    one_alone: bool = False
    """True if only losses of one wheel are considered: where an axle may be of any size, others cannot be
    distinguished from them.
    """
    sizes: TyreSizeChange | None = None
    """Wheels that may be of another size beside a loss; None: none of them."""
    limit: float = math.inf
    """Change, relative, from which a wheel deviates."""

    def compare(self, change_m: FloatArray, covariance_m2: FloatArray) -> Verdict:
        """Return the posterior over all subsets and losses by one change (d,) and its covariance (d, d),
        nuisance included."""
        return self.compare_hypotheses(
            SizeHypotheses.as_learned(change_m[None], covariance_m2[None], np.zeros(1))
        )

    def compare_hypotheses(self, change_hypotheses: SizeHypotheses) -> Verdict:
        """Return the posterior over all subsets and losses by n hypotheses of a change, and of these;
        covariances include nuisance. By compiled code where it was built."""
        found = None if compiled is None else self.by_compiled(change_hypotheses)
        return self.by_arrays(change_hypotheses) if found is None else found

    def by_arrays(self, change_hypotheses: SizeHypotheses) -> Verdict:
        """Return `compare_hypotheses` computed by NumPy, the reference."""
        d = self.radius_m.size
        _, weights, log_shares = _hypotheses(d)
        parabola = self._log_likelihood_parabola(change_hypotheses.change_m, change_hypotheses.covariance_m2)
        slope, curvature = (one[:, :, None] for one in parabola)
        fit = np.asarray(LOSS_GRID * (slope - 0.5 * LOSS_GRID * curvature))
        logs = change_hypotheses.log_weight[:, None, None] + fit + log_shares[:, None]
        logs[change_hypotheses.row > 0, 2**d - 1 :] = -np.inf  # what is larger is a row of sizes there
        if self.log_ratios is not None:
            logs[:, : 2**d - 1] += self.log_ratios[:, None]
        if self.one_alone:
            logs[:, d:] = -np.inf  # subsets come by size
        log_none = change_hypotheses.log_weight + math.log1p(-float(weights.sum()))
        top = max(np.maximum.reduce(logs, axis=None), np.maximum.reduce(log_none))
        posterior, none = np.exp(logs - top), np.exp(log_none - top)
        total = np.add.reduce(none) + np.add.reduce(posterior, axis=None)
        table = Table.from_logs(
            change_hypotheses.row, log_none, logs, self.threshold, (self._row_count, 2**d - 1)
        )
        return self._make_verdict(change_hypotheses, fit, parabola, posterior / total, none / total, table)

    def by_compiled(self, change_hypotheses: SizeHypotheses) -> Verdict | None:
        """Return `compare_hypotheses` computed by `_evidence.c`; None where a covariance has no factor."""
        n, d = change_hypotheses.change_m.shape
        members, weights, log_shares = _hypotheses(d)
        lost, sizes = 2**d - 1, self.sizes or unchanged_sizes(d)
        rows, of_each = len(sizes.mean), change_hypotheses.row.astype(np.float64)
        table = Table(
            np.empty(rows), np.empty(len(members) - lost), np.empty((rows, lost)), np.empty((rows, lost))
        )
        deflated, loss_m, best_loss_m, off = np.empty(d), np.empty(d), np.empty(d), np.empty(lost)
        gains, chances, intact = np.empty(len(members)), np.empty(n), np.empty(n)
        found = compiled.compare(
            *(table.none, table.larger, table.lost, table.large, deflated, loss_m, off, gains, best_loss_m),
            *(chances, intact, np.empty((n, 4 * len(members)))),
            *(np.ascontiguousarray(change_hypotheses.change_m), change_hypotheses.covariance_m2),
            *(change_hypotheses.log_weight, of_each, change_hypotheses.size, change_hypotheses.size_std),
            *(np.array(sizes.subset, dtype=np.float64), members, log_shares),
            np.zeros(lost) if self.log_ratios is None else self.log_ratios,
            *(self.radius_m, LOSS_GRID, severity(self.threshold)),
            *(math.log1p(-float(weights.sum())), self.limit, float(self.one_alone)),
            *(float(LOSS_GRID.searchsorted(self.threshold)), NEGLIGIBLE),
        )
        if found is None:
            return None
        return Verdict(deflated, found[0], loss_m, off, found[1], gains, best_loss_m, chances, intact, table)

    @property
    def _row_count(self) -> int:
        """Number of the rows of sizes."""
        return len((self.sizes or unchanged_sizes(self.radius_m.size)).mean)

    def _log_likelihood_parabola(
        self, change_m: FloatArray, covariance_m2: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return slope at no loss and curvature, (m, h) each, of the log-likelihood of a loss less that of
        none, a parabola over the size of the loss; by m hypotheses of the change (m, d), (m, d, d)."""
        whitener = np.linalg.inv(np.linalg.cholesky(covariance_m2))
        seen = np.einsum("nij,nj->ni", whitener, change_m)
        white = (_hypotheses(self.radius_m.size)[0] * self.radius_m) @ whitener.transpose(0, 2, 1)
        return -np.einsum("ni,nsi->ns", seen, white), np.einsum("nsi,nsi->ns", white, white)

    def _make_verdict(
        self,
        given: SizeHypotheses,
        fit: FloatArray,
        parabola: tuple[FloatArray, FloatArray],
        posterior: FloatArray,
        none: FloatArray,
        table: Table,
    ) -> Verdict:
        """Return the verdict by the log-likelihoods and the posterior (n, h, losses), and that of nothing
        lost (n,)."""
        d = self.radius_m.size
        lost, members = slice(2**d - 1), _hypotheses(d)[0][: 2**d - 1]
        change_hypotheses = none + np.add.reduce(posterior, axis=(1, 2))
        # Whether anything is lost is asked of tyres of the size that was learned.
        usual = fit[int(np.where(given.row == 0, change_hypotheses, -1.0).argmax())]
        found = np.add.reduce(posterior)
        of_losses = found[lost]
        beyond = int(LOSS_GRID.searchsorted(self.threshold))
        large = of_losses @ severity(self.threshold)
        of_best, size = divmod(int(of_losses.argmax()), LOSS_GRID.size)
        # Sums of rounded shares may exceed 1 by the last bit; a saved probability may not.
        return Verdict(
            deflated=np.minimum(large @ members, 1.0),
            none=float(np.add.reduce(none[given.row == 0]) + found[lost.stop :].sum()),
            loss_m=(of_losses @ LOSS_GRID) @ members * self.radius_m,
            off=self._deviation_probability(given, parabola, posterior, change_hypotheses),
            suspicion=float(np.maximum.reduce(usual[lost, beyond:], axis=None)),
            gains=np.maximum.reduce(fit[int(change_hypotheses.argmax())], axis=1),
            best_loss_m=members[of_best] * LOSS_GRID[size] * self.radius_m,
            change_hypotheses=change_hypotheses,
            intact=none,
            table=table,
        )

    def _deviation_probability(
        self,
        given: SizeHypotheses,
        parabola: tuple[FloatArray, FloatArray],
        posterior: FloatArray,
        change_hypotheses: FloatArray,
    ) -> FloatArray:
        """Return the (s,) probability that wheels deviate by more than the limit: by what they lost or
        gained, of which (n, h, losses) is the posterior, or by their size."""
        lost = 2**self.radius_m.size - 1
        out = np.zeros(lost)
        if not math.isfinite(self.limit):
            return out
        chances = np.add.reduce(posterior, axis=2)
        slope, curvature = parabola
        for change_index, found in np.argwhere(chances > NEGLIGIBLE).tolist():
            std = 1.0 / math.sqrt(float(curvature[change_index, found]))
            beyond = float(slope[change_index, found]) * std - self.limit / std
            # Subsets come by size: what is larger is one wheel.
            out[found % lost] += float(chances[change_index, found]) * normal_cdf(beyond)
        subset = (self.sizes or unchanged_sizes(self.radius_m.size)).subset
        for change_index in np.flatnonzero((given.row > 0) & (change_hypotheses > NEGLIGIBLE)).tolist():
            size, std = float(given.size[change_index]), max(float(given.size_std[change_index]), 1e-12)
            over = normal_cdf((size - self.limit) / std) + normal_cdf((-size - self.limit) / std)
            out[subset[int(given.row[change_index])]] += float(change_hypotheses[change_index]) * over
        return out


@functools.cache
def severity(threshold: float) -> FloatArray:
    """Return the (grid,) weight of each loss of the grid as a deflation, for a relative threshold: 1 from it
    on, below it loss over threshold.

    An alarm without any loss is a false one; to name a tyre that has lost four fifths of the threshold is
    hardly one. So what is not known of the size of a certain loss weighs less than whether there is one.
    """
    return np.minimum(LOSS_GRID / threshold, 1.0)


@functools.cache
def _hypotheses(d: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what may have happened to d wheels, (h, d): 1 for those that lost, all subsets first; -1 for one
    that is larger, where there are others to tell that by. Return also their prior probabilities (h,), and
    the logarithm of each loss's part of these (h,)."""
    found = subsets(d)
    members = [[float(wheel in subset) for wheel in range(d)] for subset in found]
    priors = [JUDGE.prior_by_size[len(subset) - 1] for subset in found]
    if d > 2:
        members += (-np.eye(d)).tolist()
        priors += [JUDGE.prior_larger] * d
    weights = np.array(priors)
    return np.array(members), weights, np.log(weights / LOSS_GRID.size)
