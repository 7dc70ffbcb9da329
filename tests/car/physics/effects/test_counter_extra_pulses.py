"""A counter that adds pulses."""

from __future__ import annotations

import numpy as np

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import EFFECTS, make_effect


def test_extra_pulses_are_missed_ones_with_the_other_sign() -> None:
    """The same share, positive."""
    extra = make_effect("counter_extra_pulses", wheel="rl", rate_per_s=3.0).wheel_slip(steady(15.0), car())
    missed = make_effect("counter_missed_pulses", wheel="rl", rate_per_s=3.0).wheel_slip(steady(15.0), car())

    np.testing.assert_allclose(extra, -missed)
    assert extra[0, 2] > 0.0


def test_a_counter_in_order_makes_none_up() -> None:
    """Odds of fifty against a name that counters seldom deserve, and of fifty more against the other sign."""
    for name in ("counter_extra_pulses", "counter_missed_pulses"):
        assert (4.0, 8.0) == (EFFECTS[name].penalty(3.0), EFFECTS[name].penalty(-3.0))
