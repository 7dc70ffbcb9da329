"""The sunny side."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_the_side_towards_the_sun_grows() -> None:
    """Southwards with the sun in the east, on the left: left wheels are larger, right ones smaller."""
    effect = make_effect("sun_side", east_m=1e-4)
    south = effect.radius_change_m(steady(20.0, heading_rad=-np.pi / 2), car())[-1]
    east = effect.radius_change_m(steady(20.0, heading_rad=0.0), car())[-1]

    assert pytest.approx([1e-4, -1e-4, 1e-4, -1e-4]) == south.tolist()
    assert pytest.approx([0.0] * 4) == east.tolist()
