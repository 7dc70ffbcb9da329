"""The objective rating of a simulated curve against a recorded one by ISO/TS 18571:2014.

In: two curves of n samples at one rate. Out: the rating, 0 to 1: 0.4 corridor + 0.2 phase + 0.2 magnitude +
0.2 slope.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray

INNER, OUTER = 0.05, 0.5
"""Half widths of the corridors over the reference's largest size."""
MAX_SHIFT = 0.2
"""Largest shift in time over the length."""
MAX_MAGNITUDE = 0.5
MAX_SLOPE = 2.0
WARP = 0.1
"""Width of the warping window over the length."""
WEIGHTS = (0.4, 0.2, 0.2, 0.2)


@dataclass(frozen=True, slots=True)
class Rating:
    """The rating and its parts."""

    corridor: float
    phase: float
    magnitude: float
    slope: float

    @property
    def overall(self) -> float:
        """Return the weighted sum."""
        parts = (self.corridor, self.phase, self.magnitude, self.slope)
        return float(sum(w * part for w, part in zip(WEIGHTS, parts, strict=True)))


def rating(reference: FloatArray, simulated: FloatArray, dt_s: float = 1e-4) -> Rating:
    """Return the rating of a curve against the reference, both (n,), n at least 10."""
    shift = _best_shift(reference, simulated)
    moved_reference, moved = _aligned(reference, simulated, shift)
    allowed = MAX_SHIFT * len(reference)
    phase = 0.0 if abs(shift) >= allowed else (allowed - abs(shift)) / allowed
    return Rating(
        _corridor_score(reference, simulated),
        phase,
        _magnitude_score(moved_reference, moved),
        _slope_score(moved_reference, moved, dt_s),
    )


def _corridor_score(reference: FloatArray, simulated: FloatArray) -> float:
    """Return 1 within the inner corridor, 0 beyond the outer one, quadratic between them; the mean."""
    size = float(np.abs(reference).max())
    apart = np.abs(reference - simulated)
    between = ((OUTER * size - apart) / ((OUTER - INNER) * size)) ** 2 if size > 0.0 else np.zeros_like(apart)
    score = np.where(apart < INNER * size, 1.0, np.where(apart > OUTER * size, 0.0, between))
    return float(score.mean())


def _best_shift(reference: FloatArray, simulated: FloatArray) -> int:
    """Return the shift of largest correlation; positive: the simulated curve is late. The least one of
    equals."""
    best, found = 0, _correlation(reference, simulated)
    for k in range(1, int(np.floor(len(reference) * MAX_SHIFT) + 1)):
        late = _correlation(reference[:-k], simulated[k:])
        if late > found:
            best, found = k, late
        early = _correlation(reference[k:], simulated[:-k])
        if early > found:
            best, found = -k, early
    return best


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Return the correlation coefficient of two curves."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else -np.inf


def _aligned(reference: FloatArray, simulated: FloatArray, shift: int) -> tuple[FloatArray, FloatArray]:
    """Return the overlapping parts of both series, the simulated one moved by `shift` samples."""
    if shift > 0:
        return reference[:-shift], simulated[shift:]
    if shift < 0:
        return reference[-shift:], simulated[:shift]
    return reference, simulated


def _magnitude_score(reference: FloatArray, simulated: FloatArray) -> float:
    """Return the score of what remains apart once both curves are warped onto each other."""
    first, second = _warping(simulated, reference)
    size = float(np.abs(reference[second]).sum())
    apart = float(np.abs(simulated[first] - reference[second]).sum())
    error = apart / size if size > 0.0 else (0.0 if apart == 0.0 else np.inf)
    return 0.0 if error > MAX_MAGNITUDE else (MAX_MAGNITUDE - error) / MAX_MAGNITUDE


def _warping(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the path of least squared distance, steps (1, 0), (0, 1), (1, 1), within the window.

    Cells are summed along anti-diagonals, on which they do not depend on each other.
    """
    n = len(x)
    width = int(np.ceil(WARP * n)) - 1
    total = np.full((n + 1, n + 1), np.inf)
    total[0, 0] = 0.0
    flat = total.reshape(-1)
    for d in range(2 * n - 1):
        low, high = max(0, d - n + 1, (d - width + 1) // 2), min(n - 1, d, (d + width) // 2)
        if low > high:
            continue
        first_cell = n + d + 2 + low * n  # of (low + 1, d - low + 1) in the flat table; the next is n further
        cells = [
            slice(first_cell - by, first_cell - by + (high - low) * n + 1, n) for by in (0, n + 1, 1, n + 2)
        ]
        before = np.minimum(np.minimum(flat[cells[1]], flat[cells[2]]), flat[cells[3]])
        flat[cells[0]] = (x[low : high + 1] - y[d - high : d - low + 1][::-1]) ** 2 + before
    row = column = n - 1
    first, second = [row], [column]
    while row > 0 or column > 0:
        which = int(np.argmin((total[row, column + 1], total[row + 1, column], total[row, column])))
        row, column = row - (which != 1), column - (which != 0)
        first.append(row)
        second.append(column)
    return np.array(first[::-1]), np.array(second[::-1])


def _slope_score(reference: FloatArray, simulated: FloatArray, dt_s: float) -> float:
    """Return the score of the difference of smoothed slopes."""
    a, b = _smooth_slope(reference, dt_s), _smooth_slope(simulated, dt_s)
    size, apart = float(np.abs(a).sum()), float(np.abs(b - a).sum())
    error = apart / size if size > 0.0 else (0.0 if apart == 0.0 else np.inf)
    return 0.0 if error >= MAX_SLOPE else (MAX_SLOPE - error) / MAX_SLOPE


def _smooth_slope(curve: FloatArray, dt_s: float) -> FloatArray:
    """Return central differences, averaged over nine samples, fewer at the ends."""
    slope = np.gradient(curve, dt_s)
    out = np.convolve(slope, np.ones(9) / 9.0, mode="same")
    for k, count in enumerate((1, 3, 5, 7)):
        out[k] = slope[:count].mean()
        out[-1 - k] = slope[-count:].mean()
    return out
