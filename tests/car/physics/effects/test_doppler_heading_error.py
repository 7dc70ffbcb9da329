"""A velocity error in the earth's frame."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_the_error_is_speed_one_way_and_course_the_other() -> None:
    """0.05 m/s towards the east: going east the speed is too high, going north the course turns right."""
    effect = make_effect("doppler_heading_error", east_mps=0.05)
    east, north = steady(20.0), steady(20.0, heading_rad=np.pi / 2)

    assert pytest.approx(0.05) == effect.gnss_speed_error_mps(east, car())[0]
    assert pytest.approx(0.0, abs=1e-12) == effect.gnss_course_error_rad(east, car())[0]
    assert pytest.approx(0.0, abs=1e-12) == effect.gnss_speed_error_mps(north, car())[0]
    assert pytest.approx(-0.0025) == effect.gnss_course_error_rad(north, car())[0]
