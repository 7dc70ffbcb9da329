"""A receiver that smooths."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import accelerating, car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_behind_a_steady_acceleration_the_speed_lags_by_the_time_constant() -> None:
    """After t of 2 m/s2 a low-pass of 0.5 s is 1 m/s * (1 - exp(-t / 0.5 s)) behind."""
    motion = accelerating(2.0)
    error = make_effect("gnss_smoothing", time_constant_s=0.5).gnss_speed_error_mps(motion, car())

    assert pytest.approx(-(1.0 - np.exp(-motion.time_s / 0.5)), abs=1e-9) == error


def test_the_course_lags_in_a_bend_equally() -> None:
    """In a bend of 0.1 rad/s to the left the course ends 0.05 rad to the right."""
    error = make_effect("gnss_smoothing", time_constant_s=0.5).gnss_course_error_rad(steady(20.0, 0.1), car())

    assert pytest.approx((0.0, -0.05), abs=1e-6) == (error[0], error[-1])


def test_without_a_time_constant_nothing_is_smoothed() -> None:
    """Zero seconds leave the speed as it is; a short one has the penalty of a better known name."""
    effect = make_effect("gnss_smoothing", time_constant_s=0.0)

    assert [0.0] == sorted(set(effect.gnss_speed_error_mps(accelerating(2.0), car()).tolist()))
    assert type(effect).penalty(0.1) > type(effect).penalty(1.0)
