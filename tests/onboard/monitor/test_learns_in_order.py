"""A baseline learns from tyres in order, and from no others."""

from __future__ import annotations

import pytest

from tests.onboard.monitor.drives import RADIUS_M, Player, monitor, one
from tpmsd.onboard.monitor.records import AlarmKind


def driven(minutes: int = 4) -> Player:
    player = Player(monitor(), dt_s=2.0)
    player.play(60.0 * minutes)
    assert player.monitor.baseline.ready
    return player


def samples(player: Player) -> int:
    """Samples that the baseline has learned from."""
    return sum(count for _, count in player.monitor.baseline.samples_by_kmh)


def test_nothing_is_learned_while_an_alarm_stands() -> None:
    """Radii that are as learned again are not learned from before the alarm is cleared; then they are."""
    player = driven()
    player.play(40.0, one(2, -0.02))
    assert (AlarmKind.DEFLATION, "rl") in player.active()
    player.play(10.0)
    before = samples(player)
    player.play(45.0)
    assert (AlarmKind.DEFLATION, "rl") in player.active()
    assert before == samples(player)
    player.play(60.0)
    assert [] == player.active()
    assert before < samples(player)


def test_a_loss_just_short_of_an_alarm_is_not_learned() -> None:
    """A tyre that may have lost 0.2 %, less than the threshold of 0.25 %, does not become normal."""
    player = driven(minutes=9)
    player.play(540.0, speed_mps=26.0)
    assert player.monitor.baseline.settled
    before = samples(player)
    player.play(400.0, one(3, -0.0022), speed_mps=26.0)
    assert [] == player.active()
    assert before == samples(player)
    # The baseline also expects a tyre that has warmed up to be 0.2 to 0.4 mm larger.
    assert player.last.wheels[3].change_m < -0.0022 * RADIUS_M + 1e-4


def test_radii_as_learned_refine_the_baseline() -> None:
    """Without a suspicion there is a sample every 20 s, also after the first learning."""
    player = driven(minutes=10)
    before = samples(player)
    player.play(600.0, speed_mps=26.0)
    assert player.monitor.baseline.settled
    assert 30 == pytest.approx(samples(player) - before, abs=1)
