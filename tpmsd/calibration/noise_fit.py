"""The noise of a drive, estimated from the drive.

In: `Windows`, a start. Out: the `Noise` of greatest likelihood, parameters profiled out; and which single
readings are outliers.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from tpmsd.calibration.whitening import Noise, whiten
from tpmsd.calibration.windows import CHANNELS, COURSE, EAST, GYRO, SPEED, Windows
from tpmsd.wheels import FloatArray

LIMITS: dict[str, tuple[float, float]] = {
    "rough_m": (2e-5, 3e-2),
    "floor_m": (1e-5, 0.1),
    "stamp_s": (1e-6, 2e-2),
    "gyro_radps": (2e-5, 5e-2),
    "gyro_drift_radps": (1e-7, 1e-3),
    "speed_white_mps": (1e-3, 2.0),
    "speed_mps": (1e-3, 2.0),
    "cross_white_mps": (1e-3, 2.0),
    "cross_mps": (1e-3, 2.0),
    "velocity_tau_s": (0.3, 20.0),
    "crab_rad": (1e-5, 5e-2),
    "white_m": (2e-3, 20.0),
    "slow_m": (5e-3, 50.0),
    "slow_tau_s": (3.0, 300.0),
    "lean": (1e-6, 5e-4),
    "lean_tau_s": (3.0, 25.0),
    "age_s": (1e-6, 2e-2),
}
_NEEDS = {
    "gyro": GYRO,
    "speed": SPEED,
    "cross": COURSE,
    "veloci": SPEED,
    "white": EAST,
    "slow": EAST,
    "age": EAST,
}
FIT_WINDOWS = 240
OUTLIER = 3.5
_PROBE = 0.35
_MAX_STEP = 1.2


def fit_noise(
    windows: Windows, start: Noise, inflate: FloatArray, prior_std: FloatArray, rounds: int
) -> Noise:
    """Climb the likelihood by parabolas along each coordinate of log(noise), all probed in one pass."""
    part = _stretch(windows)
    cut, weight = part
    names = [name for name in LIMITS if _measured(windows, name)]
    here = np.log([getattr(start, name) for name in names])
    low, high = np.log([LIMITS[name][0] for name in names]), np.log([LIMITS[name][1] for name in names])
    count = len(names)
    for _ in range(rounds):
        probes = np.concatenate([here[None], here + _PROBE * np.eye(count), here - _PROBE * np.eye(count)])
        value = _log_likelihood(cut, weight_of(inflate, weight), _noises(start, names, probes), prior_std)
        up, down = value[1 : 1 + count] - value[0], value[1 + count :] - value[0]
        slope, bend = (up - down) / (2 * _PROBE), (up + down) / _PROBE**2
        newton = np.where(bend < -1e-3, -slope / np.minimum(bend, -1e-3), np.sign(slope) * _MAX_STEP)
        step = np.clip(newton, -_MAX_STEP, _MAX_STEP) * (np.abs(slope) > 0.02)
        trials = np.clip(here + np.array([1.0, 0.6, 0.3, 0.1])[:, None] * step, low, high)
        reached = _log_likelihood(cut, weight_of(inflate, weight), _noises(start, names, trials), prior_std)
        best = int(np.argmax(reached))
        if reached[best] <= value[0]:
            break
        here = trials[best]
        if reached[best] - value[0] < 0.3:
            break
    return _noises(start, names, here[None])[0]


def outliers(white: FloatArray, inflate: FloatArray) -> FloatArray:
    """(k, 9) factors on the variances: readings beyond 3.5 standard deviations are made to weigh less."""
    size = np.abs(white)
    factor = np.where(size > OUTLIER, np.square(size / 2.0), 1.0)
    factor[:, EAST:] = factor[:, EAST:].max(axis=1, keepdims=True)
    return np.asarray(np.maximum(inflate * factor, 1.0))


def weight_of(inflate: FloatArray, part: slice) -> FloatArray:
    """The factors of a stretch."""
    return inflate[part]


def _stretch(windows: Windows) -> tuple[Windows, slice]:
    """A stretch from the middle that stands for a long drive."""
    count = len(windows)
    if count <= FIT_WINDOWS:
        return windows, slice(0, count)
    begin = (count - FIT_WINDOWS) // 2
    part = slice(begin, begin + FIT_WINDOWS)
    names = ("y", "H", "X", "grow", "speed_mps", "turn_rad", "time_s", "fixes", "extra_m2")
    return dataclasses.replace(windows, **{name: getattr(windows, name)[part] for name in names}), part


def _measured(windows: Windows, name: str) -> bool:
    channel = next((channel for start, channel in _NEEDS.items() if name.startswith(start)), None)
    return channel is None or bool(np.isfinite(windows.y[:, channel]).any())


def _noises(start: Noise, names: list[str], logs: FloatArray) -> list[Noise]:
    return [dataclasses.replace(start, **dict(zip(names, np.exp(row).tolist(), strict=True))) for row in logs]


def _log_likelihood(
    windows: Windows, inflate: FloatArray, noises: list[Noise], prior_std: FloatArray
) -> FloatArray:
    """(b,) with the parameters at their best values under their priors."""
    white, log_variance = whiten(windows, noises, inflate)
    rows = white.reshape(len(noises), len(windows) * CHANNELS, -1)
    y, X = rows[:, :, :1], rows[:, :, 1:]
    Xt = X.transpose(0, 2, 1)
    information = Xt @ X + np.diag(1.0 / np.square(prior_std))
    theta = np.linalg.solve(information, Xt @ y)
    misfit = np.square(y).sum(axis=(1, 2)) - (Xt @ y * theta).sum(axis=(1, 2))
    return np.asarray(-0.5 * (misfit + log_variance + np.linalg.slogdet(information)[1]))
