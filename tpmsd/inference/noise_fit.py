"""The noise model of a drive, estimated from the drive.

In: `Windows`, residuals, the columns of the model believed so far. Out: the `Noise` of greatest
likelihood, and how much single readings must be inflated because they are outliers. Estimated after the
best model, not before: a missing effect must not pass for noise.
"""

from __future__ import annotations

import dataclasses
import math
from enum import Enum
from typing import Any

import numpy as np

from tpmsd.inference.whitening import Noise, whiten
from tpmsd.inference.windows import CHANNELS, COURSE, EAST, GYRO, SPEED, Windows
from tpmsd.wheels import FloatArray

LIMITS: dict[str, tuple[float, float]] = {
    "rough_m": (2e-5, 2e-2),
    "floor_m": (1e-5, 0.3),
    "stamp_s": (1e-6, 5e-3),
    "gyro_radps": (2e-5, 5e-2),
    "gyro_drift_radps": (1e-8, 1e-3),
    "speed_white_mps": (1e-3, 2.0),
    "speed_mps": (1e-3, 2.0),
    "speed_memory": (0.01, 0.97),
    "cross_white_mps": (1e-3, 2.0),
    "cross_mps": (1e-3, 2.0),
    "course_floor_rad": (1e-5, 3e-2),
    "white_m": (2e-3, 20.0),
    "slow_m": (5e-3, 50.0),
    "slow_tau_s": (3.0, 300.0),
    "clock_s": (1e-4, 0.3),
    "clock_tau_s": (0.5, 60.0),
    "wander": (1e-6, 3e-3),
    "wander_tau_s": (10.0, 600.0),
}
PRIORS: dict[str, tuple[float, float]] = {
    "slow_m": (1.2, 1.0),
    "slow_tau_s": (40.0, 0.2),
    "gyro_drift_radps": (2e-6, 0.7),
    "wander": (2e-5, 1.0),
    "wander_tau_s": (60.0, 0.5),
}
"""Median and logarithmic spread of what a drive hardly tells."""
SLOW = ("slow_m", "slow_tau_s")
WANDERING = (*SLOW, "gyro_drift_radps", "speed_memory", "clock_s", "clock_tau_s", "wander", "wander_tau_s")
"""What could pass for a missing effect: not estimated before effects were looked for."""
SLOWER = "slower"
"""A coordinate of its own: a longer memory and a larger size that wander alike over short times."""
FIT_WINDOWS = 300
OUTLIER = 3.5
ROUGH_STRETCH = 1.6
"""Variance of a stretch, over the usual one, from which it is believed to be noisier."""


class Stage(Enum):
    """How far the search for effects has come, and so what of the noise may be estimated."""

    FIRST = 0
    """Nothing was looked for: not what wanders."""
    SECOND = 1
    LAST = 2
    """The rest is known: only what wanders, once more."""


def fit_noise(
    windows: Windows, columns: FloatArray, start: Noise, stage: Stage, inflate: FloatArray | None = None
) -> Noise:
    """Maximise the likelihood coordinate by coordinate.

    `columns` (w, 9, 1 + k): the residual and the columns that are believed, whose values are fitted along.
    """
    measured = np.asarray(np.isfinite(columns[:, :, 0]).any(axis=0))
    names = [name for name in LIMITS if measured[_channel(name)]]
    part = _part(windows, columns, inflate)
    noise = start
    if stage is Stage.FIRST:
        return _climbed(_apart(part), noise, [name for name in names if name not in WANDERING], 2.2)
    if stage is Stage.LAST:
        names = [name for name in names if name in WANDERING and name not in SLOW]
    noise = _climbed(part, noise, names, 1.5 if stage is Stage.SECOND else 1.3)
    return refit_slow(windows, columns, noise, inflate) if measured[EAST] else noise


def refit_slow(windows: Windows, columns: FloatArray, noise: Noise, inflate: FloatArray | None) -> Noise:
    """Only the receiver's slow error, on the whole drive."""
    return refit(windows, columns, noise, inflate, [SLOWER, *SLOW])


def refit_wander(windows: Windows, columns: FloatArray, noise: Noise, inflate: FloatArray | None) -> Noise:
    """Only the slow wander of the tyres' radii, on the whole drive."""
    return refit(windows, columns, noise, inflate, ["wander", "wander_tau_s"], 2.0)


def refit(
    windows: Windows,
    columns: FloatArray,
    noise: Noise,
    inflate: FloatArray | None,
    names: list[str],
    factor: float = 1.4,
) -> Noise:
    """These parameters alone, on the whole drive."""
    weight = np.ones((len(windows), CHANNELS)) if inflate is None else inflate
    return _climbed((windows, columns, weight), noise, names, factor)


def log_posterior(windows: Windows, columns: FloatArray, noise: Noise, inflate: FloatArray | None) -> float:
    """Log-likelihood with the columns' values fitted, and the prior of the noise."""
    weight = np.ones((len(windows), CHANNELS)) if inflate is None else inflate
    return _log_likelihood(windows, columns, weight, noise) + _log_prior(noise)


