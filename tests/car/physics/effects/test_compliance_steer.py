"""A steering that gives way in bends."""

from __future__ import annotations

import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_the_steering_wheel_turns_further_with_lateral_acceleration_alone() -> None:
    """8e-3 rad per m/s2 at 2 m/s2, 15 times geared: 0.24 rad; the same bend at half the speed a quarter."""
    effect = make_effect("compliance_steer", coefficient=8e-3)

    assert pytest.approx(0.24) == effect.steering_error_rad(steady(20.0, 0.1), car())[0]
    assert pytest.approx(0.06) == effect.steering_error_rad(steady(10.0, 0.05), car())[0]
    within = [bool(type(effect).tolerance_note(value, 1e-5, False)) for value in (-2e-3, 2.5e-3, 8e-3)]
    assert [False, True, False] == within
