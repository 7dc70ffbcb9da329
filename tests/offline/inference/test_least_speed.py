"""How slow a second may be to be compared."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.offline.inference.min_speed import INFORMATION, MIN_MPS, TYPICAL_MPS, least_speed


def test_on_the_road_walking_pace_is_left_out() -> None:
    """A tenth of the drive at 3 m/s holds a thousandth of the information of the rest at 25 m/s."""
    assert TYPICAL_MPS == least_speed(np.concatenate([np.full(100, 3.0), np.full(900, 25.0)]))


def test_in_a_car_park_the_slow_seconds_are_the_drive() -> None:
    """Speeds spread evenly up to 6 m/s: the sum of squares above v is 1 - (v / 6)^3 of the whole."""
    expected = 6.0 * (1.0 - INFORMATION) ** (1.0 / 3.0)

    assert pytest.approx(expected, abs=0.01) == least_speed(np.linspace(0.0, 6.0, 6001))


@pytest.mark.parametrize("speeds", [np.full(100, 1.0), np.linspace(0.0, 2.0, 200)])
def test_below_the_pace_at_which_counters_fall_silent_nothing_is_compared(speeds: np.ndarray) -> None:
    """However slow the drive is."""
    assert MIN_MPS == least_speed(speeds)


def test_a_car_that_stands_is_as_any_other() -> None:
    """No way holds no information to share out."""
    assert TYPICAL_MPS == least_speed(np.zeros(10))
