"""Notices of tyres that lose air over weeks: readings per drive, histories per set of tyres, events.

In: ticks with their estimates, which set of tyres is driven, resets. Out: `AlarmEvent`s of the kind
`slow_leak`. It is a notice: the wheel's state stays as it is.

A drive gives one reading: the mean contrasts of radii (`state`) over minutes 2 to 12 of informative
driving, so that tyres are about equally warm in all of them, less what wheels grow or slip more than the
others with speed. The trend over drives is judged once per drive (`trend`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import date
from typing import Any

import numpy as np

from tpmsd.car.config.model import TyreConfig, VehicleConfig
from tpmsd.car.physics.tyre import tyre_model
from tpmsd.foundation.bounds import LARGEST, number
from tpmsd.foundation.wheels import AXLES, WHEELS, FloatArray
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.baseline.baseline import TyreSetBaseline
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind
from tpmsd.onboard.monitor.settings import READINGS
from tpmsd.onboard.monitor.slow_leaks.history import LeakHistory
from tpmsd.onboard.monitor.slow_leaks.state import CONTRASTS, FRONT_REAR
from tpmsd.onboard.monitor.slow_leaks.trend import Trend
from tpmsd.onboard.timeline.tick import Tick

DAY_S = 86400.0
_EPOCH = date(1970, 1, 1).toordinal()
_LAST_DAY = date(9999, 12, 31).toordinal() - _EPOCH


class DriveReading:
    """Gathers the reading of one drive."""

    def __init__(self) -> None:
        self._driven_s = self._since_s = 0.0
        self._sums = np.zeros((2, 3))
        """Sums of difference and variance, for each contrast."""
        self._samples = 0
        self._taken = False

    def add_driving(self, dt_s: float) -> bool:
        """Add informative driving; return whether a sample is due."""
        self._driven_s += dt_s
        self._since_s += dt_s
        return self._driven_s >= READINGS.warm_s and self._since_s >= READINGS.sample_s and not self._taken

    def add(self, difference_m: FloatArray, variance_m2: FloatArray) -> None:
        """Add a sample of the three contrasts of radii and of their variances; (3,) each."""
        self._since_s = 0.0
        self._sums += np.stack([difference_m, variance_m2])
        self._samples += 1

    def take_reading(self, *, over: bool) -> tuple[FloatArray, FloatArray] | None:
        """Return difference and variance (3,) once enough was driven, and only once; else None. `over`: the
        drive has ended, and less driving is enough."""
        enough = READINGS.warm_s + (READINGS.min_s if over else READINGS.full_s)
        if self._taken or self._driven_s < enough or not self._samples:
            return None
        self._taken = True
        # Estimates of one drive are not independent: their mean is no better known than each.
        return self._sums[0] / self._samples, self._sums[1] / self._samples


class SlowLeakWatch:
    """Watches for slow leaks of all sets of tyres of one car."""

    def __init__(self, vehicle: VehicleConfig, tyre: TyreConfig, wheels: list[int]) -> None:
        self._wheels = sorted(wheels)
        self._axles = [k for k, pair in enumerate(AXLES) if set(pair) <= set(wheels)]
        models = [tyre_model(tyre, float(np.mean(np.array(vehicle.wheel_radius_m)[list(p)]))) for p in AXLES]
        front, rear = (-model.radius_change_m(0.1) / 10.0 for model in models)
        self._per_percent = (front, rear, (front + rear) / 2.0)
        self._contrasts = [*self._axles, FRONT_REAR] if len(self._axles) == len(AXLES) else self._axles
        self._histories: dict[str, LeakHistory] = {}
        self._tyres: str | None = None
        self._notices: dict[int, AlarmEvent] = {}
        self._reading = DriveReading()
        self._day = math.nan
        self._moved_s = math.nan

    @property
    def active(self) -> tuple[AlarmEvent, ...]:
        """The active notices, each as it was raised."""
        return tuple(self._notices.values())

    def reset(self, tyres: str) -> None:
        """Record a reset of this set: levels change, a leak goes on."""
        if tyres in self._histories:
            self._histories[tyres].mark_step()

    def update(
        self, tick: Tick, estimate: RadiusEstimate, baseline: TyreSetBaseline, tyres: str, trusted: bool
    ) -> list[AlarmEvent]:
        """Update by one tick; return the notices that it raised or cleared. `baseline` knows what each wheel
        grows or slips with speed beyond the others; `tyres`: the set that is driven; `trusted`: whether
        wheels and receiver agree."""
        events = self._change_set(tyres, tick)
        begins = tick.time_s - self._moved_s > READINGS.new_drive_s
        if begins:
            events += self._commit(tick, over=True)
            self._reading = DriveReading()
        if not estimate.speed_mps < READINGS.standstill_mps:
            self._moved_s = tick.time_s
        if not (estimate.informative and trusted and tick.host_time_s >= READINGS.earliest_s):
            return events
        if not self._reading.add_driving(tick.dt_s):
            return events
        self._day = tick.host_time_s / DAY_S
        if (reading := self._precise_contrasts(estimate, baseline)) is not None:
            self._reading.add(*reading)
        return events + self._commit(tick, over=False)

    def _precise_contrasts(
        self, estimate: RadiusEstimate, baseline: TyreSetBaseline
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return difference and variance of each contrast (3,), NaN for those that are not monitored; None
        where one that is monitored is not known precisely."""
        known = self._contrasts
        if self._certainly_imprecise(estimate):
            return None
        # Estimates of wheels that are not read are NaN, which a contrast's zero for them would spread.
        contrasts = CONTRASTS[np.ix_(known, self._wheels)]
        covariance_m2 = estimate.covariance_m2[np.ix_(self._wheels, self._wheels)]
        variance = np.full(3, math.nan)
        variance[known] = np.diag(contrasts @ covariance_m2 @ contrasts.T)
        if not known or not all(0.0 <= one <= READINGS.max_std_m**2 for one in variance[known].tolist()):
            return None
        difference = np.full(3, math.nan)
        difference[known] = contrasts @ (estimate.deviation_m - baseline.own_growth_m)[self._wheels]
        return (difference, variance) if np.isfinite(difference[known]).all() else None

    def _certainly_imprecise(self, estimate: RadiusEstimate) -> bool:
        """Return whether the difference of an axle's wheels is clearly not known precisely: as a rule for
        minutes, in each tick of which numpy would take ten times as long to say so."""
        m2 = estimate.covariance_m2.ravel().tolist()
        clearly_m2 = 1.001 * READINGS.max_std_m**2
        return any(
            m2[5 * left] + m2[5 * right] - m2[4 * left + right] - m2[4 * right + left] > clearly_m2
            for left, right in (AXLES[axle] for axle in self._axles)
        )

    def _change_set(self, tyres: str, tick: Tick) -> list[AlarmEvent]:
        """Record the set of tyres that is driven; if it is another, return the cleared events of the other
        set's notices."""
        if tyres == self._tyres:
            return []
        events = []
        if self._tyres is not None:
            events = [
                _cleared_event(event, tick, f"{tyres} is driven now") for event in self._notices.values()
            ]
            self._notices.clear()
            self._reading = DriveReading()
        self._tyres = tyres
        return events

    def _commit(self, tick: Tick, *, over: bool) -> list[AlarmEvent]:
        """Add the drive's reading to the history, if it is due; return the notices that this raises or
        clears."""
        reading = self._reading.take_reading(over=over)
        if reading is None or self._tyres is None:
            return []
        history = self._histories.setdefault(self._tyres, LeakHistory())
        while len(self._histories) > READINGS.max_sets:
            del self._histories[next(iter(self._histories))]
        if not history.add(self._day, *reading):
            return []
        return self._judge_history(history, tick)

    def _judge_history(self, history: LeakHistory, tick: Tick) -> list[AlarmEvent]:
        """Return the event of a notice that the history clears or raises; empty if none."""
        for wheel, notice in self._notices.items():
            since = notice.time_s / DAY_S
            rate = (notice.rate_percent_per_week, notice.rate_std_percent_per_week)
            if history.leak_has_ended(self._per_percent, wheel, rate, since):
                del self._notices[wheel]
                history.forget_before(history.recent_readings(since)[0].day)
                return [_cleared_event(notice, tick, "the drives since then show no leak")]
        trend = history.trend(self._per_percent)
        if trend is None or not trend.noticeable() or self._notices:
            return []
        self._notices[trend.wheel] = notice_of(trend.wheel, trend, tick.host_time_s)
        return [self._notices[trend.wheel]]

    # -- what survives a restart -----------------------------------------------------------------------------

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers for the state file."""
        return {
            "histories": {name: history.to_json() for name, history in self._histories.items()},
            "tyres": self._tyres,
            "notices": [_notice_to_json(event) for event in self._notices.values()],
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore what `to_json` returned; ValueError (nothing restored) if it does not fit."""
        try:
            histories = {str(name): LeakHistory.from_json(e) for name, e in saved["histories"].items()}
            notices = {WHEELS.index(entry["wheel"]): _notice_from_json(entry) for entry in saved["notices"]}
            tyres = saved["tyres"]
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"the saved trends are none: {type(error).__name__}: {error}") from error
        known = {wheel for axle in self._axles for wheel in AXLES[axle]}
        if len(histories) > READINGS.max_sets or not notices.keys() <= known:
            raise ValueError("the saved trends are not those of this car")
        if tyres is not None and not isinstance(tyres, str):
            raise ValueError("the saved trends are none")
        self._histories, self._notices, self._tyres = histories, notices, tyres
        self._reading = DriveReading()


