"""The values that `[[can.output]]` may put into a signal: a fixed list, by name.

In: a `MonitorReport`. Out: name -> number; NaN where nobody knows it.
"""

from __future__ import annotations

import math

from tpmsd.car.config.output_names import NAMES, PRESSURE_LOSS
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, MonitorReport
from tpmsd.onboard.sinks.can_layout import WHEEL_STATE_CODES


def output_values(report: MonitorReport) -> dict[str, float]:
    """Return the value of each name that a signal may be given, except counter and checksum."""
    values = dict.fromkeys(NAMES, math.nan)
    of_tyres = (AlarmKind.DEFLATION, AlarmKind.RADIUS_DEVIATION)
    tyres = [event for event in report.active if event.kind in of_tyres]
    malfunction = any(event.kind is AlarmKind.MALFUNCTION for event in report.active)
    values["alarm"], values["malfunction"] = float(bool(tyres)), float(malfunction)
    values["warning"] = float(bool(report.active))
    values["alarms"] = float(len(report.active))
    values["learning"] = float(any(wheel.state == "learning" for wheel in report.wheels))
    for name in WHEELS:
        of_wheel = [event for event in tyres if _is_about(event, name)]
        values[f"state_{name}"] = WHEEL_STATE_CODES["unavailable"]
        values[f"alarm_{name}"] = float(bool(of_wheel))
        for kind in of_tyres:
            values[f"{kind}_{name}"] = float(any(event.kind is kind for event in of_wheel))
    for wheel in report.wheels:
        values[f"state_{wheel.wheel}"] = WHEEL_STATE_CODES[wheel.state]
        values[f"deviation_mm_{wheel.wheel}"] = 1e3 * wheel.deviation_m
        values[f"change_mm_{wheel.wheel}"] = 1e3 * wheel.change_m
        values[f"std_mm_{wheel.wheel}"] = 1e3 * wheel.std_m
        values[f"{PRESSURE_LOSS}_{wheel.wheel}"] = 100.0 * max(wheel.pressure_loss, 0.0)
    return values


def _is_about(event: AlarmEvent, wheel: str) -> bool:
    """Return whether an alarm is about a wheel, or about all of them."""
    return event.wheel is None or event.wheel == wheel
