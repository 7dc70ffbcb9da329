"""Wind along the road."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import EFFECTS, make_effect


@pytest.mark.parametrize(
    ("heading", "drag_mps2"),
    [
        (0.0, 2.7e-4 * (38.0**2 - 30.0**2)),
        (math.pi, 2.7e-4 * (22.0**2 - 30.0**2)),
        (math.pi / 2, 0.0),
    ],
)
def test_the_slip_is_that_of_the_drag_in_the_wind(heading: float, drag_mps2: float) -> None:
    """Wind of 8 m/s from the east: driving east at 30 m/s the air passes at 38 m/s, west at 22, north at
    30; slip is the stiffness' 4e-3 s2/m times the drag's difference from calm air, on driven wheels."""
    effect = make_effect("head_wind", east_mps=8.0)
    slip = effect.wheel_slip(steady(30.0, heading_rad=heading), car("front"))[0]

    assert slip == pytest.approx([4e-3 * drag_mps2, 4e-3 * drag_mps2, 0.0, 0.0], abs=1e-12)


def test_a_wind_from_behind_that_is_faster_than_the_car_pushes() -> None:
    """At 4 m/s with 10 m/s from behind the air comes from behind at 6 m/s: -36 - 16 square metres per
    second squared."""
    slip = make_effect("head_wind", north_mps=10.0).wheel_slip(
        steady(4.0, heading_rad=-math.pi / 2), car("rear")
    )[0]

    assert slip[2] == pytest.approx(4e-3 * 2.7e-4 * (-36.0 - 16.0))


def test_it_takes_wheels_that_are_not_driven() -> None:
    """A car that drives all wheels does not show it, nor a bus with one axle."""
    cls = EFFECTS["head_wind"]

    assert not cls.observable(steady(), car("all"))
    assert cls.observable(steady(), car("rear"))
    assert "both_axles" in cls.identification.needs
    assert not np.any(make_effect("head_wind").wheel_slip(steady(30.0), car("rear")))