def notice_of(wheel: int, trend: Trend, time_s: float) -> AlarmEvent:
    """Return the notice of a leak of this wheel, now."""
    early, middle, late = (_iso_date(time_s / DAY_S + in_d) for in_d in trend.low_in_d)
    reason = (
        f"loses {trend.rate:.1f} +- {trend.rate_std:.1f} % of its pressure per week against its axle's other "
        f"tyre, by {trend.days:.0f} days of driving in {trend.span_d:.0f} days; 20 % low on {middle} "
        f"({early} to {late})"
    )
    return AlarmEvent(
        time_s=time_s,
        kind=AlarmKind.SLOW_LEAK,
        wheel=WHEELS[wheel],
        state="raised",
        deviation_m=math.nan,
        std_m=math.nan,
        probability=min(trend.probability, 1.0),
        reason=reason,
        pressure_loss=trend.lost / 100.0,
        rate_percent_per_week=trend.rate,
        rate_std_percent_per_week=trend.rate_std,
        low_on=middle,
        low_between=(early, late),
    )


def _cleared_event(event: AlarmEvent, tick: Tick, why: str) -> AlarmEvent:
    """Return the cleared event of a notice, with the cause."""
    reason = f"no longer so ({why}): {event.reason}"
    return replace(event, time_s=tick.host_time_s, state="cleared", probability=0.0, reason=reason)


