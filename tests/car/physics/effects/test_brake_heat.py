"""Brakes that warm an axle."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import accelerating, car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_the_energy_of_a_stop_is_what_warms() -> None:
    """From 20 to 10 m/s at -2 m/s2 are 150 m2/s2: with slow cooling 0.105 mm in front, none at the rear."""
    effect = make_effect("brake_heat", wheels="front", growth=7e-7, cooling_s=1e5, soak_s=0.0)
    change = effect.radius_change_m(accelerating(-2.0, 20.0, 5.0), car())[-1]

    assert pytest.approx([1.05e-4, 1.05e-4, 0.0, 0.0], rel=3e-3) == change.tolist()


def test_heat_tends_to_power_times_the_time_constant() -> None:
    """Down a slope of 0.05 rad at 20 m/s for five time constants: g sin(0.05) * 20 * tau, and 0.7 % less."""
    effect = make_effect("brake_heat", wheels="rl", growth=1e-6, cooling_s=2.0, soak_s=0.0)
    change = effect.radius_change_m(steady(20.0, grade_rad=-0.05), car())[-1, 2]

    assert (
        pytest.approx(1e-6 * 9.80665 * np.sin(0.05) * 20.0 * 2.0 * (1.0 - np.exp(-5.0)), rel=2e-3) == change
    )


def test_a_disc_gives_its_heat_to_the_tyre_within_a_time_of_its_own() -> None:
    """Constant power for T from the start: two first-order lags in a row, in closed form."""
    cooling_s, soak_s, at_s = 3.0, 1.0, 5.0
    effect = make_effect("brake_heat", wheels="rl", growth=1e-6, cooling_s=cooling_s, soak_s=soak_s)
    motion = steady(20.0, grade_rad=-0.05)
    change = np.interp(at_s, motion.time_s, effect.radius_change_m(motion, car())[:, 2])
    lags = np.exp(-at_s / cooling_s) * cooling_s - np.exp(-at_s / soak_s) * soak_s
    power = 9.80665 * np.sin(0.05) * 20.0

    assert change == pytest.approx(1e-6 * power * cooling_s * (1.0 - lags / (cooling_s - soak_s)), rel=0.02)
