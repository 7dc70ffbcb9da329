"""Recordings of one car and of two, by their configurations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.offline.calibration.test_parts import CIRCLE, perfect
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.drive_checks.same_car import SAME_LENGTH_M, car_difference, check_same_car


def test_drives_of_two_cars_are_identified_by_what_differs() -> None:
    """Teeth, lengths beyond a file's rounding and driven wheels make another car; rounding does not."""
    one = perfect(CIRCLE)
    geometry = one.car.geometry
    rounded = replace(geometry, wheelbase_m=geometry.wheelbase_m + 0.5 * SAME_LENGTH_M)
    longer = replace(geometry, wheelbase_m=geometry.wheelbase_m + 0.1)
    teeth = replace(one, car=replace(one.car, teeth_per_rev=one.car.teeth_per_rev + 1))
    driven = replace(one, car=replace(one.car, driven=np.logical_not(one.car.driven)))

    assert "" == car_difference(one, replace(one, car=replace(one.car, geometry=rounded)))
    assert "wheelbase_m" in car_difference(one, replace(one, car=replace(one.car, geometry=longer)))
    assert "teeth_per_rev" in car_difference(one, teeth)
    assert "" == car_difference(one, teeth, teeth=False)
    assert "driven wheels" in car_difference(one, driven)
    with pytest.raises(ConfigError, match="different cars"):
        check_same_car([one, one, teeth])
