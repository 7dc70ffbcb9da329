"""Thinner air."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_tyres_grow_up_the_hill() -> None:
    """200 m of road at a slope of 0.05 rad climb 10 m: 4 um at 4e-7."""
    change = make_effect("ambient_pressure", per_m=4e-7).radius_change_m(steady(20.0, grade_rad=0.05), car())

    assert pytest.approx([4e-7 * 200.0 * np.sin(0.05)] * 4) == change[-1].tolist()
    assert [0.0] * 4 == change[0].tolist()
