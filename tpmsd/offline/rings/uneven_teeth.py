"""Looks for uneven teeth: a ripple once per revolution of a wheel, too fast for windows of a second.

In: `Recording`, `ReferenceTrajectory`. Out: the `Ripple` of each wheel that has one.

At every tick's edge each wheel's shown angle is compared with the smooth motion and with the other
wheels; what is left above 0.3 Hz is regressed on sine and cosine of the wheel's own angle. Turning faster
than the ticks only folds the ripple to other frequencies, where the regression finds it all the same.

Speeds that are read less than twice per revolution fold it before they are summed to an angle: what is left
of the ripple then has another size and phase at every speed, and even another sign. Where that fits much
better, each range of speeds has a sine and a cosine of its own; the amplitude is then known to a factor of
two only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.kinematics import wheel_speeds
from tpmsd.car.physics.motion import integrate
from tpmsd.car.rings.ring import amplitude_and_phase, turns_hz
from tpmsd.car.rings.ripple import MIN_STD_RAD, OUTLIER_STDS, robust_std
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.smoothing import NEAREST, gaussian
from tpmsd.offline.inference.trajectory import ReferenceTrajectory
from tpmsd.offline.rings.settings import COUNTERS


@dataclass(frozen=True)
class Ripple:
    """A once-per-turn error of one wheel: shown angle = angle + amplitude * sin(angle + phase)."""

    wheel: str
    amplitude_rad: float
    std_rad: float
    phase_rad: float
    phase_std_rad: float
    gain: float
    """Log-likelihood on held-out blocks."""
    rms_before: float
    rms_after: float


def ripples(recording: Recording, reference: ReferenceTrajectory) -> list[Ripple]:
    """Return the wheels whose teeth are uneven, the clearest first."""
    if len(recording.wheels) < 4:
        return []
    rows, regressors, revolutions_hz, blocks = _prepare_regression(recording, reference)
    if len(rows) < 10 * COUNTERS.ripple_block_ticks:
        return []
    found = _ripples_by_wheel(
        rows, blocks, lambda k, rows: _smoothed_by_readings(k, rows, regressors, revolutions_hz)
    )
    folded = _ripples_by_wheel(
        rows, blocks, lambda k, rows: _regressors_by_speed_range(regressors[:, k], revolutions_hz[:, k])
    )
    plain = found[0].gain if found else 0.0
    return folded if folded and folded[0].gain > COUNTERS.ripple_folded_from * plain else found


def _smoothed_by_readings(
    k: int, rows: FloatArray, regressors: FloatArray, revolutions_hz: FloatArray
) -> FloatArray:
    """Return the (n, 2) sine and cosine of a wheel, attenuated by interpolation between readings of the
    period that fits best.

    Linear interpolation between readings T apart leaves of a sine of f the share sinc2(f T).
    """
    best, most = regressors[:, k], -math.inf
    for period_s in COUNTERS.ripple_periods_s:
        X = regressors[:, k] * np.sinc(revolutions_hz[:, k, None] * period_s) ** 2
        b = X.T @ rows[:, k]
        gain = float(b @ np.linalg.solve(X.T @ X + 1e-9 * np.eye(2), b))
        if gain > most:
            best, most = X, gain
    return best


def _ripples_by_wheel(
    rows: FloatArray, blocks: np.ndarray, form: Callable[[int, FloatArray], FloatArray]
) -> list[Ripple]:
    """Return the wheels' ripples, the clearest first; each is removed before the next is fitted, for a
    quarter of it is in the other wheels.

    `form` gives a wheel's response (n, m) to sines and cosines.
    """
    found: list[Ripple] = []
    left = list(range(4))
    while left:
        forms = {k: form(k, rows) for k in left}
        judged = {k: _fit_ripple(k, rows, forms[k], blocks) for k in left}
        clear = {k: one for k, one in judged.items() if one is not None}
        if not clear:
            break
        k = max(clear, key=lambda wheel: clear[wheel].gain)
        found.append(clear[k])
        left.remove(k)
        own = forms[k] @ np.linalg.lstsq(0.75 * forms[k], rows[:, k], rcond=None)[0]
        share = np.full(4, -0.25)
        share[k] = 0.75
        rows = rows - own[:, None] * share
    return found


def _regressors_by_speed_range(regressor: FloatArray, revolutions_hz: FloatArray) -> FloatArray:
    """Return the (n, 2 * RANGES) sine and cosine, each zero outside its range of speeds."""
    edges = np.quantile(revolutions_hz, np.linspace(0.0, 1.0, COUNTERS.ripple_ranges + 1)[1:-1])
    here = np.searchsorted(edges, revolutions_hz)[:, None] == np.arange(COUNTERS.ripple_ranges)
    return np.concatenate([regressor[:, :1] * here, regressor[:, 1:] * here], axis=1)


def _prepare_regression(
    recording: Recording, reference: ReferenceTrajectory
) -> tuple[FloatArray, FloatArray, FloatArray, np.ndarray]:
    """Return the high-pass differences between wheels (n, 4) in rad, sines and cosines (n, 4, 2), turns per
    second (n, 4) and blocks (n,).
    """
    motion, car = reference.motion, reference.car
    turned = np.nan_to_num(recording.rotation_rad)
    angle = np.concatenate([np.zeros((1, 4)), np.cumsum(turned, axis=0)])
    speeds = wheel_speeds(motion.speed_mps, motion.yaw_rate_radps, car.geometry)
    expected = integrate(speeds, motion.time_s)
    revolutions_hz = turns_hz(speeds, car.radius_m)
    off = angle - expected / car.radius_m
    sigma = COUNTERS.ripple_high_pass_s / recording.dt_s

    def high_pass(values: FloatArray) -> FloatArray:
        return np.asarray(values - gaussian(values, sigma, NEAREST))

    rows = high_pass(off)
    rows = rows - rows.mean(axis=1, keepdims=True)
    regressors = np.stack([high_pass(np.sin(angle)), high_pass(np.cos(angle))], axis=2)
    whole = np.concatenate([[False], reference.valid]) & np.concatenate([reference.valid, [False]])
    broken = gaussian((~whole).astype(np.float64), sigma) > 0.02
    use = ~broken & (motion.speed_mps > COUNTERS.ripple_from_mps)
    rows, regressors, revolutions_hz = rows[use], regressors[use], revolutions_hz[use]
    if not len(rows):
        return rows, regressors, revolutions_hz, np.zeros(0, dtype=int)
    calm = np.abs(rows).max(axis=1) < OUTLIER_STDS * max(robust_std(rows), MIN_STD_RAD)
    rows, regressors, revolutions_hz = rows[calm], regressors[calm], revolutions_hz[calm]
    return rows, regressors, revolutions_hz, np.arange(len(rows)) // COUNTERS.ripple_block_ticks


def _fit_ripple(k: int, rows: FloatArray, regressors: FloatArray, blocks: np.ndarray) -> Ripple | None:
    """Return the ripple of a wheel by its response (n, m); None where it is not significant or not reproduced
    on held-out blocks.
    """
    y = rows[:, k]
    X = 0.75 * regressors  # a quarter went into the mean of the wheels
    variance = float(np.var(y))
    count = int(blocks.max()) + 1
    A = np.stack([X[blocks == b].T @ X[blocks == b] for b in range(count)])
    b = np.stack([X[blocks == i].T @ y[blocks == i] for i in range(count)])
    total_A, total_b = A.sum(axis=0), b.sum(axis=0)
    if np.linalg.cond(total_A) > 1e6:
        return None
    values = np.linalg.solve(total_A, total_b)
    left = b - A @ values
    inverse = np.linalg.inv(total_A)
    spread = inverse @ (left.T @ left) @ inverse * count / (count - 2)
    ratio = max(1.0, float(np.max(np.diag(spread) / (variance * np.diag(inverse)))))
    gain = 0.5 * float(total_b @ values) / variance / ratio
    heldout = 0.0
    for fold in range(COUNTERS.ripple_folds):
        out = np.arange(count) % COUNTERS.ripple_folds == fold
        # A range of speeds that only the held-out blocks have is not trained: its values are zero.
        trained = np.linalg.lstsq(A[~out].sum(axis=0), b[~out].sum(axis=0), rcond=1e-12)[0]
        heldout += float(trained @ b[out].sum(axis=0) - 0.5 * trained @ A[out].sum(axis=0) @ trained)
    heldout /= variance * ratio
    sine, cosine = values.reshape(2, -1)
    # One value of both is the plain ripple; of several, which are folded, the middle one.
    middle = int(np.argsort(np.hypot(sine, cosine))[len(sine) // 2])
    amplitude, phase = amplitude_and_phase(float(sine[middle]), float(cosine[middle]))
    if gain < COUNTERS.ripple_admit_nats + len(values) - 2 or heldout < 0.5 * COUNTERS.ripple_admit_nats:
        return None
    std = math.sqrt(variance * ratio * float(np.trace(inverse)) / len(values))
    after = math.sqrt(max(variance - 2.0 * heldout * variance * ratio / len(y), 0.0))
    return Ripple(
        wheel=WHEELS[k],
        amplitude_rad=amplitude,
        std_rad=math.hypot(
            std,
            (COUNTERS.ripple_flattened_std if len(sine) == 1 else COUNTERS.ripple_folded_std) * amplitude,
        ),
        phase_rad=phase,
        phase_std_rad=std / amplitude,
        gain=heldout,
        rms_before=1.0,
        rms_after=after / math.sqrt(variance),
    )
