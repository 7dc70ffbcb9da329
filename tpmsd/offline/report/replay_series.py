"""The series of a replayed drive as they are drawn, whatever draws them.

In: a `ReplayResult`. Out: arrays in drive time and in the units of the axes, with a row of NaN where the
recording pauses; spans without fixes, spans of driving that is not informative.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.report.replay_result import GNSS_GAP_S, ReplayResult

MAX_POINTS = 4000
"""More columns than a picture has pixels; keeps vector files small."""
BREAK_S = 5.0
"""A line is interrupted where the series itself has a hole longer than this (and than three steps)."""


@dataclass(frozen=True)
class ReplaySeries:
    """(n,) per quantity, (n, 4) per wheel; NaN while unknown and in pauses."""

    drive_s: FloatArray
    """Time since the drive's start."""
    speed_kmh: FloatArray
    informative: FloatArray
    """1 or 0."""
    gnss_age_s: FloatArray
    probability: FloatArray
    can_faults: FloatArray
    """So far, as the next one."""
    gnss_faults: FloatArray
    deviation_mm: FloatArray
    std_mm: FloatArray
    change_mm: FloatArray
    change_std_mm: FloatArray

    @classmethod
    def of(cls, result: ReplayResult) -> ReplaySeries:
        """Return the series of a result with at least one row, thinned to `MAX_POINTS`, NaN rows in
        pauses."""
        count = len(result.time_s)
        stride = max(1, -(-count // MAX_POINTS))
        pick = np.unique(np.append(np.arange(0, count, stride), count - 1))
        time_s = result.time_s[pick] - result.start_s
        steps = np.diff(time_s)
        step_s = float(np.median(steps)) if len(steps) else 0.0
        breaks = np.flatnonzero(steps > max(BREAK_S, 3.0 * step_s)) + 1

        def with_gaps(values: NDArray[Any]) -> FloatArray:
            return np.insert(np.asarray(values[pick], dtype=np.float64), breaks, np.nan, axis=0)

        return cls(
            drive_s=np.insert(time_s, breaks, time_s[breaks] - step_s),
            speed_kmh=with_gaps(result.speed_mps) * 3.6,
            informative=with_gaps(result.informative),
            gnss_age_s=with_gaps(result.gnss_age_s),
            probability=with_gaps(result.deflation_probability),
            can_faults=with_gaps(result.can_faults),
            gnss_faults=with_gaps(result.gnss_faults),
            deviation_mm=with_gaps(result.deviation_m) * 1e3,
            std_mm=with_gaps(result.std_m) * 1e3,
            change_mm=with_gaps(result.change_m) * 1e3,
            change_std_mm=with_gaps(result.change_std_m) * 1e3,
        )

    @property
    def edges_s(self) -> FloatArray:
        """Return (n + 1,) edges between the rows, never decreasing (a host clock may step back)."""
        previous = np.concatenate([[0.0], self.drive_s])
        return np.asarray(np.maximum.accumulate(previous), dtype=np.float64)

    def uninformative_spans(self) -> list[tuple[float, float]]:
        """Return the spans (s) of driving from which no radius is learned."""
        return _spans(self.informative == 0.0, self.edges_s)

    def outage_spans(self) -> list[tuple[float, float]]:
        """Return the spans (s) of more than `GNSS_GAP_S` without a fix, each from the last fix on."""
        silent_s = np.minimum(self.gnss_age_s, self.drive_s)  # before the first fix the wait counts
        lost = silent_s > GNSS_GAP_S
        out = []
        for start, end in _spans(lost, self.edges_s):
            # The last fix is as old as the first row beyond the limit says.
            first = np.flatnonzero(lost & (self.drive_s > start))[0]
            out.append((max(0.0, float(self.drive_s[first] - silent_s[first])), end))
        return out


def settled_range(values: FloatArray, std: FloatArray, marks: list[float]) -> tuple[float, float]:
    """Return a range that holds the settled part of the curves with their bands, and the marks.

    The first seconds of a filter, when it knows nothing yet, have bands of centimetres that would flatten all
    that follows; rows with a standard deviation above four times the median are therefore left out.
    """
    known = np.isfinite(values) & np.isfinite(std)
    low, high = min(marks), max(marks)
    if known.any():
        settled = known & (std <= 4.0 * np.median(std[known]))
        low = min(low, float(np.min(values[settled] - 2 * std[settled])))
        high = max(high, float(np.max(values[settled] + 2 * std[settled])))
    margin = 0.06 * max(high - low, 0.5)
    return low - margin, high + margin


def _spans(mask: NDArray[np.bool_], edges: FloatArray) -> list[tuple[float, float]]:
    """Return the intervals of the edges in which the mask holds."""
    padded = np.concatenate([[False], mask, [False]])
    flips = np.flatnonzero(padded[1:] != padded[:-1])
    return [(float(edges[a]), float(edges[b])) for a, b in zip(flips[::2], flips[1::2], strict=True)]
