"""Counts per revolution: what rings have, what the tyre allows, what the wheels' irregularity shows.

In: counts per metre of road, the tyre's size where it is known, the wheels' counters. Out: `ToothCount`:
the posterior over numbers, which is prior x likelihood of the rolling radius x evidence of the ripple.

A size that is given may be wrong: the density of the rolling radius is (1 - w) of the size's, and w of that
over all tyres (a contaminated prior; Box and Tiao 1968). So the ripple is looked for wherever a tyre may
have it, and decides where it is plain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.config.rules import TYRE_SIZE
from tpmsd.car.rings.ring import counts_per_revolution, radius_from_counts_m
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.rings.count_line import Blocks, exact_powers, log_evidence, residual_blocks
from tpmsd.offline.rings.counter import Counter
from tpmsd.offline.rings.settings import TOOTH_COUNTS, ToothCountSettings

_INCH_M = 0.0254
_COMMON_COUNTS: dict[int, float] = {
    48: 6.0, 96: 4.0, 43: 2.0, 44: 2.0, 100: 2.0, 46: 1.2, 47: 1.2, 50: 1.2, 52: 1.2, 60: 1.2, 58: 1.0,
    86: 1.0, 88: 1.0, 92: 0.8, 94: 0.8, 72: 0.6, 120: 0.6,
}  # fmt: skip
"""Weights of ring sizes, one or both edges counted. Assumed: rings that workshops list, no survey of cars."""


@dataclass(frozen=True, slots=True)
class ToothCount:
    """The counts of one revolution."""

    value: float
    std: float
    probability: float
    """Probability of `value`; of an encoder: of the line from which it comes, 0 without one."""
    radius_m: float
    """The rolling radius that goes with it."""
    alternatives: tuple[tuple[float, float], ...] = ()
    """Other numbers and their probability."""
    by_size: tuple[float, float] | None = None
    """Counts that the tyre's size needs, and their standard deviation, where `value` contradicts the size."""


@dataclass(frozen=True, slots=True)
class CountPrior:
    """Density of the counts per revolution by the rolling radius: one or two normal ones."""

    parts: tuple[tuple[float, float, float], ...]
    """Weight, mean and standard deviation of each, in counts; the size's first where there is one."""
    has_size: bool

    @property
    def expected(self) -> float:
        """Mean of the first part, approximately the number of counts."""
        return self.parts[0][1]

    def log_density(self, numbers: FloatArray) -> FloatArray:
        """Return (k,) log density at `numbers` (k,)."""
        return np.asarray(np.logaddexp.reduce([_log_normal(numbers, *part) for part in self.parts], axis=0))

    def by_size(
        self, value: float, settings: ToothCountSettings = TOOTH_COUNTS
    ) -> tuple[float, float] | None:
        """Return the counts by the tyre's size, mean and standard deviation, if `value` contradicts them;
        else None.
        """
        if not self.has_size:
            return None
        at = np.array([value])
        right = math.exp(float((_log_normal(at, *self.parts[0]) - self.log_density(at))[0]))
        return None if right > 1.0 - settings.decided else self.parts[0][1:]


def _log_normal(numbers: FloatArray, weight: float, mean: float, std: float) -> FloatArray:
    """Return the (k,) logarithm of a weighted normal density, without the common constant."""
    return np.asarray(math.log(weight / std) - 0.5 * ((numbers - mean) / std) ** 2)


def count_prior(
    per_metre: float, per_metre_std: float, tyre: str | None, settings: ToothCountSettings = TOOTH_COUNTS
) -> CountPrior:
    """Return the density by the tyre's size, which may be wrong, and by all tyres."""
    any_tyre = (settings.radius_m, settings.radius_std_m / settings.radius_m)
    by_size = tyre_radius_m(tyre, settings) if tyre else None
    weighted = [(1.0, *any_tyre)]
    if by_size is not None:
        wrong = settings.wrong_size
        weighted = [(1.0 - wrong, by_size, settings.tyre_radius_std), (wrong, *any_tyre)]
    turn = counts_per_revolution(per_metre, 1.0)
    parts = tuple(
        (weight, turn * radius, turn * radius * math.hypot(share, per_metre_std / per_metre))
        for weight, radius, share in weighted
    )
    return CountPrior(parts, by_size is not None)


def tyre_radius_m(size: str, settings: ToothCountSettings = TOOTH_COUNTS) -> float | None:
    """Return the rolling radius of a tyre by its size, m; None if it is no size."""
    match = TYRE_SIZE.match(size.strip())
    if match is None:
        return None
    width, aspect, rim = float(match[1]), float(match[2]), float(match[3])
    return settings.rolling_share * (0.5 * rim * _INCH_M + 1e-3 * width * aspect / 100.0)


