"""Figures as JSON for the report's script, which draws them with uPlot.

In: `Chart`, `Bars`, `Track`. Out: JSON that may stand in a page's `<script type="application/json">`; empty
for what has no interaction.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from tpmsd.foundation.palette import STYLES
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.report.figures import Bars, Chart, Figure
from tpmsd.offline.report.static_figures import Picture

DIGITS = 5
"""Significant ones: more than a screen can show."""


def figure_json(figure: Figure, picture: Picture | None) -> str:
    """Return the figure's data as JSON; of a track, its pixels over time; empty where there is nothing to
    draw."""
    if isinstance(figure, Bars):
        return ""
    if isinstance(figure, Chart):
        return _script_json(_chart_json(figure))
    if picture is None or figure.time_s is None:
        return ""
    x, y = picture.points.T
    return _script_json(
        {
            "kind": "track",
            "group": figure.group,
            "time": _json_numbers(figure.time_s),
            "x": _json_numbers(x),
            "y": _json_numbers(y),
        }
    )


def _chart_json(chart: Chart) -> dict[str, Any]:
    low, high = chart.extent()
    return {
        "kind": "chart",
        "group": chart.group,
        "time": chart.time,
        "date": chart.date,
        "counts": chart.counts,
        "xLabel": chart.x_label,
        "yLabel": chart.y_label,
        "yRange": [low, high],
        "x": np.round(chart.x).tolist() if chart.date else _json_numbers(chart.x),
        "curves": [
            {
                "name": curve.name,
                "style": curve.style,
                "dashes": [2.0 * part for part in STYLES[curve.style].dashes],
                "dots": curve.dots,
                "y": _json_numbers(curve.y),
                "low": None if curve.low is None else _json_numbers(curve.low),
                "high": None if curve.high is None else _json_numbers(curve.high),
            }
            for curve in chart.curves
        ],
        "levels": [{"at": one.at, "name": one.name, "style": one.style} for one in chart.levels],
        "moments": [{"at": one.at, "name": one.name, "style": one.style} for one in chart.moments],
        "spans": [{"from": one.start, "to": one.end, "style": one.style} for one in chart.spans],
        "spanNames": [{"style": style, "name": name} for style, name in chart.legend_spans()],
        "noise": None if chart.noise is None else list(chart.noise),
    }


def _json_numbers(values: FloatArray) -> list[float | None]:
    """Return values in `DIGITS` digits, None where they are not finite."""
    return [float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()]


def _script_json(document: dict[str, Any]) -> str:
    """Return JSON in which no text can end the script element."""
    return json.dumps(document, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
