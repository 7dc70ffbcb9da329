"""Counts that a wheel loses or adds one by one, found by how its distance scatters.

In: a drive's `Linearised` windows, what the model leaves of the channels. Out: `SingleLosses`, or None.

A share of counts that is lost is taken up by the calibration of the radius, for it is a constant. But counts
are lost one at a time and at random: a wheel's distance falls back in steps of a whole count, and their
number in a window has a Poisson distribution, whose mean is a share of what was counted. So the wheel
scatters more than the others, and two accounts of its scatter are compared by their likelihood: steps of a
count beside normal noise; and symmetric noise of any size, with tails as heavy as it likes (Student's
distribution). A wheel's distance is compared with what the other wheels and the gyro leave open, the motion's
speed and yaw rate eliminated by least squares.

Skew alone is no loss. Three things that a Poisson process cannot lack are asked of the drive itself:

- Losses last, a late reading does not. A count that the control unit took some milliseconds before the
  frame, in a rhythm that beats against the frames, skews the distances by several counts, and so does
  rounding at steady speed; but the next reading makes up for it. Distances over many windows must scatter
  more than those over one by what losses add up to (Poisson: the variance grows with the mean; of a bounded
  error it does not grow).
- Losses come at random from window to window. What slip, load or a temperature do to a radius lasts for
  seconds, so that distances over two and four windows scatter more than the losses would.
- Losses are of one wheel. It scatters more than the others, whose readings are as late; and no other
  direction in the space of what the motion leaves open, such as front against rear where their messages are
  of different ages, may explain more.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import gammaln, logsumexp

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.inference.trajectory import WINDOW_S
from tpmsd.offline.inference.windows import GYRO, Linearised
from tpmsd.offline.rings.settings import COUNTERS


@dataclass(frozen=True)
class SingleLosses:
    """Counts that one wheel loses or adds."""

    wheel: str
    rate_per_s: float
    """Positive where they are lost."""
    rate_std_per_s: float
    std: float
    """Noise of the wheel's distance over a window, in counts."""
    similar_wheels: tuple[str, ...]
    """Other wheels of which the opposite would look the same."""
    gain: float
    """Log-likelihood of steps over that of symmetric noise, nats."""
    unlike: float
    """Log-likelihood of a scatter of its own over that of the other wheels' scatter, nats."""
    p_value: float
    """Probability that a symmetric scatter favours losses as much on one of the wheels, at most."""


@dataclass(frozen=True)
class _Distances:
    """Evidence of a wheel's distance beside the other wheels and the gyro."""

    counts: FloatArray
    """(w,) in counts, less the mean of some minutes."""
    counted: FloatArray
    """(w,) that the wheel made in a window."""
    explained: float
    """Half the sum of squares that an error of this wheel explains."""
    elsewhere: float
    """Log-likelihood of scatter in the best direction of all over that in this wheel's, nats."""


@dataclass(frozen=True)
class _CountSteps:
    """Steps of a count beside normal noise."""

    share: float
    """Fraction of what was counted."""
    std: float
    """Standard deviation of the share, by the curvature of the likelihood."""
    log_likelihood: float
    ahead: FloatArray
    """(w,) log-likelihood of each window over that of the same with the opposite sign."""


def single_losses(
    windows: Linearised, left: FloatArray, count_m: FloatArray, gyro_radps: float
) -> SingleLosses | None:
    """Return the losses of the wheel that shows them best; None where none are significant.

    `left` (w, 9) of the channels by the model; `count_m` (4,) distance of a wheel per count, zero where it
    does not count; `gyro_radps` standard deviation of a window's yaw rate.
    """
    distances = _distance_residuals(windows, left, count_m, gyro_radps)
    if not distances:
        return None
    most = max(distance.explained for distance in distances.values())
    similar = [wheel for wheel in distances if distances[wheel].explained > COUNTERS.single_similar * most]
    # A counter in order rather misses a count than makes one up.
    wheel = min(similar, key=lambda one: float(np.mean(distances[one].counts ** 3)))
    counts = distances[wheel].counts
    sign = -1.0 if float(np.mean(counts**3)) < 0.0 else 1.0
    counted = distances[wheel].counted
    steps = _fit_count_steps(sign * counts, counted)
    mean = steps.share * float(counted.mean())
    gain = steps.log_likelihood - _symmetric_log_likelihood(counts) - _misfit_of_random_losses(counts, mean)
    unlike = _own_variance_log_likelihood_ratio(
        counts, [distance.counts for other, distance in distances.items() if other not in similar]
    )
    if _loss_log_likelihood_ratio(counts, mean) < COUNTERS.single_admit_nats:
        return None
    if distances[wheel].elsewhere > COUNTERS.lost_admit_nats:
        return None
    if gain < COUNTERS.single_admit_nats or unlike < COUNTERS.lost_admit_nats:
        return None
    by_growth = _lost_counts_by_variance_growth(counts)
    return SingleLosses(
        wheel=WHEELS[wheel],
        rate_per_s=-sign * 0.5 * (mean + by_growth) / WINDOW_S,
        # The two differ where the noise is not normal, as that of late readings is not.
        rate_std_per_s=math.hypot(steps.std * mean / steps.share, 0.5 * (mean - by_growth)) / WINDOW_S,
        std=float(counts.std()),
        similar_wheels=tuple(WHEELS[other] for other in similar if other != wheel),
        gain=gain,
        unlike=unlike,
        p_value=min(1.0, 2.0 * len(distances) * _sign_test_p_value(steps.ahead)),
    )


