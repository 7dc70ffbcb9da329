"""Slow leaks: what is learned on a drive must not hide what a tyre loses on it."""

from __future__ import annotations

import json

import pytest

from tests.onboard.monitor.drives import RADIUS_M, Player, monitor, one
from tpmsd.onboard.monitor.records import AlarmKind


def _parked(player: Player) -> None:
    """An hour and more at a standstill: another drive begins."""
    driving_s, player.dt_s = player.dt_s, 10.0
    player.play(4000.0, speed_mps=0.0, informative=False)
    player.dt_s = driving_s


def test_a_leak_of_half_an_hour_is_held_against_the_drives_before() -> None:
    """A tyre that loses a fifth of its pressure on a drive is seen in full: the loss is not learned."""
    player = Player(monitor(), dt_s=2.0, std_m=2.8e-4)
    player.play(600.0, speed_mps=16.0)
    player.play(300.0, speed_mps=24.0)
    _parked(player)
    player.play(180.0, speed_mps=24.0)
    for step in range(25):
        player.play(60.0, one(2, -0.0046 * step / 24), speed_mps=24.0)
    player.play(30.0, one(2, -0.0046), speed_mps=24.0)

    assert -0.0046 * RADIUS_M == pytest.approx(player.last.wheels[2].change_m, abs=2e-4)
    assert [(AlarmKind.DEFLATION, "rl")] == player.active()


def test_what_a_drive_taught_counts_from_the_next_on_unless_it_ended_in_doubt() -> None:
    """Samples of a sound drive are taken over; those of a drive at whose end a tyre may be soft are not."""
    ranges = []
    for change in (0.0, -0.0023):
        player = Player(monitor(), dt_s=2.0)
        player.play(1200.0, speed_mps=16.0)
        _parked(player)
        for step in range(20):
            player.play(60.0, one(2, change * step / 19), speed_mps=24.0)
        _parked(player)
        player.play(2.0)
        ranges.append(sum(player.monitor.baseline.reference.ranges))

    assert 75 <= ranges[0]
    assert ranges[1] <= 60


def test_a_first_impression_that_was_wrong_does_not_end_the_learning() -> None:
    """While the car is learned for the first time, an axle that seems to have lost half a millimetre since
    the first samples is no fault yet."""
    player = Player(monitor(), dt_s=2.0)
    player.play(60.0, (0.0, 0.0, 0.0019, 0.0019), std_m=2e-4)
    player.play(600.0, std_m=2e-4)

    assert 25 <= sum(samples for _, samples in player.monitor.baseline.samples_by_kmh)
    assert [] == player.active()


def test_the_shadow_baseline_survives_a_restart() -> None:
    """What the drive has taught so far is saved with the rest; a state of before has none and is taken up."""
    player = Player(monitor(), dt_s=2.0)
    player.play(500.0, speed_mps=16.0)
    player.play(500.0, speed_mps=24.0)
    saved = json.loads(json.dumps(player.monitor.snapshot()))
    assert saved["sets"]["baseline"]["lessons"] is not None
    other = monitor()
    other.restore(saved)
    assert saved == other.snapshot()
    del saved["sets"]["baseline"]["lessons"], saved["sets"]["baseline"]["doubt"]
    other.restore(saved)
    assert other.snapshot()["sets"]["baseline"]["lessons"] is None
