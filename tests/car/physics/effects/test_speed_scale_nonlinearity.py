"""A scale that changes with speed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.car.physics.kinematics import wheel_speeds


def test_the_error_grows_with_speed() -> None:
    """1e-4 s/m at 30 m/s is 0.3 % on every wheel."""
    share = make_effect("speed_scale_nonlinearity", per_mps=1e-4).wheel_slip(steady(30.0), car())[0]

    assert pytest.approx([3e-3] * 4) == share.tolist()


def test_in_a_bend_each_wheel_is_shown_by_its_own_speed() -> None:
    """The inner wheel is slower than the car; by the car's speed the error would tell a wrong track."""
    motion, geometry = steady(10.0, yaw_rate_radps=0.3), car().geometry
    hubs = wheel_speeds(motion.speed_mps, motion.yaw_rate_radps, geometry)
    slip = make_effect("speed_scale_nonlinearity", per_mps=1e-4).wheel_slip(motion, car())

    assert np.allclose(hubs * (1.0 + 1e-4 * hubs), hubs * (1.0 + slip), rtol=1e-12)


def test_a_scale_that_no_bus_has_is_penalised() -> None:
    """Nats by Student's distribution: k of 5e-5 s/m costs half a nat, five times as much costs five."""
    penalty = EFFECTS["speed_scale_nonlinearity"].penalty
    typical, rare = penalty(5e-5) - penalty(0.0), penalty(-2.5e-4) - penalty(0.0)

    assert pytest.approx(2.5 * math.log(1.25)) == typical
    assert pytest.approx(2.5 * math.log(7.25)) == rare
