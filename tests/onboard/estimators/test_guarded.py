"""The guard around an estimator: what it goes back to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.onboard.monitor.drives import RADIUS_M
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.base import NIGHT_S, RadiusEstimate
from tpmsd.onboard.estimators.gates.agreement import AGREED, Agreement
from tpmsd.onboard.estimators.gates.guarded import KEEP_EVERY_S, GuardedEstimator
from tpmsd.onboard.timeline.tick import Tick

FAR_M = 0.04
"""No estimate may be saved so far from nominal, and one may be so far off for a while: a wheel that spins."""


class Spun:
    """An estimator whose radii have left the bounds of a saved state."""

    def step(self, tick: Tick) -> RadiusEstimate:
        covariance = np.eye(4) * 1e-8
        pose = dict.fromkeys(("yaw_rate_radps", "east_m", "north_m", "heading_rad"), 0.0)
        known = dict.fromkeys(("position_std_m", "heading_std_rad", "gnss_age_s", "effective_particles"), 1.0)
        return RadiusEstimate(
            tick.time_s, np.full(4, FAR_M), covariance, np.ones(4), True, 0.0, speed_mps=20.0, **pose, **known
        )

    def snapshot(self) -> dict[str, Any]:
        return {}

    def restore(self, saved: dict[str, Any], since_s: float = 0.0) -> None:
        raise ValueError("the saved mean_m is not finite or beyond 0.03")


class DisagreesAtTheEnd:
    """An agreement that ends with the last tick."""

    def __init__(self, ticks: int) -> None:
        self.left = ticks

    def update(self, tick: Tick, radius_m: FloatArray, radius_std_m: float) -> Agreement:
        self.left -= 1
        return AGREED if self.left else Agreement(withheld=True, unsteady=False, began=True)


def test_what_cannot_be_taken_up_again_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """A disagreement after radii that left the bounds of a saved state: the estimate is made again, and a
    fault says so."""
    guarded = GuardedEstimator(Spun, [0, 1, 2, 3], np.full(4, RADIUS_M))
    ticks = 3
    monkeypatch.setattr(guarded, "_watch", DisagreesAtTheEnd(ticks))
    faults = []
    for k in range(ticks):
        tick = Tick(k, float(k), KEEP_EVERY_S, np.ones(4), np.full(4, 0.05))
        given, _, _ = guarded.step(tick)
        faults.append([fault.kind for fault in given.faults])
    assert [[], [], ["restarted"]] == faults


class Drifting:
    """An estimator that knows nothing but for how long it was away."""

    def __init__(self) -> None:
        self.away_s: list[float] = []

    def step(self, tick: Tick) -> RadiusEstimate:
        return Spun().step(tick)

    def snapshot(self) -> dict[str, Any]:
        return {}

    def restore(self, saved: dict[str, Any], since_s: float = NIGHT_S) -> None:
        self.away_s.append(since_s)


@pytest.mark.parametrize(("quiet_s", "away_s"), [(25.0, 15.0), (300.0, 80.0)])
def test_a_short_disagreement_is_no_night(
    monkeypatch: pytest.MonkeyPatch, quiet_s: float, away_s: float
) -> None:
    """Radii of before a disagreement are widened by the time since then, not by what a night does."""
    guarded = GuardedEstimator(Drifting, [0, 1, 2, 3], np.full(4, RADIUS_M))
    ticks = round(quiet_s)
    monkeypatch.setattr(guarded, "_watch", DisagreesAtTheEnd(ticks))
    for k in range(ticks):
        guarded.step(Tick(k, float(k), 1.0, np.ones(4), np.full(4, 0.05)))

    assert isinstance(guarded.inner, Drifting)
    assert [away_s] == guarded.inner.away_s


def test_trouble_right_after_the_start_leaves_what_was_taken_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """A disagreement before anything of this start was kept: those of the earlier one are taken up again."""
    guarded = GuardedEstimator(Drifting, [0, 1, 2, 3], np.full(4, RADIUS_M))
    guarded.restore({})
    monkeypatch.setattr(guarded, "_watch", DisagreesAtTheEnd(2))
    first = guarded.inner
    for k in range(2):
        guarded.step(Tick(k, float(k), 1.0, np.ones(4), np.full(4, 0.05)))

    assert isinstance(guarded.inner, Drifting)
    assert first is not guarded.inner
    assert [NIGHT_S] == guarded.inner.away_s
