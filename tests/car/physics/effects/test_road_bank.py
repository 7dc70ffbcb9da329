"""Roads that fall to the side."""

from __future__ import annotations

import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


@pytest.mark.parametrize("yaw", [0.1, -0.1])
def test_gravity_bears_a_share_of_the_force_in_a_bend(yaw: float) -> None:
    """At 2 m/s2 a share of a quarter takes 0.5 m/s2 off the reading, to either side."""
    error = make_effect("road_bank", bank_share=0.25).accel_error_mps2(steady(20.0, yaw), car())[0]

    assert pytest.approx([0.0, -5.0 * yaw]) == error.tolist()


def test_a_crown_reads_as_a_constant() -> None:
    """Two per cent with the left side up are 0.196 m/s2 to the left."""
    error = make_effect("road_bank", crown_rad=0.02).accel_error_mps2(steady(20.0), car())[0]

    assert pytest.approx([0.0, 0.19612], rel=1e-3) == error.tolist()
