"""Records that the monitor hands to the sinks: one `MonitorReport` per tick.

In: nothing (plain records). Out: `WheelState`, `AlarmKind`, `WheelReport`, `AlarmEvent`, `MonitorReport`.
Times are seconds of the host clock, as in `tpmsd.onboard.timeline.tick.Tick`; NaN stands for a number
nobody knows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

    from tpmsd.onboard.monitor.alarms.questions import Question
    from tpmsd.onboard.monitor.evidence.detectable import (
        DetectableLoss,
    )  # with numpy, which `tpmsd status` does without


class WheelState(StrEnum):
    """State of one wheel's monitoring."""

    UNAVAILABLE = "unavailable"
    """Nothing is known of this wheel: not on the bus, or its signals are not usable."""
    LEARNING = "learning"
    """Its own normal radius is still being learned; it cannot alarm on a deflation yet."""
    MONITORING = "monitoring"
    ALARM = "alarm"


class AlarmKind(StrEnum):
    """Kinds of alarms."""

    RADIUS_DEVIATION = "radius_deviation"
    """The rolling radius has changed against the learned baseline, in either direction."""
    DEFLATION = "deflation"
    """The rolling radius has become smaller as that of a tyre that loses air."""
    SLOW_LEAK = "slow_leak"
    """A notice: one tyre loses air against the other wheel of its axle, over weeks of drives."""
    MALFUNCTION = "malfunction"
    """The system cannot do its work (no usable wheels, or moving without fixes)."""


class WheelReport(NamedTuple):
    """One wheel at the end of one tick. A named tuple, as is the report: four are made in every tick."""

    wheel: str
    """fl | fr | rl | rr"""
    state: WheelState
    deviation_m: float
    """Radius minus nominal; NaN while unknown."""
    std_m: float
    change_m: float
    """Radius minus the learned baseline; NaN while learning."""
    change_std_m: float
    deflation_probability: float
    deviation_probability: float
    pressure_loss: float = math.nan
    """Estimated share of the pressure that is lost since the baseline; NaN while learning."""
    pressure_loss_std: float = math.nan


@dataclass(frozen=True, slots=True)
class AlarmEvent:
    """An alarm that was raised or cleared."""

    time_s: float
    kind: AlarmKind
    wheel: str | None
    """fl | fr | rl | rr; None where it speaks of no single wheel."""
    state: Literal["raised", "cleared"]
    deviation_m: float
    """Radius minus nominal at that moment; NaN while unknown."""
    std_m: float
    probability: float
    reason: str
    """One sentence for the driver or the journal."""
    pressure_loss: float = math.nan
    """Estimated share of the pressure that is lost; NaN where the alarm speaks of no single tyre."""
    pressure_loss_std: float = math.nan
    since: str = ""
    """`before the first start` for a tyre that was never learned sound; else empty."""
    rate_percent_per_week: float = math.nan
    """Pressure that a slow leak loses per week, %; NaN for other kinds, as its standard deviation."""
    rate_std_percent_per_week: float = math.nan
    low_on: str = ""
    """Day (ISO 8601) on which a slow leak will have lost 20 %; empty for other kinds."""
    low_between: tuple[str, str] = ("", "")
    """Interval of 95 % of that day."""

    def additional_keys(self) -> dict[str, Any]:
        """Return the keys, with their values, that only some alarms have in JSON documents."""
        out: dict[str, Any] = {"since": self.since} if self.since else {}
        if self.kind is AlarmKind.SLOW_LEAK:
            out |= {
                "rate_percent_per_week": round(self.rate_percent_per_week, 4),
                "rate_std_percent_per_week": round(self.rate_std_percent_per_week, 4),
                "low_on": self.low_on,
                "low_between": list(self.low_between),
            }
        return out


@dataclass(frozen=True, slots=True)
class LearningReport:
    """State of the baseline, for people and programs."""

    tyres: str
    """Name of the set of tyres that is driven."""
    sets: tuple[str, ...]
    """All sets that are kept, this one included."""
    learned_s: float
    """Driving time that this set's baseline was learned from."""
    samples_by_kmh: tuple[tuple[int, int], ...]
    """Samples learned in each range of speed, by its middle in km/h."""
    reset: Literal["none", "learning", "accepted", "refused"]
    """Outcome of the last reset."""
    reset_reason: str
    """One sentence on it; empty if there was none."""
    resets: int = 0
    """Requests for a reset since the start of the process."""


class MonitorReport(NamedTuple):
    """Report of the monitor at the end of one tick."""

    time_s: float
    wheels: tuple[WheelReport, ...]
    active: tuple[AlarmEvent, ...]
    """The alarms that stand now, each as it was raised."""
    events: tuple[AlarmEvent, ...]
    """The alarms raised or cleared in this very tick."""
    learning_fraction: float
    """Fraction of the baseline that is learned, 0 to 1."""
    learning: LearningReport | None = None
    losses: Callable[[], DetectableLoss] | None = None
    """Returns the minimum detectable losses; None before anything was judged."""
    questions: tuple[Question, ...] = ()
    """Questions: what has probably changed and cannot be distinguished."""

    @property
    def detectable(self) -> DetectableLoss | None:
        """Minimum detectable losses, computed again each time; None before anything was judged."""
        return None if self.losses is None else self.losses()
