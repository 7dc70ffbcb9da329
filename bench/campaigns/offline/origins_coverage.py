"""Coverage of 95 % intervals by origin: drives with several effects of known size.

In: a drive's specification, or rows of the campaign `origins` of the kind `KIND`. Out: the effects and their
true values, or a table. An interval is a value and 1.96 of its standard deviations; those of effects found by
their name count. Shares bear 95 % intervals of Clopper and Pearson; intervals of one drive are not quite
independent, so that these are a little too narrow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from bench.campaigns.offline.diagnosis.draw import concealed
from bench.statistics import count, percent
from bench.worlds.spec import Spec

Row = dict[str, Any]
Truth = dict[str, dict[str, Any]]

KIND = "known"
"""Of a drive with effects of known size."""
EFFECTS = (
    *("radius_change", "gnss_latency", "centrifugal_growth"),
    *("yaw_rate_scale", "track_width_error", "antenna_lever_arm"),
)
TOGETHER = 3
"""Effects of a drive."""
STRENGTHS = (0.5, 2.0)
"""1 is what 20 % of pressure make of a radius, and as much of the others (`diagnosis/draw.py`)."""
WITHIN_STDS = 1.96
APART = ("onset_s", "duration_s")
"""Of a ramp: they are looked for on a grid and have no Gaussian error."""


def known(spec: Spec, rng: np.random.Generator) -> Truth:
    """Effects that this car's bus and receiver can show, with their parameters."""
    possible = [name for name in EFFECTS if spec.with_gyro or name != "yaw_rate_scale"]
    names = [str(name) for name in rng.choice(possible, TOGETHER, replace=False)]
    low, high = np.log(STRENGTHS)
    return {name: concealed(name, float(np.exp(rng.uniform(low, high))), spec, rng) for name in names}


def as_reported(truth: Truth, spec: Spec) -> Truth:
    """The values that a diagnosis should tell: a latency is that beyond the age of the wheels' own frames."""
    reported = {name: dict(parameters) for name, parameters in truth.items()}
    if "gnss_latency" in reported:
        wheels_s = 0.5 * spec.speed_window_s + spec.speed_filter_s
        wheels_s += spec.frame_jitter_s if spec.wheel_signal == "counts" else 0.0
        reported["gnss_latency"]["latency_s"] += spec.arrival_jitter_s - wheels_s
    return reported


def errors(row: Row) -> Iterator[tuple[str, float]]:
    """Name of effect and parameter, and error in standard deviations, of each interval of a drive."""
    for finding in row["findings"]:
        true = row["truth"].get(finding["effect"])
        if true is None or ("wheel" in true and finding["where"]["wheels"] != [true["wheel"]]):
            continue
        for name, (value, std) in finding["parameters"].items():
            if name in true and name not in APART and isinstance(value, float) and std:
                yield f"{finding['effect']} {name}", (value - true[name]) / std


def table(rows: Sequence[Row]) -> str:
    """Coverage by origin and by parameter; empty without such drives."""
    those = [row for row in rows if row["kind"] == KIND and row["verdict"] != "insufficient_data"]
    if not those:
        return ""
    lines = [
        "| effects of known size on | drives | effects found by name | false names "
        "| intervals that hold the truth | root mean square error (std) |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for origin in dict.fromkeys(row["origin"] for row in those):
        lines.append(_line(origin, [row for row in those if row["origin"] == origin]))
    lines += [_line("all", those), ""]
    parts = []
    found = [each for row in those for each in errors(row)]
    for name in sorted({name for name, _ in found}):
        off = np.array([error for other, error in found if other == name])
        parts.append(f"{name} {off.mean():+.2f} ({(np.abs(off) < WITHIN_STDS).sum()}/{len(off)})")
    lines.append(f"Mean error in std (intervals that hold the truth): {', '.join(parts) or 'none'}.")
    return "\n".join(lines) + "\n"


def _line(origin: str, rows: Sequence[Row]) -> str:
    off = np.array([error for row in rows for _, error in errors(row)])
    named = [any(each["effect"] == name for each in row["findings"]) for row in rows for name in row["truth"]]
    false = sum(
        each["effect"] not in (*row["truth"], "velocity_lag") for row in rows for each in row["findings"]
    )
    size = f"{np.sqrt(np.mean(off**2)):.2f}" if len(off) else "-"
    cells = [
        origin,
        str(len(rows)),
        percent(count(named)),
        str(false),
        percent(count(np.abs(off) < WITHIN_STDS)),
    ]
    return f"| {' | '.join([*cells, size])} |"
