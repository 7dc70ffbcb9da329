"""Radius estimates become alarms.

In: a `RadiusEstimate` per tick, with the tick. Out: a `MonitorReport` per tick. Pure: no clock, no I/O.

The `baseline` learns the radii of tyres that are in order, as a function of how the car is driven. Once a
second of informative driving all wheels' changes against it are judged together (`judge`), and each alarm
goes through its own hysteresis (`alarm_state`). docs/explanation/alarms.md has the state machine as a table.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from tpmsd.car.config.model import CalibrationConfig, MonitorConfig, TyreConfig, VehicleConfig
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.gates.agreement import AGREED, Agreement
from tpmsd.onboard.monitor.alarms.alarm_state import Hysteresis
from tpmsd.onboard.monitor.alarms.judge import Judge, Judgement
from tpmsd.onboard.monitor.alarms.questions import Question, Questions
from tpmsd.onboard.monitor.alarms.saved_alarms import alarm_from_json, alarm_to_json
from tpmsd.onboard.monitor.baseline.baseline import TyreSetBaseline
from tpmsd.onboard.monitor.baseline.tyre_sets import TyreSets
from tpmsd.onboard.monitor.evidence.first_start import BEFORE, FirstStart
from tpmsd.onboard.monitor.health.configuration_watch import ConfigurationWatch
from tpmsd.onboard.monitor.health.encoder_watch import EncoderWatch
from tpmsd.onboard.monitor.health.signal_watch import SignalWatch, WatchState
from tpmsd.onboard.monitor.records import (
    AlarmEvent,
    AlarmKind,
    LearningReport,
    MonitorReport,
    WheelReport,
    WheelState,
)
from tpmsd.onboard.monitor.settings import JUDGE, STATED
from tpmsd.onboard.monitor.slow_leaks.watch import SlowLeakWatch
from tpmsd.onboard.resonance.evidence import ResonanceEvidence
from tpmsd.onboard.timeline.tick import Tick


class Monitor:
    """Baselines, judgement and hysteresis for one car."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        settings: MonitorConfig,
        wheels: tuple[int, ...],
        tyre: TyreConfig | None = None,
        calibration: CalibrationConfig | None = None,
    ) -> None:
        """`wheels`: indices of the wheels whose signals the bus has; `calibration`: how well the nominal
        radii are known, None where they are guessed."""
        self._wheels = list(wheels)
        self._vehicle, self._settings, self._tyre = vehicle, settings, tyre or TyreConfig()
        self._judge = Judge(vehicle, settings, self._tyre, self._wheels)
        self._sets = TyreSets(vehicle, self._wheels, settings.learn_s, self._judge)
        self._sets.baseline.start_from_calibration(calibration or CalibrationConfig())
        self._grid = np.ix_(self._wheels, self._wheels)
        self._since_judged_s = 0.0
        self._judged = Judgement.unknown()
        self._cached = (self._judged, self._judged.by_wheel())
        """Result of the judgement, and the same as plain numbers."""
        self._trusted, self._restored = True, False
        self._since_seen_s = math.inf
        """Since the wheels were last known well enough to see a soft one."""
        radius = float(np.mean(np.array(vehicle.wheel_radius_m)[self._wheels]))
        self._seen_m = JUDGE.seen_share * settings.deflation_percent / 100.0 * radius

        def hysteresis() -> Hysteresis:
            return Hysteresis(
                settings.raise_probability,
                settings.clear_probability,
                settings.raise_hold_s,
                settings.clear_hold_s,
            )

        self._scale_m2 = [(STATED.receiver_scale * radius_m) ** 2 for radius_m in vehicle.wheel_radius_m]
        """(4,) variance of a radius by a scale of the receiver: part of what is stated, not of a change."""
        self._alarms = {
            (kind, wheel): hysteresis()
            for kind in (AlarmKind.DEFLATION, AlarmKind.RADIUS_DEVIATION)
            for wheel in self._wheels
        }
        nominal = np.array(vehicle.wheel_radius_m)[self._wheels]
        self._first = FirstStart(self._wheels, nominal, hysteresis)
        self._active: dict[tuple[AlarmKind, int], AlarmEvent] = {}
        self._taken_back: list[tuple[AlarmKind, int]] = []
        self._signals = SignalWatch(settings, self._wheels)
        self._configuration = ConfigurationWatch(vehicle, self._wheels)
        self._encoders = EncoderWatch(vehicle, self._wheels)
        self._leaks = SlowLeakWatch(vehicle, self._tyre, self._wheels)
        self._questions = Questions(settings, self._wheels, vehicle.driven_axle)
        self._resonance: ResonanceEvidence | None = None
        self._learning = self.learning()

    @property
    def baseline(self) -> TyreSetBaseline:
        """Baseline of the set of tyres that is driven."""
        return self._sets.baseline

    @property
    def sets(self) -> TyreSets:
        """The sets of tyres, each with its baseline."""
        return self._sets

    @property
    def judgement(self) -> Judgement:
        """The last judgement of the wheels."""
        return self._judged

    @property
    def questions(self) -> tuple[Question, ...]:
        """Questions: what has probably changed and cannot be distinguished."""
        return self._questions.open

    def learning(self) -> LearningReport:
        """Return the report of what is learned, and for which tyres."""
        return self._sets.report()

    # -- per tick --------------------------------------------------------------------------------------------

    def update(
        self,
        tick: Tick,
        estimate: RadiusEstimate,
        resonance: ResonanceEvidence | None = None,
        agreement: Agreement = AGREED,
    ) -> MonitorReport:
        """Update by one tick, its estimate, and the evidence of the resonances if they are used; return the
        report. Without the `agreement` of wheels and receiver no tyre is judged and nothing is learned."""
        self._resonance = resonance
        if (mounted := self._sets.mounted.update(tick)) not in (None, self._sets.name):
            self.reset(mounted)
        known_wrong = bool(self._configuration.contradiction)
        contradicted = bool(self._configuration.update(tick))
        if contradicted and not known_wrong and not self._restored:
            self._sets.restart_baseline()  # it was learned through a wrong file
        self._trusted = agreement.trusted and not contradicted
        self._since_seen_s += tick.dt_s
        self._encoders.update(tick)
        events = self._signals.update(tick, estimate, self._watch_state(), agreement)
        events += self._withdrawal_events(tick, estimate)
        self._sets.update(tick, estimate)
        if not self._trusted:
            self._judged = Judgement.unknown()
            self._sets.comparison_baseline.forget_recent()
        elif estimate.informative:
            self._since_judged_s += tick.dt_s
            if self._since_judged_s >= JUDGE.every_s:
                events += self._judge_now(tick, estimate, self._since_judged_s)
                self._since_judged_s = 0.0
        events += self._leaks.update(tick, estimate, self.baseline, self._sets.name, self._trusted)
        return MonitorReport(
            time_s=tick.host_time_s,
            wheels=self._wheel_reports(tick, estimate),
            active=(*self._active.values(), *self._leaks.active, *self._signals.active),
            events=tuple(events),
            learning_fraction=self.baseline.fraction,
            learning=self._learning,
            losses=None if (detectability := self._judged.detectability) is None else detectability.losses,
            questions=self.questions,
        )

    def note_car_speed(self, kmh: int) -> None:
        """Record that a control unit of the car states its speed (OBD-II), 0 to 255 km/h."""
        self._signals.car.note_stated(kmh)

    def car_speed_agreement(self) -> dict[str, Any]:
        """Return whether wheels and receiver agree with the car's own speed, for the status; None: not
        known."""
        received = self._signals.car.received
        return {"wheels_agree": received.wheels, "receiver_agrees": received.receiver}

    def _watch_state(self) -> WatchState:
        """Return the state of the monitor that malfunctions depend on."""
        can_detect = self._since_seen_s <= JUDGE.seen_fresh_s
        return WatchState(
            can_detect, self._sets.undecided, self._configuration.contradiction, self._encoders.losing
        )

    def _judge_now(self, tick: Tick, estimate: RadiusEstimate, elapsed_s: float) -> list[AlarmEvent]:
        """Judge a second of driving, decide on a reset and learn; return the events of alarms."""
        events: list[AlarmEvent] = []
        if math.isinf(estimate.gnss_age_s):
            estimate = self._without_level(estimate)
        trusted = False
        judging = self._sets.comparison_baseline
        if judging.ready:
            changes = judging.changes(estimate, self._judge.nuisance_m2)
            if changes is None:
                return []
            judging.observe(estimate, self._judge.nuisance_m2)
            drive = judging.change_hypotheses(alarm_active=bool(self._active))
            before = judging.change_before(changes[0]), judging.change_before(changes[1])
            others = self._sets.other_tyres
            self._judged = self._judge.judge(*changes, self._resonance, others, drive, before)
            self._since_seen_s = 0.0 if self._judged.contrast_std_m <= self._seen_m else math.inf
            trusted = self._judged.may_learn(judging.settled) and not self._active
            soft_before, min_hold_s = self._first.reported, self._judged.min_hold_s
            for (kind, wheel), alarm in self._alarms.items():
                if wheel in soft_before:
                    alarm.hold_elapsed_s = 0.0
                    continue  # its baseline is that of a tyre that was soft already
                probability = self._probability(kind, wheel)
                possible = float(self._judged.possible[wheel]) if kind is AlarmKind.DEFLATION else None
                transition = alarm.update(probability, elapsed_s, min_hold_s, possible)
                if transition is not None:
                    events.append(self._tyre_event(kind, wheel, transition, probability, tick, estimate))
                    judging.note_transition(self._judged.change_index if transition == "raised" else None)
        events += self._judge_first(tick, estimate, elapsed_s)
        self._update_questions(elapsed_s, tick.host_time_s)
        sound = trusted and not self._encoders.losing  # lost counts look like a larger tyre
        self.baseline.learn(estimate, self._judge.nuisance_m2, sound, elapsed_s)
        if self._sets.decide(estimate) == "accepted":
            self._withdraw_alarms()
        self._learning = self.learning()
        return events

    def _without_level(self, estimate: RadiusEstimate) -> RadiusEstimate:
        """Return the estimate with the level common to all wheels unknown: its variance is raised.

        Before the first fix nothing measures it: an estimator then holds its prior, and small errors of the
        wheels and the gyro that all have one sign move it far in some minutes.
        """
        radius_m = np.array(self._vehicle.wheel_radius_m)
        level_m2 = STATED.unknown_level**2 * np.outer(radius_m, radius_m)
        return estimate._replace(covariance_m2=estimate.covariance_m2 + level_m2)

    def _judge_first(self, tick: Tick, estimate: RadiusEstimate, elapsed_s: float) -> list[AlarmEvent]:
        """Compare the first radii of a car with those of cars in general; return the events of alarms."""
        deviation, spread = estimate.deviation_m[self._wheels], estimate.covariance_m2[self._grid]
        if not (self._sets.is_first_learning(bool(self._first.reported)) and np.isfinite(deviation).all()):
            return []
        events = []
        ordinary = {wheel for (_, wheel), event in self._active.items() if not event.since}
        changed = self._first.changed_axles(self._judged.change_m, ordinary)
        for transition in self._first.update(deviation, spread, elapsed_s, changed):
            pressure, pressure_std = math.nan, math.nan
            if transition.kind is AlarmKind.DEFLATION and transition.state == "raised":
                std = math.sqrt(float(estimate.covariance_m2[transition.wheel, transition.wheel]))
                pressure, pressure_std = self._judge.pressure_loss(transition.wheel, -transition.loss_m, std)
            about = (
                transition.kind,
                transition.wheel,
                transition.state,
                transition.probability,
                transition.reason,
            )
            event = self._event(tick, estimate, *about, (pressure, pressure_std), BEFORE)
            if transition.state == "raised":
                self._active[(transition.kind, transition.wheel)] = event
            else:
                self._active.pop((transition.kind, transition.wheel), None)
                if not self._first.reported:
                    self._sets.restart_baseline()  # what was learned was the soft tyre's radius
            events.append(event)
        return events

    def _update_questions(self, elapsed_s: float, time_s: float) -> None:
        """Update the questions by this second of driving; without the judgement where tyres may be others."""
        if self._sets.is_first_learning(bool(self._first.reported)):
            self._questions.update_first_start(self._first.suspected, elapsed_s)
        found = None if self._sets.other_tyres else self._judged
        self._questions.update(found, elapsed_s, time_s, alarm_active=bool(self._active))

    def _probability(self, kind: AlarmKind, wheel: int) -> float:
        """Return the probability of a deflation or of a deviation of a wheel, by the last judgement."""
        judged = self._judged
        return float((judged.deflated if kind is AlarmKind.DEFLATION else judged.deviates)[wheel])

    def _tyre_event(
        self,
        kind: AlarmKind,
        wheel: int,
        transition: Literal["raised", "cleared"],
        probability: float,
        tick: Tick,
        estimate: RadiusEstimate,
    ) -> AlarmEvent:
        """Return the event of an alarm that is raised or cleared, and add it to the active ones or remove
        it."""
        judged = self._judged
        change, std = float(judged.change_m[wheel]), float(judged.change_std_m[wheel])
        pressure, pressure_std = float(judged.pressure_loss[wheel]), float(judged.pressure_loss_std[wheel])
        since = f"since {self._sets.comparison_baseline.origin}"
        if kind is AlarmKind.DEFLATION:
            reason = (
                f"lost {1e3 * float(judged.loss_m[wheel]):.1f} mm of radius {since}, "
                f"about {100 * pressure:.0f} +- {100 * pressure_std:.0f} % of its pressure "
                f"(probability {probability:.3f})"
            )
            if judged.all_lost and transition == "raised":
                reason += "; all wheels alike: this rests on the receiver's speed alone"
        else:
            reason = f"radius changed by {1e3 * change:+.1f} +- {1e3 * std:.1f} mm {since}"
            if judged.all_larger > JUDGE.undecided and transition == "raised":
                reason += "; all wheels alike: other tyres (then: tpmsd reset --tyres NAME), or the receiver"
        reason = f"no longer so: {reason}" if transition == "cleared" else reason
        event = self._event(
            tick, estimate, kind, wheel, transition, probability, reason, (pressure, pressure_std)
        )
        if transition == "raised":
            self._active[(kind, wheel)] = event
        else:
            self._active.pop((kind, wheel), None)
        return event

    # -- resets ----------------------------------------------------------------------------------------------

    def reset(self, tyres: str | None = None) -> tuple[bool, str]:
        """Learn the radii again, or change to the set `tyres`; return whether it was accepted, and the
        reason."""
        active = [WHEELS[w] for kind, w in self._active if kind is AlarmKind.DEFLATION]
        before = self._sets.baseline
        taken, reason = self._sets.request(tyres, active)
        if taken:
            self._leaks.reset(self._sets.name)
        if self._sets.baseline is not before:
            self._judged = Judgement.unknown()
            for alarm in self._alarms.values():
                alarm.hold_elapsed_s = 0.0
            if self._sets.state == "accepted":
                self._withdraw_alarms()
        self._learning = self.learning()
        return taken, reason

    def _withdraw_alarms(self) -> None:
        """Reset judgement, questions and alarms, as other radii are normal now; active alarms are to be
        announced as withdrawn."""
        self._judged = Judgement.unknown()
        self._questions.close_all()
        self._first.restore_reported(())
        for key, alarm in self._alarms.items():
            alarm.active, alarm.hold_elapsed_s = False, 0.0
            if key in self._active:
                self._taken_back.append(key)

    def _withdrawal_events(self, tick: Tick, estimate: RadiusEstimate) -> list[AlarmEvent]:
        """Return the cleared events of alarms that a reset has withdrawn, and remove these from the active
        ones."""
        events = []
        for kind, wheel in self._taken_back:
            if self._active.pop((kind, wheel), None) is None:
                continue
            reason = f"taken back by a reset: {self._sets.reason}"
            events.append(self._event(tick, estimate, kind, wheel, "cleared", 0.0, reason))
        self._taken_back.clear()
        return events

    # -- reports ---------------------------------------------------------------------------------------------

    def _event(
        self,
        tick: Tick,
        estimate: RadiusEstimate,
        kind: AlarmKind,
        wheel: int,
        state: Literal["raised", "cleared"],
        probability: float,
        reason: str,
        pressure_loss: tuple[float, float] = (math.nan, math.nan),
        since: str = "",
    ) -> AlarmEvent:
        """Return the event of an alarm of a wheel at this moment; `pressure_loss`: share and its standard
        deviation."""
        return AlarmEvent(
            time_s=tick.host_time_s,
            kind=kind,
            wheel=WHEELS[wheel],
            state=state,
            deviation_m=float(estimate.deviation_m[wheel]),
            std_m=_sqrt_or_nan(float(estimate.covariance_m2[wheel, wheel]) + self._scale_m2[wheel]),
            probability=probability,
            reason=reason,
            pressure_loss=pressure_loss[0],
            pressure_loss_std=pressure_loss[1],
            since=since,
        )

    def _wheel_reports(self, tick: Tick, estimate: RadiusEstimate) -> tuple[WheelReport, ...]:
        """Return the report of each of four wheels at a tick."""
        if self._cached[0] is not self._judged:
            self._cached = (self._judged, self._judged.by_wheel())
        watched: Sequence[int] = () if self._signals.unusable else self._signals.recently_valid(tick.time_s)
        sound = WheelState.LEARNING
        if self.baseline.ready and not self._sets.undecided:
            sound = WheelState.MONITORING
        deviation, variance = estimate.deviation_m.tolist(), estimate.covariance_m2.ravel().tolist()[::5]
        states = [sound] * 4
        for _, wheel in self._active:
            states[wheel] = WheelState.ALARM
        if len(watched) < 4 or not math.isfinite(sum(deviation)):
            for wheel, off_m in enumerate(deviation):
                if wheel not in watched or not math.isfinite(off_m):
                    states[wheel] = WheelState.UNAVAILABLE
        std = [_sqrt_or_nan(known + scale) for known, scale in zip(variance, self._scale_m2, strict=True)]
        if not self._trusted:
            deviation = std = [math.nan] * 4
        make, rows = WheelReport._make, zip(WHEELS, states, deviation, std, self._cached[1], strict=True)
        return tuple(
            [make((name, state, off_m, std_m, *stated)) for name, state, off_m, std_m, stated in rows]
        )

    # -- what survives a restart -----------------------------------------------------------------------------

    def snapshot(self) -> dict[str, Any]:
        """Return baselines, active tyre alarms and malfunctions of missing signals as plain numbers."""
        return {
            "sets": self._sets.to_json(),
            "wheels": [WHEELS[i] for i in self._wheels],
            "alarms": [alarm_to_json(e) for key, e in self._active.items() if key not in self._taken_back],
            "leaks": self._leaks.to_json(),
            "malfunctions": self._signals.to_json(),
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore a snapshot; ValueError if it does not fit (then nothing is restored).

        What was learned before is forgotten. Alarms stand again until driving clears them.
        """
        try:
            if saved["wheels"] != [WHEELS[i] for i in self._wheels]:
                raise ValueError("the saved baseline belongs to another set of wheels")
            active = [alarm_from_json(entry, self._alarms) for entry in saved["alarms"]]
            sets = saved["sets"]
            if any(not event.since for event in active) and not (
                sets["baseline"]["ready"] or sets["before"] is not None
            ):
                raise ValueError("the saved alarms have no baseline that they stand against")
            leaks = SlowLeakWatch(self._vehicle, self._tyre, self._wheels)
            if "leaks" in saved:  # states of before have none
                leaks.restore(saved["leaks"])
            signals = SignalWatch(self._settings, self._wheels)
            signals.restore(saved.get("malfunctions", []))  # states of before have none
            self._sets.restore(sets)
        except (KeyError, TypeError, AttributeError, OverflowError) as error:
            raise ValueError(f"the saved monitor is not one: {type(error).__name__}: {error}") from error
        self._leaks, self._signals, self._restored = leaks, signals, True
        self._since_judged_s = 0.0
        self._judged = Judgement.unknown()
        self._active.clear()
        self._taken_back.clear()
        for alarm in self._alarms.values():
            alarm.active, alarm.hold_elapsed_s = False, 0.0
        for event in active:
            key = (event.kind, WHEELS.index(event.wheel or ""))
            self._alarms[key].active = not event.since
            self._active[key] = event
        self._first.restore_reported(key for key, event in self._active.items() if event.since)
        self._learning = self.learning()


def _sqrt_or_nan(variance: float) -> float:
    return math.sqrt(variance) if variance >= 0.0 else math.nan
