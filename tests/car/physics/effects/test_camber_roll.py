"""Wheels that the body's roll cambers."""

from __future__ import annotations

import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_bends_to_either_side_shrink_all_wheels() -> None:
    """4e-6 s4/m at 4 m/s2 is 0.064 mm, whatever the side."""
    effect = make_effect("camber_roll", coefficient=4e-6)
    for yaw in (0.2, -0.2):
        assert pytest.approx([-6.4e-5] * 4) == effect.radius_change_m(steady(20.0, yaw), car())[0].tolist()
