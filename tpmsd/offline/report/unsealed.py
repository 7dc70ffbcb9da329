"""A diagnosis scored against the truth that was sealed before it.

In: the unsealed truth, the report of `tpmsd diagnose --json`, and, if at hand, that of the untouched
recording. Out: plain objects, and lines for people. A real recording has effects of its own: what the
diagnosis finds in the untouched one is neither wrong nor part of what was concealed, and its values add up
with those that were.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

SIGMAS = 1.96
"""Standard deviations to either end of a 95 % interval."""
CONFIDENT = 0.9
"""Confidence from which a name that was not concealed is plainly wrong."""
_WHEEL = ("wheel", "wheels", "on")
_BY_COURSE = {"duration_s": "course"}
"""Numbers whose meaning a word decides: how long a ramp takes, or an exponential's time constant."""


def score(
    truth: Mapping[str, Any], report: Mapping[str, Any], untouched: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return each concealed effect with the finding that names it, and the findings that name none of
    them."""
    findings = _findings_of(report)
    before = _findings_of(untouched or {})
    matched = _match_findings(truth["effects"], findings)
    own = [
        rank
        for rank, finding in enumerate(findings)
        if rank not in matched.values() and any(_same_effect_and_wheels(finding, other) for other in before)
    ]
    new = [rank for rank in range(len(findings)) if rank not in own]
    concealed = []
    for number, effect in enumerate(truth["effects"]):
        rank_found = matched.get(number)
        other = next((one for one in before if _names_effect(effect, one)), None)
        found = None if rank_found is None else findings[rank_found]
        concealed.append(
            _scored_entry(effect, found, None if rank_found is None else new.index(rank_found) + 1, other)
        )
    others = [
        _other_finding_entry(findings[rank], rank in own)
        for rank in range(len(findings))
        if rank not in matched.values()
    ]
    counted = _score_counts(concealed)
    return {
        "concealed": concealed,
        "others": others,
        "named": counted["named"],
        "missed": counted["missed"],
        "named_first": bool(new) and new[0] in matched.values(),
        "wrong": sum(one["wrong"] for one in others),
        "values": counted["values"],
        "values_within": counted["values_within"],
    }


def _match_findings(effects: list[Mapping[str, Any]], findings: list[Mapping[str, Any]]) -> dict[int, int]:
    """Return index of a concealed effect -> index of the finding that names it, each finding once."""
    matched: dict[int, int] = {}
    for number, effect in enumerate(effects):
        free = (rank for rank in range(len(findings)) if rank not in matched.values())
        rank = next((rank for rank in free if _names_effect(effect, findings[rank])), None)
        if rank is not None:
            matched[number] = rank
    return matched


def _score_counts(concealed: list[dict[str, Any]]) -> dict[str, int]:
    """Return how many effects were named and missed, and how many values lie within their intervals."""
    values = [
        value for one in concealed for value in one["parameters"].values() if value["within"] is not None
    ]
    return {
        "named": sum(one["named"] for one in concealed),
        "missed": sum(not one["named"] for one in concealed),
        "values": len(values),
        "values_within": sum(value["within"] for value in values),
    }


def _findings_of(report: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the findings of a report; empty if it has none."""
    return [one for one in report.get("findings", []) if isinstance(one, Mapping)]


def _names_effect(effect: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    """Return whether a finding names this effect, on the same wheels if the effect has any."""
    if finding.get("effect") != effect["name"]:
        return False
    wheels = [str(value) for name, value in effect["parameters"].items() if name in _WHEEL]
    return not wheels or _wheels_of(finding) in ("", wheels[0])


def _same_effect_and_wheels(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether two findings are of the same effect on the same wheels."""
    return (one.get("effect"), _wheels_of(one)) == (other.get("effect"), _wheels_of(other))


def _wheels_of(finding: Mapping[str, Any]) -> str:
    """Return the wheels of a finding as their parameter states them; empty without such a parameter."""
    parameters = finding.get("parameters") or {}
    return next((str(parameters[name].get("value")) for name in _WHEEL if name in parameters), "")


def _scored_entry(
    effect: Mapping[str, Any],
    finding: Mapping[str, Any] | None,
    rank: int | None,
    before: Mapping[str, Any] | None,
) -> dict[str, Any]:
    return {
        "effect": effect["name"],
        "named": finding is not None,
        "rank": rank,
        "status": None if finding is None else finding.get("status"),
        "confidence": None if finding is None else finding.get("confidence"),
        "untouched": before is not None,
        "parameters": {
            name: _value_entry(
                name, value, None if _different_quantity(effect, finding, name) else finding, before
            )
            for name, value in effect["parameters"].items()
            if value is not None
        },
    }


def _different_quantity(effect: Mapping[str, Any], finding: Mapping[str, Any] | None, name: str) -> bool:
    """Return whether a finding's number is another quantity than the concealed one of that name, so that the
    two are not compared. A word that a finding leaves out is the usual one."""
    word = _BY_COURSE.get(name, "")
    concealed, found = effect["parameters"].get(word), _text_value(finding, word)
    return concealed is not None and found is not None and concealed != found


def _value_entry(
    name: str, true: Any, finding: Mapping[str, Any] | None, before: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Return a concealed value beside the one that was found; `within`: in its 95 % interval, null where not
    asked.

    A value that the untouched recording has of its own is added to the concealed one, with its uncertainty.
    """
    found, std = _value_and_std(finding, name)
    own, own_std = _value_and_std(before, name)
    within = None
    if isinstance(true, (int, float)) and found is not None and std is not None and std > 0.0:
        sum_of_both = true + _minus_neutral(name, own)
        within = abs(found - sum_of_both) <= SIGMAS * math.hypot(std, own_std or 0.0)
    shown = found if found is not None else _text_value(finding, name)
    return {"concealed": true, "found": shown, "std": std, "untouched": own, "within": within}


def _minus_neutral(name: str, value: float | None) -> float:
    """Return a value minus that at which its effect does nothing; 0 for None."""
    if value is None:
        return 0.0
    return value - 1.0 if name == "scale" else value


def _value_and_std(finding: Mapping[str, Any] | None, name: str) -> tuple[float | None, float | None]:
    """Return a parameter of a finding with its standard deviation; None for each that it lacks."""
    quantity = ((finding or {}).get("parameters") or {}).get(name) or {}
    value, std = quantity.get("value"), quantity.get("std")
    return (
        float(value) if isinstance(value, (int, float)) else None,
        float(std) if isinstance(std, (int, float)) else None,
    )


def _text_value(finding: Mapping[str, Any] | None, name: str) -> str | None:
    """Return a parameter of a finding that is a word; None if it is a number or missing."""
    quantity = ((finding or {}).get("parameters") or {}).get(name) or {}
    value = quantity.get("value")
    return value if isinstance(value, str) else None


def _other_finding_entry(finding: Mapping[str, Any], own: bool) -> dict[str, Any]:
    confidence = finding.get("confidence")
    confident = isinstance(confidence, (int, float)) and confidence > CONFIDENT
    wrong = not own and confident and finding.get("status", "finding") == "finding"
    return {
        "effect": finding.get("effect"),
        "status": finding.get("status"),
        "confidence": confidence,
        "untouched": own,
        "wrong": wrong,
    }


def unsealed_summary(document: Mapping[str, Any], untouched_known: bool = True) -> str:
    """Return the score in lines for people.

    Without the report of the untouched recording a last line says how to distinguish what it holds itself.
    """
    lines = [f"sealed truth {document['sha256']}"]
    for one in document["concealed"]:
        lines.append(f"  {one['effect']}: " + (_found_words(one) if one["named"] else "missed"))
        lines += [f"      {_compared_text(name, value)}" for name, value in one["parameters"].items()]
    for one in document["others"]:
        why = "in the untouched recording, too" if one["untouched"] else "was not concealed"
        lines.append(f"  {one['effect']} (confidence {_short(one['confidence'])}): {why}")
    count = document["named"] + document["missed"]
    lines.append(
        f"{document['named']} of {count} named, {document['missed']} missed,"
        f" {document['wrong']} wrong above {CONFIDENT:g};"
        f" {document['values_within']} of {document['values']} values in their 95 % interval"
    )
    if document["others"] and not untouched_known:
        lines.append(
            "A recording may hold effects of its own: diagnose it untouched,"
            " and give that report with --untouched"
        )
    return "\n".join(lines)


def _found_words(one: Mapping[str, Any]) -> str:
    """Return how a hidden effect was found: its rank among the findings and its confidence."""
    status = "" if one["status"] in (None, "finding") else f", a {one['status']}"
    return f"named, rank {one['rank']}, confidence {_short(one['confidence'])}{status}"


def _compared_text(name: str, value: Mapping[str, Any]) -> str:
    text = f"{name} = {_short(value['concealed'])}"
    if value["found"] is None:
        return text
    std = "" if value["std"] is None else f" +- {value['std']:.1g}"
    text += f", found {_short(value['found'])}{std}"
    if value["untouched"] is not None:
        text += f" (of its own the recording has {_short(value['untouched'])})"
    if value["within"] is None:
        return text
    return text + ("" if value["within"] else ": outside of the 95 % interval")


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, (int, float)) else str(value)
