"""A brake that does not let go."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.car.physics.motions import accelerating, car, steady
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.foundation.wheels import RR


def test_the_wheel_grows_and_drags_more_as_it_warms_up() -> None:
    """At 20 m/s for two time constants: cold drag times 1.865, and 0.5 m * 1e-3 * 0.865 of radius."""
    effect = make_effect("brake_drag", wheel="rr", slip=1e-3, cooling_s=5.0)
    motion, warm = steady(20.0), 1.0 - math.exp(-2.0)

    assert effect.wheel_slip(motion, car())[-1] == pytest.approx(
        [0.0, 0.0, 0.0, -1e-3 * (1.0 + warm)], rel=2e-3
    )
    assert effect.radius_change_m(motion, car())[-1, RR] == pytest.approx(5e-4 * warm, rel=3e-3)
    assert effect.wheel_slip(motion, car())[0, RR] == pytest.approx(-1e-3, rel=2e-3)


def test_the_warmth_follows_the_speed() -> None:
    """Speeding up, it is what a solver of differential equations says."""
    effect = make_effect("brake_drag", wheel="fl", slip=1e-3, cooling_s=3.0, growth_m=1.0)
    motion = accelerating(1.5)
    solved = solve_ivp(
        lambda t, h: ((10.0 + 1.5 * t) / 20.0 - h) / 3.0, (0.0, 5.0), [0.0], t_eval=motion.time_s, rtol=1e-9
    )

    change = effect.radius_change_m(motion, car())[:, 0]
    assert change == pytest.approx(1e-3 * solved.y[0], abs=4e-6)
    assert not np.any(effect.radius_change_m(motion, car())[:, 1:])


def test_few_brakes_drag_and_none_pushes() -> None:
    """Odds of fifty against it, and of fifty more against a negative one."""
    cls = EFFECTS["brake_drag"]

    assert (cls.penalty(1e-3), cls.penalty(-1e-3)) == (4.0, 8.0)
    assert cls.identification.wheel_patterns == ("fl", "fr", "rl", "rr")
