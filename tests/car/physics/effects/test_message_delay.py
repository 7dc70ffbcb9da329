"""Messages of different age."""

from __future__ import annotations

import pytest

from tests.car.physics.motions import accelerating, car
from tpmsd.car.physics.catalogue import make_effect


def test_older_front_wheels_lag_behind_an_acceleration() -> None:
    """At 1 m/s2 and 10 m/s 20 ms are 0.02 m/s, 0.2 % less on the front wheels alone."""
    share = make_effect("message_delay", front_s=0.02).wheel_slip(accelerating(1.0, 10.0), car())[0]

    assert pytest.approx([-2e-3, -2e-3, 0.0, 0.0]) == share.tolist()