def _distance_residuals(
    windows: Linearised, left: FloatArray, count_m: FloatArray, gyro_radps: float
) -> dict[int, _Distances]:
    """Return the residual distance by wheel; without wheels whose residual is mostly the motion's own
    error.
    """
    rows = [wheel for wheel in range(GYRO) if np.isfinite(left[:, wheel]).mean() > 0.5]
    if any(count_m[wheel] <= 0.0 for wheel in rows):
        return {}
    stds = [count_m[wheel] / math.sqrt(6.0) for wheel in rows]  # of a difference of two readings
    if np.isfinite(left[:, GYRO]).mean() > 0.5:
        rows, stds = [*rows, GYRO], [*stds, gyro_radps]
    read = np.isfinite(left[:, rows]).all(axis=1)
    if len(rows) < 3 or read.sum() < COUNTERS.single_block_windows:
        return {}
    scaled = left[read][:, rows] / np.array(stds)
    design = windows.design[read][:, rows, :2] / np.array(stds)[:, None]
    solved = np.linalg.pinv(design)
    onto = np.eye(len(rows)) - design @ solved
    rest = np.einsum("wij,wj->wi", onto, scaled)
    level = np.stack([_less_block_mean(one) for one in rest.T], axis=1)
    out = {}
    for k, wheel in enumerate(rows):
        own = onto[:, k, k]
        if wheel == GYRO or float(np.median(own)) < COUNTERS.single_min_own:
            continue
        error = rest[:, k] / own * stds[k] / count_m[wheel]
        explained = 0.5 * float(np.sum(rest[:, k] ** 2 / own))
        counted = windows.covariates["speed"][read] * WINDOW_S / count_m[wheel]
        mine = np.sum(onto[:, :, k] / np.sqrt(own)[:, None] * level, axis=1)
        out[wheel] = _Distances(
            _less_block_mean(error),
            counted,
            explained,
            _other_direction_log_likelihood(level, mine, len(rows) - 2),
        )
    return out


def _other_direction_log_likelihood(level: FloatArray, mine: FloatArray, size: int) -> float:
    """Return by how much (nats) scatter in the best of all directions is likelier than in a wheel's.

    `level` (w, r) are residuals in `size` dimensions, `mine` (w,) their part in the wheel's direction; the
    noise is the same in all others.
    """
    if size < 2:
        return 0.0
    each = np.linalg.eigvalsh(level.T @ level / len(level))
    whole = max(float(each.sum()), 1e-30)

    def log_likelihood(part: float) -> float:
        rest = max((whole - part) / (size - 1), 1e-12 * whole)
        return -0.5 * len(level) * (math.log(max(part, 1e-12 * whole)) + (size - 1) * math.log(rest))

    return log_likelihood(float(each[-1])) - log_likelihood(float(np.mean(mine**2)))


def _own_variance_log_likelihood_ratio(values: FloatArray, others: list[FloatArray]) -> float:
    """Return the log-likelihood ratio (nats) of a wheel's own variance against the mean of the others', for
    normal noise; 0 without others, or if it is the smaller one.
    """
    if not others:
        return 0.0
    ratio = float(values.var()) / max(float(np.mean([other.var() for other in others])), 1e-30)
    return 0.5 * len(values) * (ratio - 1.0 - math.log(ratio)) if ratio > 1.0 else 0.0


