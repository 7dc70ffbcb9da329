"""Summary of a status document for other systems, in one shape.

In: a document as the status socket gives it, from this version of tpmsd or a later one. Out: `DaemonSummary`.
What a document does not say, or says in a form that is not known, is None; nothing here raises.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tpmsd.foundation.plain import number
from tpmsd.foundation.wheels import WHEELS

MALFUNCTION = "malfunction"
NOT_WELL = ("down", "silent", "waiting")


@dataclass(frozen=True, slots=True)
class Alarm:
    """Standing alarm of the status document, with its wheel, host time (s) and deviation (mm)."""

    kind: str
    wheel: str | None
    time_s: float | None
    """Host time at which it was raised, s."""
    deviation_mm: float | None = None
    reason: str = ""

    @property
    def key(self) -> str:
        """Return the key of an alarm, equal in every document: kind, wheel and instant."""
        instant = "0" if self.time_s is None else f"{self.time_s:.3f}"
        return f"{self.kind}:{self.wheel or 'all'}:{instant}"


@dataclass(frozen=True, slots=True)
class WheelSummary:
    """State of one wheel in the status document, with deviation and change of its radius (mm)."""

    name: str
    state: str
    problem: bool
    """True if an alarm concerns it."""
    deviation_mm: float | None
    std_mm: float | None
    change_mm: float | None
    deflation_probability: float | None
    pressure_loss_percent: float | None


@dataclass(frozen=True, slots=True)
class DaemonSummary:
    """The daemon at one instant."""

    version: str
    ready: bool
    """True if the daemon has made a tick; before that it does not state which alarms are active."""
    wheels: tuple[WheelSummary, ...]
    alarms: tuple[Alarm, ...]
    malfunction: bool
    can: str
    gnss: str

    @property
    def health(self) -> str:
        """Return `ok`, or the first fault in a word or two: `malfunction`, `bus STATE`, `receiver STATE`, `no
        wheel`."""
        if self.malfunction:
            return MALFUNCTION
        for name, state in (("bus", self.can), ("receiver", self.gnss)):
            if state in NOT_WELL:
                return f"{name} {state}"
        return "ok" if any(wheel.state != "unavailable" for wheel in self.wheels) else "no wheel"


def summarise(document: Mapping[str, Any]) -> DaemonSummary:
    """Return the summary of a document."""
    raw = document.get("alarms")
    alarms = tuple(_alarm_of(one) for one in raw if isinstance(one, dict)) if isinstance(raw, list) else ()
    concerned = {name for alarm in alarms for name in _affected_wheels(alarm)}
    wheels = _mapping_or_empty(document.get("wheels"))
    return DaemonSummary(
        version=_text_or_default(document.get("tpmsd"), "unknown"),
        ready=number(document.get("time")) is not None,
        wheels=tuple(
            _wheel_summary(name, _mapping_or_empty(wheels[name]), name in concerned)
            for name in WHEELS
            if name in wheels
        ),
        alarms=alarms,
        malfunction=any(alarm.kind == MALFUNCTION for alarm in alarms),
        can=_text_or_default(_mapping_or_empty(document.get("can")).get("state"), "unknown"),
        gnss=_text_or_default(_mapping_or_empty(document.get("gnss")).get("state"), "unknown"),
    )


def _alarm_of(raw: Mapping[str, Any]) -> Alarm:
    wheel = raw.get("wheel")
    return Alarm(
        kind=_text_or_default(raw.get("kind"), "unknown"),
        wheel=wheel if wheel in WHEELS else None,
        time_s=number(raw.get("time")),
        deviation_mm=number(raw.get("deviation_mm")),
        reason=_text_or_default(raw.get("reason"), ""),
    )


def _affected_wheels(alarm: Alarm) -> tuple[str, ...]:
    """Return the wheels of an alarm: all for one without a wheel, none for a malfunction of tpmsd."""
    if alarm.wheel is not None:
        return (alarm.wheel,)
    return () if alarm.kind == MALFUNCTION else WHEELS


def _wheel_summary(name: str, raw: Mapping[str, Any], concerned: bool) -> WheelSummary:
    return WheelSummary(
        name=name,
        state=_text_or_default(raw.get("state"), "unavailable"),
        problem=concerned,
        deviation_mm=number(raw.get("deviation_mm")),
        std_mm=number(raw.get("std_mm")),
        change_mm=number(raw.get("change_mm")),
        deflation_probability=number(raw.get("deflation_probability")),
        pressure_loss_percent=number(raw.get("pressure_loss_percent")),
    )


def _mapping_or_empty(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _text_or_default(value: object, default: str) -> str:
    return value[:200] if isinstance(value, str) and value else default