def _iso_date(day: float) -> str:
    """Return the date (ISO 8601) of a day since the epoch."""
    return date.fromordinal(_EPOCH + int(min(max(day, 0.0), _LAST_DAY))).isoformat()


def _notice_to_json(event: AlarmEvent) -> dict[str, Any]:
    return {
        "wheel": event.wheel,
        "time_s": event.time_s,
        "probability": event.probability,
        "reason": event.reason,
        "pressure_loss": event.pressure_loss,
        "rate": event.rate_percent_per_week,
        "rate_std": event.rate_std_percent_per_week,
        "low_on": event.low_on,
        "low_between": list(event.low_between),
    }


def _notice_from_json(saved: dict[str, Any]) -> AlarmEvent:
    early, late = (date.fromisoformat(str(text)).isoformat() for text in saved["low_between"])
    return AlarmEvent(
        time_s=number(saved["time_s"], 0.0, LARGEST, "time"),
        kind=AlarmKind.SLOW_LEAK,
        wheel=str(saved["wheel"]),
        state="raised",
        deviation_m=math.nan,
        std_m=math.nan,
        probability=number(saved["probability"], 0.0, 1.0, "probability"),
        reason=str(saved["reason"])[:500],
        pressure_loss=number(saved["pressure_loss"], -1.0, 10.0, "loss of pressure"),
        rate_percent_per_week=number(saved["rate"], 0.0, 100.0, "rate"),
        rate_std_percent_per_week=number(saved["rate_std"], 0.0, 100.0, "rate"),
        low_on=date.fromisoformat(str(saved["low_on"])).isoformat(),
        low_between=(early, late),
    )
