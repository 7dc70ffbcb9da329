"""Frames of the two axles that are stamped one after the other."""

from __future__ import annotations

import pytest

from tests.car.physics.motions import accelerating, car
from tpmsd.car.physics.catalogue import make_effect


def test_wheels_read_at_once_differ_by_the_acceleration_between_their_stamps() -> None:
    """At 1 m/s2 and 10 m/s 0.25 ms are 0.25 mm/s, 2.5e-5 more on front wheels that are stamped earlier."""
    share = make_effect("frame_age", front_s=-2.5e-4).wheel_slip(accelerating(1.0, 10.0), car())[0]

    assert pytest.approx([2.5e-5, 2.5e-5, 0.0, 0.0]) == share.tolist()
