"""A steering with another ratio."""

from __future__ import annotations

import math

import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_a_rack_with_a_fifth_more_ratio_reads_a_fifth_more() -> None:
    """On 200 m of radius the road wheels turn by atan(2.63 / 200), the steering wheel 15 times as far."""
    effect = make_effect("steering_ratio_error", ratio=1.2)

    assert 0.0 == effect.steering_error_rad(steady(20.0), car())[0]
    expected = 0.2 * 15.0 * math.atan(2.63 / 200.0)
    assert pytest.approx(expected) == effect.steering_error_rad(steady(20.0, 0.1), car())[0]
