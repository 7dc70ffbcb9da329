"""Slip by the drive torque of the bus."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.car.physics.motions import accelerating, car, steady
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.car.physics.effect import Parameter
from tpmsd.car.physics.motion import Motion


def pulling(rise_nm_per_s: float) -> Motion:
    """Torque that rises evenly from none."""
    motion = steady(20.0)
    return dataclasses.replace(motion, measured={"torque": rise_nm_per_s * motion.time_s})


def test_slip_goes_with_the_torque_of_a_moment_ago() -> None:
    """500 Nm more every second, 0.2 s late: after 4 s it is that of 1900 Nm, on the driven wheels."""
    slip = make_effect("torque_slip", slip_per_nm=8e-6, lag_s=0.2).wheel_slip(pulling(500.0), car("rear"))

    assert slip[400] == pytest.approx([0.0, 0.0, 8e-6 * 1900.0, 8e-6 * 1900.0])


def test_one_car_has_one_size_of_either_slip() -> None:
    """1500 kg on wheels of 0.316 m at 1.5 m/s2 take 711 Nm: 4e-3 s2/m are then 8.4e-6 /Nm."""
    torque, motion = 1500.0 * 1.5 * 0.316, accelerating(1.5)
    told = dataclasses.replace(motion, measured={"torque": np.full(len(motion), torque)})
    by_torque = make_effect("torque_slip", slip_per_nm=4e-3 * 1.5 / torque).wheel_slip(told, car())
    by_force = make_effect("longitudinal_slip", slip_per_accel=4e-3).wheel_slip(told, car())

    assert by_torque == pytest.approx(by_force)
    (known, _) = EFFECTS["torque_slip"].parameters
    assert isinstance(known, Parameter)
    assert known.prior is not None
    assert known.prior.mean == pytest.approx(4e-3 / (1500.0 * 0.316), rel=0.1)


def test_without_a_torque_there_is_none() -> None:
    """On a bus that tells none, and where it is missing for a while."""
    effect = make_effect("torque_slip", slip_per_nm=8e-6)
    gap = dataclasses.replace(steady(20.0), measured={"torque": np.full(1001, np.nan)})

    assert not np.any(effect.wheel_slip(steady(20.0), car()))
    assert not np.any(effect.wheel_slip(gap, car()))
    assert EFFECTS["torque_slip"].identification.needs == ("torque",)
