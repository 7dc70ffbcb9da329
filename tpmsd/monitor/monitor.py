"""Radius estimates become alarms.

In: a `RadiusEstimate` per tick, with the tick. Out: a `MonitorReport` per tick. Pure: no clock, no I/O.

Learning: the first `learn_s` of informative driving give the baseline. Then, once a second of informative
driving, all wheels' changes are judged together (`hypotheses`), and each alarm goes through its own
hysteresis (`alarm_state`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.special import ndtr

from tpmsd.config.model import MonitorConfig, VehicleConfig
from tpmsd.estimators.base import RadiusEstimate
from tpmsd.monitor.alarm_state import Hysteresis
from tpmsd.monitor.baseline import Baseline
from tpmsd.monitor.hypotheses import Nuisance, compare
from tpmsd.monitor.records import AlarmEvent, AlarmKind, MonitorReport, WheelReport, WheelState
from tpmsd.monitor.signal_watch import SignalWatch
from tpmsd.timeline.tick import Tick
from tpmsd.wheels import WHEELS, FloatArray

JUDGE_EVERY_S = 1.0
MAX_BASELINE_CONTRAST_STD = 0.0008
"""Learning goes on until the contrast between the wheels is known this well, relative to the radius."""


@dataclass(slots=True)
class _Judgement:
    change: FloatArray
    change_std: FloatArray
    deflated: FloatArray
    deviates: FloatArray
    loss_m: FloatArray

    @classmethod
    def unknown(cls) -> _Judgement:
        """Before anything was judged."""
        return cls(*(np.full(4, np.nan) for _ in range(5)))


class Monitor:
    """Baseline, hypotheses and hysteresis for one car."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        settings: MonitorConfig,
        wheels: tuple[int, ...],
        nuisance: Nuisance | None = None,
    ) -> None:
        """`wheels`: indices of the wheels whose signals the bus has."""
        self._wheels = list(wheels)
        self._radius = np.array(vehicle.wheel_radius_m)
        self._settings = settings
        self._nuisance = (nuisance or Nuisance()).covariance(self._wheels, self._radius[self._wheels])
        self.baseline: Baseline | None = None
        self._since_judged_s = 0.0
        self._judged = _Judgement.unknown()
        self._alarms = {
            (kind, wheel): Hysteresis(
                settings.raise_probability,
                settings.clear_probability,
                settings.raise_hold_s,
                settings.clear_hold_s,
            )
            for kind in (AlarmKind.DEFLATION, AlarmKind.RADIUS_DEVIATION)
            for wheel in self._wheels
        }
        self._standing: dict[tuple[AlarmKind, int], AlarmEvent] = {}
        self._signals = SignalWatch(settings, self._wheels)
        self._learned_from_s: float | None = None

    # -- per tick --------------------------------------------------------------------------------------------

    def update(self, tick: Tick, estimate: RadiusEstimate) -> MonitorReport:
        """Take one tick and its estimate."""
        events = self._signals.update(tick, estimate)
        if estimate.informative:
            self._learn(estimate)
            if self.baseline is not None:
                self._since_judged_s += tick.dt_s
                if self._since_judged_s >= JUDGE_EVERY_S:
                    events += self._judge(tick, estimate, self._since_judged_s)
                    self._since_judged_s = 0.0
        return MonitorReport(
            time_s=tick.host_time_s,
            wheels=tuple(self._wheel_report(i, tick, estimate) for i in range(4)),
            active=(*self._standing.values(), *self._signals.standing),
            events=tuple(events),
            learning_fraction=self._learning_fraction(estimate),
        )

    def _learning_fraction(self, estimate: RadiusEstimate) -> float:
        if self.baseline is not None:
            return 1.0
        begun = self._learned_from_s if self._learned_from_s is not None else estimate.informative_s
        return min((estimate.informative_s - begun) / self._settings.learn_s, 0.99)

    def _learn(self, estimate: RadiusEstimate) -> None:
        """Freeze the baseline when enough was driven and the wheels are known against each other."""
        if self.baseline is not None:
            return
        if self._learned_from_s is None:
            self._learned_from_s = estimate.informative_s
        if estimate.informative_s - self._learned_from_s < self._settings.learn_s:
            return
        cov = estimate.covariance_m2[np.ix_(self._wheels, self._wheels)]
        if not np.all(np.isfinite(cov)):
            return
        d = len(self._wheels)
        centring = np.eye(d) - np.ones((d, d)) / d
        contrast = math.sqrt(float(np.max(np.diag(centring @ cov @ centring))))
        if contrast > MAX_BASELINE_CONTRAST_STD * float(self._radius.mean()):
            return
        self.baseline = Baseline(estimate.deviation_m.copy(), estimate.covariance_m2.copy())

    def forget(self) -> None:
        """Forget the baseline and learn anew; standing tyre alarms are taken back with it."""
        self.baseline = None
        self._learned_from_s = None
        self._since_judged_s = 0.0
        self._judged = _Judgement.unknown()
        for key, alarm in self._alarms.items():
            alarm.active, alarm.held_s = False, 0.0
            self._standing.pop(key, None)

    def _judge(self, tick: Tick, estimate: RadiusEstimate, elapsed_s: float) -> list[AlarmEvent]:
        assert self.baseline is not None
        index = np.ix_(self._wheels, self._wheels)
        own = estimate.covariance_m2[index] + self.baseline.covariance_m2[index]
        change = (estimate.deviation_m - self.baseline.deviation_m)[self._wheels]
        if not (np.all(np.isfinite(own)) and np.all(np.isfinite(change))):
            return []
        radius = self._radius[self._wheels]
        verdict = compare(change, own + self._nuisance, radius, self._settings.deflation_percent / 100.0)
        std = np.sqrt(np.diag(own))
        limit = self._settings.deviation_percent / 100.0 * radius
        # What speed, warmth, load and slip do to a radius is no deviation: it widens the question, too.
        wide = np.sqrt(np.diag(own + self._nuisance))
        deviates = ndtr((-limit - change) / wide) + ndtr((change - limit) / wide)
        judged = _Judgement.unknown()
        for target, values in (
            (judged.change, change),
            (judged.change_std, std),
            (judged.deflated, verdict.deflated),
            (judged.deviates, deviates),
            (judged.loss_m, verdict.loss_m),
        ):
            target[self._wheels] = values
        self._judged = judged
        events: list[AlarmEvent] = []
        for (kind, wheel), alarm in self._alarms.items():
            probability = float((judged.deflated if kind is AlarmKind.DEFLATION else judged.deviates)[wheel])
            turned = alarm.update(probability, elapsed_s)
            if turned is not None:
                events.append(self._tyre_event(kind, wheel, turned, probability, tick, estimate))
        return events

    def _tyre_event(
        self,
        kind: AlarmKind,
        wheel: int,
        turned: Literal["raised", "cleared"],
        probability: float,
        tick: Tick,
        estimate: RadiusEstimate,
    ) -> AlarmEvent:
        change = float(self._judged.change[wheel])
        std = float(self._judged.change_std[wheel])
        loss = float(self._judged.loss_m[wheel])
        if kind is AlarmKind.DEFLATION:
            reason = (
                f"lost {1e3 * loss:.1f} mm of radius against the other wheels since learned "
                f"(probability {probability:.3f})"
            )
        else:
            reason = f"radius changed by {1e3 * change:+.1f} +- {1e3 * std:.1f} mm since learned"
        if turned == "cleared":
            reason = f"no longer so: {reason}"
        event = AlarmEvent(
            time_s=tick.host_time_s,
            kind=kind,
            wheel=WHEELS[wheel],
            state=turned,
            deviation_m=float(estimate.deviation_m[wheel]),
            std_m=math.sqrt(float(estimate.covariance_m2[wheel, wheel])),
            probability=probability,
            reason=reason,
        )
        self._stand(kind, wheel, event)
        return event

    def _stand(self, kind: AlarmKind, key: int, event: AlarmEvent) -> None:
        if event.state == "raised":
            self._standing[(kind, key)] = event
        else:
            self._standing.pop((kind, key), None)

    # -- reports ---------------------------------------------------------------------------------------------

    def _wheel_report(self, wheel: int, tick: Tick, estimate: RadiusEstimate) -> WheelReport:
        known = wheel in self._wheels
        deviation = float(estimate.deviation_m[wheel])
        variance = float(estimate.covariance_m2[wheel, wheel])
        if not known or self._signals.is_lost(wheel, tick.time_s):
            state = WheelState.UNAVAILABLE
        elif any(standing == wheel for _, standing in self._standing):
            state = WheelState.ALARM
        else:
            state = WheelState.LEARNING if self.baseline is None else WheelState.MONITORING
        judged = self._judged
        return WheelReport(
            wheel=WHEELS[wheel],
            state=state,
            deviation_m=deviation,
            std_m=math.sqrt(variance) if variance >= 0.0 else math.nan,
            change_m=float(judged.change[wheel]),
            change_std_m=float(judged.change_std[wheel]),
            deflation_probability=_known(judged.deflated[wheel]),
            deviation_probability=_known(judged.deviates[wheel]),
        )

    # -- what survives a restart -----------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Baseline and standing tyre alarms as plain numbers."""
        return {
            "baseline": None if self.baseline is None else self.baseline.to_json(),
            "wheels": [WHEELS[i] for i in self._wheels],
            "alarms": [
                {
                    "kind": str(e.kind),
                    "wheel": e.wheel,
                    "time_s": e.time_s,
                    "probability": e.probability,
                    "reason": e.reason,
                }
                for (kind, _), e in self._standing.items()
                if kind is not AlarmKind.MALFUNCTION
            ],
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up a snapshot; ValueError if it does not fit (then nothing is taken up).

        What was learned before is forgotten. Alarms stand again until driving clears them.
        """
        try:
            baseline, standing = self._parsed(saved)
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"the saved monitor is not one: {type(error).__name__}: {error}") from error
        self.forget()
        self.baseline = baseline
        for event in standing:
            key = (event.kind, WHEELS.index(event.wheel or ""))
            self._alarms[key].active = True
            self._standing[key] = event

    def _parsed(self, saved: dict[str, Any]) -> tuple[Baseline | None, list[AlarmEvent]]:
        if saved["wheels"] != [WHEELS[i] for i in self._wheels]:
            raise ValueError("the saved baseline belongs to another set of wheels")
        entry = saved["baseline"]
        baseline = None if entry is None else Baseline.from_json(entry, self._wheels)
        standing = [
            AlarmEvent(
                time_s=float(entry["time_s"]),
                kind=AlarmKind(entry["kind"]),
                wheel=str(entry["wheel"]),
                state="raised",
                deviation_m=math.nan,
                std_m=math.nan,
                probability=float(entry["probability"]),
                reason=str(entry["reason"]),
            )
            for entry in saved["alarms"]
        ]
        for event in standing:
            if event.wheel not in WHEELS or (event.kind, WHEELS.index(event.wheel)) not in self._alarms:
                raise ValueError(f"the saved {event.kind} alarm of {event.wheel} is not one of this car")
            if baseline is None:
                raise ValueError("the saved alarms have no baseline that they stand against")
        return baseline, standing


def _known(probability: float) -> float:
    """The probability, 0 where nothing has been judged."""
    value = float(probability)
    return value if value == value else 0.0
