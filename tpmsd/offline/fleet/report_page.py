"""The fleet's report as one page that opens offline.

In: the report's document and the tables. Out: HTML (template `fleet.html`): tables for manager and
engineer, to be sorted by a click on their heads, and for every car its drives with the radii of each.
ConfigError without the extra `report`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tpmsd.foundation.plain import with_unit
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.fleet.report import drives_of_cars, model_title, utc_minute
from tpmsd.offline.fleet.settings import SETTINGS
from tpmsd.offline.report.figures import Chart, Curve
from tpmsd.offline.report.page import Cell, HtmlTable, Origin, RenderedFigure, Tile, render, render_figure
from tpmsd.offline.report.wording import parameter_name, plain_name, wheel_name

Row = dict[str, Any]
_ORDER = {"now": 0, "soon": 1, "look": 2}


@dataclass(frozen=True)
class ModelView:
    """Tables of the report's page about one model of car."""

    title: str
    findings: HtmlTable
    differing: HtmlTable
    named: HtmlTable
    parameters: HtmlTable


@dataclass(frozen=True)
class CarView:
    """One car with its drives."""

    anchor: str
    title: str
    note: str
    figure: RenderedFigure | None
    drives: HtmlTable
    is_open: bool
    """True where its drives are shown at once: cars that need attention."""


def report_page(
    document: Mapping[str, Any], tables: Mapping[str, list[Row]], pages: Mapping[str, str] | None = None
) -> str:
    """Return the page as HTML; `pages`: links to pages of drives by their keys."""
    return render(
        "fleet.html",
        Origin.now(document),
        standalone=True,
        head=_summary_tiles(document),
        attention=_attention_table(document["attention"]),
        models=[_model_view(model) for model in document["models"]],
        cars=list(_car_views(tables, [row["car"] for row in document["attention"]], pages or {})),
    )


def _summary_tiles(document: Mapping[str, Any]) -> list[Tile]:
    cars = len({row["car"] for row in document["attention"]})
    return [
        Tile(str(document["cars"]), "Vehicles", f"Models: {len(document['models'])}."),
        Tile(
            str(cars), "Need attention", "An alarm is active, a trend was found, or a drive cannot be used."
        ),
        Tile(str(document["drives"]), "Drives", "All in the store, those that could not be used among them."),
        Tile(f"{document['distance_km']:.0f} km", "Distance", "By the estimated speed."),
        Tile(f"{document['duration_h']:.1f} h", "Time", "Of recording."),
    ]


def _attention_table(rows: Sequence[Row]) -> HtmlTable:
    body = tuple(
        (
            Cell(row["urgency"], _ORDER[row["urgency"]], style=row["urgency"]),
            Cell(str(row["car"]), link=_html_anchor(row["car"])),
            Cell(str(row["why"]).replace("+-", "±")),
            Cell(row["since"] or "", style="when"),
            Cell(row["what_to_do"]),
        )
        for row in rows
    )
    return HtmlTable(("urgency", "vehicle", "why", "since (UTC)", "what to do"), body)


def _model_view(model: Row) -> ModelView:
    findings = tuple(
        (*_effect_cells(row), *_value_cells(row), _unit_cell(row), _p_value_cell(row))
        for row in model["findings"]
    )
    differing = tuple(
        (
            Cell(str(row["car"]), link=_html_anchor(row["car"])),
            Cell(str(row["kind"])),
            *_effect_cells(row),
            *_value_cells(row),
            _unit_cell(row),
            _p_value_cell(row),
        )
        for row in model["differing"]
    )
    named = tuple(
        (Cell(plain_name(row["effect"])), _count_cell(row["drives"]), _count_cell(row["cars"]))
        for row in model["named_in_drives"]
    )
    parameters = tuple(
        (
            Cell(str(row["parameter"])),
            *_value_cells(row),
            _number_cell(row["spread_cars"]),
            _number_cell(row["spread_drives"]),
            _unit_cell(row),
        )
        for row in model["parameters"]
    )
    interval = "95 % interval"
    return ModelView(
        f"{model_title(model['model'])}: {drives_of_cars(model)}",
        HtmlTable(("effect of the model", "parameter", "value", interval, "unit", "p-value"), findings),
        HtmlTable(
            ("vehicle", "what", "effect", "parameter", "difference or slope", interval, "unit", "p-value"),
            differing,
        ),
        HtmlTable(("named by the diagnosis of single drives", "drives", "cars"), named),
        HtmlTable(
            ("parameter", "mean", interval, "from car to car", "from drive to drive", "unit"),
            parameters,
        ),
    )


