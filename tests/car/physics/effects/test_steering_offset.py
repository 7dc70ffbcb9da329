"""A steering wheel that is not straight."""

from __future__ import annotations

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_the_sensor_reads_an_angle_on_the_straight_and_as_much_more_in_bends() -> None:
    """0.1 rad; three degrees are usual, six are not."""
    effect = make_effect("steering_offset", offset_rad=0.1)

    assert 0.1 == effect.steering_error_rad(steady(20.0), car())[0]
    assert 0.1 == effect.steering_error_rad(steady(20.0, 0.1), car())[0]
    assert [True, False] == [bool(type(effect).tolerance_note(value, 1e-3, False)) for value in (0.05, 0.1)]
