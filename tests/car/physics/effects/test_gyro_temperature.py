"""A zero that goes with the temperature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_the_zero_goes_with_the_temperature_on_the_bus() -> None:
    """1e-4 rad/s per K is 1e-3 rad/s at 10 K above the trim, and nothing where no temperature is known."""
    effect = make_effect("gyro_temperature", per_kelvin=1e-4)
    motion = steady(20.0)
    warm = replace(motion, measured={"temperature": np.full(len(motion), 303.15)})

    np.testing.assert_allclose(effect.yaw_rate_error_radps(warm, car()), 1e-3)
    np.testing.assert_array_equal(effect.yaw_rate_error_radps(motion, car()), 0.0)
