"""Malfunctions: signals of wheels and receiver that stay away, and what else keeps monitoring from its work.

In: ticks and their estimates. Out: malfunction events, raised after a time without and cleared after a time
with the signal. A parked car whose bus goes quiet is in order. So is a receiver without a fix in a garage.
Not so one that is unplugged, a bus on which another node sends the wheels' frames, or wheels and a receiver
that disagree on the speed: frozen frames, a frozen receiver, or a DBC of another car.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from tpmsd.car.config.model import MonitorConfig
from tpmsd.foundation.bounds import LARGEST, number
from tpmsd.foundation.wheels import RL, RR, WHEELS
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.gates.agreement import AGREED, Agreement
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind
from tpmsd.onboard.monitor.sampling.car_speed import CarSpeed
from tpmsd.onboard.monitor.settings import SIGNALS
from tpmsd.onboard.timeline.tick import Fix, Tick

DISAGREE = "wheels and receiver disagree on the speed"
NEVER_AGREED = " (is it the right DBC?)"
AGREED_BEFORE = ", on which they agreed before"
_ESTIMATED = 6
"""GGA quality of dead reckoning: independent of no wheel, so it confirms nothing."""


def _finite_or_zero(speed_mps: float) -> float:
    """Return a speed, 0 for an unknown one."""
    return speed_mps if math.isfinite(speed_mps) else 0.0


class ReceiverSpeed:
    """Speed over ground by the receiver alone: its own, or the way between its positions."""

    def __init__(self) -> None:
        self._speed_mps, self._time_s = math.nan, -math.inf
        self._anchor: Fix | None = None

    def update(self, tick: Tick) -> float:
        """Update by one tick; return the present speed (m/s), NaN where it is not known."""
        for fix in tick.fixes:
            if fix.quality == _ESTIMATED:
                continue
            if math.isfinite(fix.speed_mps):
                self._speed_mps, self._time_s = fix.speed_mps, fix.time_s
            else:
                self._update_from_position(fix)
        return self._speed_mps if 0.0 <= tick.time_s - self._time_s <= SIGNALS.speed_fresh_s else math.nan

    def _update_from_position(self, fix: Fix) -> None:
        """Update the speed by the distance between two positions, for receivers that state none."""
        anchor = self._anchor
        if anchor is not None and 0.0 <= fix.time_s - anchor.time_s < SIGNALS.chord_s:
            return
        self._anchor = fix
        if anchor is not None and 0.0 < fix.time_s - anchor.time_s <= 2.0 * SIGNALS.chord_s:
            distance_m = math.hypot(fix.east_m - anchor.east_m, fix.north_m - anchor.north_m)
            self._speed_mps, self._time_s = distance_m / (fix.time_s - anchor.time_s), fix.time_s


class WatchState(NamedTuple):
    """State of the monitor that malfunctions depend on."""

    can_detect: bool
    """True if a soft tyre would be detected."""
    undecided: bool
    """True while a reset waits for its new baseline."""
    contradiction: str = ""
    """Part of the configuration that the drive contradicts; empty if none."""
    losing: Mapping[int, float] = MappingProxyType({})
    """Wheels whose encoder loses counts, and which share of them."""


@dataclass(slots=True)
class _Malfunction:
    """One way in which monitoring can be out of order."""

    reason: str
    wheel: int | None = None
    clear_s: float = math.inf
    """Time in good order that clears it, if that is less than the share of its limit."""
    bad_s: float = 0.0
    good_s: float = 0.0
    raised: AlarmEvent | None = None

    def update(self, bad: bool, good: bool, limit_s: float, tick: Tick) -> list[AlarmEvent]:
        """Update by one tick, which counts as bad, as good or as neither; return the event of its being
        raised or cleared, if any. Bad time up to `limit_s` raises; a tenth of that in good order clears."""
        if not (bad or self.bad_s or self.raised):
            return []  # as nearly always; the time in good order counts from the next bad tick on
        if bad:
            self.bad_s += tick.dt_s
            self.good_s = 0.0
        elif good:
            self.good_s += tick.dt_s
            if self.good_s > SIGNALS.bad_time_reset_s:
                self.bad_s = 0.0
        if self.raised is None and self.bad_s >= limit_s:
            self.raised = self._event("raised", self.reason, tick)
            return [self.raised]
        if self.raised is not None and self.good_s >= min(
            max(SIGNALS.clear_share * limit_s, SIGNALS.min_clear_s), self.clear_s
        ):
            self.raised, self.bad_s = None, 0.0
            return [self._event("cleared", f"over: {self.reason}", tick)]
        return []

    def restore_active(self, time_s: float | None) -> None:
        """Make it active since that time, or inactive (None), as before a restart."""
        self.bad_s = self.good_s = 0.0
        self.raised = None if time_s is None else self._event_at("raised", self.reason, time_s)

    def _event(self, state: Literal["raised", "cleared"], reason: str, tick: Tick) -> AlarmEvent:
        """Return the event of this malfunction at a tick."""
        return self._event_at(state, reason, tick.host_time_s)

    def _event_at(self, state: Literal["raised", "cleared"], reason: str, time_s: float) -> AlarmEvent:
        """Return the event of this malfunction at a host time."""
        wheel = None if self.wheel is None else WHEELS[self.wheel]
        nan = math.nan
        return AlarmEvent(time_s, AlarmKind.MALFUNCTION, wheel, state, nan, nan, 1.0, reason)


class SignalWatch:
    """Watches the wheels' signals, the bus as a whole and the receiver."""

    def __init__(self, settings: MonitorConfig, wheels: Sequence[int]) -> None:
        """`wheels`: indices of the wheels whose signals the bus should have."""
        self._settings = settings
        self._rear = _Malfunction("no usable signal of the rear wheels")
        self._gnss = _Malfunction("no usable fix from the receiver while driving")
        self._unplugged = _Malfunction("the receiver is unplugged or cannot be opened")
        self._spoofed = _Malfunction("another node sends the wheels' frames: they are rejected")
        self._disagree = _Malfunction(DISAGREE)
        self._agreed_s = 0.0
        """Driving (`SIGNALS.driving_mps`) in which wheels and receiver agreed."""
        self._car_differs = _Malfunction("the wheels' speed is far from the car's own (OBD)")
        self._restarted = _Malfunction("the estimate of the radii broke down and is made again")
        self._no_detection = _Malfunction(
            "driving for ten minutes, and no soft tyre would have been seen", None, 10.0
        )
        self._undecided = _Malfunction("a reset waits for its baseline for ten minutes of driving")
        self._unsteady = _Malfunction("the wheels' readings jump again and again: they are rejected")
        self._contradicted = _Malfunction("the drive contradicts the configuration")
        self._last_fix_s = -math.inf
        self._received_s = {"unplugged": -math.inf, "spoofed": -math.inf, "restarted": -math.inf}
        self._receiver = ReceiverSpeed()
        self.car = CarSpeed()
        self._wheels = {
            wheel: _Malfunction(f"no usable signal of wheel {WHEELS[wheel]} while the others turn", wheel)
            for wheel in wheels
        }
        self._losing = {
            wheel: _Malfunction(f"the encoder of wheel {WHEELS[wheel]} loses counts", wheel)
            for wheel in wheels
        }
        inputs = (self._rear, self._gnss, self._unplugged, self._spoofed, self._disagree, self._unsteady)
        own = (self._car_differs, self._restarted, self._no_detection, self._undecided, self._contradicted)
        self._all = (*inputs, *own, *self._wheels.values(), *self._losing.values())
        self._kept = {
            "rear": self._rear,
            "gnss": self._gnss,
            "receiver": self._unplugged,
            "blind": self._no_detection,
        }
        self._kept |= {WHEELS[wheel]: one for wheel, one in self._wheels.items()}
        """That outlast a restart, by name."""
        self._blinding = (self._rear, self._disagree, self._unsteady, self._restarted, self._contradicted)
        """Those by which no wheel at all is watched."""
        self._stationary = False
        self._bus_down = False
        self._last_valid_s = dict.fromkeys(wheels, -math.inf)

    @property
    def active(self) -> tuple[AlarmEvent, ...]:
        """The active malfunctions, each as it was raised."""
        return tuple([m.raised for m in self._all if m.raised is not None])

    def to_json(self) -> list[dict[str, Any]]:
        """Return the active malfunctions of missing signals, which the next start has to show at once (UN
        R141); they are cleared as ever, with the signal."""
        return [
            {"of": name, "time_s": one.raised.time_s}
            for name, one in self._kept.items()
            if one.raised is not None
        ]

    def restore(self, saved: list[dict[str, Any]]) -> None:
        """Make the saved malfunctions active, and no other of their kind. ValueError, KeyError or TypeError
        (nothing restored) if they are not of this car."""
        times = {
            str(entry["of"]): number(entry["time_s"], -LARGEST, LARGEST, "time") for entry in list(saved)
        }
        if unknown := times.keys() - self._kept.keys():
            raise ValueError(f"the saved malfunction of {min(unknown)} is not one of this car")
        for name, one in self._kept.items():
            one.restore_active(times.get(name))

    def recently_valid(self, time_s: float) -> list[int]:
        """Return the wheels of which there was a usable signal within the time that a malfunction takes."""
        limit_s = self._settings.malfunction_s
        return [wheel for wheel, valid_s in self._last_valid_s.items() if not time_s - valid_s > limit_s]

    @property
    def unusable(self) -> bool:
        """True while a malfunction is active by which no wheel at all is watched."""
        return any([m.raised is not None for m in self._blinding])  # noqa: C419 - a list is faster

    def update(
        self,
        tick: Tick,
        estimate: RadiusEstimate,
        watching: WatchState,
        agreement: Agreement = AGREED,
    ) -> list[AlarmEvent]:
        """Update all malfunctions by one tick; return those that it raised or cleared."""
        # Plain numbers: for four of them numpy takes ten times as long, and this is asked every tick.
        turned = tick.rotation_rad.tolist()
        valid = [math.isfinite(angle) for angle in turned]
        moving = estimate.speed_mps > SIGNALS.moving_mps
        rear = valid[RL] and valid[RR]
        self._update_signals(tick, valid, rear and not moving, rear)
        receiver_mps = self._receiver.update(tick)
        car = self.car.update(tick.time_s, estimate.speed_mps if rear else math.nan, receiver_mps)
        # A parked car's bus goes quiet: nothing is wrong, unless the interface itself is gone.
        parked = self._stationary and car.min_mps < SIGNALS.moving_mps
        asleep = True not in valid and parked and not self._bus_down
        limit_s = self._settings.malfunction_s
        events = self._rear.update(not rear and not asleep, rear, limit_s, tick)
        events += self._update_fixes(tick, estimate, not rear or agreement.withheld, moving)
        events += self._update_faults(tick)
        fastest_mps = max(_finite_or_zero(estimate.speed_mps), _finite_or_zero(receiver_mps), car.min_mps)
        driving = fastest_mps > SIGNALS.driving_mps
        events += self._update_own(watching, driving, tick)
        compared = self._compare_speeds(rear, estimate.speed_mps, receiver_mps)
        events += self._update_disagreement(compared, agreement, driving, car.agreement_note, tick)
        # Against wheels and receiver together it is outvoted.
        differs = car.wheels is False and car.receiver is not False
        events += self._car_differs.update(differs, car.wheels is True, limit_s, tick)
        events += self._unsteady.update(agreement.unsteady, not agreement.unsteady, limit_s, tick)
        return events + self._update_wheels(turned, valid, watching.losing, tick)

    def _update_signals(self, tick: Tick, valid: list[bool], stationary: bool, rear: bool) -> None:
        """Record which wheels have a valid signal, whether the car is stationary, and whether the bus is
        down."""
        for wheel in self._wheels:
            if valid[wheel]:
                self._last_valid_s[wheel] = tick.time_s
        if rear:
            self._stationary = stationary
        if True in valid:
            self._bus_down = False
        elif any(fault.kind == "down" and fault.source == "can" for fault in tick.faults):
            self._bus_down = True

    def _update_fixes(
        self, tick: Tick, estimate: RadiusEstimate, own: bool, moving: bool
    ) -> list[AlarmEvent]:
        """Update the malfunction of missing fixes; return its events. `own`: the estimator uses none (without
        the rear wheels, or while they are withheld), so the receiver's own silence counts."""
        if any(math.isfinite(fix.east_m) for fix in tick.fixes):
            self._last_fix_s = tick.time_s
        age_s = tick.time_s - self._last_fix_s if own else estimate.gnss_age_s
        stale = age_s > SIGNALS.gnss_fresh_s
        return self._gnss.update(stale and moving, not stale, self._settings.gnss_malfunction_s, tick)

    def _update_own(self, watching: WatchState, driving: bool, tick: Tick) -> list[AlarmEvent]:
        """Update the malfunctions of the monitor itself; return their events."""
        can_detect, undecided, wrong = watching.can_detect, watching.undecided, bool(watching.contradiction)
        events = self._no_detection.update(
            driving and not can_detect, can_detect, SIGNALS.no_detection_s, tick
        )
        events += self._undecided.update(driving and undecided, not undecided, SIGNALS.no_detection_s, tick)
        if wrong:
            self._contradicted.reason = f"the drive contradicts the configuration: {watching.contradiction}"
        return events + self._contradicted.update(wrong, not wrong, SIGNALS.at_once_s, tick)

    def _update_wheels(
        self, turned: list[float], valid: list[bool], losing: Mapping[int, float], tick: Tick
    ) -> list[AlarmEvent]:
        """Update the malfunctions of wheels without a signal while others turn, and of encoders; return their
        events."""
        events: list[AlarmEvent] = []
        limit_s = self._settings.malfunction_s
        turning = any(angle > SIGNALS.turning_rad for angle in turned)  # false for NaN
        for wheel, malfunction in self._wheels.items():
            events += malfunction.update(not valid[wheel] and turning, valid[wheel], limit_s, tick)
        if losing or any(one.raised for one in self._losing.values()):
            events += self._update_encoders(losing, tick)
        return events

    def _update_disagreement(
        self,
        compared: tuple[bool, bool],
        agreement: Agreement,
        driving: bool,
        agreement_note: str,
        tick: Tick,
    ) -> list[AlarmEvent]:
        """Update the malfunction of wheels and receiver that state different speeds; return its events.
        `compared`: whether both are known, and agree."""
        known, good = compared
        # While they recover they agree: a receiver's burst ends with it, and not with the fixes' return.
        apart = (known and not good) or (agreement.withheld and not agreement.recovering)
        good = known and good and not agreement.withheld
        if good and driving:
            self._agreed_s += tick.dt_s
        cause = AGREED_BEFORE if self._agreed_s >= SIGNALS.agreed_s else NEVER_AGREED
        self._disagree.reason = DISAGREE + cause + agreement_note
        return self._disagree.update(apart, good, self._settings.malfunction_s, tick)

    def _update_encoders(self, losing: Mapping[int, float], tick: Tick) -> list[AlarmEvent]:
        """Update the malfunctions of encoders, with the share of counts that each of `losing` loses; return
        their events."""
        events: list[AlarmEvent] = []
        for wheel, malfunction in self._losing.items():
            bad = wheel in losing
            if bad:
                percent = 100.0 * losing[wheel]
                malfunction.reason = (
                    f"the encoder of wheel {WHEELS[wheel]} loses {percent:.2f} % of its counts: "
                    "the ripple of its ring comes after fewer than that of the other wheel"
                )
            events += malfunction.update(bad, not bad, SIGNALS.at_once_s, tick)
        return events

    def _update_faults(self, tick: Tick) -> list[AlarmEvent]:
        """Update the malfunctions that the inputs report of themselves; return their events."""
        events: list[AlarmEvent] = []
        for fault in tick.faults:
            if fault.kind in self._received_s:
                self._received_s[fault.kind] = tick.time_s
        for kind, malfunction in (("unplugged", self._unplugged), ("spoofed", self._spoofed)):
            bad = tick.time_s - self._received_s[kind] <= max(SIGNALS.fault_fresh_s, tick.dt_s)
            events += malfunction.update(bad, not bad, self._settings.malfunction_s, tick)
        broke = self._received_s["restarted"] == tick.time_s
        good = tick.time_s - self._received_s["restarted"] > self._settings.malfunction_s
        events += self._restarted.update(broke, good, SIGNALS.at_once_s, tick)
        return events

    @staticmethod
    def _compare_speeds(rear: bool, wheels_mps: float, receiver_mps: float) -> tuple[bool, bool]:
        """Return whether both speeds are known, and whether they agree."""
        known = rear and math.isfinite(receiver_mps + wheels_mps)
        apart = abs(wheels_mps - receiver_mps)
        limit = (
            max(SIGNALS.disagree_mps, SIGNALS.disagree_share * max(abs(wheels_mps), receiver_mps))
            if known
            else 0.0
        )
        return known, apart <= limit