def tooth_count(
    per_metre: float,
    per_metre_std: float,
    tyre: str | None,
    wheels: Sequence[tuple[Counter, float]] = (),
    settings: ToothCountSettings = TOOTH_COUNTS,
) -> ToothCount:
    """Return the likeliest number of counts. `per_metre`: counts per metre of road, as the DBC scales them.

    `wheels`: counter and scale of each wheel, for the ripple.
    """
    prior = count_prior(per_metre, per_metre_std, tyre, settings)
    expected = prior.expected
    blocks = residual_blocks(wheels, expected, settings)
    if expected > settings.max_ring_teeth:
        return _count_of_encoder(prior, per_metre, blocks, settings)
    low = min(mean - 5 * std for _, mean, std in prior.parts)
    high = max(mean + 5 * std for _, mean, std in prior.parts)
    numbers = np.arange(max(1, int(low)), int(high) + 2).astype(np.float64)
    log_weight = prior.log_density(numbers) + np.log([_count_prior_weight(int(n)) for n in numbers])
    log_weight = log_weight + log_evidence(
        blocks, numbers, _numbers_between_integers(expected), settings.other_lines
    )
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    order = np.argsort(-weight)
    best = float(numbers[order[0]])
    return ToothCount(
        best,
        float(np.sqrt(weight @ (numbers - best) ** 2)),
        min(float(weight[order[0]]), settings.max_probability),
        radius_from_counts_m(best, per_metre),
        tuple((float(numbers[k]), float(weight[k])) for k in order[1:4] if weight[k] > 1e-3),
        prior.by_size(best, settings),
    )


def _count_prior_weight(number: int) -> float:
    """Return the prior weight of a number of teeth."""
    return _COMMON_COUNTS.get(number, TOOTH_COUNTS.odd_count if number % 2 else TOOTH_COUNTS.even_count)


def _numbers_between_integers(expected: float) -> FloatArray:
    """Return trial numbers around the expected one that no ring has: between the whole ones."""
    near = np.arange(math.floor(0.8 * expected), math.ceil(1.2 * expected) + 1)
    return np.asarray((near[:, None] + np.linspace(0.25, 0.75, 21)).ravel())


def _count_of_encoder(
    prior: CountPrior, per_metre: float, blocks: Blocks, settings: ToothCountSettings
) -> ToothCount:
    """Return the counts of an encoder with many counts: where the line is, or by the tyre's radius alone."""
    _, expected, spread = prior.parts[0]
    unknown = ToothCount(float(round(expected)), spread, 0.0, radius_from_counts_m(expected, per_metre))
    if blocks.longest_counts <= 0.0:
        return unknown
    grid, step = _trial_numbers(prior, blocks.longest_counts, settings)
    density = prior.log_density(grid)
    # Each trial's threshold is lower by as much as the prior prefers it (weighted Bonferroni; Genovese,
    # Roeder and Wasserman 2006): with weights of mean one the rate of false lines is as without.
    weight = density - (np.logaddexp.reduce(density) - math.log(len(grid)))
    best = int(np.argmax(log_evidence(blocks, grid, grid, 0.0) + weight))
    at_end = not 0 < best < len(grid) - 1 or grid[best + 1] - grid[best - 1] > 3.0 * step
    # Where the line is, all blocks tell; that it is one, no few of them do: perfect encoders show some lines.
    plain = log_evidence(blocks, grid, grid, settings.other_lines)
    about = slice(max(best - int(settings.grid_per_line), 0), best + int(settings.grid_per_line) + 1)
    gain = float((plain + weight)[about].max() - np.median(plain))
    if at_end or gain < settings.line_nats:
        return unknown
    # The bins of the search blur a line by some steps; without them its top is plain.
    near = grid[best] + step * np.linspace(-TOOTH_COUNTS.grid_per_line, TOOTH_COUNTS.grid_per_line, 33)
    top = float(near[np.argmax(exact_powers(blocks, near).sum(axis=0))])
    near = top + step * np.linspace(-0.5, 0.5, 11)
    power = exact_powers(blocks, near)
    value = float(near[np.argmax(power.sum(axis=0))])
    std = math.hypot(_jackknife_std(power, near), near[1] - near[0])
    radius_m = radius_from_counts_m(value, per_metre)
    by_size = prior.by_size(value, settings)
    return ToothCount(value, std, settings.max_probability, radius_m, by_size=by_size)


def _trial_numbers(
    prior: CountPrior, longest: float, settings: ToothCountSettings
) -> tuple[FloatArray, float]:
    """Return the (k,) trial numbers, multiples of a step, around each part of the prior; and the step."""
    least, narrowest = min(mean for _, mean, _ in prior.parts), min(std for *_, std in prior.parts)
    step = min(least**2 / longest / settings.grid_per_line, 0.25 * narrowest)
    around = []
    for _, mean, std in prior.parts:
        half = min(math.ceil(4 * std / step), settings.max_trials // 2)
        around.append(round(mean / step) + np.arange(-half, half + 1))
    multiples = np.unique(np.concatenate(around))
    return np.asarray(step * multiples[multiples > 0], dtype=np.float64), step


def _jackknife_std(power: FloatArray, grid: FloatArray) -> float:
    """Return the standard error of the number with the strongest line, blocks left out one by one."""
    count = len(power)
    if count < 2:
        return float(np.ptp(grid))
    left = power.sum(axis=0) - power
    values = grid[np.argmax(left, axis=1)]
    return float(np.sqrt((count - 1) / count * ((values - values.mean()) ** 2).sum()))
