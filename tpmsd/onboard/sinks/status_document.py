"""The daemon's status as one JSON document, for `tpmsd status` and for other programs.

In: the last `MonitorReport` and `RadiusEstimate`, the health of loop and sources, and the resonances if they
are listened to. Out: a dictionary of plain JSON types; numbers nobody knows are null. Lengths are in mm, as
in the report of `tpmsd replay --json`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from tpmsd.car.vehicle_state.record import VehicleState
from tpmsd.foundation.plain import finite, millimetres
from tpmsd.foundation.version import __version__
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.estimators.base import RadiusEstimate, RadiusStatement
from tpmsd.onboard.monitor.evidence.detectable import DetectableLoss
from tpmsd.onboard.monitor.records import (
    AlarmKind,
    LearningReport,
    MonitorReport,
    WheelReport,
    WheelState,
)
from tpmsd.onboard.resonance.watch import ResonanceStatus
from tpmsd.onboard.sinks.alarm_entry import alarm_entry
from tpmsd.onboard.sinks.status_version import DOCUMENT_VERSION


class SourceState(StrEnum):
    """State of an input in the status document: the bus, or the receiver."""

    OFF = "off"
    """Input that is not configured."""
    WAITING = "waiting"
    """Open, but nothing usable has come yet."""
    OK = "ok"
    SILENT = "silent"
    """Open, but what came before has stopped."""
    DOWN = "down"
    """Input that is gone or cannot be opened; tried again with back-off."""


@dataclass(frozen=True, slots=True)
class SourceHealth:
    """One input: the bus or the receiver."""

    state: SourceState
    name: str = ""
    """Name of the channel or device."""
    received: int = 0
    """Number of frames of the bus, or fixes of the receiver."""
    faults: Mapping[str, int] = field(default_factory=dict)
    """Count by kind (`SourceFault.kind`), since the start."""
    age_s: float = math.nan
    """Time since the last frame or fix."""
    detail: str = ""
    """Reason for which it does not work, in a few words."""
    faults_last_minute: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class LoopHealth:
    """Seconds, ticks and late ticks of the daemon's event loop since it started."""

    uptime_s: float
    ticks: int
    missed_deadlines: int


def build_status(
    report: MonitorReport | None,
    *,
    loop: LoopHealth,
    can: SourceHealth,
    gnss: SourceHealth,
    estimate: RadiusEstimate | None = None,
    method: str = "",
    resonance: Sequence[ResonanceStatus] | None = None,
    last_known: Mapping[str, tuple[float, WheelReport]] | None = None,
    vehicle_state: tuple[str, VehicleState | None] | None = None,
    vehicle_name: str | None = None,
) -> dict[str, Any]:
    """Return the document; `report` and `estimate` are None until the first tick.

    `last_known`: of each wheel its last report with a change, and the time of that.
    `resonance`: of each wheel in the order of WHEELS; None where nobody listens.
    `vehicle_state`: method and last state; without it the document has no such key.
    `vehicle_name`: of the configuration; the document has `vehicle` where there is one.
    """
    document = {
        "version": DOCUMENT_VERSION,
        "tpmsd": __version__,
        "time": None if report is None else finite(report.time_s),
        "uptime_s": finite(loop.uptime_s),
        "ticks": loop.ticks,
        "missed_deadlines": loop.missed_deadlines,
        "learning_fraction": None if report is None else finite(report.learning_fraction),
        "baseline": None if report is None or report.learning is None else _baseline_entry(report.learning),
        "can": {**_source_entry(can, "channel"), "frames": can.received},
        "gnss": {**_source_entry(gnss, "device"), "fixes": gnss.received},
        "wheels": {}
        if report is None
        else {
            wheel.wheel: _wheel_entry(wheel)
            | _last_change_entry(report.time_s, (last_known or {}).get(wheel.wheel))
            for wheel in report.wheels
        },
        "watch": None if report is None else _watch_entry(report),
        "resonance": None if resonance is None else _resonance_entries(report, resonance),
        "alarms": [] if report is None else [alarm_entry(alarm) for alarm in report.active],
        "estimator": None if estimate is None else _estimator_entry(estimate, method),
    }
    if vehicle_name is not None:
        document["vehicle"] = {"name": vehicle_name}
    if vehicle_state is not None:
        document["vehicle_state"] = state_entry(*vehicle_state)
    return document


def state_entry(method: str, state: VehicleState | None) -> dict[str, Any]:
    """Return the vehicle state as plain numbers, null where it is not known."""
    values = [math.nan] * len(VehicleState._fields) if state is None else state
    entry = {name: finite(value) for name, value in zip(VehicleState._fields, values, strict=True)}
    return {"method": method, **entry}


def _source_entry(source: SourceHealth, name_key: str) -> dict[str, Any]:
    return {
        "state": str(source.state),
        name_key: source.name,
        "faults": dict(source.faults),
        "faults_last_minute": dict(source.faults_last_minute),
        "age_s": finite(source.age_s),
        "detail": source.detail,
    }


ALL_FOUR = (
    "the receiver alone: a loss of all four tyres is seen against its speed; "
    "a receiver whose speed is scaled slowly looks like one, or hides one"
)


