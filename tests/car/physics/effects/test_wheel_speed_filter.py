"""Wheel speeds that a control unit smooths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.car.physics.motions import GEOMETRY, accelerating, car
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.car.physics.motion import Motion
from tpmsd.foundation.wheels import RL, RR


def test_behind_a_steady_acceleration_speeds_lag_by_the_time_constant() -> None:
    """After t of 2 m/s2 a low-pass of 0.3 s is 0.6 m/s * (1 - exp(-t / 0.3 s)) behind, on every wheel."""
    motion = accelerating(2.0)
    slip = make_effect("wheel_speed_filter", time_constant_s=0.3).wheel_slip(motion, car())
    behind = -0.6 * (1.0 - np.exp(-motion.time_s / 0.3))

    assert slip * motion.speed_mps[:, None] == pytest.approx(np.repeat(behind[:, None], 4, axis=1), abs=1e-9)


def test_the_difference_between_wheels_comes_late_too() -> None:
    """As the car turns in, the difference of the rear wheels is that of the differential equation, solved
    step by step."""
    time = np.arange(0.0, 6.0, 0.01)
    yaw = 0.3 * np.sin(time)
    motion = Motion.from_profiles(time, np.full_like(time, 12.0), yaw, wheelbase_m=GEOMETRY.wheelbase_m)
    effect = make_effect("wheel_speed_filter", time_constant_s=0.5)
    hubs = 12.0 + yaw[:, None] * np.array([-0.76, 0.76])
    shown = hubs * (1.0 + effect.wheel_slip(motion, car())[:, [RL, RR]])
    solved = solve_ivp(
        lambda t, y: (1.52 * 0.3 * np.sin(t) - y) / 0.5, (0.0, 6.0), [0.0], t_eval=time, rtol=1e-9, atol=1e-12
    )

    assert shown[:, 1] - shown[:, 0] == pytest.approx(solved.y[0], abs=2e-5)


def test_a_short_one_is_usual_and_dear() -> None:
    """What control units do for themselves is a note; a dashboard's 0.3 s is a finding."""
    cls = EFFECTS["wheel_speed_filter"]

    assert "0.03 +- 0.01 s" in cls.tolerance_note(0.03, 0.01, True)
    assert cls.tolerance_note(0.3, 0.02, True) == ""
    assert (cls.penalty(0.05), cls.penalty(0.3)) == (10.0, 4.0)
    assert {"speeds", "gnss"} == set(cls.identification.needs)
