"""Contents of figures, whoever draws them.

In: arrays. Out: `Chart`, `Bars` and `Track`: plain records that `static_figures` (matplotlib) and the
report's script (uPlot) draw alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class Curve:
    """A line over the chart's `x`, with a band where `low` and `high` are given; NaN interrupts it."""

    name: str
    y: FloatArray
    """(n,) in the unit of the chart's `y_label`, as `low` and `high`."""
    style: str
    """A role of `palette.STYLES`."""
    low: FloatArray | None = None
    high: FloatArray | None = None
    dots: bool = False


@dataclass(frozen=True)
class Level:
    """A horizontal line with a name."""

    at: float
    name: str
    style: str = "soft"


@dataclass(frozen=True)
class MarkedInstant:
    """A vertical line with a name."""

    at: float
    name: str
    style: str = "bad"


@dataclass(frozen=True)
class ShadedSpan:
    """A shaded stretch of the x axis."""

    start: float
    end: float
    style: str


@dataclass(frozen=True)
class Chart:
    """Curves over a common x axis."""

    title: str
    x_label: str
    y_label: str
    x: FloatArray
    """(n,) ascending."""
    curves: tuple[Curve, ...]
    levels: tuple[Level, ...] = ()
    moments: tuple[MarkedInstant, ...] = ()
    spans: tuple[ShadedSpan, ...] = ()
    span_names: tuple[tuple[str, str], ...] = ()
    """(style, what it means) of the spans, for the legend."""
    noise: tuple[float, float] | None = None
    """A band of the y axis within which noise stays."""
    noise_name: str = ""
    y_range: tuple[float, float] | None = None
    """None: all that is drawn."""
    group: str = ""
    """Charts of one group are zoomed together."""
    time: bool = False
    """True if x is seconds since the start of a drive."""
    date: bool = False
    """True if x is a host time, shown as a date (UTC)."""
    counts: bool = False
    """True if x counts things: marks stand at whole numbers."""

    def legend_spans(self) -> tuple[tuple[str, str], ...]:
        """Return (style, meaning) of shaded spans and of the band of noise."""
        return (*self.span_names, *([("line", self.noise_name)] if self.noise_name else []))

    def extent(self) -> tuple[float, float]:
        """Return the y range: as given, or that of curves, bands and levels plus 6 %."""
        if self.y_range is not None:
            return self.y_range
        parts = [
            array for curve in self.curves for array in (curve.y, curve.low, curve.high) if array is not None
        ]
        parts.append(np.array([level.at for level in self.levels]))
        if self.noise is not None:
            parts.append(np.array(self.noise))
        values = np.concatenate(parts)
        values = values[np.isfinite(values)]
        if len(values) == 0:
            return -1.0, 1.0
        low, high = float(values.min()), float(values.max())
        margin = 0.06 * (high - low) if high > low else 1.0
        return low - margin, high + margin


@dataclass(frozen=True)
class Bars:
    """Named numbers from 0 on; a logarithmic axis where they span more than two decades."""

    title: str
    x_label: str
    rows: tuple[tuple[str, float, bool], ...]
    """(name, value, whether it stands out)."""


@dataclass(frozen=True)
class Track:
    """A track in the plane, coloured by one quantity."""

    title: str
    colour_label: str
    east_m: FloatArray
    """(n,) as `north_m`, `value` and `time_s`."""
    north_m: FloatArray
    value: FloatArray
    time_s: FloatArray | None = None
    """Since the start of the drive; None where no chart is to be followed."""
    moments: tuple[MarkedInstant, ...] = ()
    """Marks by drive time."""
    group: str = ""


Figure = Chart | Bars | Track
