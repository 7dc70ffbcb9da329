"""A status document as Prometheus metrics.

In: a document, or None where the daemon does not answer. Out: metric families by name, kind and help, with
base units (metres, seconds, ratios), as Prometheus and OpenTelemetry name them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from tpmsd.foundation.plain import number
from tpmsd.interfaces.bridges.summary import summarise

WHEEL_STATES = ("unavailable", "learning", "monitoring", "alarm")
ALARM_KINDS = ("radius_deviation", "deflation", "slow_leak", "malfunction")
_MAX_KINDS = 50
"""Number of kinds of faults that are exposed: a document must not make series without end."""


@dataclass(slots=True)
class Family:
    """One metric with its series."""

    name: str
    kind: str
    """gauge | counter; the name of a counter has no _total here."""
    help: str
    labels: tuple[str, ...] = ()
    samples: list[tuple[tuple[str, ...], float]] = field(default_factory=list)

    def add(self, value: object, *labels: str) -> None:
        """Add a sample with its labels; left out where the value is not a finite number."""
        if (known := number(value)) is not None:
            self.samples.append((labels, known))


def families(document: Mapping[str, Any] | None) -> Iterator[Family]:
    """Yield all metric families of a document; without a document `tpmsd_up` alone."""
    up = Family("tpmsd_up", "gauge", "1 if the daemon answers on its socket")
    up.add(0 if document is None else 1)
    yield up
    if document is None:
        return
    summary = summarise(document)
    info = Family("tpmsd_build_info", "gauge", "Version of the daemon", ("version",))
    info.add(1, summary.version)
    yield info
    yield from _wheel_metrics(document)
    alarms = Family("tpmsd_alarm_active", "gauge", "1 while an alarm is active", ("kind", "wheel"))
    active = {(alarm.kind, alarm.wheel or "all") for alarm in summary.alarms}
    for wheel in summary.wheels:
        for kind in ALARM_KINDS[:3]:
            alarms.add(int((kind, wheel.name) in active), kind, wheel.name)
            active.discard((kind, wheel.name))
    active_malfunction = ("malfunction", "all")
    alarms.samples.append((active_malfunction, float(summary.malfunction)))
    alarms.samples += [(key, 1.0) for key in sorted(active - {active_malfunction})[:_MAX_KINDS]]
    yield alarms
    yield from _source_metrics(document)
    for name, kind, text, key in (
        ("tpmsd_uptime_seconds", "gauge", "Time since the daemon's start", "uptime_s"),
        ("tpmsd_ticks", "counter", "Ticks of the estimator", "ticks"),
        ("tpmsd_missed_deadlines", "counter", "Ticks that came too late", "missed_deadlines"),
        ("tpmsd_learning_ratio", "gauge", "How much of the baseline is learned", "learning_fraction"),
    ):
        family = Family(name, kind, text)
        family.add(document.get(key))
        yield family
    speed = Family("tpmsd_vehicle_speed_meters_per_second", "gauge", "Speed as estimated")
    speed.add(_table_or_empty(document, "estimator").get("speed_mps"))
    yield speed


def _wheel_metrics(document: Mapping[str, Any]) -> Iterator[Family]:
    wheels = {
        name: value for name, value in _table_or_empty(document, "wheels").items() if isinstance(value, dict)
    }
    for name, text, key, factor in (
        ("tpmsd_wheel_radius_deviation_meters", "Radius minus nominal", "deviation_mm", 1e-3),
        ("tpmsd_wheel_radius_deviation_std_meters", "Its standard deviation", "std_mm", 1e-3),
        ("tpmsd_wheel_radius_change_meters", "Radius minus baseline", "change_mm", 1e-3),
        (
            "tpmsd_wheel_pressure_loss_ratio",
            "Share of the pressure that is missing",
            "pressure_loss_percent",
            1e-2,
        ),
        (
            "tpmsd_wheel_deflation_probability_ratio",
            "Probability of a deflation",
            "deflation_probability",
            1.0,
        ),
    ):
        family = Family(name, "gauge", text, ("wheel",))
        for wheel, values in wheels.items():
            if (value := number(values.get(key))) is not None:
                family.add(factor * value, wheel)
        yield family
    states = Family("tpmsd_wheel_state", "gauge", "1 for the state a wheel is in", ("wheel", "state"))
    for wheel, values in wheels.items():
        for state in WHEEL_STATES:
            states.add(int(values.get("state") == state), wheel, state)
    yield states


def _source_metrics(document: Mapping[str, Any]) -> Iterator[Family]:
    up = Family("tpmsd_source_up", "gauge", "1 while bus or receiver gives data", ("source",))
    age = Family("tpmsd_source_age_seconds", "gauge", "Time since the last frame or fix", ("source",))
    received = Family(
        "tpmsd_source_received", "counter", "Frames of the bus, fixes of the receiver", ("source",)
    )
    faults = Family("tpmsd_source_faults", "counter", "Faults of an input by kind", ("source", "kind"))
    for source, count in (("can", "frames"), ("gnss", "fixes")):
        part = _table_or_empty(document, source)
        if part.get("state") == "off":
            continue
        up.add(int(part.get("state") == "ok"), source)
        age.add(part.get("age_s"), source)
        received.add(part.get(count), source)
        for kind, number_of in list(_table_or_empty(part, "faults").items())[:_MAX_KINDS]:
            faults.add(number_of, source, str(kind)[:50])
    yield from (up, age, received, faults)


def _table_or_empty(document: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = document.get(key)
    return value if isinstance(value, dict) else {}
