"""Wheels of another size than was learned: a change that stands beside any loss, and hides none.

In: the monitored wheels. Out: `TyreSizeChange`, the rows of that change; and `with_sizes`, hypotheses of one
change under each of them.

Other tyres, chains, or a receiver that scales make the radii of one wheel, an axle or all larger by the share
x; after wheels were changed front to rear x has one sign in front and the other behind. x is normal with mean
and variance of its row. So a row adds x's covariance to that of the change and takes its mean off; what is
left is held against the losses. A row and a loss are no alternatives: both can be true at once.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import IS_FRONT, FloatArray
from tpmsd.onboard.monitor.evidence.kernel import compiled
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, JUDGE


@dataclass(frozen=True, slots=True)
class TyreSizeChange:
    """r rows, the first of them with no change of size. Relative to the radius."""

    pattern: FloatArray
    """(r, d) 1 or -1 for the wheels whose size has changed."""
    mean: FloatArray
    """(r,)"""
    variance: FloatArray
    """(r,)"""
    log_prior: FloatArray
    """(r,)"""
    subset: list[int]
    """(r) which of `subsets` the wheels of each row are; 0 for none of them."""
    came: int = 0
    """Number of the last rows, of sizes that came in the window in question: their wheels are those of the
    rows from the second on."""

    @property
    def all_wheels_row(self) -> FloatArray:
        """(r,) 1 for the row of all wheels larger, 0 for the others."""
        return np.array([float(row.min() > 0.0) for row in self.pattern])

    def rows_of_window(self, before: SizeHypotheses, lost: float) -> TyreSizeChange:
        """Return the rows of a window by what was seen before it, hypotheses under every row; behind them
        rows of sizes that came in the window, where all was as learned before.

        `lost`: probability that a tyre had lost air before: then nothing is known of the sizes. That one
        wheel seems larger all at once also comes from signals: it is as probable as a new tyre. An axle or
        all of them hardly ever change on the way."""
        share, mean, variance = before.moments_by_row(len(self.mean))
        with np.errstate(divide="ignore"):
            weights = np.stack([np.log1p(-lost) + share, np.log(lost) + self.log_prior])
        known = np.logaddexp.reduce(weights)
        first, second = np.exp(weights - known)
        middle = first * mean + second * self.mean
        spread = first * (variance + (mean - middle) ** 2) + second * (
            self.variance + (self.mean - middle) ** 2
        )
        several = np.abs(self.pattern).sum(axis=1) > 1.0
        on_drive = np.log(np.where(several, DRIVE_EVIDENCE.resized_while_driving, 1.0))
        return TyreSizeChange(
            np.concatenate([self.pattern, self.pattern[1:]]),
            np.concatenate([middle, self.mean[1:]]),
            np.concatenate([spread, self.variance[1:]]),
            np.concatenate([known, known[0] + (self.log_prior + on_drive)[1:]]),
            [*self.subset, *self.subset[1:]],
            came=len(self.mean) - 1,
        )

    @classmethod
    def from_rows(
        cls, pattern: list[FloatArray], mean: list[float], variance: list[float], prior: list[float]
    ) -> TyreSizeChange:
        """Return the rows of these patterns (d,), means, variances and prior probabilities; `prior` of all
        rows but the first."""
        indices = {members: index for index, members in enumerate(subsets(pattern[0].size))}
        wheels = [tuple(np.flatnonzero(row).tolist()) for row in pattern]
        return cls(
            np.array(pattern),
            np.array(mean),
            np.array(variance),
            np.log([1.0 - sum(prior), *prior]),
            [indices.get(members, 0) for members in wheels],
        )


def subsets(d: int) -> list[tuple[int, ...]]:
    """Return all subsets of d wheels but the empty one, in the order in which they are compared."""
    return [c for size in range(1, d + 1) for c in itertools.combinations(range(d), size)]


@functools.cache
def size_rows(wheels: tuple[int, ...]) -> TyreSizeChange:
    """Return the rows of a car of which these wheels are monitored: no change; one wheel, an axle or all
    larger; wheels changed front to rear. What is smaller has no row: nothing tells it from a loss, and
    nothing should."""
    front = IS_FRONT[list(wheels)]
    # Of a pair alone nothing tells which wheel has changed: there it is the one that lost.
    alone = np.eye(len(wheels)) if len(wheels) > 2 else np.empty((0, len(wheels)))
    axles = {tuple(mask.tolist()) for mask in (front, ~front, front | ~front) if np.count_nonzero(mask) > 1}
    larger = [*alone, *(np.array(axle, dtype=np.float64) for axle in sorted(axles))]
    changed = [np.where(front, 1.0, -1.0)] if front.any() and not front.all() else []
    mean, std = JUDGE.resized
    rows, several = len(larger) + len(changed), len(axles) + len(changed)
    return TyreSizeChange.from_rows(
        [np.zeros(len(wheels)), *larger, *changed],
        [0.0, *[mean] * len(larger), *[0.0] * len(changed)],
        [0.0, *[std**2] * rows],
        [*[JUDGE.prior_larger] * len(alone), *[JUDGE.prior_resized] * several],
    )


@functools.cache
def unchanged_sizes(d: int) -> TyreSizeChange:
    """Return the single row of d wheels that are all of the size that was learned."""
    return TyreSizeChange.from_rows([np.zeros(d)], [0.0], [0.0], [])


@dataclass(frozen=True, slots=True)
class SizeHypotheses:
    """Hypotheses of a change with and without another size of some wheels, n of them."""

    change_m: FloatArray
    """(n, d) without the mean of that size."""
    covariance_m2: FloatArray
    """(n, d, d) with its variance."""
    log_weight: FloatArray
    """(n,) if no tyre has lost air."""
    row: NDArray[np.intp]
    """(n,) index of the row."""
    size: FloatArray
    """(n,) of the row, relative, if no tyre has lost air, and ..."""
    size_std: FloatArray
    """(n,)"""

    def moments_by_row(self, rows: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the log probability of each row, mean and variance of its size, (r,) each, of hypotheses
        under every row, row by row."""
        logs, size, std = (one.reshape(rows, -1) for one in (self.log_weight, self.size, self.size_std))
        total = np.logaddexp.reduce(logs, axis=1)
        weight = np.exp(logs - total[:, None])
        mean = np.add.reduce(weight * size, axis=1)
        variance = np.add.reduce(weight * (std**2 + (size - mean[:, None]) ** 2), axis=1)
        return total - np.logaddexp.reduce(total), mean, variance

    @classmethod
    def as_learned(
        cls, change_m: FloatArray, covariance_m2: FloatArray, log_weight: FloatArray
    ) -> SizeHypotheses:
        """Return hypotheses in which all wheels are of the size that was learned."""
        zeros = np.zeros(log_weight.size)
        return cls(change_m, covariance_m2, log_weight, zeros.astype(np.intp), zeros, zeros)


