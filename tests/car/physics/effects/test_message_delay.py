"""Messages of different age."""

from __future__ import annotations

import pytest

from tests.car.physics.motions import accelerating, car
from tpmsd.car.physics.catalogue import EFFECTS, make_effect


def test_older_front_wheels_lag_behind_an_acceleration() -> None:
    """At 1 m/s2 and 10 m/s 20 ms are 0.02 m/s, 0.2 % less on the front wheels alone."""
    share = make_effect("message_delay", front_s=0.02).wheel_slip(accelerating(1.0, 10.0), car())[0]

    assert pytest.approx([-2e-3, -2e-3, 0.0, 0.0]) == share.tolist()


def test_frames_of_one_reading_are_usual() -> None:
    """Two frames that follow each other within a millisecond hold one reading; 10 ms are a delay."""
    effect = EFFECTS["message_delay"]

    assert [True, False] == [bool(effect.tolerance_note(age, 1e-5, False)) for age in (-2.4e-4, 0.01)]
