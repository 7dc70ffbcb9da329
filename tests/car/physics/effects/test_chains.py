"""Snow chains."""

from __future__ import annotations

import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_nine_millimetres_make_a_driven_axle_turn_slower_while_they_are_on() -> None:
    """On a radius of 0.3 m they are 3 % from the second to the eighth second, in front alone."""
    effect = make_effect("chains", wheels="front", slip=-0.009 / 0.3, onset_s=2.0, duration_s=6.0)
    slip = effect.wheel_slip(steady(10.0), car())

    assert [0.0] * 4 == slip[199].tolist() == slip[800].tolist()
    assert pytest.approx([-0.03, -0.03, 0.0, 0.0]) == slip[500].tolist()


@pytest.mark.parametrize(
    ("slip", "duration_s", "driven", "axle", "fits"),
    [
        (-0.03, 600.0, True, True, True),
        (-0.03, 600.0, True, False, False),
        (-0.03, 600.0, False, True, False),
        (-0.03, 60.0, True, True, False),
        (0.03, 600.0, True, True, False),
        (-0.004, 600.0, True, True, False),
        (-0.2, 600.0, True, True, False),
    ],
)
def test_it_is_long_and_of_the_driven_axle(
    slip: float, duration_s: float, driven: bool, axle: bool, fits: bool
) -> None:
    """What is shorter is a locked wheel, what is thinner a tyre; an axle without drive
    needs no chains, and one wheel alone bears none."""
    cls = type(make_effect("chains", wheels="front", slip=-0.03, onset_s=0.0, duration_s=1.0))

    assert fits == cls.fits_span(slip, duration_s, driven, axle)
