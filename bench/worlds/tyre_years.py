"""Years of a car's four tyres as a monitor would read them: one reading per drive, healthy or with a leak.

In: a generator, the settings of a car's year. Out: per drive its day, the pressures, and the estimates of the
four rolling radii with what they claim of their standard deviation. Nothing of the program is imported.

What acts, all drawn per car: diffusion of 1 to 3 % a month, each tyre its own; refills of all, of an axle or
of one tyre, to within 2 %; seasons and days of temperature, with tyres that answer to it unequally; load by
seats; wear; radius drift over days; scatter of the estimates with heavy tails and a wrongly stated
standard deviation; summer and winter tyres, wheels that change places, with a reset or without.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
RADIUS_M = 0.316
_SIZE_M, _AIR = 6.27e-3, 0.722
"""Radius lost for a share x of pressure lost: A x / (1 - B x); 1.47 mm at 20 %."""
MONTH_D = 30.4
ESTIMATE_STD_M = (0.03e-3, 0.15e-3)
"""Of one wheel in one drive, the part that is not common to all four: the difference of left and right is
then 0.04 to 0.2 mm off. Drives of the estimator benchmark come to 0.01 to 0.06 mm; on recorded motorway
drives the difference spreads by 0.23 to 0.31 mm over the ticks of a drive."""


@dataclass(frozen=True)
class Leak:
    """One tyre that loses air."""

    wheel: int
    onset_d: float
    percent_per_week: float


@dataclass(frozen=True)
class Year:
    """n drives of one car."""

    day: Array
    """(n,)"""
    radius_m: Array
    """(n, 4) estimates: radius minus nominal; fl fr rl rr."""
    std_m: Array
    """(n, 4) what the estimate states."""
    lost: Array
    """(n, 4) share of the cold pressure that is lost."""
    reset: NDArray[np.bool_]
    """(n,) whether the driver asked for a reset before the drive."""


def draw_year(rng: np.random.Generator, days: float = 365.0, leak: Leak | None = None) -> Year:
    """One car, one year."""
    day = _drives(rng, days)
    lost, reset = _pressures(rng, day, leak)
    radius = -_SIZE_M * lost / (1.0 - _AIR * lost)
    radius += _temperature(rng, day) + _load(rng, day) + _wear(rng, day) + _radius_drift(rng, day)
    radius += _tyres(rng, day, reset)
    quality = rng.uniform(*ESTIMATE_STD_M)
    std = quality * rng.lognormal(0.0, 0.3, (day.size, 4))
    misstatement = rng.uniform(0.7, 1.6)
    noise = misstatement * std * rng.standard_t(4.0, (day.size, 4)) / math.sqrt(2.0)
    noise += rng.normal(0.0, 0.2e-3, (day.size, 1))
    return Year(day, radius + noise, std, lost, reset)


def _drives(rng: np.random.Generator, days: float) -> Array:
    """Days on which the car is driven, with the hour; holidays without."""
    per_day = rng.uniform(0.5, 3.0)
    weekday = rng.uniform(0.4, 1.0)
    out: list[float] = []
    away_until = 0.0
    for day in range(int(days)):
        if rng.random() < 1.0 / 120.0:
            away_until = day + rng.uniform(4.0, 21.0)
        if day < away_until or rng.random() > weekday:
            continue
        out += sorted(day + rng.uniform(0.25, 0.95, 1 + rng.poisson(per_day - 0.5)))
    return np.array(out)


def _pressures(rng: np.random.Generator, day: Array, leak: Leak | None) -> tuple[Array, NDArray[np.bool_]]:
    per_day = rng.uniform(0.01, 0.03, 4) / MONTH_D
    every_d = rng.uniform(20.0, 150.0)
    presses = rng.random() < 0.5
    lost = np.zeros((day.size, 4))
    reset = np.zeros(day.size, dtype=bool)
    now, last, refill = rng.normal(0.0, 0.02, 4), 0.0, rng.uniform(0.0, every_d)
    for k, at in enumerate(day):
        now = now + per_day * (at - last)
        if leak is not None:
            span = max(at - max(leak.onset_d, last), 0.0)
            now[leak.wheel] += leak.percent_per_week / 100.0 * span / 7.0
        if at >= refill:
            which = rng.random()
            wheels = [0, 1, 2, 3]
            if which < 0.15:
                wheels = [[0, 1], [2, 3]][rng.integers(2)]
            elif which < 0.25:
                wheels = [int(rng.integers(4))]
            now[wheels] = rng.normal(0.0, 0.02, len(wheels))
            reset[k] = presses and rng.random() < 0.7
            refill = at + every_d * rng.uniform(0.5, 1.5)
        lost[k], last = now, at
    return lost, reset


def _temperature(rng: np.random.Generator, day: Array) -> Array:
    """Radius by the warmth of the air and the sun: 0.028 mm per kelvin, unequal by 10 %."""
    season = rng.uniform(6.0, 13.0) * np.sin(2 * math.pi * (day / 365.0 + rng.random()))
    weather = _first_order(rng, day, 4.0, 4.0) + 4.0 * np.sin(2 * math.pi * (day - 0.4))
    each = 0.028e-3 * (1.0 + rng.normal(0.0, 0.1, 4))
    sunny = rng.random(day.size) < 0.2
    side = np.where(rng.random(day.size) < 0.5, 1.0, -1.0) * sunny * rng.uniform(0.0, 8.0, day.size)
    sun = 0.5 * side[:, None] * np.array([1.0, -1.0, 1.0, -1.0])
    return np.asarray(((season + weather)[:, None] + sun) * each)


def _load(rng: np.random.Generator, day: Array) -> Array:
    """Driver alone, a passenger, people and luggage behind: 0.25 mm per 500 N."""
    per_n = 0.25e-3 / 500.0
    passenger = (rng.random(day.size) < rng.uniform(0.05, 0.6)) * rng.normal(700.0, 120.0, day.size)
    behind = (rng.random(day.size) < 0.2) * rng.uniform(200.0, 2000.0, day.size)
    lean = rng.uniform(0.35, 0.65, day.size)
    load = np.zeros((day.size, 4))
    load[:, 1] += 0.3 * passenger
    load[:, 3] += 0.3 * passenger
    load[:, 0] += 0.2 * passenger
    load[:, 2] += 0.2 * passenger + 0.8 * behind * lean
    load[:, 3] += 0.8 * behind * (1.0 - lean)
    return np.asarray(-per_n * load)


def _wear(rng: np.random.Generator, day: Array) -> Array:
    """1 mm per 8,000 to 20,000 km, driven axle more, left and right apart by 15 %."""
    km_per_day = rng.uniform(15.0, 90.0)
    per_km = 1e-3 / rng.uniform(8e3, 20e3) * np.array([1.3, 1.3, 0.7, 0.7]) * rng.normal(1.0, 0.1, 4)
    return np.asarray(-day[:, None] * km_per_day * per_km)


def _radius_drift(rng: np.random.Generator, day: Array) -> Array:
    """Radius drift of each wheel over days and weeks, without a cause that is known."""
    std, time_d = rng.uniform(0.0, 0.05e-3), rng.uniform(1.0, 30.0)
    return np.stack([_first_order(rng, day, std, time_d) for _ in range(4)], axis=1)


def _tyres(rng: np.random.Generator, day: Array, reset: NDArray[np.bool_]) -> Array:
    """Own radii of the tyres; other tyres or other places twice a year, with a reset or without."""
    radii = rng.normal(0.0, 0.6e-3, 4)
    out = np.tile(radii, (day.size, 1))
    for _ in range(rng.poisson(1.5)):
        k = int(rng.integers(1, max(day.size, 2)))
        out[k:] = rng.normal(0.0, 0.6e-3, 4) if rng.random() < 0.6 else out[k - 1][[2, 3, 0, 1]]
        if k < day.size:
            reset[k] |= rng.random() < 0.6
    return out


def _first_order(rng: np.random.Generator, day: Array, std: float, time_d: float) -> Array:
    """Gauss-Markov process of first order at these days."""
    out = np.zeros(day.size)
    if day.size:
        out[0] = std * rng.standard_normal()
    for k in range(1, day.size):
        decay = math.exp(-(day[k] - day[k - 1]) / time_d)
        out[k] = decay * out[k - 1] + std * math.sqrt(1.0 - decay**2) * rng.standard_normal()
    return out
