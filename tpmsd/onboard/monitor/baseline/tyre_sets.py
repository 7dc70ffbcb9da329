"""Sets of tyres, each with its own baseline, and resets that a soft tyre cannot pass.

In: requests to learn again. Out: the baseline that counts, and what became of the request.

A reset keeps the baseline before it until the new one is ready. Then the radii are held against the old one:
a tyre that was soft when the driver pressed the button is found, the reset is refused and the old baseline
counts again (UN R141 forbids learning at low pressure; it is the field's best-known misuse). A set that was
learned before needs no learning: its baseline is taken up as it is.
"""

from __future__ import annotations

import re
from typing import Any, Literal

from tpmsd.car.config.model import VehicleConfig
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.alarms.judge import Judge
from tpmsd.onboard.monitor.baseline.baseline import TyreSetBaseline
from tpmsd.onboard.monitor.baseline.set_signal import DEFAULT_SET, SetSignal
from tpmsd.onboard.monitor.records import LearningReport
from tpmsd.onboard.monitor.settings import FIRST_START, TYRE_SETS
from tpmsd.onboard.timeline.tick import Tick

NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,23}")
"""Names of sets: they go into files, sentences and JSON."""


TOO_MANY = "too many resets in a short time: ask again later, in ten minutes at most"

ResetState = Literal["none", "learning", "accepted", "refused"]


