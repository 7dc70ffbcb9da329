"""Whole drives on which wheels are of another size, and a tyre loses air: nothing hides it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import pytest

from bench.campaigns.onboard.alarms.cases import Group, group
from bench.campaigns.onboard.alarms.play import LegResult, State, replay_leg
from bench.worlds.magic_tyre import Array
from bench.worlds.trips import Loss, drive_leg


@dataclass(frozen=True)
class Learned:
    """A car after two drives in order."""

    group: Group
    state: State
    tyre_k: Array

    def drive(self, **more: Any) -> LegResult:
        """What is said on a third one."""
        base = replace(self.group.healthy[1], start_s=self.group.cases[0].leg.start_s, duration_s=450.0)
        return replay_leg(drive_leg(self.group.car, replace(base, **more), self.tyre_k), self.state)


@pytest.fixture(scope="module")
def learned() -> Learned:
    """A front-driven car of the development half."""
    made = group("development", 701002, 1)
    state: State = {}
    tyre_k = None
    for leg in made.healthy:
        driven = drive_leg(made.car, leg, tyre_k)
        state, tyre_k = replay_leg(driven, state).state, driven.temperature_k
    assert tyre_k is not None
    return Learned(made, state, tyre_k)


@pytest.mark.parametrize(
    ("larger_m", "share"), [((5e-3,) * 4, 0.2), ((9e-3,) * 4, 0.3), ((8e-3, 8e-3, 0.0, 0.0), 0.27)]
)
def test_a_loss_beside_wheels_of_another_size_is_named(
    learned: Learned, larger_m: tuple[float, float, float, float], share: float
) -> None:
    """All four are 1.6 or 2.8 % larger, or the front axle by 8 mm: these wheels deviate within 450 s,
    and a tyre that loses 20 to 30 % after five is named within two, and no other."""
    outcome = learned.drive(seed=501, resized_m=larger_m, losses=(Loss(0, share, 300.0, 10.0),))
    deviating = {said.wheel for said in outcome.raised("radius_deviation")}
    assert {
        wheel for wheel, more in zip(("fl", "fr", "rl", "rr"), larger_m, strict=True) if more
    } == deviating
    assert ["fl"] == [said.wheel for said in outcome.raised("deflation")]
    assert 300.0 < outcome.raised("deflation")[0].time_s < 430.0
