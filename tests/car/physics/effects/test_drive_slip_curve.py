"""Slip that saturates with force."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import accelerating, car, steady
from tpmsd.car.physics.catalogue import make_effect


def dugoff_force(slip: float, stiffness: float, grip: float) -> float:
    """The tyre's force at a slip: Dugoff, Fancher and Segel, 1970, without side force."""
    least = grip / (2.0 * stiffness * slip)
    return stiffness * slip * (least * (2.0 - least) if least < 1.0 else 1.0)


@pytest.mark.parametrize("accel", [0.5, 1.2, 2.0])
def test_the_slip_is_what_dugoffs_tyre_needs_for_the_force(accel: float) -> None:
    """Put into the tyre's own curve, the slip of the driven wheels gives the force back."""
    effect = make_effect("drive_slip_curve", slip_per_accel=4e-3, saturation_mps2=2.6)
    slip = effect.wheel_slip(accelerating(accel), car())[100]

    assert [slip[0], slip[0], 0.0, 0.0] == slip.tolist()
    assert pytest.approx(accel) == dugoff_force(slip[0], stiffness=1.0 / 4e-3, grip=2.6)


def test_it_is_odd_and_continuous_and_bounded() -> None:
    """Braking mirrors driving; the two branches meet at half the grip; beyond the grip the slip stays."""
    effect = make_effect("drive_slip_curve", slip_per_accel=4e-3, saturation_mps2=2.6)
    at = [effect.wheel_slip(accelerating(a, 30.0, 2.0), car())[50, 0] for a in (1.299, 1.301, -1.301, 3, 9)]

    assert pytest.approx(4e-3 * 1.3, rel=2e-3) == at[0]
    assert pytest.approx(at[0], rel=5e-3) == at[1]
    assert pytest.approx(-at[1]) == at[2]
    assert pytest.approx(4e-3 * 2.6 / 0.4) == at[3] == at[4]
    drag = make_effect("drive_slip_curve", slip_per_accel=0.0, slip_per_speed2=5e-7)
    assert pytest.approx(2e-4) == drag.wheel_slip(steady(20.0), car())[0, 0]


def test_gentle_driving_does_not_show_it() -> None:
    """It is a hypothesis where 1 % of the driving is beyond 1 m/s2, and not on a steady motorway."""
    cls = type(make_effect("drive_slip_curve", slip_per_accel=4e-3))

    assert not cls.observable(steady(30.0), car())
    assert cls.observable(accelerating(1.5), car())
    assert not cls.observable(steady(0.0), car())
    assert np.isfinite(
        make_effect("drive_slip_curve", slip_per_accel=4e-3).wheel_slip(steady(0.0), car())
    ).all()
