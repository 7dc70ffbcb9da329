"""The offset between two clocks, from the one thing both saw: the car's speed.

In: two series of speeds, each on its own clock. Out: how far the second clock is behind, and how sure that
is. Needed for recordings whose NMEA lines bear no host time: the receiver's UTC and the bus's host clock may
differ by any constant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray

GRID_S = 0.1
MIN_OVERLAP_S = 30.0
MIN_OVERLAP_SHARE = 0.5
"""Overlap as a share of the shorter series, at least: short overlaps of unrelated logs correlate by
chance."""
MIN_CORRELATION = 0.9


@dataclass(frozen=True, slots=True)
class Alignment:
    """Offset to add to the second clock's times, and the correlation of the speeds there."""

    offset_s: float
    correlation: float

    @property
    def trusted(self) -> bool:
        """True if the speeds agree well enough to use the offset."""
        return self.correlation >= MIN_CORRELATION


def align(
    first_time_s: FloatArray, first_mps: FloatArray, second_time_s: FloatArray, second_mps: FloatArray
) -> Alignment | None:
    """Return the best offset by the normalised cross-correlation of the overlap; None where there is too
    little to compare.

    Times ascending. The normalisation is by each overlap's own mean and spread, so that a short overlap of a
    constant stretch does not win.
    """
    if min(first_time_s.size, second_time_s.size) < 10:
        return None
    a, a_start = _resample(first_time_s, first_mps)
    b, b_start = _resample(second_time_s, second_mps)
    overlap = int(max(MIN_OVERLAP_S / GRID_S, MIN_OVERLAP_SHARE * min(a.size, b.size)))
    if overlap > min(a.size, b.size):
        return None
    size = 1 << int(np.ceil(np.log2(a.size + b.size)))

    def correlate(x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the (a.size + b.size - 1,) cross-correlation of two series at all lags."""
        spectrum = np.fft.rfft(x, size) * np.conj(np.fft.rfft(y, size))
        wrapped = np.fft.irfft(spectrum, size)
        return np.concatenate([wrapped[-(b.size - 1) :], wrapped[: a.size]])

    # Lag k: b shifted by k steps lies on a. Sums over the overlap of each lag, all by convolution.
    ones_a, ones_b = np.ones_like(a), np.ones_like(b)
    count = np.maximum(correlate(ones_a, ones_b), 1.0)
    sum_a, sum_b = correlate(a, ones_b), correlate(ones_a, b)
    var_a = np.maximum(correlate(a * a, ones_b) - sum_a**2 / count, 1e-9)
    var_b = np.maximum(correlate(ones_a, b * b) - sum_b**2 / count, 1e-9)
    score = (correlate(a, b) - sum_a * sum_b / count) / np.sqrt(var_a * var_b)
    enough = (count >= overlap) & (var_a / count > 1.0) & (var_b / count > 1.0)
    if not np.any(enough):
        return None
    score = np.where(enough, score, -1.0)
    best = int(np.argmax(score))
    shift = _peak_index(score, best)
    lag = shift - (b.size - 1)
    return Alignment(a_start - b_start + lag * GRID_S, float(score[best]))


def _peak_index(score: FloatArray, best: int) -> float:
    """Return the fractional index of the maximum by a parabola through it and its neighbours; `best` itself
    at an end."""
    if not 0 < best < score.size - 1:
        return float(best)
    left, middle, right = score[best - 1], score[best], score[best + 1]
    bend = left - 2 * middle + right
    return best + float(0.5 * (left - right) / bend) if bend < 0 and min(left, right) > -1.0 else float(best)


def _resample(time_s: FloatArray, speed_mps: FloatArray) -> tuple[FloatArray, float]:
    """Return the speed (m,) interpolated every `GRID_S`, and the time of its first value."""
    start = float(time_s[0])
    grid = np.arange(start, float(time_s[-1]), GRID_S)
    return np.interp(grid, time_s, speed_mps), start
