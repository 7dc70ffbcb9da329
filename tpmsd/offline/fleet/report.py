"""Report on a fleet: vehicles that need attention and why, and the findings for each model.

In: the tables as rows. Out: a document of plain values, and its text. Pure.
"""

from __future__ import annotations

import datetime
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

from tpmsd.foundation.plain import with_unit
from tpmsd.offline.fleet.settings import SETTINGS
from tpmsd.offline.report.wording import parameter_name, plain_name

Row = dict[str, Any]
Tables = dict[str, list[Row]]

URGENT, SOON, LOOK = "now", "soon", "look"
_ORDER = {URGENT: 0, SOON: 1, LOOK: 2}
_WHEELS = {"fl": "front left", "fr": "front right", "rl": "rear left", "rr": "rear right"}
_WHAT_TO_DO = {
    "deflation": "check the pressure before the next drive",
    "radius_deviation": "look at the tyre: another size, worn, or the wrong pressure",
    "loss": "check the pressure before the next drive, unless this tyre was changed",
    "slow_leak": "check the pressure; look for a nail or a leaking valve",
    "malfunction": "look at bus and receiver: tpmsd could not do its work",
    "differs": "compare configuration, tyres and sensors with the other cars of the model",
    "wear": "measure the tread",
    "failed": "look at the recording: it cannot be used",
    "set_aside": "look at the recording: working on it took the worker down",
}

_CHECK_RING = "check this wheel's encoder ring and sensor: dirt, rust, a missing tooth, too wide a gap"
_ADVICE = (
    ("loses counts", _CHECK_RING),
    ("of its counts", _CHECK_RING),
    ("no usable signal", "look at this wheel's sensor and at its signal on the bus"),
    ("another node", "find out which control unit or tool sends the wheels' frames"),
    ("contradicts the configuration", "hold the configuration against the drive: tpmsd check --drive"),
    ("receiver", "look at the receiver, its antenna and its cable"),
)
"""Words in the reason of a malfunction, and what to do then; the first that fits."""
_OF_ONE_TYRE = {"deflation", "radius_deviation", "loss", "slow_leak"}
"""Kinds of attention that share one row where they concern one wheel."""
_DERIVED_MODEL = re.compile(r"(\d+(?:\.\d+)?)m-(\w+)-([0-9a-f]{4})")


def report_document(tables: Tables) -> dict[str, Any]:
    """Return the report: in `attention` a row per vehicle and reason, the most urgent first; in `models`
    findings and parameters.
    """
    drives = tables["drives"]
    attention = _merge_rows_of_wheel(
        [
            *_active_alarm_rows(tables),
            *_finding_attention_rows(tables["findings"]),
            *_unusable_drive_rows(drives),
        ]
    )
    attention.sort(key=lambda row: (_ORDER[row["urgency"]], row["car"], row["since"] or "", row["why"]))
    return {
        "drives": len(drives),
        "cars": len({row["car"] for row in drives}),
        "distance_km": sum(row["distance_m"] or 0.0 for row in drives) / 1e3,
        "duration_h": sum(row["duration_s"] or 0.0 for row in drives) / 3600.0,
        "attention": attention,
        "models": [_model_document(tables, model) for model in sorted({row["model"] for row in drives})],
    }


def _model_document(tables: Tables, model: str) -> dict[str, Any]:
    """Return the report's entry of one model: numbers of cars and drives, findings and parameters."""
    drives, findings, statistics = (
        [row for row in tables[table] if row["model"] == model]
        for table in ("drives", "findings", "statistics")
    )
    return {
        "model": model,
        "cars": len({row["car"] for row in drives}),
        "drives": len(drives),
        "findings": [row for row in findings if row["level"] == "model"],
        "differing": [row for row in findings if row["level"] == "car"],
        "named_in_drives": _named_effect_rows(findings),
        "parameters": [row for row in statistics if row["level"] == "model"],
    }


def _active_alarm_rows(tables: Tables) -> list[Row]:
    """Return the alarms active at the end of the last drive that had any, each with the time of its first
    transition.
    """
    order_of = {row["key"]: (row["start"] or 0.0, row["path"]) for row in tables["drives"]}
    active: dict[tuple[str, str, str], Row] = {}

    def time_order(row: Row) -> tuple[Any, ...]:
        """Return the sort key of an alarm: drive after drive, also of drives that begin at one instant, then
        time.
        """
        return (*order_of.get(row["key"], (0.0, "")), row["time"] or 0.0)

    for alarm in sorted(tables["alarms"], key=time_order):
        subject = (alarm["car"], alarm["kind"], alarm["wheel"] or "")
        if alarm["state"] == "raised":
            active.setdefault(subject, alarm)
        else:
            active.pop(subject, None)
    found = []
    for (car, kind, wheel), alarm in active.items():
        urgency = {"deflation": URGENT, "malfunction": LOOK}.get(kind, SOON)
        where = _WHEELS.get(wheel, "")
        why, reason = f"{kind.replace('_', ' ')} {where}".strip(), alarm.get("reason") or ""
        why += f": {reason}" if reason and kind == "malfunction" else ""
        one = _attention_row(car, urgency, why, alarm["time"], kind, alarm["key"], wheel)
        if kind == "malfunction":
            one["what_to_do"] = next((do for words, do in _ADVICE if words in reason), one["what_to_do"])
        found.append(one)
    return found


