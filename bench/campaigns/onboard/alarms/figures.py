"""The figures of a run, with their intervals.

In: rows of `score` and `recorded`. Out: plain numbers. Shares bear 95 % intervals of Clopper and Pearson,
rates the exact Poisson interval of Garwood (Biometrika 26 and 28, 1934 and 1936).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from bench import statistics
from bench.campaigns.onboard.alarms.lives import is_resized
from bench.campaigns.onboard.alarms.reliability import reliability
from bench.statistics import count, percent
from bench.worlds.surfaces import TAGS

Row = dict[str, Any]
Figures = dict[str, Any]
PER_KM = 10_000.0
STANDARDS = ("r141-puncture", "r141-diffusion", "fmvss-1", "fmvss-2", "fmvss-3", "fmvss-4")
KINDS = ("deflation", "radius_deviation", "malfunction")
TRUE_SIZE = "snow_chains"
"""Where a `radius_deviation` is the truth: chains make a wheel larger."""
NO_SIGNAL = ("ferry", "towing", "car_wash", "outages", "canyon")
"""Where a malfunction that is announced is the truth: wheels and position part, or no fix for minutes."""


def rate(events: int, kilometres: float) -> Figures:
    """Events per 10,000 km with their interval."""
    return {"km": kilometres, **statistics.rate(events, kilometres, PER_KM)}


def figures(rows: Sequence[Row]) -> Figures:
    """All of a run."""
    cases, legs, recorded, failed = (_of(rows, what) for what in ("case", "leg", "recording", "failed"))
    undetected = [case for case in cases if not case["detected"]]
    out: Figures = {
        "cases": len(cases),
        "legs": len(legs),
        "failed": [f"{row['name']}: {row['error']}" for row in failed],
        "by_standard": {name: detection([c for c in cases if c["standard"] == name]) for name in STANDARDS},
        "by": {title: _grouped(cases, of) for title, of in GROUPINGS.items()},
        "malfunction": _missing_signals(rows),
        "one": detection([c for c in cases if c["standard"] == "r141-puncture"]),
        "one_at_once": detection(
            [c for c in cases if c["standard"] == "r141-puncture" and c["onset"] != "slow"]
        ),
        "four": detection([c for c in cases if c["standard"] == "r141-diffusion"]),
        "all": detection(cases),
        "missed": [{"name": c["name"], "reason": c["reason"]} for c in undetected],
        "causes": dict(Counter(c["reason"].split(":")[0] for c in undetected)),
        "wrong_wheel": _wrong_wheels(cases),
        "false": false_alarms(rows, legs, cases),
        "reliability": reliability(_of_their_size([*cases, *legs])),
        "recordings": recorded,
        "cpu_s": sum(row.get("cpu_s", 0.0) for row in rows),
    }
    out["bars"] = bars(out)
    return out


def _missing_signals(rows: Sequence[Row]) -> Figures:
    """Of the cases in which a wheel's signal is missing."""
    of_them = [row for row in rows if row["what"] == "malfunction"]
    return {name: count(row[name] for row in of_them) for name in ("by_law", "stands")}


def _of_their_size(rows: Iterable[Row]) -> list[Row]:
    """Those on which no wheel is of another size: there the change is true."""
    return [row for row in rows if not is_resized(row.get("tags", ()))]


GROUPINGS: dict[str, Callable[[Row], Any]] = {
    "onset": lambda c: c["onset"],
    "road": lambda c: c["road"],
    "receiver": lambda c: f"{c['receiver_hz']:g} Hz",
    "signal": lambda c: c["signal"],
    "season": lambda c: c["season"],
    "load": lambda c: "trailer" if c["trailer"] else "other load" if c["reloaded"] else "as learned",
    "car": lambda c: c["car"],
    "soft": lambda c: "+".join(c["wheels"]),
}


def detection(cases: Sequence[Row]) -> Figures:
    """Share detected, times, wheels."""
    found = [c for c in cases if c["detected"]]
    times = [float(c["fast_s"]) for c in found]
    # a case without an alarm takes longer than all others
    ranked = sorted(times) + [float("inf")] * (len(cases) - len(found))
    named = [c for c in cases if c["named"]]
    return {
        "detected": count(c["detected"] for c in cases),
        "by_law": count(c["by_law"] for c in cases if "by_law" in c),
        "stands": count(c["stands"] for c in cases if "stands" in c),
        "median_s": _order(ranked, 0.5),
        "p95_s": _order(ranked, 0.95),
        "longest_s": max(times, default=None),
        "right_wheel": count(c["right_wheel"] for c in named),
        "early": sum(c["early"] for c in cases),
    }


def _order(ranked: list[float], quantile: float) -> float | None:
    """The order statistic; None where that many were not detected."""
    if not ranked:
        return None
    value = ranked[min(int(np.ceil(quantile * len(ranked))), len(ranked)) - 1]
    return value if np.isfinite(value) else None


def _of(rows: Sequence[Row], what: str) -> list[Row]:
    """Return the rows of one sort."""
    return [row for row in rows if row["what"] == what]


def _grouped(cases: Sequence[Row], of: Callable[[Row], Any]) -> Figures:
    """Return the figures of the cases by what `of` says of each."""
    return {
        str(key): detection([case for case in cases if of(case) == key])
        for key in sorted({of(case) for case in cases}, key=str)
    }


