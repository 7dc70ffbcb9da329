"""The document of `tpmsd explain` as lines for people.

In: the document, a time zone. Out: text. Times of a drive count from its start, those of a daemon are local.
Numbers that nobody knows are shown as `-`.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, tzinfo
from typing import Any

_NAMES = {
    "receiver_all_wheels": "all wheels against the receiver",
    "front_minus_rear": "front against rear",
    "fl_minus_fr": "fl against fr",
    "rl_minus_rr": "rl against rr",
}
SHOWN = 6
"""Moments of evidence that are shown; the JSON holds all."""


def explanation_text(document: Mapping[str, Any], zone: tzinfo | None = None) -> str:
    """Return the whole explanation, ending with a line break; `zone` None: the time zone of this machine."""
    lines: list[str] = []
    start_s = document.get("start_time")
    raised = [alarm for alarm in document["alarms"] if alarm["state"] == "raised"]
    for alarm in document["alarms"]:
        lines += _alarm_lines(alarm, start_s, zone)
    if not raised:
        lines += ["No alarm was raised.", ""]
    lines.append("Each wheel now:")
    for name, wheel in document["wheels"].items():
        lines.append(f"  {name} {wheel['state']}: {wheel['why_no_alarm']}")
        if wheel.get("smallest_loss_seen_mm") is not None:
            lines.append(f"     a loss of {wheel['smallest_loss_seen_mm']:.2f} mm and more would be seen")
    if document["why_no_alarm"]:
        lines += ["", "What is missing:", *(f"  {line}" for line in document["why_no_alarm"])]
    if document["alternatives"]:
        lines += [
            "",
            "What may have happened, by what is known now:",
            *_alternative_lines(document["alternatives"]),
        ]
    if document.get("would_change"):
        lines += ["", "What would change this:", *(f"  {line}" for line in document["would_change"])]
    return "\n".join(lines) + "\n"


def _alarm_lines(alarm: Mapping[str, Any], start_s: float | None, zone: tzinfo | None) -> list[str]:
    """Return an alarm as text: when and why, its evidence, its alternatives, and when it clears."""
    when = _time_text(alarm["time"], start_s, zone)
    wheel = f" {alarm['wheel']}" if alarm["wheel"] else ""
    since = f" (since {alarm['since']})" if alarm.get("since") else ""
    lines = [f"{when} {alarm['kind']}{wheel} {alarm['state']}{since}: {alarm['reason']}"]
    clears = [f"  It clears when {alarm['clears_when']}."] if alarm["state"] == "raised" else []
    if alarm["kind"] in ("malfunction", "slow_leak"):
        return [*lines, *clears, ""]
    if alarm["before_mm"] is not None:
        lines.append(f"  The radius before: {alarm['before_mm']:+.2f} mm from nominal.")
    lines.append("  Evidence (change in mm, and the log-likelihood gain of each contrast for the best loss):")
    for moment in alarm["evidence"][-SHOWN:]:
        parts = [
            f"{_NAMES[name]} {_contrast_text(contrast)}"
            for name, contrast in moment["evidence_by_source"].items()
            if name in _NAMES and contrast is not None
        ]
        lines.append(f"    {_time_text(moment['time'], start_s, zone)} {'; '.join(parts)}")
    lines += [
        "  Alternatives, by probability:",
        *(f"  {line}" for line in _alternative_lines(alarm["alternatives"])),
    ]
    return [*lines, *clears, ""]


def _alternative_lines(entries: list[dict[str, Any]]) -> list[str]:
    return [f"  {entry['probability']:8.4f}  {entry['what']}: {entry['why']}" for entry in entries]


def _contrast_text(contrast: Mapping[str, Any]) -> str:
    if contrast["change_mm"] is None or contrast["std_mm"] is None:
        return "-"
    adds = f" ({contrast['gain_nats']:+.1f} nats)" if contrast.get("gain_nats") is not None else ""
    return f"{contrast['change_mm']:+.2f} +- {contrast['std_mm']:.2f}{adds}"


def _time_text(time_s: float | None, start_s: float | None, zone: tzinfo | None) -> str:
    """Return minutes and seconds from the start of a drive, or date and time of day without a start."""
    if time_s is None:
        return "-"
    if start_s is None:
        return datetime.fromtimestamp(time_s, zone).strftime("%Y-%m-%d %H:%M:%S")
    minutes, seconds = divmod(round(10.0 * (time_s - start_s)), 600)
    return f"{minutes}:{seconds / 10.0:04.1f}"