def _block_sums(values: FloatArray, windows: int) -> FloatArray:
    """Return the sums over each `windows` successive windows."""
    return np.asarray(values[: len(values) // windows * windows].reshape(-1, windows).sum(axis=1))


def _loss_log_likelihood_ratio(values: FloatArray, mean: float) -> float:
    """Return the log-likelihood ratio of counts lost at random, `mean` in a window, to a bounded reading
    error.

    Sums over n windows: losses (Poisson) add (n - 1) * mean to their variance, a bounded error nothing.
    """
    long = COUNTERS.single_sum_windows
    sums = _block_sums(values, long)
    bounded = float(values.var())
    random = bounded + (long - 1) * mean
    return 0.5 * (
        float(np.sum(sums**2)) * (1.0 / bounded - 1.0 / random) - len(sums) * math.log(random / bounded)
    )


def _lost_counts_by_variance_growth(values: FloatArray) -> float:
    """Return the mean number of lost counts in a window, by how the variance of sums over windows grows.

    `values` (w,) are distances in counts less their mean. The variance of a sum over n windows is that of
    bounded noise, whatever its size, plus n times the mean number of lost counts (Poisson).
    """
    few = COUNTERS.single_few_windows[-1]
    return (float(np.mean(_block_sums(values, few) ** 2)) - float(values.var())) / (few - 1)


def _misfit_of_random_losses(values: FloatArray, mean: float) -> float:
    """Return how much less likely (nats) random losses are than a scatter of any size.

    Sums over a few windows are compared: random losses, `mean` in each window, have a scatter of their own
    beside a bounded error.
    """
    bounded = max(float(values.var()) - mean, 0.0)
    lost = 0.0
    for windows in COUNTERS.single_few_windows:
        sums = _block_sums(values, windows)
        ratio = float(np.mean(sums**2)) / (windows * mean + bounded)
        lost += 0.5 * len(sums) * (ratio - 1.0 - math.log(ratio))
    return lost


def _sign_test_p_value(ahead: FloatArray) -> float:
    """Return an upper bound of the p-value: the probability that noise of random sign in each block favours
    steps of one sign as much (Hoeffding, J. Am. Stat. Assoc. 58, 1963, theorem 2).
    """
    blocks = _block_sums(ahead, COUNTERS.single_sum_windows)
    return math.exp(-0.5 * max(float(blocks.sum()), 0.0) ** 2 / max(float(np.sum(blocks**2)), 1e-30))


def _less_block_mean(values: FloatArray) -> FloatArray:
    """Return the (w,) values less the mean of their block: radii drift slowly."""
    block = np.arange(len(values)) // COUNTERS.single_block_windows
    mean = np.bincount(block, values) / np.bincount(block)
    return np.asarray(values - mean[block])


def _fit_count_steps(values: FloatArray, counted: FloatArray) -> _CountSteps:
    """Fit random upward steps: values (w,) are counts above their mean, a share of those `counted` (w,)."""
    spread = float(values.var())
    most = 0.5 * spread + COUNTERS.single_stds * math.sqrt(spread) + 1.0
    number = np.arange(min(math.ceil(most), COUNTERS.single_max_steps))
    orders, usual = gammaln(number + 1.0), counted / counted.mean()

    def each(of: FloatArray, free: FloatArray) -> FloatArray:
        """Return the (w,) log-likelihoods of values `of` under steps with the free parameters, log mean and
        log std.
        """
        mean, std = usual * math.exp(free[0]), math.exp(free[1])
        weight = number * np.log(mean)[:, None] - mean[:, None] - orders
        off = (of[:, None] - number + mean[:, None]) / std
        return np.asarray(logsumexp(weight - 0.5 * off**2, axis=1)) - float(free[1])

    def negative(free: FloatArray) -> float:
        return -float(each(values, free).sum())

    found = _minimum(negative, [math.log(0.5 * spread), 0.5 * math.log(0.5 * spread)])
    share = math.exp(found[0]) / float(counted.mean())
    ahead = each(values, found) - each(-values, found)
    return _CountSteps(
        share, share * math.sqrt(_variance_by_curvature(negative, found)), -negative(found), ahead
    )


def _variance_by_curvature(negative: Callable[[FloatArray], float], at: FloatArray) -> float:
    """Return the variance of the first of two parameters, the other one free, by the curvature of the
    negative log-likelihood.
    """
    step = COUNTERS.single_probe * np.eye(2)
    middle = negative(at)
    moved = [[negative(at + k * one) for k in (-1.0, 1.0)] for one in step]
    (a, d) = (float(sum(pair)) - 2.0 * middle for pair in moved)
    both = step.sum(axis=0)
    b = 0.5 * (negative(at + both) + negative(at - both) - 2.0 * middle - a - d)
    bend = (a - b**2 / d if d > 0.0 else a) / COUNTERS.single_probe**2
    return 1.0 / max(bend, 1e-12)


def _symmetric_log_likelihood(values: FloatArray) -> float:
    """Return the log-likelihood by a Student distribution of fitted scale and freedom, without the constant
    of a normal one.
    """

    def negative(free: FloatArray) -> float:
        std, freedom = np.exp(free)
        one = gammaln(0.5 * (freedom + 1.0)) - gammaln(0.5 * freedom) - 0.5 * math.log(0.5 * freedom)
        tails = 0.5 * (freedom + 1.0) * np.log1p(np.square(values / std) / freedom)
        return float(tails.sum()) - len(values) * float(one - free[0])

    return -negative(_minimum(negative, [0.5 * math.log(float(values.var())), math.log(30.0)]))


def _minimum(function: Callable[[FloatArray], float], start: list[float]) -> FloatArray:
    """Return the minimum's position by the Nelder-Mead method."""
    return np.asarray(minimize(function, start, method="Nelder-Mead", options={"xatol": 1e-3}).x)
