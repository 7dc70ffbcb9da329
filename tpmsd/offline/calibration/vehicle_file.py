"""A vehicle.toml with calibrated radii and tracks in it.

In: the text of a configuration, a `FittedGeometry`. Out: the same text with those keys replaced and a
[calibration] table that says where they come from; comments and all else stay as they were.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping

from tpmsd.offline.calibration.result import FittedGeometry

_TABLE = re.compile(r"\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$")
_WRITTEN = ("vehicle.wheel_radius_m", "calibration")
"""Tables that are replaced as a whole."""


def calibrated_toml(
    text: str,
    found: FittedGeometry,
    radii_m: dict[str, float],
    bus_radii_m: dict[str, float],
    dbc: str | None,
    made: str,
) -> str:
    """Return the text with calibrated values: `radii_m` of all four wheels, `bus_radii_m` of those whose bus
    states speeds (`CalibrationConfig.bus_radius_fl_m`), `dbc` where the DBC lies seen from the new file
    (None: as the text has it), `made` the date."""
    values = {"wheel_radius_m": _inline_table(radii_m)}
    if math.isfinite(found.track_rear_std_m):
        values["track_rear_m"] = f"{found.track_rear_m:.4f}"
    if math.isfinite(found.track_front_m):
        values["track_front_m"] = f"{found.track_front_m:.4f}"
    added = {"vehicle": [f"{key} = {value}  # calibrated" for key, value in values.items()]}
    stale = {"vehicle": set(values)}
    if dbc is not None:
        added["can"] = [f"dbc = {json.dumps(dbc, ensure_ascii=False)}"]
        stale["can"] = {"dbc"}
    out = list(_lines_with_replacements(text, stale, added))
    while out and not out[-1].strip():
        out.pop()
    return "\n".join([*out, "", *_provenance_lines(found, bus_radii_m, made), ""])


def _lines_with_replacements(
    text: str, stale: Mapping[str, set[str]], added: Mapping[str, list[str]]
) -> Iterator[str]:
    """Yield the lines of a configuration without the stale keys, by table, and without the tables that are
    written again; the lines that are added follow the heading of their table."""
    table = ""
    for line in text.splitlines():
        heading = _TABLE.match(line)
        if heading:
            table = re.sub(r"[\s\"']", "", heading.group(1))
        if table in _WRITTEN:
            continue
        if heading:
            yield from (line, *added.get(table, ()))
        elif _first_key(line) not in stale.get(table, ()):
            yield line


def _first_key(line: str) -> str:
    """Return the first part of the key that a line sets."""
    return re.split(r"[.=\s]", line.strip().replace('"', "").replace("'", ""), maxsplit=1)[0]


def _inline_table(radii_m: dict[str, float]) -> str:
    """Return the radii as a TOML inline table."""
    return "{ " + ", ".join(f"{wheel} = {radius:.6f}" for wheel, radius in radii_m.items()) + " }"


def _provenance_lines(found: FittedGeometry, bus_radii_m: dict[str, float], made: str) -> list[str]:
    """Return the lines of the table [calibration]."""
    lines = [
        "[calibration]",
        "# How the radii and tracks in [vehicle] were found; the monitor takes its tyres for these.",
        f"made = {json.dumps(made)}",
        f"method = {json.dumps(found.method)}",
        f"drives = {json.dumps(', '.join(found.drives), ensure_ascii=False)}",
        f"reference_speed_mps = {found.reference_speed_mps:.2f}",
    ]
    lines += [f"radius_std_{wheel}_m = {result.radius_std_m:.6f}" for wheel, result in found.wheels.items()]
    if math.isfinite(found.track_rear_std_m):
        lines.append(f"track_rear_std_m = {found.track_rear_std_m:.4f}")
    if math.isfinite(found.track_front_std_m):
        lines.append(f"track_front_std_m = {found.track_front_std_m:.4f}")
    lines += [f"bus_radius_{wheel}_m = {radius!r}" for wheel, radius in bus_radii_m.items()]
    return lines