def _wrong_wheels(cases: Sequence[Row]) -> list[Figures]:
    """Return the cases in which a wheel was named that is not soft."""
    return [
        {"name": case["name"], "named": case["named"], "soft": case["wheels"]}
        for case in cases
        if case["named"] and not case["right_wheel"]
    ]


def false_alarms(rows: Sequence[Row], legs: Sequence[Row], cases: Sequence[Row]) -> Figures:
    """Rates over the campaign, by kind and by what confounds."""
    honest = [row for row in legs if not is_resized(row["tags"])]
    learning, recorded = _of(rows, "learning"), _of(rows, "recording")
    out: Figures = {
        "hours": sum(row["hours"] for row in legs),
        "deflation": _rate(honest, "deflation"),
        "radius_deviation": _rate(honest, "radius_deviation"),
        "unexplained": _rate([row for row in honest if TRUE_SIZE not in row["tags"]], "radius_deviation"),
        "malfunction": _rate([row for row in honest if not set(row["tags"]) & set(NO_SIGNAL)], "malfunction"),
        "single": _rate([row for row in honest if "plain" in row["tags"]], "deflation"),
        "not_learned": sum(not row["learned"] for row in legs),
        "learning_drives": sum(len(row["false"]) for row in learning),
        "before_onset": sum(len(row["false_before"]) for row in cases),
        "recorded": rate(
            sum(len(row["tyre_alarms"]) for row in recorded), sum(row["km"] for row in recorded)
        ),
        "by_tag": {},
        "incidents": [incident for row in legs for incident in _incidents(row)],
    }
    for tag in TAGS:
        having = legs_with(tag, legs)
        if having:
            out["by_tag"][tag] = {kind: _rate(having, kind) for kind in KINDS}
    return out


def _incidents(leg: Row) -> list[Figures]:
    """Return the false alarms of a leg."""
    return [
        {
            "name": leg["name"],
            "tags": leg["tags"],
            "kind": kind,
            "at_s": at,
            "wheels": wheels,
            "reason": reason,
        }
        for kind in KINDS
        for at, wheels, reason in leg[kind]
    ]


def legs_with(tag: str, legs: Iterable[Row]) -> list[Row]:
    """The legs that have this confounder. Where a wheel is of another size as well, the leg counts for that
    alone: that change is true."""
    return [row for row in legs if tag in row["tags"] and is_resized(row["tags"]) == is_resized([tag])]


def _rate(legs: Iterable[Row], kind: str) -> Figures:
    legs = list(legs)
    return rate(sum(len(row[kind]) for row in legs), sum(row["km"] for row in legs))


def bars(found: Figures) -> list[Figures]:
    """Each bar, what was measured, and whether it is held; None where nothing was measured."""
    one, four, everything = found["one"], found["four"], found["all"]
    at_once = found["one_at_once"]
    false = found["false"]["deflation"]
    singles = found["by_standard"]["r141-puncture"]

    def held(group: Figures, ok: bool) -> bool | None:
        return ok if group["detected"]["of"] else None

    def seconds(value: float | None) -> str:
        return "not reached" if value is None else f"{value:.0f} s"

    def at_least(group: Figures, least: float) -> bool | None:
        return held(group, group["detected"]["hits"] >= least * group["detected"]["of"])

    unexplained = found["false"]["unexplained"]
    return [
        {
            "bar": "R141 and FMVSS 138 cases detected in time: 97 %",
            "measured": percent(everything["detected"]),
            "held": at_least(everything, 0.97),
        },
        {
            "bar": "-20 % on one wheel, fast or at the start: median 45 s above 40 km/h",
            "measured": seconds(at_once["median_s"]),
            "held": held(at_once, at_once["median_s"] is not None and at_once["median_s"] <= 45.0),
        },
        {
            "bar": "-20 % on one wheel: 99 % within 600 s",
            "measured": f"{percent(one['detected'])}, longest {seconds(one['longest_s'])}",
            "held": at_least(one, 0.99),
        },
        {
            "bar": "all four at -20 %: 90 % within 1200 s",
            "measured": f"{percent(four['detected'])}, median {seconds(four['median_s'])}",
            "held": at_least(four, 0.9),
        },
        {
            "bar": "right wheel in 99 % (one tyre)",
            "measured": percent(singles["right_wheel"]),
            "held": None
            if not singles["right_wheel"]["of"]
            else singles["right_wheel"]["hits"] >= 0.99 * singles["right_wheel"]["of"],
        },
        {
            "bar": "at most one false `deflation` in 10,000 km",
            "measured": rated(false),
            "held": None if not false["km"] else false["rate"] <= 1.0,
        },
        {
            "bar": "at most three unexplained `radius_deviation` in 10,000 km",
            "measured": rated(unexplained),
            "held": None if not unexplained["km"] else unexplained["rate"] <= 3.0,
        },
    ]


def rated(part: Figures) -> str:
    """A rate with its interval, as text."""
    if not part["km"]:
        return "-"
    low, middle, high = (f"{part[name]:.1f}" for name in ("low", "rate", "high"))
    return f"{part['events']} in {part['km']:.0f} km = {middle} [{low}, {high}]"
