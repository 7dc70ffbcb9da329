"""Accelerometers that are turned in their mount."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import accelerating, car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_a_turn_about_the_vertical_mixes_the_axes() -> None:
    """Turned by 0.05 rad: 2 m/s2 to the left leak 0.1 forward, 2 m/s2 forward -0.1 to the left."""
    effect = make_effect("accelerometer_tilt", yaw_rad=0.05)

    assert pytest.approx([0.1, 0.0]) == effect.accel_error_mps2(steady(20.0, 0.1), car())[0].tolist()
    assert pytest.approx([0.0, -0.1]) == effect.accel_error_mps2(accelerating(2.0), car())[0].tolist()


def test_pitch_and_roll_are_constants_of_gravity() -> None:
    """Nose up by 30 degrees reads half of gravity forward, the left side up as much to the left."""
    effect = make_effect("accelerometer_tilt", pitch_rad=np.pi / 6, roll_rad=np.pi / 6)

    assert pytest.approx([4.903325] * 2) == effect.accel_error_mps2(steady(0.0), car())[0].tolist()
