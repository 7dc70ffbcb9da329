"""Offset of two clocks, by the speed in both recordings.

In: a wheel's speed with its stamps, the receiver's. Out: the offset and the correlation there.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.settings import SETTINGS


def best_offset(
    wheel_s: FloatArray, wheel: FloatArray, fix_s: FloatArray, speed: FloatArray
) -> tuple[float, float, float] | None:
    """Return the offset, s, to add to the fixes' stamps, the correlation there, and the correlation as
    stamped (NaN where they do not overlap); None where none can be found.

    The offset lies where the parabola through the correlations, a second apart, has its top. None where the
    recordings are too short or one of them stands still.
    """
    one, start_one = _resample(wheel_s, wheel)
    other, start_other = _resample(fix_s, speed)
    if min(len(one), len(other)) < SETTINGS.min_overlap_steps or min(one.std(), other.std()) < 0.5:
        return None
    size = 1 << int(np.ceil(np.log2(len(one) + len(other))))

    def correlate(x: FloatArray, y: FloatArray) -> FloatArray:
        full = np.fft.irfft(np.fft.rfft(x, size) * np.conj(np.fft.rfft(y, size)), size)
        return np.concatenate([full[size - len(y) + 1 :], full[: len(x)]])

    ones, ones_other = np.ones(len(one)), np.ones(len(other))
    count = np.maximum(correlate(ones, ones_other), 1e-9)
    sum_x, sum_y = correlate(one, ones_other), correlate(ones, other)
    var_x = correlate(one**2, ones_other) - sum_x**2 / count
    var_y = correlate(ones, other**2) - sum_y**2 / count
    covariance = correlate(one, other) - sum_x * sum_y / count
    with np.errstate(divide="ignore", invalid="ignore"):
        r = covariance / np.sqrt(np.maximum(var_x, 1e-6) * np.maximum(var_y, 1e-6))
    shared = count >= min(SETTINGS.min_overlap_steps, 0.5 * min(len(one), len(other)))
    r = np.where(shared & (var_x / count > 0.3) & (var_y / count > 0.3), r, -1.0)
    lags = np.arange(-(len(other) - 1), len(one)) * SETTINGS.offset_step_s
    best = int(np.argmax(r))
    offsets = lags + start_one - start_other
    top = float(offsets[best])
    if 0 < best < len(r) - 1 and min(r[best - 1], r[best + 1]) > 0.0:
        before, after = r[best - 1] - r[best], r[best + 1] - r[best]
        top += 0.5 * SETTINGS.offset_step_s * float((before - after) / min(before + after, -1e-12))
    near = np.flatnonzero(np.abs(offsets) < SETTINGS.offset_step_s)
    here = float(r[near].max()) if len(near) else float("nan")
    return top, float(r[best]), here


def _resample(time_s: FloatArray, value: FloatArray) -> tuple[FloatArray, float]:
    """Return finite values interpolated on a regular grid of time, and the grid's first instant."""
    known = np.isfinite(value) & np.isfinite(time_s)
    t, x = time_s[known], value[known]
    if len(t) < 2:
        return np.zeros(0), 0.0
    start = float(np.ceil(t[0]))
    grid = np.arange(start, t[-1], SETTINGS.offset_step_s)
    return np.interp(grid, t, x), start
