"""Rear wheels that are steered."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.car.physics.forward import antenna_truth, wheel_rates
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import RL


@pytest.mark.parametrize(("speed", "ratio"), [(5.0, -0.8), (15.0, 0.0), (45.0, 0.8)])
def test_wheels_turn_against_the_bend_when_slow_and_with_it_when_fast(speed: float, ratio: float) -> None:
    """At a third of the crossover (1 - 9) / (1 + 9) of the gain, at three times it as much with it: the path
    of the rear axle leaves the body by that share of the angle that an unsteered rear needs in front."""
    effect = make_effect("rear_axle_steering", gain=0.2, crossover_mps=15.0)
    motion = steady(speed, 0.01 * speed)
    truth = antenna_truth(motion, car(), ExtendedModel((effect,)))
    course = math.atan2(truth.north_mps[0], truth.east_mps[0])

    assert course == pytest.approx(0.2 * ratio * math.atan(2.63 * 0.01), abs=1e-12)


def test_the_rear_wheels_roll_the_length_of_the_path() -> None:
    """Of a path at 0.03 rad to the body a wheel rolls 1 / cos(0.03) of what the body moves forward."""
    effect = make_effect("rear_axle_steering", gain=1.0, crossover_mps=1.0)
    motion, vehicle = steady(40.0, 0.4), car()
    plain = wheel_rates(motion, vehicle, ExtendedModel())[0, RL]
    angle = (1600.0 - 1.0) / 1601.0 * math.atan(2.63 * 0.01)

    assert wheel_rates(motion, vehicle, ExtendedModel((effect,)))[0, RL] / plain == pytest.approx(
        1.0 / math.cos(angle), rel=1e-12
    )


def test_few_cars_have_it_and_none_the_other_sign() -> None:
    """Odds of fifty against it, and of fifty more against rear wheels that turn the wrong way."""
    cls = EFFECTS["rear_axle_steering"]

    assert (cls.penalty(0.1), cls.penalty(-0.1)) == (4.0, 8.0)
    assert not np.any(make_effect("rear_axle_steering", gain=0.2).axle_course_rad(steady(20.0)))


@pytest.mark.parametrize(
    ("speeds", "shows"), [((5.0, 25.0), True), ((4.0, 9.0), True), ((14.0, 14.5), False), ((20.0,), False)]
)
def test_it_takes_bends_over_which_the_angle_changes(speeds: tuple[float, ...], shows: bool) -> None:
    """Slow bends alone show how it turns against the front ones, faster and slower; at one speed it is a
    share of their angle, which an antenna's position is too, and on a straight there is nothing."""
    cls, bends = EFFECTS["rear_axle_steering"], [steady(speed, 0.1) for speed in speeds]
    driven = {
        name: np.concatenate([getattr(bend, name) for bend in bends])
        for name in ("speed_mps", "yaw_rate_radps")
    }

    assert shows == cls.observable(SimpleNamespace(**driven), car())  # type: ignore[arg-type]
    assert not cls.observable(steady(20.0), car())
