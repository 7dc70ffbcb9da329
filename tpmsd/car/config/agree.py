"""Agreement of settings with each other, beyond each value's own rule.

In: the values that passed their rules. Out: problems, handed to a `Reporter`, and the vehicle's record.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any, Protocol

from tpmsd.car.config.dynamics import RADIUS
from tpmsd.car.config.model import (
    AlarmsConfig,
    GnssConfig,
    MonitorConfig,
    ObdConfig,
    TyreConfig,
    VehicleConfig,
    VehicleStateConfig,
)
from tpmsd.car.config.problems import BadValueError, show
from tpmsd.car.config.suggest import nearest
from tpmsd.car.config.vehicle_state import missing_keys
from tpmsd.foundation.wheels import WHEELS

FRONT, REAR = WHEELS[:2], WHEELS[2:]
_STANDARD_ID_LIMIT = 0x7FF
# Rear wheels alone need no wheelbase; the record holds a usual one, so that no arithmetic meets a NaN.
_WHEELBASE_UNUSED_M = 2.7


class Reporter(Protocol):
    """Takes a problem of a key in a table; `inside` are steps from the key to a place within its value."""

    def __call__(self, bad: BadValueError, table: str, key: str = "", *inside: str) -> None:
        """Note the problem at the key's line, or at the table's where there is no such key."""


def monitored_wheels(roles: Collection[str], report: Reporter) -> tuple[str, ...]:
    """Return the wheels that have a signal; report if they are neither all four nor the rear pair."""
    table = "can.signals"
    sources: dict[str, list[str]] = {
        wheel: [role for role in (f"wheel_count_{wheel}", f"wheel_speed_{wheel}") if role in roles]
        for wheel in WHEELS
    }
    for found in sources.values():
        if len(found) == 2:
            report(
                BadValueError(f"the wheel has {found[0]} already", allowed="one of the two"), table, found[1]
            )
    wheels = tuple(wheel for wheel in WHEELS if sources[wheel])
    if not wheels:
        needed = "wheel_count_* or wheel_speed_* of all four wheels, or of rl and rr alone"
        report(BadValueError("no wheel signals", allowed=needed), table)
        return ()
    family = sources[wheels[0]][0].removesuffix(wheels[0])
    for wheel in WHEELS:
        if not sources[wheel] and (wheel in REAR or any(front in wheels for front in FRONT)):
            missing = BadValueError(
                "missing", f"signals of {' '.join(wheels)}", "all four wheels, or rl and rr alone"
            )
            report(missing, table, f"{family}{wheel}")
    return wheels


def make_vehicle(
    raw: Mapping[str, Any],
    good: Mapping[str, Any],
    given: Collection[str],
    wheels: tuple[str, ...],
    steered: bool,
    report: Reporter,
) -> VehicleConfig | None:
    """Return the vehicle's record; None if something was reported.

    `good` are the values that passed their rules, `given` the keys that are there at all, `wheels` those that
    have a signal and `steered` says that the steering wheel's angle has one.
    """
    radii = _wheel_radii(raw, given, wheels, report)
    values = {key: value for key, value in good.items() if key != "wheel_radius_m"}
    tracks = {"track_front_m", "track_rear_m"}
    if not tracks & set(given):
        report(
            BadValueError("missing", allowed="metres; track_front_m alone will do"), "vehicle", "track_rear_m"
        )
    for one, other in (("track_front_m", "track_rear_m"), ("track_rear_m", "track_front_m")):
        if one not in given and other in values:
            values[one] = values[other]
    if "wheelbase_m" not in given:
        if steered or any(wheel in FRONT for wheel in wheels):
            reason = "the front wheels are monitored" if not steered else "the steering wheel's angle is used"
            report(BadValueError(f"missing, and {reason}", allowed="metres"), "vehicle", "wheelbase_m")
        values["wheelbase_m"] = _WHEELBASE_UNUSED_M
    if radii is None or not (tracks | {"wheelbase_m"} <= values.keys()):
        return None
    return VehicleConfig(wheel_radius_m=radii, **values)


def _wheel_radii(
    raw: Mapping[str, Any], given: Collection[str], wheels: tuple[str, ...], report: Reporter
) -> tuple[float, float, float, float] | None:
    """Return the nominal radii (m) of the four wheels; None if something was reported."""
    key = "wheel_radius_m"
    if key not in raw:
        if key not in given:
            report(
                BadValueError("missing", allowed=f"{RADIUS.allowed}, or {{ fl, fr, rl, rr }}"), "vehicle", key
            )
        return None
    value = raw[key]
    if not isinstance(value, dict):
        radius = _read_or_report(lambda: _one_radius(value), report, key)
        return None if radius is None else (radius, radius, radius, radius)
    return _radii_by_wheel(value, wheels, report)


def _radii_by_wheel(
    value: Mapping[str, Any], wheels: tuple[str, ...], report: Reporter
) -> tuple[float, float, float, float] | None:
    """Return the nominal radii (m) of a table by wheel; None if something was reported."""
    key = "wheel_radius_m"
    for wheel in value:
        if wheel not in WHEELS:
            bad = BadValueError("no such wheel", show(wheel), " ".join(WHEELS), nearest(wheel, WHEELS))
            report(bad, "vehicle", key, wheel)
    needed = [wheel for wheel in WHEELS if wheel in REAR or wheel in wheels]
    if missing := [wheel for wheel in needed if wheel not in value]:
        report(
            BadValueError(f"no radius of {' '.join(missing)}", allowed="all wheels that have a signal"),
            "vehicle",
            key,
        )
    radii = {
        wheel: _read_or_report(lambda wheel=wheel: RADIUS.read(value[wheel]), report, key, wheel)  # type: ignore[misc]
        for wheel in WHEELS
        if wheel in value
    }
    read = [radius for radius in radii.values() if radius is not None]
    if missing or len(read) != len(radii):
        return None
    # A wheel that nobody monitors gets the mean of the others: a number that never matters.
    filled = [radii.get(wheel) or sum(read) / len(read) for wheel in WHEELS]
    return filled[0], filled[1], filled[2], filled[3]


def _one_radius(value: object) -> float:
    """Return the nominal radius (m) that all wheels share; BadValueError if the value is none."""
    if isinstance(value, list):
        raise BadValueError(
            "not a number", show(value), f"{RADIUS.allowed}, or {{ fl = , fr = , rl = , rr = }}"
        )
    return RADIUS.read(value)


def _read_or_report(read: Callable[[], float], report: Reporter, key: str, *inside: str) -> float | None:
    """Return the value read; None after its error was reported."""
    try:
        return read()
    except BadValueError as bad:
        report(bad, "vehicle", key, *inside)
        return None


def check_monitor(settings: MonitorConfig, given: Collection[str], report: Reporter) -> None:
    """Report alarms that do not clear below the probability at which they are raised."""
    if settings.clear_probability >= settings.raise_probability:
        key = "clear_probability" if "clear_probability" in given else "raise_probability"
        found = f"clear {settings.clear_probability:g}, raise {settings.raise_probability:g}"
        report(
            BadValueError("alarms would flicker", found, "clear_probability below raise_probability"),
            "monitor",
            key,
        )


_POSITION_ROLES = ("gnss_latitude", "gnss_longitude")


def with_fixes_on_can(settings: GnssConfig, roles: Collection[str]) -> GnssConfig:
    """Return the settings with the position on the bus as source of fixes, if no source is named."""
    named = settings.source is not None or settings.device is not None
    return settings if named or not set(_POSITION_ROLES) <= set(roles) else replace(settings, source="can")


def check_gnss(settings: GnssConfig, roles: Collection[str], report: Reporter) -> None:
    """Report contradictions in [gnss]: two sources of fixes, or fixes on CAN without signals of a
    position."""
    if settings.source is None:
        return
    if settings.device is not None:
        both = BadValueError("given as well as device", show(settings.source), "one of the two")
        report(both, "gnss", "source")
    missing = [role for role in _POSITION_ROLES if role not in roles]
    if settings.source == "can" and missing:
        needed = BadValueError(f"no signal of {' '.join(missing)}", show("can"), "both in [can.signals]")
        report(needed, "gnss", "source")


def check_obd(
    settings: ObdConfig, allowed_ids: Collection[int], buses: Collection[str], report: Reporter
) -> None:
    """Report a bus that does not exist, and a request whose identifier is not allowed to be sent."""
    if settings.bus is not None and settings.bus not in buses:
        known = " ".join(buses) or "an entry of [can.buses]"
        report(BadValueError("no such bus", show(settings.bus), known), "obd", "bus")
    if settings.speed and settings.request_id not in allowed_ids:
        needed = f"output_ids = [0x{settings.request_id:X}] in [can], the list of what may be sent"
        bad = BadValueError(f"0x{settings.request_id:X}, which asks the car, may not be sent", allowed=needed)
        report(bad, "obd", "speed")


def check_tyre(settings: TyreConfig, given: Collection[str], report: Reporter) -> None:
    """Report a measured curve without as many radii as pressures."""
    pressures, radii = len(settings.curve_pressure_percent), len(settings.curve_radius_mm)
    if pressures != radii:
        key = "curve_radius_mm" if "curve_radius_mm" in given else "curve_pressure_percent"
        found = f"{pressures} pressures, {radii} radii"
        report(BadValueError("the two lists of the curve differ in length", found, "as many"), "tyre", key)


def check_alarms(settings: AlarmsConfig, given: Collection[str], report: Reporter) -> None:
    """Report identifiers that are equal or do not fit their format."""
    limit = 0x1FFF_FFFF if settings.extended_ids else _STANDARD_ID_LIMIT
    for key in ("status_id", "alarm_id", "reset_id"):
        value: int | None = getattr(settings, key)
        if value is not None and value > limit:
            allowed = f"0x0 to 0x{limit:X}, or extended_ids = true"
            report(
                BadValueError("out of range of 11-bit identifiers", f"0x{value:X}", allowed), "alarms", key
            )
    if settings.reset_id in (settings.status_id, settings.alarm_id):
        report(BadValueError("taken by tpmsd's own frames", f"0x{settings.reset_id:X}"), "alarms", "reset_id")
    if settings.status_id == settings.alarm_id:
        key = "alarm_id" if "alarm_id" in given else "status_id"
        report(
            BadValueError("status_id and alarm_id are the same", f"0x{settings.alarm_id:X}"), "alarms", key
        )


def check_vehicle_state_settings(
    settings: VehicleStateConfig, given: Mapping[str, Collection[str]], report: Reporter
) -> None:
    """Report a filter of the vehicle state whose masses, tyres or signals are missing."""
    missing = missing_keys(given["dynamics"], given["vehicle"], given["can.signals"])
    if settings.method is not None and missing:
        report(BadValueError(f"{settings.method} needs {missing}"), "vehicle_state", "method")