def _car_views(
    tables: Mapping[str, list[Row]], first: Sequence[str], pages: Mapping[str, str]
) -> Iterable[CarView]:
    wheels: dict[str, dict[str, Row]] = defaultdict(dict)
    for row in tables["wheels"]:
        wheels[row["key"]][row["wheel"]] = row
    alarms: dict[str, list[Row]] = defaultdict(list)
    for row in tables["alarms"]:
        alarms[row["key"]].append(row)
    cars: dict[str, list[Row]] = defaultdict(list)
    for row in tables["drives"]:
        cars[row["car"]].append(row)
    pictured = set(list(dict.fromkeys([*first, *sorted(cars)]))[: SETTINGS.max_pictures])
    each = max(1, SETTINGS.max_drives // max(len(cars), 1))
    for car, drives in sorted(cars.items()):
        drives.sort(key=lambda row: (row["start"] or 0.0, row["path"]))
        shown = drives[-each:]
        dated = [row for row in shown if utc_minute(row["start"]) is not None]
        read = [one for one in WHEELS if any(one in wheels[row["key"]] for row in shown)]
        heads = ("drive", "start (UTC)", "km", "status", *(f"{wheel} (mm)" for wheel in read), "alarms")
        chart = _radius_chart(dated, [wheels[row["key"]] for row in dated])
        anchor = _html_anchor(car)
        yield CarView(
            anchor,
            f"{car} ({model_title(drives[0]['model'])}), {len(drives)} drive{'s' * (len(drives) != 1)}",
            f"The newest {len(shown)} of {len(drives)} drives." if len(shown) < len(drives) else "",
            None if chart is None else render_figure(chart, f"{anchor}-radii", static=car in pictured),
            HtmlTable(
                heads,
                tuple(
                    _drive_cells(row, read, wheels[row["key"]], alarms[row["key"]], pages.get(row["key"], ""))
                    for row in shown
                ),
            ),
            car in first,
        )


def _drive_cells(
    row: Row, read: Sequence[str], wheels: Mapping[str, Row], alarms: Sequence[Row], page: str
) -> tuple[Cell, ...]:
    """Return the cells of a drive's row; `read` are the wheels that have a column, those of any drive of its
    car.
    """
    named = "\n".join(
        " ".join(filter(None, (plain_name(one["kind"]), one["wheel"], one["state"]))) for one in alarms
    )
    return (
        Cell(str(row["path"]), href=page),
        Cell(utc_minute(row["start"]) or "", row["start"], style="when"),
        _number_cell((row["distance_m"] or 0.0) / 1e3),
        Cell(row["status"] + (f": {row['reason']}" if row["reason"] else "")),
        *(_radius_cell(wheels.get(wheel)) for wheel in read),
        Cell(named),
    )


def _radius_cell(one: Row | None) -> Cell:
    """Return the cell of a radius: its difference from nominal with one standard deviation."""
    if one is None or one["deviation_mm"] is None:
        return Cell("", number=True)
    std = "" if one["std_mm"] is None else f" ± {one['std_mm']:.2f}"
    return Cell(f"{one['deviation_mm']:+.2f}{std}", one["deviation_mm"], number=True)


def _radius_chart(dated: Sequence[Row], drives: Sequence[Mapping[str, Row]]) -> Chart | None:
    """Return the chart of each wheel's radius minus nominal over the date, with two standard deviations; or
    None.

    A car is on one drive at a time: where drives overlap, their clocks are no dates, and the axis counts
    drives.
    """
    values = {
        wheel: np.array([_number_of_row(one.get(wheel), "deviation_mm") for one in drives])
        for wheel in WHEELS
    }
    stds = {wheel: np.array([_number_of_row(one.get(wheel), "std_mm") for one in drives]) for wheel in WHEELS}
    curves = tuple(
        Curve(
            wheel_name(wheel),
            values[wheel],
            wheel,
            values[wheel] - 2.0 * stds[wheel],
            values[wheel] + 2.0 * stds[wheel],
            dots=True,
        )
        for wheel in WHEELS
        if np.isfinite(values[wheel]).any()
    )
    if len(drives) < 2 or not curves:
        return None
    starts_s = np.array([row["start"] for row in dated], dtype=np.float64)
    ends_s = starts_s + [row["duration_s"] or 0.0 for row in dated]
    overlap = bool(np.any((starts_s[1:] < ends_s[:-1]) | (starts_s[1:] == starts_s[:-1])))
    return Chart(
        "Radii, drive by drive" if overlap else "Radii over the date",
        "drive, in the table's order (some overlap in time)" if overlap else "start of the drive (UTC)",
        "radius minus nominal (mm)",
        np.arange(1.0, len(dated) + 1.0) if overlap else starts_s,
        curves,
        date=not overlap,
        counts=overlap,
    )


def _number_of_row(one: Row | None, name: str) -> float:
    """Return a number of a row; NaN without the row or the number."""
    value = None if one is None else one[name]
    return float("nan") if value is None else float(value)


def _effect_cells(row: Row) -> tuple[Cell, Cell]:
    parameter = str(row["parameter"])
    name = wheel_name(parameter) if parameter in WHEELS else parameter_name(parameter)
    return Cell(plain_name(row["effect"])), Cell(name)


def _value_cells(row: Row) -> tuple[Cell, Cell]:
    """Return the cells of a value and of its 95 % interval, empty without a standard deviation."""
    value, std = row["value"], row["std"]
    if std is None:
        return _number_cell(value), Cell("", number=True)
    low, high = value - 1.96 * std, value + 1.96 * std
    return _number_cell(value), Cell(f"{low:.4g} to {high:.4g}", std, number=True)


def _unit_cell(row: Row) -> Cell:
    return Cell(with_unit("", row["unit"]).strip())


def _p_value_cell(row: Row) -> Cell:
    return Cell(f"{row['p_value']:.1g}", row["p_value"], number=True)


def _number_cell(value: float | None) -> Cell:
    return Cell("" if value is None else f"{value:.4g}", value, number=True)


def _count_cell(value: int) -> Cell:
    return Cell(str(value), value, number=True)


def _html_anchor(car: str) -> str:
    return "car-" + "".join(c if c.isascii() and c.isalnum() else f"_{ord(c):x}_" for c in car)
