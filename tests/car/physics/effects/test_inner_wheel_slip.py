"""The slip of inner wheels in bends."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.car.physics.motions import accelerating, car
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.motion import Motion


def _turning(accel_mps2: float, accel_lat_mps2: float) -> Motion:
    motion = accelerating(accel_mps2)
    return dataclasses.replace(motion, accel_lat_mps2=np.full(len(motion), accel_lat_mps2))


def test_the_slip_of_the_wheel_that_carries_less_is_the_greater() -> None:
    """Slip is force over stiffness times load: at k a_y = 0.14 it is c f / 0.86 inside and c f / 1.14
    outside; half their difference is q f a_y, but for the square of 0.14. At 10 m/s drag and rolling
    resistance are 0.127 m/s2 of f."""
    k, c, a_x, a_y = 0.07, 4e-3, 1.5, 2.0
    force = a_x + 0.127
    effect = make_effect("inner_wheel_slip", driven=c * k)
    slip = effect.wheel_slip(_turning(a_x, a_y), car("rear"))[0]
    inner, outer = c * force / (1.0 - k * a_y), c * force / (1.0 + k * a_y)

    assert [0.0, 0.0] == slip[:2].tolist()
    assert slip[2] == pytest.approx(0.5 * (inner - outer), rel=0.025)
    assert slip[3] == -slip[2]


def test_wheels_that_are_not_driven_slip_under_the_brakes_alone() -> None:
    """Braking in a right turn the right wheel, the inner one, turns slower; speeding up, neither does."""
    effect = make_effect("inner_wheel_slip", free=1e-4)

    braking = effect.wheel_slip(_turning(-2.0, -3.0), car("front"))[0]
    brakes = 1e-4 * (2.0 - 0.127) * 3.0
    assert [0.0, 0.0, brakes, -brakes] == pytest.approx(braking.tolist())
    assert not np.any(effect.wheel_slip(_turning(2.0, -3.0), car("front")))


def test_driven_wheels_slip_less_under_the_brakes_that_all_wheels_share() -> None:
    """Brakes put 40 % of the force on the driven axle, drive force is all theirs: for the same force the
    difference between the wheels is 0.4 times as large, and of the other sign."""
    k, c, a_y = 0.07, 4e-3, 2.0
    effect = make_effect("inner_wheel_slip", driven=c * k, braked=0.4 * c * k)

    driving, braking = (
        effect.wheel_slip(_turning(a_x, a_y), car("rear"))[0] for a_x in (1.5 - 0.127, -1.5 - 0.127)
    )
    assert [0.0, 0.0] == braking[:2].tolist()
    assert (braking[2:] / driving[2:]).tolist() == pytest.approx([-0.4, -0.4])
    assert ("rl", "rr") == effect.acting_wheels(car("rear"), ("braked",))
    assert ("fl", "fr") == effect.acting_wheels(car("rear"), ("free",))
