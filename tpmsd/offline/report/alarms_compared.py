"""Alarms and radii of a drive without and with the model found.

In: two `ReplayResult`s of one drive, the second with the model compensated, and the faults found. Out:
`AlarmsCompared`, its JSON and its sentences. A radius that changes is the fault itself: in both replays,
and is taken out of the radii only where their bias is measured.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tpmsd.car.physics.catalogue import FAULT
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.assessment.result import Finding
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.offline.report.wording import drive_time, wheel_name
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind
from tpmsd.onboard.sinks.alarm_entry import alarm_entry

SETTLED_S = 120.0
"""Before, the radii have not been learned yet."""
SOONER_S = 10.0
"""An alarm that comes earlier or later by less is not worth a word."""

Key = tuple[AlarmKind, str | None]


@dataclass(frozen=True)
class WheelScatter:
    """Scatter of a wheel's estimated radius about its own median over the drive, the fault taken out."""

    wheel: str
    before_m: float
    after_m: float
    std_m: float
    """Standard deviation that the estimator states, in the median: no bias below it can be seen."""


@dataclass(frozen=True)
class RampedLoss:
    """A wheel's radius that ramps by `deviation_m`."""

    wheel: str
    deviation_m: float
    onset_s: float = 0.0
    duration_s: float = 0.0


@dataclass(frozen=True)
class AlarmsCompared:
    """One drive, replayed without and with the model."""

    drive: str
    before: ReplayResult
    after: ReplayResult
    """Record where the model holds nothing to compensate."""
    faults: tuple[RampedLoss, ...]
    notes: tuple[str, ...]
    """Part of the model that was not compensated."""

    @property
    def wheels(self) -> tuple[WheelScatter, ...]:
        """Return the scatter of each wheel whose radius was estimated in both replays."""
        out = []
        for k, wheel in enumerate(WHEELS):
            before, after = (self._scatter_m(result, k) for result in (self.before, self.after))
            if math.isfinite(before) and math.isfinite(after):
                claimed = float(np.nanmedian(self.before.std_m[:, k]))
                out.append(WheelScatter(wheel, before, after, claimed))
        return tuple(out)

    def _scatter_m(self, result: ReplayResult, wheel: int) -> float:
        """Return the root mean square of a wheel's radius about its median once settled, faults taken out,
        metres; NaN for ten values or fewer."""
        deviation = result.deviation_m[:, wheel] - self.fault_m(result, wheel)
        since = result.time_s - result.start_s
        known = deviation[np.isfinite(deviation) & (since > min(SETTLED_S, 0.3 * result.duration_s))]
        return float(np.sqrt(np.mean((known - np.median(known)) ** 2))) if len(known) > 10 else math.nan

    def fault_m(self, result: ReplayResult, wheel: int) -> FloatArray:
        """Return the (n,) change of a wheel's radius by the ramped losses of the model, metres."""
        since = result.time_s - result.start_s
        out = np.zeros_like(since)
        for fault in self.faults:
            if fault.wheel == WHEELS[wheel]:
                share = np.clip((since - fault.onset_s) / max(fault.duration_s, 1e-9), 0.0, 1.0)
                out += fault.deviation_m * share
        return out

    @property
    def changes(self) -> tuple[str, ...]:
        """Return one sentence per alarm that is lost, is new, or is raised at another time with the model."""
        before, after = _first_raised(self.before), _first_raised(self.after)
        leaking = {fault.wheel for fault in self.faults if fault.deviation_m < 0.0}
        changed = {fault.wheel for fault in self.faults}
        out = []
        for key, alarm in before.items():
            when = drive_time(alarm.time_s - self.before.start_s)
            faulty = alarm.wheel in (leaking if alarm.kind == AlarmKind.DEFLATION else changed)
            if key not in after:
                what = "An alarm is lost" if faulty else "A false alarm goes"
                out.append(f"{what}: {_alarm_name(alarm)} at {when}.")
            else:
                moved = (after[key].time_s - self.after.start_s) - (alarm.time_s - self.before.start_s)
                if abs(moved) > SOONER_S:
                    word = "sooner" if moved < 0 else "later"
                    out.append(
                        f"{_alarm_name(alarm).capitalize()} is announced {drive_time(abs(moved))} {word}."
                    )
        for key, alarm in after.items():
            if key not in before:
                faulty = alarm.wheel in (leaking if alarm.kind == AlarmKind.DEFLATION else changed)
                what = "A hidden leak appears" if faulty else "A new alarm that no fault explains appears"
                when = drive_time(alarm.time_s - self.after.start_s)
                out.append(f"{what}: {_alarm_name(alarm)} at {when}.")
        return tuple(out)


