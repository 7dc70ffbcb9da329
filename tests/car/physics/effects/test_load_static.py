"""The load of an axle that changes at a stop."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import GEOMETRY, car, steady
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.motion import Motion


def with_stops(*stops: tuple[float, float]) -> Motion:
    """200 s at 10 m/s with stops from one time to another."""
    time = np.arange(20_001) / 100.0
    speed = np.full_like(time, 10.0)
    for begin, end in stops:
        speed[(time >= begin) & (time < end)] = 0.0
    return Motion.from_profiles(time, speed, np.zeros_like(time), wheelbase_m=GEOMETRY.wheelbase_m)


def test_an_axle_changes_after_the_longest_stop() -> None:
    """Of stops of 22 s and 40 s the second counts: from its end on the rear is 0.3 mm smaller."""
    effect = make_effect("load_static", rear_m=-3e-4, front_m=5e-5)
    change = effect.radius_change_m(with_stops((20.0, 42.0), (100.0, 140.0)), car())

    assert [0.0] * 4 == np.abs(change[:14_000]).max(axis=0).tolist()
    assert [5e-5, 5e-5, -3e-4, -3e-4] == change[14_000].tolist() == change[-1].tolist()
    assert ("rl", "rr") == effect.acting_wheels(car(), ("rear_m",))


@pytest.mark.parametrize(
    ("motion", "shown"),
    [
        (steady(20.0), False),
        (with_stops((50.0, 65.0)), False),
        (with_stops((0.0, 90.0)), False),
        (with_stops((50.0, 75.0)), True),
    ],
)
def test_it_needs_a_stop_between_two_stretches_of_driving(motion: Motion, shown: bool) -> None:
    """A traffic light of 15 s or the wait before the start is none; a stop of 25 s is."""
    effect = make_effect("load_static", rear_m=-3e-4)

    assert shown == type(effect).observable(motion, car())
    assert shown == bool(np.any(effect.radius_change_m(motion, car()) != 0.0))
