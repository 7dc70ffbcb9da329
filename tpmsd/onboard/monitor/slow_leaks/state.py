"""State of a hypothesis of slow leaks: four tyres, their motion over days, what readings show.

In: settings, Gaussians, days. Out: Gaussians. Per cent of pressure; rates in per cent per week:

    base   own radius of each tyre; walks, and is another one when wheels are changed
    lost   what each tyre has lost since air was put in; lost += rate * days / 7
    rate   of each tyre: diffusion, and the leak
    drift  fluctuations of each contrast over days: warmth, load, slip of the driven axle
    wear   what the front axle's treads lose more than the rear axle's; no refill puts it back

A reading shows, of each contrast, base - lost + drift.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.slow_leaks.settings import TrendSettings

WEEK_D = 7.0
CONTRASTS = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0], [0.5, 0.5, -0.5, -0.5]])
"""(3, 4) left minus right of the front and of the rear axle, front minus rear. Where wheels are known alike,
their errors are independent."""
FRONT_REAR = 2
BASE, LOST, RATE, DRIFT = slice(0, 4), slice(4, 8), slice(8, 12), slice(12, 15)
WEAR, SIZE = 15, 16
SEEN = np.concatenate([CONTRASTS, -CONTRASTS, np.zeros((3, 4)), np.eye(3), np.zeros((3, 1))], axis=1)
"""(3, SIZE) what readings show of each."""
WHEEL_SETS: tuple[list[int], ...] = ([0, 1, 2, 3], [0, 1], [2, 3], [0], [1], [2], [3])
"""The tyres of one visit to the pump or the workshop: all, an axle, one."""


def initial_gaussian(settings: TrendSettings, drift: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean (n, SIZE) and covariance (n, SIZE, SIZE) before the first reading; `drift` (n, 3)."""
    n, four = len(drift), np.eye(4)
    mean, covariance = np.zeros((n, SIZE)), np.zeros((n, SIZE, SIZE))
    mean[:, RATE] = settings.diffusion[0]
    covariance[:, BASE, BASE] = settings.first_base_std**2 * four
    covariance[:, LOST, LOST] = refill_covariance(settings, WHEEL_SETS[0])
    covariance[:, RATE, RATE] = settings.diffusion[1] ** 2 * four
    covariance[:, range(DRIFT.start, DRIFT.stop), range(DRIFT.start, DRIFT.stop)] = drift**2
    covariance[:, WEAR, WEAR] = settings.wear_std**2
    return mean, covariance


def refill_covariance(settings: TrendSettings, wheels: list[int]) -> FloatArray:
    """Return the (4, 4) covariance of the pressure that these tyres lack after air has been put in."""
    out = np.zeros((4, 4))
    out[wheels, wheels] = settings.refill_std**2
    return out


def predict(
    settings: TrendSettings, mean: FloatArray, covariance: FloatArray, drift: FloatArray, days: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance after days without a reading: the time update of the Kalman filter."""
    s = settings
    transition = np.eye(SIZE)
    transition[LOST, RATE] = np.eye(4) * days / WEEK_D
    transition[BASE, WEAR] = np.array([-0.5, -0.5, 0.5, 0.5]) * days / WEEK_D
    left = math.exp(-days / s.drift_d)
    transition[DRIFT, DRIFT] = np.eye(3) * left
    out = transition @ covariance @ transition.T
    for part, std in ((BASE, s.base_walk), (RATE, s.rate_walk)):
        out[:, part, part] += np.eye(4) * std**2 * days
    out[:, range(DRIFT.start, DRIFT.stop), range(DRIFT.start, DRIFT.stop)] += drift**2 * (1.0 - left**2)
    return mean @ transition.T, out
