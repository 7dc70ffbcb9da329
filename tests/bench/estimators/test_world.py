"""The bench's drive and its instruments, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.worlds.paper_drive import (
    FIX_S,
    K2,
    QUANTUM_RAD,
    RADIUS_M,
    RL,
    RR,
    SCENARIOS,
    STATED_STD_M,
    drive,
    markov,
)
from bench.worlds.paper_route import TRACK_M, paper_route


def test_the_drive_is_twelve_kilometres_in_eighteen_minutes() -> None:
    """As Lundquist et al.'s (2013)."""
    route = paper_route()
    assert pytest.approx(1080.0) == route.time_s[-1]
    assert pytest.approx(12_000.0) == route.rolled_m[-1, [RL, RR]].mean()


def test_rear_wheels_differ_by_turn_times_track() -> None:
    """On any path, the rear wheels of a rigid car do."""
    route = paper_route()
    turned = route.heading_rad - route.heading_rad[0]
    np.testing.assert_allclose(route.rolled_m[:, RR] - route.rolled_m[:, RL], turned * TRACK_M, atol=1e-6)


def test_no_wheel_of_a_rigid_car_rolls_less_than_its_hub_moves() -> None:
    """Front hubs sweep: sqrt((1 -+ k t / 2)^2 + (k L)^2) is never below the rear wheel of their side."""
    rolled = paper_route().rolled_m[-1]
    assert rolled[0] > rolled[RL]
    assert rolled[1] > rolled[RR]


def test_a_count_never_leaves_its_wheel_by_more_than_half_a_count() -> None:
    """The reading error is bounded, and its variance that of a uniform one."""
    error = drive(SCENARIOS["balanced"], "white", 3).reading_rad
    assert float(np.abs(error).max()) <= QUANTUM_RAD / 2 + 1e-9
    assert pytest.approx(QUANTUM_RAD**2 / 12, rel=0.1) == float(error[3000:].var())


def test_rotation_times_true_radius_is_the_distance() -> None:
    """Over the whole drive, to a count and the road's roughness."""
    driven = drive(SCENARIOS["unbalanced"], "white", 1)
    angle = np.sum([tick.rotation_rad for tick in driven.ticks], axis=0)
    distance = angle * (RADIUS_M + driven.offsets_m[0])
    np.testing.assert_allclose(distance, paper_route().rolled_m[-1], atol=0.25)


def test_the_puncture_ends_where_the_paper_says() -> None:
    """-2.5 mm on the right rear wheel from tick 5808 on, half of it at half the way."""
    offsets = drive(SCENARIOS["puncture"], "white", 1).offsets_m
    lost = offsets[:, RR] - offsets[:, RL]
    assert pytest.approx(-1.25e-3, rel=1e-3) == lost[K2 // 2]
    np.testing.assert_allclose(lost[K2:], -2.5e-3, atol=1e-12)


def test_white_errors_are_white_and_of_the_stated_size() -> None:
    """Position errors of neighbouring fixes are uncorrelated."""
    driven = drive(SCENARIOS["balanced"], "white", 5)
    east = np.array(
        [tick.fixes[0].east_m - driven.pose[k + 1, 0] for k, tick in enumerate(driven.ticks) if tick.fixes]
    )
    assert pytest.approx(STATED_STD_M, rel=0.05) == float(east.std())
    assert abs(float(np.corrcoef(east[1:], east[:-1])[0, 1])) < 0.06


def test_correlated_errors_last_for_tens_of_seconds() -> None:
    """Two fixes, 0.2 s apart, share nearly all of their slow error."""
    driven = drive(SCENARIOS["balanced"], "correlated", 5)
    east = np.array(
        [tick.fixes[0].east_m - driven.pose[k + 1, 0] for k, tick in enumerate(driven.ticks) if tick.fixes]
    )
    errors = driven.errors
    slow = errors.slow_m**2
    expected = slow * math.exp(-FIX_S / errors.slow_tau_s) / (slow + errors.white_m**2)
    assert pytest.approx(expected, abs=0.08) == float(np.corrcoef(east[1:], east[:-1])[0, 1])


def test_markov_processes_are_stationary_with_the_memory_asked_for() -> None:
    """Autocorrelation exp(-1) after tau."""
    values = markov(np.random.default_rng(1), 200_000, 0.1, 2.0, 1.0)[:, 0]
    assert pytest.approx(2.0, rel=0.03) == float(values.std())
    assert pytest.approx(math.exp(-1.0), abs=0.03) == float(np.corrcoef(values[10:], values[:-10])[0, 1])


def test_the_same_seed_is_the_same_drive() -> None:
    """All methods play the same data."""
    first, second = (drive(SCENARIOS["lively"], "correlated", 8) for _ in range(2))
    assert first.ticks[4321].fixes == second.ticks[4321].fixes
    np.testing.assert_array_equal(first.offsets_m, second.offsets_m)


def test_an_unknown_receiver_is_refused() -> None:
    """There are two."""
    with pytest.raises(ValueError, match="no receiver"):
        drive(SCENARIOS["balanced"], "perfect", 1)
