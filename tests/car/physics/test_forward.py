"""The forward model without effects: closed forms of straight, circle and slope."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.car.physics.motions import GEOMETRY, accelerating, car, steady
from tpmsd.car.physics.forward import antenna_truth, wheel_angles, wheel_rates
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Motion, driven_mask
from tpmsd.foundation.wheels import FL, FR, RL, RR

ROLLING = ExtendedModel()


def test_on_a_straight_the_angle_is_distance_over_radius() -> None:
    """200 m on 0.316 m wheels are 632.91 rad on each."""
    assert pytest.approx([200 / 0.316] * 4, rel=1e-12) == wheel_angles(steady(20.0), car(), ROLLING)[-1]


def test_acceleration_integrates_exactly() -> None:
    """From 10 m/s at 2 m/s2 for 5 s are 75 m."""
    motion = accelerating(2.0)

    assert pytest.approx(75.0) == motion.distance_m[-1]
    assert pytest.approx(75.0 / 0.316) == wheel_angles(motion, car(), ROLLING)[-1, RL]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_on_a_circle_every_wheel_rolls_its_own_radius(side: float) -> None:
    """On a circle of 25 m a wheel turns as often as its own circle is longer than its circumference."""
    yaw = side * 0.4
    angles = wheel_angles(steady(10.0, yaw, duration_s=10.0), car(), ROLLING)[-1]
    inner_rear, outer_rear = 25.0 - 0.76, 25.0 + 0.76
    inner_front = math.hypot(25.0 - 0.765, GEOMETRY.wheelbase_m)
    outer_front = math.hypot(25.0 + 0.765, GEOMETRY.wheelbase_m)
    left_turn = np.array([inner_front, outer_front, inner_rear, outer_rear])
    expected = left_turn if side > 0 else left_turn[[FR, FL, RR, RL]]

    assert pytest.approx(expected * 4.0 / 0.316) == angles


def test_a_circle_closes_on_the_map() -> None:
    """After one turn to the left the car is back, having been 50 m to its left at half time."""
    time = np.linspace(0.0, 2 * np.pi / 0.4, 5001)
    motion = Motion.from_profiles(
        time, np.full_like(time, 10.0), np.full_like(time, 0.4), wheelbase_m=GEOMETRY.wheelbase_m
    )
    truth = antenna_truth(motion, car(), ROLLING)

    assert pytest.approx((0.0, 0.0), abs=1e-4) == (truth.east_m[-1], truth.north_m[-1])
    assert pytest.approx((0.0, 50.0), abs=1e-3) == (truth.east_m[2500], truth.north_m[2500])


def test_signs_of_a_left_turn() -> None:
    """Yaw rate, lateral acceleration, steering and heading rise; the right wheels are the faster."""
    motion = steady(10.0, 0.3)
    rates = wheel_rates(motion, car(), ROLLING)[0]

    assert (True, True, True) == (
        bool(motion.accel_lat_mps2[0] > 0),
        bool(motion.steering_rad[0] > 0),
        bool(motion.heading_rad[-1] > motion.heading_rad[0]),
    )
    assert (True, True) == (bool(rates[FR] > rates[FL]), bool(rates[RR] > rates[RL]))


def test_steering_is_the_angle_of_the_ackermann_circle() -> None:
    """tan(steering) = wheelbase / radius of the rear axle's circle."""
    assert pytest.approx(math.atan(2.63 / 25.0)) == steady(10.0, 0.4).steering_rad[0]


def test_specific_force_holds_gravity_uphill() -> None:
    """A car that stands or rolls evenly uphill feels g*sin(slope), and no acceleration."""
    motion = steady(20.0, grade_rad=0.1)

    assert pytest.approx(0.0, abs=1e-9) == motion.accel_long_mps2[5]
    assert pytest.approx(9.80665 * math.sin(0.1)) == motion.specific_force_long_mps2[5]


def test_without_effects_a_slope_is_not_seen_by_the_receiver() -> None:
    """The plain rolling model takes the road for flat: 200 m of road are 200 m on the map."""
    assert pytest.approx(200.0) == antenna_truth(steady(20.0, grade_rad=0.1), car(), ROLLING).east_m[-1]


def test_arrays_of_a_motion_must_agree() -> None:
    """A motion whose arrays differ in length is refused, and so is time that stands still."""
    time = np.arange(10) / 10.0
    with pytest.raises(ValueError, match="must have at least two entries and increase"):
        Motion.from_profiles(np.zeros(10), time, time, wheelbase_m=2.6)
    with pytest.raises(ValueError, match=r"motion\.grade_rad has shape \(3,\), time_s has \(10,\)"):
        Motion.from_profiles(time, time, time, wheelbase_m=2.6, grade_rad=np.zeros(3))


@pytest.mark.parametrize(
    ("axle", "mask"),
    [("front", [1, 1, 0, 0]), ("rear", [0, 0, 1, 1]), ("all", [1, 1, 1, 1])],
)
def test_driven_wheels_by_axle(axle: str, mask: list[int]) -> None:
    """The mask follows the order fl fr rl rr."""
    assert mask == driven_mask(axle).astype(int).tolist()