class TyreSets:
    """The baselines of one car."""

    def __init__(self, vehicle: VehicleConfig, wheels: list[int], learn_s: float, judge: Judge) -> None:
        self._vehicle = vehicle
        self._wheels = wheels
        self._learn_s = learn_s
        self._judge = judge
        self.name = DEFAULT_SET
        self.baseline = self._new_baseline()
        self._others: dict[str, dict[str, Any]] = {}
        self._before: TyreSetBaseline | None = None
        self._name_before = DEFAULT_SET
        self.mounted = SetSignal()
        """Set of tyres that the car itself states."""
        self.state: ResetState = "none"
        self.reason = ""
        self._requests = 0
        self._allowance = TYRE_SETS.allowance

    def _new_baseline(self) -> TyreSetBaseline:
        return TyreSetBaseline(self._vehicle, self._wheels, self._learn_s)

    def update(self, tick: Tick, estimate: RadiusEstimate) -> None:
        """Update the baselines by a tick, and refill the allowance of resets."""
        self._allowance = min(self._allowance + TYRE_SETS.refill_per_s * tick.dt_s, TYRE_SETS.allowance)
        self.baseline.update(tick, estimate)
        if self._before is not None:
            self._before.update(tick, estimate)

    def request(self, name: str | None, announced: list[str]) -> tuple[bool, str]:
        """Request to learn again, or to change to the set `name`; return whether it was accepted, and the
        reason.

        `announced`: wheels for which a deflation is announced now. To ask for the set that is being learned
        changes nothing: else whoever asks every minute keeps the car unlearned.
        """
        wanted = self.name if name is None else name
        if self.undecided:
            if wanted == self.name:
                self._requests += 1
                return True, self.reason
            if self._allowance < TYRE_SETS.cost_other:
                return False, TOO_MANY
        taken = self._process_request(name, announced)
        return taken, self.reason

    def _process_request(self, name: str | None, announced: list[str]) -> bool:
        """Count a request and begin its baseline unless something forbids it; return whether it was begun."""
        self._requests += 1
        wanted = self.name if name is None else name
        cost = TYRE_SETS.cost_same if wanted == self.name else TYRE_SETS.cost_other
        why = self._refusal_reason(wanted, announced, cost)
        if why:
            return self._refuse(why)
        self._allowance -= cost
        self._begin_set(wanted)
        return True

    def _refusal_reason(self, wanted: str, announced: list[str], cost: float) -> str:
        """Return the reason to refuse a reset to this set; empty if there is none."""
        if NAME.fullmatch(wanted) is None:
            return f"{wanted!r:.40} is no name of a set of tyres (a-z 0-9 _ -, at most 24)"
        if announced and wanted == self.name:
            what = f"the alarm of {' '.join(announced)} is active"
            return f"{what}: inflate the tyre and drive on until it is cleared"
        known = wanted == self.name or wanted in self._others
        if not known and len(self._others) + 1 >= TYRE_SETS.max_sets:
            return f"{TYRE_SETS.max_sets} sets of tyres are kept already"
        return TOO_MANY if self._allowance < cost else ""

    def _begin_set(self, wanted: str) -> None:
        """Begin a baseline of this set, or restore the one it has; the one before is kept for comparison."""
        # Asked again before the first was decided: what was known before both still counts.
        undecided = self._before is not None
        before = self._before or self.baseline
        name_before = self._name_before if undecided else self.name
        if name_before != wanted and before.ready:
            self._others[name_before] = before.to_json()
        saved = self._others.pop(wanted, None) if wanted != self.name else None
        fresh = self._new_baseline()
        if saved is not None:
            fresh.restore(saved)
        fresh.copy_conditions(self.baseline)
        self.baseline, self.name = fresh, wanted
        known = saved is not None and fresh.ready
        self._before = None if known or not before.ready else before
        self._name_before = name_before
        if known:
            self.state, self.reason = "accepted", f"changed to {wanted}, as learned before"
        elif self._before is None:
            self.state, self.reason = "accepted", f"learning {wanted} again"
        else:
            self.state = "learning"
            self.reason = f"learning {wanted} again; it will be compared with what was normal before"

    def _refuse(self, why: str) -> bool:
        """Record that the reset is refused; return False."""
        self.state, self.reason = "refused", f"reset refused: {why}"
        return False

    def decide(self, estimate: RadiusEstimate) -> ResetState | None:
        """Decide on a reset once its new baseline is ready: accept, or refuse and restore the one before.
        Return the decision if it was made in this call, else None."""
        if self._before is None or not self.baseline.ready:
            return None
        changes = self._before.changes(estimate, self._judge.nuisance_m2)
        if changes is None:
            return None
        soft = self._judge.soft_probability_at_reset(changes[0], self.name != self._name_before)
        named = [WHEELS[w] for w in self._wheels if soft[w] >= TYRE_SETS.soft_probability]
        before, self._before = self._before, None
        if not named:
            self.state, self.reason = "accepted", f"{self.name} is learned again"
            return self.state
        if self.name != self._name_before:
            self._others.pop(self._name_before, None)
        self.baseline, self.name = before, self._name_before
        loss = ", ".join(f"{1e3 * x:+.1f} mm" for x in self._values_of(named, changes[0].change_m))
        self._refuse(f"{' '.join(named)} had a smaller radius than before ({loss}): inflate and ask again")
        return self.state

    def _values_of(self, named: list[str], values: FloatArray) -> list[float]:
        """Return the values (d,) of the named wheels, as a list."""
        return [float(values[self._wheels.index(WHEELS.index(wheel))]) for wheel in named]

    @property
    def undecided(self) -> bool:
        """True while a reset waits for its new baseline."""
        return self._before is not None

    def is_first_learning(self, reported: bool) -> bool:
        """Return whether these tyres have never been compared with others: no reset yet, and either they are
        being learned for the first time, or one was `reported` then. Calibrated tyres have been."""
        if self.baseline.calibrated:
            return False
        early = self.baseline.learned_s < FIRST_START.first_s
        driven = self.baseline.ready or self.baseline.learned_s >= self._learn_s
        return self.state == "none" and driven and (early or reported)

    def restart_baseline(self) -> None:
        """Discard the active baseline, learned on a deflated tyre, and learn a new one."""
        fresh = self._new_baseline()
        fresh.copy_conditions(self.baseline)
        self.baseline = fresh

    @property
    def comparison_baseline(self) -> TyreSetBaseline:
        """Baseline that changes are computed against: while a reset is undecided the one before it."""
        return self.baseline if self._before is None else self._before

    @property
    def other_tyres(self) -> bool:
        """True if the tyres on the car may be others than those of `comparison_baseline`."""
        return self._before is not None and self.name != self._name_before

    def report(self) -> LearningReport:
        """Return the state of learning, for status and reports."""
        return LearningReport(
            tyres=self.name,
            sets=tuple(sorted({self.name, *self._others})),
            learned_s=self.baseline.learned_s,
            samples_by_kmh=self.baseline.samples_by_kmh,
            reset=self.state,
            reset_reason=self.reason,
            resets=self._requests,
        )

    # -- what survives a restart -----------------------------------------------------------------------------

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers for the state file."""
        return {
            "tyres": self.name,
            "baseline": self.baseline.to_json(),
            "others": {name: dict(saved) for name, saved in self._others.items()},
            "before": None if self._before is None else self._before.to_json(),
            "tyres_before": self._name_before,
            "reset": self.state,
            "reset_reason": self.reason,
            "allowance": self._allowance,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore what `to_json` returned; ValueError (nothing restored) if it does not fit."""
        try:
            names = [saved["tyres"], saved["tyres_before"], *saved["others"]]
            state, reason = saved["reset"], str(saved["reset_reason"])[: TYRE_SETS.max_reason_chars]
            baseline = self._baseline_from_json(saved["baseline"])
            others = {
                name: self._baseline_from_json(entry).to_json() for name, entry in saved["others"].items()
            }
            before = None if saved["before"] is None else self._baseline_from_json(saved["before"])
            allowance = _checked_allowance(saved.get("allowance", TYRE_SETS.allowance))
        except (KeyError, TypeError, AttributeError, OverflowError) as error:
            raise ValueError(f"the saved sets of tyres are none: {error}") from error
        if not all(isinstance(name, str) and NAME.fullmatch(name) for name in names):
            raise ValueError("a saved set of tyres has no name")
        if state not in ("none", "learning", "accepted", "refused") or len(others) >= TYRE_SETS.max_sets:
            raise ValueError("the saved sets of tyres are none")
        self.name, self._name_before = names[0], names[1]
        self.baseline, self._others, self._before = baseline, others, before
        self.state, self.reason = state, reason
        self._allowance = allowance

    def _baseline_from_json(self, saved: dict[str, Any]) -> TyreSetBaseline:
        out = self._new_baseline()
        out.restore(saved)
        return out


def _checked_allowance(saved: object) -> float:
    """Return the saved allowance of resets, which a restart does not refill; ValueError beyond its bounds."""
    if (
        isinstance(saved, bool)
        or not isinstance(saved, int | float)
        or not 0.0 <= saved <= TYRE_SETS.allowance
    ):
        raise ValueError("the saved ration of resets is none")
    return float(saved)