def _watch_entry(report: MonitorReport) -> dict[str, Any]:
    """Return the entry of the watched wheels, of the others with the reason, and of the means by which a loss
    of all four is detected."""
    malfunctions = [alarm for alarm in report.active if alarm.kind is AlarmKind.MALFUNCTION]
    not_watched = {}
    for wheel in report.wheels:
        if wheel.state is WheelState.LEARNING:
            not_watched[wheel.wheel] = "its normal radius is being learned"
        elif wheel.state is WheelState.UNAVAILABLE:
            of_it = [alarm.reason for alarm in malfunctions if alarm.wheel == wheel.wheel]
            of_all = [alarm.reason for alarm in malfunctions if alarm.wheel is None]
            not_watched[wheel.wheel] = (of_it + of_all + ["there is no signal of it"])[0]
    watched = [wheel.wheel for wheel in report.wheels if wheel.wheel not in not_watched]
    return {
        "watched": watched,
        "not_watched": not_watched,
        "all_four_rest_on": ALL_FOUR,
        **_detectable_entry(report.detectable),
        "questions": [question.entry() for question in report.questions],
    }


LOW = 0.2
"""Share of the pressure: the loss that is to be seen (UN R141)."""


def _detectable_entry(detectable: DetectableLoss | None) -> dict[str, Any]:
    """Return the smallest losses that are detectable now, and in words those of 20 % that are not."""
    if detectable is None:
        return {"smallest_loss_percent": None, "cannot_see": []}
    losses = {
        "one tyre": detectable.one_tyre,
        "both tyres of an axle": detectable.one_axle,
        "all tyres alike": detectable.all_tyres,
    }
    cannot_see = [
        f"a loss of 20 % of the pressure of {what}"
        + ("" if least >= 1.0 else f" (seen from {100.0 * least:.0f} % on)")
        for what, least in losses.items()
        if least > LOW
    ]
    percent = {what.replace(" ", "_"): finite(100.0 * least) for what, least in losses.items()}
    return {"smallest_loss_percent": percent, "cannot_see": cannot_see}


def _resonance_entries(report: MonitorReport | None, resonance: Sequence[ResonanceStatus]) -> dict[str, Any]:
    """Return the resonance entries of the wheels that the bus has."""
    watched = [] if report is None else [wheel.wheel for wheel in report.wheels]
    return {name: status.to_json() for name, status in zip(WHEELS, resonance, strict=True) if name in watched}


def _wheel_entry(wheel: WheelReport) -> dict[str, Any]:
    return {
        "state": str(wheel.state),
        "deviation_mm": millimetres(wheel.deviation_m),
        "std_mm": millimetres(wheel.std_m),
        "change_mm": millimetres(wheel.change_m),
        "change_std_mm": millimetres(wheel.change_std_m),
        "deflation_probability": finite(wheel.deflation_probability),
        "deviation_probability": finite(wheel.deviation_probability),
        "pressure_loss_percent": finite(100.0 * wheel.pressure_loss),
        "pressure_loss_std_percent": finite(100.0 * wheel.pressure_loss_std),
    }


def _last_change_entry(time_s: float, last: tuple[float, WheelReport] | None) -> dict[str, Any]:
    """Return the last known change of a wheel with its age; nulls if there was none."""
    if last is None:
        return {"last_change_mm": None, "last_change_std_mm": None, "last_change_age_s": None}
    return {
        "last_change_mm": millimetres(last[1].change_m),
        "last_change_std_mm": millimetres(last[1].change_std_m),
        "last_change_age_s": finite(max(0.0, time_s - last[0])),
    }


def _baseline_entry(learning: LearningReport) -> dict[str, Any]:
    return {
        "tyres": learning.tyres,
        "sets": list(learning.sets),
        "learned_s": finite(learning.learned_s),
        "samples_by_kmh": {str(kmh): samples for kmh, samples in learning.samples_by_kmh},
        "reset": learning.reset,
        "reset_reason": learning.reset_reason,
        "resets": learning.resets,
    }


def _estimator_entry(estimate: RadiusEstimate, method: str) -> dict[str, Any]:
    return {
        "method": method,
        "informative": bool(estimate.informative),
        "informative_s": finite(estimate.informative_s),
        "speed_mps": finite(estimate.speed_mps),
        "position_std_m": finite(estimate.position_std_m),
        "gnss_age_s": finite(estimate.gnss_age_s),
        "effective_particles": finite(estimate.effective_particles),
        "ancestors": finite(estimate.ancestors),
        "between_std_mm": millimetres(estimate.between_std_m),
        **_stated_entry(estimate.stated),
    }


def _stated_entry(stated: RadiusStatement | None) -> dict[str, Any]:
    """Return the radii under the hypothesis of no recent change (or of one, where that is likelier), and the
    probability of a change."""
    if stated is None:
        return {}
    std = [math.sqrt(max(variance, 0.0)) for variance in stated.covariance_m2.diagonal().tolist()]
    rows = zip(WHEELS, stated.mean_m.tolist(), std, strict=True)
    return {
        "change_probability": finite(stated.change_probability),
        "stated": {
            wheel: {"deviation_mm": millimetres(off_m), "std_mm": millimetres(std_m)}
            for wheel, off_m, std_m in rows
        },
    }
