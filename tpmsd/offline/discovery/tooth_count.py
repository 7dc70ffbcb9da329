"""Counts per revolution: what rings have, what the tyre allows, what the wheels' irregularity shows.

In: counts per metre of road, the tyre's size where it is known, the wheels' counters. Out: `ToothCount`:
the posterior over numbers, which is prior x likelihood of the rolling radius x evidence of the ripple.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.config.rules import TYRE_SIZE
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.series import Counter
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.offline.discovery.tone_ring import Blocks, cut, exact_powers, log_evidence

_INCH_M = 0.0254
_USUAL_COUNTS: dict[int, float] = {
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
    """Of `value`; of an encoder: of the line from which it comes, 0 without one."""
    radius_m: float
    """The rolling radius that goes with it."""
    rivals: tuple[tuple[float, float], ...] = ()
    """Other numbers and their probability."""


def tyre_radius_m(size: str, settings: Settings = SETTINGS) -> float | None:
    """Rolling radius of a tyre by its size; None if it is no size."""
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
    settings: Settings = SETTINGS,
) -> ToothCount:
    """The likeliest number of counts. `per_metre`: counts per metre of road, as the DBC scales them.

    `wheels`: counter and scale of each wheel, for the ripple.
    """
    by_size = tyre_radius_m(tyre, settings) if tyre else None
    mean = by_size or settings.radius_m
    share = settings.tyre_radius_std if by_size else settings.radius_std_m / settings.radius_m
    expected = 2 * math.pi * mean * per_metre
    spread = expected * math.hypot(share, per_metre_std / per_metre)
    blocks = cut(wheels, expected, settings)
    if expected > settings.most_whole:
        return _encoder(expected, spread, per_metre, blocks)
    numbers = np.arange(max(1, int(expected - 5 * spread)), int(expected + 5 * spread) + 2).astype(np.float64)
    log_weight = -0.5 * ((numbers - expected) / spread) ** 2 + np.log([_usual(int(n)) for n in numbers])
    log_weight = log_weight + log_evidence(blocks, numbers, _between(expected), settings.other_lines)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    order = np.argsort(-weight)
    best = float(numbers[order[0]])
    return ToothCount(
        best,
        float(np.sqrt(weight @ (numbers - best) ** 2)),
        min(float(weight[order[0]]), settings.max_probability),
        best / (2 * math.pi * per_metre),
        tuple((float(numbers[k]), float(weight[k])) for k in order[1:4] if weight[k] > 1e-3),
    )


def _usual(number: int) -> float:
    return _USUAL_COUNTS.get(number, SETTINGS.odd_count if number % 2 else SETTINGS.even_count)


def _between(expected: float) -> FloatArray:
    """Trial numbers around the expected one that no ring has: away from whole ones."""
    near = np.arange(math.floor(0.8 * expected), math.ceil(1.2 * expected) + 1)
    return np.asarray((near[:, None] + np.linspace(0.25, 0.75, 21)).ravel())


def _encoder(expected: float, spread: float, per_metre: float, blocks: Blocks) -> ToothCount:
    """A number of many counts: where the line is, or the tyre's radius alone."""
    unknown = ToothCount(float(round(expected)), spread, 0.0, expected / (2 * math.pi * per_metre))
    if blocks.longest <= 0.0:
        return unknown
    step = min(expected**2 / blocks.longest / SETTINGS.grid_per_line, 0.25 * spread)
    trials = min(int(8 * spread / step) + 1, SETTINGS.most_trials)
    grid = np.asarray(expected + step * (np.arange(trials) - trials // 2), dtype=np.float64)
    evidence = log_evidence(blocks, grid, grid, 0.0) - 0.5 * ((grid - expected) / spread) ** 2
    best = int(np.argmax(evidence))
    if evidence[best] - float(np.median(evidence)) < SETTINGS.line_nats or not 0 < best < trials - 1:
        return unknown
    # The bins of the search blur a line by some steps; without them its top is plain.
    near = grid[best] + step * np.linspace(-SETTINGS.grid_per_line, SETTINGS.grid_per_line, 33)
    top = float(near[np.argmax(exact_powers(blocks, near).sum(axis=0))])
    near = top + step * np.linspace(-0.5, 0.5, 11)
    power = exact_powers(blocks, near)
    value = float(near[np.argmax(power.sum(axis=0))])
    std = math.hypot(_jackknife_std(power, near), near[1] - near[0])
    return ToothCount(value, std, SETTINGS.max_probability, value / (2 * math.pi * per_metre))


def _jackknife_std(power: FloatArray, grid: FloatArray) -> float:
    """Standard error of the strongest number, blocks left out one by one."""
    count = len(power)
    if count < 2:
        return float(np.ptp(grid))
    left = power.sum(axis=0) - power
    values = grid[np.argmax(left, axis=1)]
    return float(np.sqrt((count - 1) / count * ((values - values.mean()) ** 2).sum()))
