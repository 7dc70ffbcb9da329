"""Brakes that make wheels slip."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import accelerating, car
from tpmsd.car.physics.catalogue import make_effect


def test_wheels_turn_slower_under_the_brakes_alone() -> None:
    """At -2 m/s2, 2e-3 s2/m in front and 1e-3 at the rear are 0.4 % and 0.2 %; speeding up, none."""
    effect = make_effect("brake_slip", front=2e-3, rear=1e-3)

    assert (
        pytest.approx([-4e-3, -4e-3, -2e-3, -2e-3])
        == effect.wheel_slip(accelerating(-2.0), car())[0].tolist()
    )
    assert [0.0] * 4 == np.abs(effect.wheel_slip(accelerating(2.0), car())[0]).tolist()


def test_free_wheels_turn_without_force_until_the_brakes_begin() -> None:
    """Drag slows a car down by 0.2 m/s2: at -2 m/s2 the brakes do the other 1.8, at -0.1 nothing."""
    effect = make_effect("brake_slip", front=2e-3, rear=1e-3, from_mps2=0.2)

    assert (
        pytest.approx([-3.6e-3, -3.6e-3, -1.8e-3, -1.8e-3])
        == effect.wheel_slip(accelerating(-2.0), car())[0].tolist()
    )
    assert [0.0] * 4 == np.abs(effect.wheel_slip(accelerating(-0.1), car())[0]).tolist()
