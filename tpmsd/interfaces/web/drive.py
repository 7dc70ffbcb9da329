"""A recorded drive for the page: its series at any zoom, its alarms, its track.

In: a `Replay` of the API with its tick table. Out: plain JSON values. A series is decimated to the smallest
and the largest value of each bucket, so that no spike is lost however far the view is zoomed out.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.interfaces.api.results import Replay
from tpmsd.offline.report.decimation import decimated
from tpmsd.offline.tables.columns import BY_NAME, COLUMNS

TIME = "drive_time_s"
TRACK = ("east_m", "north_m")
PANELS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("Radius minus baseline", tuple(f"change_{wheel}_m" for wheel in WHEELS)),
    ("Radius minus nominal", tuple(f"deviation_{wheel}_m" for wheel in WHEELS)),
    ("Probability of a deflation", tuple(f"deflation_probability_{wheel}" for wheel in WHEELS)),
    ("Speed", ("speed_mps", "gnss_speed_mps")),
    ("Yaw rate", ("yaw_rate_radps", "estimated_yaw_rate_radps")),
    ("Acceleration", ("accel_long_mps2", "accel_lat_mps2")),
    ("Age of the last fix", ("gnss_age_s",)),
    ("Faults per tick", ("faults",)),
)
"""Charts of the page, one below the other, with a shared time axis."""
BANDS = {f"{stem}_{wheel}_m": f"{stem}_std_{wheel}_m" for stem in ("change", "deviation") for wheel in WHEELS}
"""A series and its standard deviation; the band is two of them."""


def overview(replay: Replay) -> dict[str, Any]:
    """Return the document that the page needs before it asks for series."""
    table = replay.table
    if table is None:
        raise ConfigError("the replay has no tick table")
    document = replay.to_dict()
    have = {name for name in BY_NAME if name in table.numbers and np.isfinite(table[name]).any()}
    return {
        "drive": document["drive"],
        "duration_s": document["duration_s"],
        "distance_m": document["distance_m"],
        "wheels": document["wheels"],
        "alarms": document["alarms"],
        "notes": list(replay.notes),
        "columns": [
            {"name": column.name, "unit": column.unit, "meaning": column.meaning}
            for column in COLUMNS
            if column.name in have
        ],
        "panels": [
            {"title": title, "series": [name for name in names if name in have]}
            for title, names in PANELS
            if any(name in have for name in names)
        ],
    }


def series(
    replay: Replay, names: list[str], from_s: float, to_s: float, points: int
) -> dict[str, list[float | None]]:
    """Return columns between two drive times, with at most `points` values each; `x` is the time in s.

    Columns of `BANDS` come with `<name>:low` and `<name>:high`, two standard deviations either side.

    Raises:
        ConfigError: no such column, or the span is empty.
    """
    table = replay.table
    if table is None:
        raise ConfigError("the replay has no tick table")
    if not to_s > from_s:
        raise ConfigError("the end of the span is not after its beginning")
    for name in names:
        if name not in table.numbers:
            raise ConfigError(f"no such column: {name[:80]}")
    time_s = table[TIME]
    # One row either side, so that a line goes on to the edge of the view.
    first = max(int(np.searchsorted(time_s, from_s)) - 1, 0)
    last = min(int(np.searchsorted(time_s, to_s, side="right")) + 1, len(time_s))
    rows = slice(first, last)
    columns: dict[str, FloatArray] = {name: table[name][rows] for name in names}
    for name in names:
        if (std := BANDS.get(name)) is not None and std in table.numbers:
            columns[f"{name}:low"] = table[name][rows] - 2.0 * table[std][rows]
            columns[f"{name}:high"] = table[name][rows] + 2.0 * table[std][rows]
    x, kept = decimated(time_s[rows], columns, points)
    return {"x": plain_list(x), **{name: plain_list(values) for name, values in kept.items()}}


def track(replay: Replay, colour: str, points: int) -> dict[str, list[float | None]]:
    """Return the track in the plane of the first fix with the values of one column to colour it by.

    ConfigError: no such column.
    """
    table = replay.table
    if table is None:
        raise ConfigError("the replay has no tick table")
    if colour not in table.numbers:
        raise ConfigError(f"no such column: {colour[:80]}")
    step = max(1, math.ceil(len(table) / max(points, 1)))
    names = {"east_m": TRACK[0], "north_m": TRACK[1], "value": colour, "time_s": TIME}
    return {key: plain_list(table[name][::step]) for key, name in names.items()}


def plain_list(values: FloatArray) -> list[float | None]:
    """Return values with seven significant digits for JSON, None for what is not finite."""
    return [float(f"{value:.7g}") if math.isfinite(value) else None for value in values.tolist()]