def _ramped_loss(values: Mapping[str, float | str]) -> RampedLoss:
    """Return the loss that a finding's parameter values describe; values that it lacks are 0."""
    wheel, *numbers = (values.get(name, 0.0) for name in ("wheel", "deviation_m", "onset_s", "duration_s"))
    return RampedLoss(str(wheel), *(float(number) for number in numbers))


def compare_alarms(
    drive: str,
    before: ReplayResult,
    after: ReplayResult | None,
    findings: Sequence[Finding],
    notes: tuple[str, ...] = (),
) -> AlarmsCompared:
    """Return both replays with the losses among the findings; `after` is None where nothing was
    compensated."""
    found = tuple(
        _ramped_loss(
            {name: quantity.value for name, quantity in finding.parameters.items()} | {"wheel": wheel}
        )
        for finding in findings
        if finding.effect == FAULT.name and drive in (finding.drives or (drive,))
        for wheel in finding.where.wheels
    )
    return AlarmsCompared(drive, before, before if after is None else after, found, notes)


def alarms_document(compared: AlarmsCompared) -> dict[str, Any]:
    """Return the comparison as plain JSON values."""
    before, after = compared.before, compared.after
    return {
        "drive": compared.drive,
        "before": [alarm_entry(alarm, before.start_s) for alarm in before.alarms],
        "after": [alarm_entry(alarm, after.start_s) for alarm in after.alarms],
        "radius_bias_mm": {
            bias.wheel: {
                "before": 1e3 * bias.before_m,
                "after": 1e3 * bias.after_m,
                "estimate_std": 1e3 * bias.std_m,
            }
            for bias in compared.wheels
        },
        "changes": list(compared.changes),
        "not_compensated": list(compared.notes),
    }


def alarms_summary(compared: AlarmsCompared) -> str:
    """Return the comparison in plain sentences."""
    name = compared.drive
    counts = [sum(alarm.state == "raised" for alarm in r.alarms) for r in (compared.before, compared.after)]
    if compared.after is compared.before:
        return f"Alarms of {name}: {_number_word(counts[0])}; the model holds nothing to compensate."
    lines = [
        f"Alarms of {name}: {_number_word(counts[0])} without the model, {_number_word(counts[1])} with it."
    ]
    lines += [f"   {change}" for change in compared.changes]
    biases = ", ".join(f"{b.wheel} {1e3 * b.before_m:.2f} to {1e3 * b.after_m:.2f}" for b in compared.wheels)
    lines.append(f"   radii scatter about their own median by (mm, before to after): {biases}")
    lines += [f"   {note}" for note in compared.notes]
    return "\n".join(lines)


def _number_word(number: int) -> str:
    return {0: "none", 1: "one"}.get(number, str(number))


def _first_raised(result: ReplayResult) -> dict[Key, AlarmEvent]:
    """Return the first raised alarm of each kind and wheel, in order of time."""
    out: dict[Key, AlarmEvent] = {}
    for alarm in result.alarms:
        if alarm.state == "raised":
            out.setdefault((alarm.kind, alarm.wheel), alarm)
    return out


def _alarm_name(alarm: AlarmEvent) -> str:
    return f"{alarm.kind} of the {wheel_name(alarm.wheel)} wheel" if alarm.wheel else str(alarm.kind)