def _finding_attention_rows(findings: Iterable[Row]) -> list[Row]:
    """Return a row of attention for each finding about a car."""
    found = []
    for row in findings:
        if row["level"] != "car":
            continue
        size = with_unit(f"{row['value']:+.3g} +- {row['std']:.2g}", row["unit"])
        if row["effect"] == "slow_leak":
            why, kind = f"slow leak {_WHEELS[row['parameter']]}: {size} of radius", "slow_leak"
        elif row["kind"] == "loss":
            why, kind = (
                f"{_WHEELS[row['parameter']]} smaller than on drives before: {size} of radius",
                "loss",
            )
        elif row["kind"] == "wear":
            why, kind = f"wear: {size} of radius", "wear"
        else:
            of = _WHEELS.get(row["parameter"]) or parameter_name(row["parameter"])
            why, kind = f"unlike its model: {plain_name(row['effect'])} {of} by {size}", "differs"
        urgency = {"loss": URGENT, "slow_leak": SOON}.get(kind, LOOK)
        found.append(_attention_row(row["car"], urgency, why, row.get("since"), kind, None, row["parameter"]))
    return found


def _unusable_drive_rows(drives: Iterable[Row]) -> list[Row]:
    """Return a row of attention for each drive that failed or was set aside."""
    return [
        _attention_row(row["car"], LOOK, f"{row['path']}: {row['reason']}", None, row["status"], row["key"])
        for row in drives
        if row["status"] in ("failed", "set_aside")
    ]


def _merge_rows_of_wheel(rows: Iterable[Row]) -> list[Row]:
    """Merge the rows about one tyre into one, with the urgency and the advice of the most urgent."""
    rows = sorted(rows, key=lambda row: _ORDER[row["urgency"]])
    found: list[Row] = []
    by_tyre: dict[tuple[str, str], Row] = {}
    for row in rows:
        wheel, kind = row.pop("wheel"), row.pop("kind")
        first = by_tyre.get((row["car"], wheel)) if kind in _OF_ONE_TYRE and wheel in _WHEELS else None
        if first is None:
            found.append(row)
            if kind in _OF_ONE_TYRE and wheel in _WHEELS:
                by_tyre[row["car"], wheel] = row
            continue
        first["why"] += f"; {row['why']}"
        first["since"] = min(filter(None, (first["since"], row["since"])), default=None)
        first["drive"] = first["drive"] or row["drive"]
    return found


def _attention_row(
    car: str, urgency: str, why: str, time_s: float | None, kind: str, key: str | None, wheel: str = ""
) -> Row:
    """Return a row of attention; `kind` and `wheel` are removed again when rows of one tyre are merged."""
    what = _WHAT_TO_DO.get(kind, "look at it")
    shown = {
        "car": car,
        "urgency": urgency,
        "why": why,
        "since": utc_minute(time_s),
        "what_to_do": what,
        "drive": key,
    }
    return {**shown, "kind": kind, "wheel": wheel}


def model_title(model: str) -> str:
    """Return a model's name for display: for one that is derived from a configuration its geometry."""
    derived = _DERIVED_MODEL.fullmatch(model)
    if derived is None:
        return model
    wheelbase, axle, tag = derived.groups()
    return f"wheelbase {wheelbase} m, driven {axle} ({tag})"


def _is_named(row: Row) -> bool:
    """Return whether the diagnosis named the finding's effect: no mere suspicion, and of enough
    confidence.
    """
    confidence = row.get("confidence")
    return row.get("status") != "suspicion" and (
        confidence is None or confidence >= SETTINGS.named_confidence
    )


def utc_minute(time_s: float | None) -> str | None:
    """Return a host time as date and minute; None where it is not known or no date."""
    try:
        moment = datetime.datetime.fromtimestamp(float("nan") if time_s is None else time_s, tz=datetime.UTC)
    except (ValueError, OverflowError, OSError):
        return None
    return moment.strftime("%Y-%m-%d %H:%M")


def _named_effect_rows(findings: Iterable[Row]) -> list[Row]:
    """Return, for each effect that the diagnosis named, in how many drives of how many cars it did."""
    drives: dict[str, set[str]] = defaultdict(set)
    cars: dict[str, set[str]] = defaultdict(set)
    for row in findings:
        if row["level"] == "drive" and _is_named(row):
            drives[row["effect"]].add(row["key"])
            cars[row["effect"]].add(row["car"])
    return [{"effect": name, "drives": len(drives[name]), "cars": len(cars[name])} for name in sorted(drives)]


def drives_of_cars(row: Mapping[str, Any]) -> str:
    """Return the numbers of drives and cars of a row in words."""
    drives, cars = row["drives"], row["cars"]
    return f"{drives} drive{'s' * (drives != 1)} of {cars} car{'s' * (cars != 1)}"


def report_text(document: dict[str, Any]) -> str:
    """Return the report as lines of text."""
    lines = [
        f"{drives_of_cars(document)}: {document['distance_km']:.0f} km, {document['duration_h']:.1f} h",
        "",
    ]
    if not document["attention"]:
        lines.append("No vehicle needs attention.")
    for row in document["attention"]:
        since = f" (since {row['since']} UTC)" if row["since"] else ""
        lines.append(f"[{row['urgency']}] {row['car']}: {row['why']}{since}: {row['what_to_do']}")
    for model in document["models"]:
        lines += ["", f"model {model_title(model['model'])}: {drives_of_cars(model)}"]
        lines += [
            f"  {row['effect']} {row['parameter']}: "
            + with_unit(f"{row['value']:+.3g} +- {row['std']:.2g}", row["unit"])
            + f" (p {row['p_value']:.1g})"
            for row in model["findings"]
        ]
        lines += [f"  {row['effect']}: named in {drives_of_cars(row)}" for row in model["named_in_drives"]]
    return "\n".join(lines)