def _climbed(
    part: tuple[Windows, FloatArray, FloatArray], noise: Noise, names: list[str], factor: float
) -> Noise:
    """One sweep over the coordinates, by steps of a factor."""
    best = _log_likelihood(*part, noise) + _log_prior(noise)
    for name in names:
        for step in (factor, 1.0 / factor):
            moved = False
            for _ in range(6):
                trial = _changed(noise, name, step)
                likelihood = _log_likelihood(*part, trial) + _log_prior(trial)
                if likelihood <= best + 0.02:
                    break
                noise, best, moved = trial, likelihood, True
            if moved:
                break
    return noise


def _log_prior(noise: Noise) -> float:
    """What is known of receivers: a drive holds too few swings of the slow error to tell it alone."""
    return -0.5 * sum(
        (math.log(getattr(noise, name) / middle) / spread) ** 2 for name, (middle, spread) in PRIORS.items()
    )


def outliers(white: FloatArray, blocks: np.ndarray, inflate: FloatArray | None) -> FloatArray:
    """(w, 9) factors on the variances, from the whitened residual of the best model so far.

    Readings beyond 3.5 standard deviations are made to weigh less, and so are stretches in which a
    channel scatters more than in the rest of the drive (a receiver under bridges): noise is not the same
    all along a road.
    """
    before = np.ones(white.shape[:2]) if inflate is None else inflate
    size = np.abs(white)
    factor = np.where(size > OUTLIER, (size / 2.0) ** 2, 1.0)
    calm = np.minimum(size, OUTLIER) ** 2
    for channels in (
        slice(0, GYRO),
        slice(GYRO, SPEED),
        slice(SPEED, COURSE),
        slice(COURSE, EAST),
        slice(EAST, 9),
    ):
        live = size[:, channels] > 0.0
        if channels.start == 0:
            live[:, :2] = False  # these rows tell the motion, not the noise
        total = np.bincount(blocks, (calm[:, channels] * live).sum(axis=1))
        number = np.bincount(blocks, live.sum(axis=1))
        scatter = total / np.maximum(number, 1.0)
        rough = np.where((scatter > ROUGH_STRETCH) & (number > 10), scatter, 1.0)
        factor[:, channels] *= rough[blocks][:, None]
    return np.asarray(before * factor)


def _channel(name: str) -> int:
    if name.startswith("gyro"):
        return GYRO
    if name.startswith("speed"):
        return SPEED
    if name.startswith(("cross", "course")):
        return COURSE
    return EAST if name.startswith(("white", "slow", "clock")) else 2


def _changed(noise: Noise, name: str, factor: float) -> Noise:
    if name == SLOWER:
        return _changed(_changed(noise, "slow_tau_s", factor), "slow_m", math.sqrt(factor))
    low, high = LIMITS[name]
    value = float(getattr(noise, name))
    if name == "speed_memory":
        odds = value / (1.0 - value) * factor
        value = odds / (1.0 + odds)
    else:
        value = value * factor
    changes: dict[str, Any] = {name: min(max(value, low), high)}
    return dataclasses.replace(noise, **changes)


def _part(
    windows: Windows, columns: FloatArray, inflate: FloatArray | None
) -> tuple[Windows, FloatArray, FloatArray]:
    """Two contiguous stretches that stand for a long drive."""
    count = len(windows)
    weight = np.ones((count, CHANNELS)) if inflate is None else inflate
    if count <= FIT_WINDOWS:
        return windows, columns, weight
    half = FIT_WINDOWS // 2
    first = count // 4 - half // 2
    second = 3 * count // 4 - half // 2
    at = np.concatenate([np.arange(first, first + half), np.arange(second, second + half)])
    cut = dataclasses.replace(
        windows,
        index=windows.index[at],
        measured=windows.measured[at],
        fixes=windows.fixes[at],
        covariates={name: values[at] for name, values in windows.covariates.items()},
        design=windows.design[at],
        to_east_north=windows.to_east_north[at],
    )
    return cut, columns[at], weight[at]


def _apart(
    part: tuple[Windows, FloatArray, FloatArray],
) -> tuple[Windows, FloatArray, FloatArray]:
    """With radii of its own for each stretch: a tyre that changed between them is no noise in them."""
    windows, columns, weight = part
    gaps = np.flatnonzero(np.diff(windows.index) > 1)
    if not len(gaps):
        return part
    cut = gaps[int(np.argmax(np.diff(windows.index)[gaps]))] + 1
    wheels = np.flatnonzero(np.isfinite(columns[:, :GYRO, 0]).any(axis=0))
    own = np.zeros((*columns.shape[:2], len(wheels)))
    own[cut:, wheels, np.arange(len(wheels))] = windows.covariates["speed"][cut:, None]
    return windows, np.concatenate([columns, own], axis=2), weight


def _log_likelihood(windows: Windows, columns: FloatArray, inflate: FloatArray, noise: Noise) -> float:
    white, log_variance = whiten(windows, noise, columns, inflate)
    rows = white.reshape(-1, columns.shape[2])
    y, X = rows[:, 0], rows[:, 1:]
    if X.shape[1]:
        scale = np.sqrt(np.maximum((X**2).sum(axis=0), 1e-300))
        X = X / scale
        y = y - X @ np.linalg.solve(X.T @ X + 1e-9 * np.eye(X.shape[1]), X.T @ y)
    return -0.5 * (float(y @ y) + log_variance)
