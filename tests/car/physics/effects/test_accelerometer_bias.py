"""Accelerometers with a zero of their own."""

from __future__ import annotations

import numpy as np

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_a_constant_is_added_whatever_the_motion() -> None:
    """0.4 m/s2 forward and -0.3 to the left; up to 0.25 m/s2 it is a sensor's own."""
    effect = make_effect("accelerometer_bias", long_mps2=0.4, lat_mps2=-0.3)
    error = effect.accel_error_mps2(steady(20.0, 0.1), car())

    assert [0.4, -0.3] == error[0].tolist() == error[-1].tolist()
    assert not np.any(effect.radius_change_m(steady(), car()))
    assert ["", True] == [
        type(effect).tolerance_note(0.4, 0.01, False),
        bool(type(effect).tolerance_note(-0.2, 0.01, False)),
    ]