def with_sizes(
    change_m: FloatArray,
    covariance_m2: FloatArray,
    log_weight: FloatArray,
    radius_m: FloatArray,
    sizes: TyreSizeChange,
    *,
    every: bool = False,
) -> SizeHypotheses:
    """Return m hypotheses of a change, (m, d), (m, d, d) and (m,), under the first row and each that is not
    negligible; with `every` under all rows, row by row.

    radius_m: (d,); by compiled code where it was built."""
    given = change_m, covariance_m2, log_weight, radius_m, sizes
    found = None if compiled is None else with_sizes_by_compiled(*given, every=every)
    return with_sizes_by_arrays(*given, every=every) if found is None else found


def with_sizes_by_compiled(
    change_m: FloatArray,
    covariance_m2: FloatArray,
    log_weight: FloatArray,
    radius_m: FloatArray,
    sizes: TyreSizeChange,
    *,
    every: bool = False,
) -> SizeHypotheses | None:
    """Return `with_sizes` computed by `_evidence.c`; None where a covariance is not positive definite."""
    (m, d), rows = covariance_m2.shape[:2], len(sizes.mean)
    out = np.empty((rows * m, d)), np.empty((rows * m, d, d)), *np.empty((4, rows * m))
    count = compiled.with_sizes(
        *(*out, np.empty((rows, m)), np.ascontiguousarray(change_m), covariance_m2, log_weight, radius_m),
        *(sizes.pattern, sizes.mean, sizes.variance, sizes.log_prior),
        *(float(every), DRIVE_EVIDENCE.negligible_nats),
    )
    if count < 0:
        return None
    change, covariance, log, row, size, std = (one[:count] for one in out)
    return SizeHypotheses(change, covariance, log, row.astype(np.intp), size, std)


def with_sizes_by_arrays(
    change_m: FloatArray,
    covariance_m2: FloatArray,
    log_weight: FloatArray,
    radius_m: FloatArray,
    sizes: TyreSizeChange,
    *,
    every: bool = False,
) -> SizeHypotheses:
    """Return `with_sizes` computed by NumPy, the reference."""
    pattern = sizes.pattern * radius_m
    rest = change_m - (sizes.mean[:, None] * pattern)[:, None]  # (r, m, d)
    spread = sizes.variance[:, None, None] * pattern[:, :, None] * pattern[:, None, :]
    total = covariance_m2 + spread[:, None]
    solved = np.linalg.solve(total, rest[..., None])[..., 0]
    squares = np.einsum("rmd,rmd->rm", rest, solved)
    _, volumes = np.linalg.slogdet(total)
    gain = 0.5 * (squares[0] + volumes[0] - squares - volumes)  # the first row changes no size
    logs = sizes.log_prior[:, None] + log_weight + gain
    counts = every | (logs + 0.5 * squares > logs.max() - DRIVE_EVIDENCE.negligible_nats)
    counts[0] = True
    row, index = np.nonzero(counts)
    left, patterns, variance = solved[row, index], pattern[row], sizes.variance[row]
    weighed = np.linalg.solve(total[row, index], patterns[..., None])[..., 0]
    known = variance - variance**2 * np.einsum("nd,nd->n", patterns, weighed)
    return SizeHypotheses(
        rest[row, index],
        total[row, index],
        logs[row, index],
        row,
        sizes.mean[row] + variance * np.einsum("nd,nd->n", patterns, left),
        np.sqrt(np.maximum(known, 0.0)),
    )
