"""An estimator that is given plausible inputs alone, and that returns finite estimates alone.

In: ticks. Out: for each the tick (with a fault where the estimate broke down), the estimate and the
`Agreement` of wheels and receiver. Where they disagree the fixes are withheld, and the estimator goes back to
what it knew before: what it took in meanwhile was no drive of this car.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.base import NIGHT_S, Estimator, RadiusEstimate, unsound_reason
from tpmsd.onboard.estimators.gates.agreement import Agreement, AgreementWatch
from tpmsd.onboard.sources.events import SourceFault
from tpmsd.onboard.timeline.tick import Tick

KEEP_EVERY_S, KEPT = 10.0, 8
"""Snapshots are kept for 80 s: readings are unsteady for 20 s, fixes off for 5 s, before that shows."""


class _Snapshot(NamedTuple):
    """Knowledge at an instant."""

    at_s: float
    """On the guard's own clock, which counts ticks."""
    snapshot: dict[str, Any]
    radius_m: FloatArray
    """(4,)"""
    std_m: float
    """Root mean square of the wheels'."""


class GuardedEstimator:
    """Wraps the estimator that `make` makes."""

    def __init__(self, make: Callable[[], Estimator], wheels: list[int], radius_m: FloatArray) -> None:
        """`wheels`: indices of those that are estimated; radius_m (4,): nominal."""
        self._make = make
        self._wheels = wheels
        self._nominal = radius_m
        self.inner = make()
        self._watch = AgreementWatch()
        self._kept: deque[_Snapshot] = deque(maxlen=KEPT)
        self._saved: dict[str, Any] | None = None
        """State that an earlier start has left."""
        self._clock_s = self._last_kept_s = 0.0
        self._trusted = True
        self._trusted_radii = (radius_m, 0.01 * float(np.mean(radius_m)))

    def step(self, tick: Tick) -> tuple[Tick, RadiusEstimate, Agreement]:
        """Advance by one tick; return it with faults of the estimator, the estimate, and the agreement."""
        self._clock_s += tick.dt_s
        agreement = self._watch.update(tick, *self._trusted_radii)
        if agreement.trusted != self._trusted:
            unknown = self._restore_trusted()
            if unknown:
                tick = _with_restart_fault(tick, unknown)
            self._trusted = agreement.trusted
        given = replace(tick, fixes=()) if agreement.withheld and tick.fixes else tick
        estimate, reason = self._try_step(given)
        if reason:
            self.inner = self._make()
            self._kept.clear()
            tick = _with_restart_fault(tick, reason)
            estimate, _ = self._try_step(given)
        assert estimate is not None
        if agreement.trusted:
            self._keep_snapshot(estimate)
        return tick, estimate, agreement

    def _try_step(self, tick: Tick) -> tuple[RadiusEstimate | None, str]:
        """Return the estimate of a tick, or None where the step raised, and the reason if it cannot be used,
        else an empty text."""
        try:
            estimate = self.inner.step(tick)
        except (ArithmeticError, ValueError) as error:  # sines of infinity, matrices that have no root
            return None, f"{type(error).__name__}: {error}"
        return estimate, unsound_reason(estimate, self._wheels)

    def _restore_trusted(self) -> str:
        """Restart from the oldest kept snapshot; return the reason if that cannot be restored, else an empty
        text."""
        self.inner = self._make()
        self._last_kept_s = self._clock_s
        if not self._kept:
            if self._saved is not None:
                self.inner.restore(self._saved)
            return ""
        kept = self._kept[0]
        self._kept.clear()
        try:
            self.inner.restore(kept.snapshot, min(self._clock_s - kept.at_s, NIGHT_S))
        except ValueError as error:  # radii that had left all bounds before that showed
            self.inner = self._make()
            return str(error)
        self._kept.append(kept)
        return ""

    def _keep_snapshot(self, estimate: RadiusEstimate) -> None:
        """Keep a snapshot if one is due, and set the radii that wheels and receiver are compared by."""
        if self._clock_s - self._last_kept_s < KEEP_EVERY_S:
            return
        self._last_kept_s = self._clock_s
        radius = self._nominal + np.nan_to_num(estimate.deviation_m)
        wheels = np.ix_(self._wheels, self._wheels)
        std = float(np.sqrt(max(float(np.mean(estimate.covariance_m2[wheels])), 0.0)))
        self._kept.append(_Snapshot(self._clock_s, self.inner.snapshot(), radius, std))
        # The radii of half a minute ago: those of now may have followed a lie already.
        past = self._kept[max(len(self._kept) - 4, 0)]
        self._trusted_radii = (past.radius_m, past.std_m)

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore a snapshot; raises as the estimator's `restore`."""
        self.inner.restore(saved)
        self._saved = saved
        self._kept.clear()


def _with_restart_fault(tick: Tick, reason: str) -> Tick:
    """Return the tick with the fault that the estimator was restarted."""
    return replace(tick, faults=(*tick.faults, SourceFault(tick.time_s, "estimator", "restarted", reason)))
