"""A gyro that does not stand upright."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import GEOMETRY, car, steady
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.motion import Motion


def over_crests(amplitude_rad: float) -> Motion:
    """Straight on at 20 m/s; the slope swings once in ten seconds."""
    time = np.arange(3001) / 100.0
    grade = amplitude_rad * np.sin(2.0 * np.pi * time / 10.0)
    return Motion.from_profiles(
        time,
        np.full_like(time, 20.0),
        np.zeros_like(time),
        wheelbase_m=GEOMETRY.wheelbase_m,
        grade_rad=grade,
    )


def test_pitching_over_crests_leaks_into_the_yaw_rate() -> None:
    """An axis tilted by 0.05 rad to the left reads 0.05 of the pitch rate, positive where the nose drops."""
    effect = make_effect("gyro_misalignment", sideways_rad=0.05)
    error = effect.yaw_rate_error_radps(over_crests(0.04), car())

    # The slope falls fastest in the middle of the swing: 0.04 rad * 2 pi / 10 s of pitch.
    assert pytest.approx(0.05 * 0.04 * 2.0 * np.pi / 10.0, rel=1e-3) == error[500]
    assert pytest.approx(-error[500], rel=1e-3) == error[1000]


def test_level_roads_do_not_show_it() -> None:
    """It needs hills, and slopes that are known."""
    cls = type(make_effect("gyro_misalignment", sideways_rad=0.05))

    assert [True, False] == [cls.observable(motion, car()) for motion in (over_crests(0.04), steady(20.0))]
    assert {"yaw_rate", "slopes"} == set(cls.identification.needs)
