"""A counter that adds pulses."""

from __future__ import annotations

import numpy as np

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_extra_pulses_are_missed_ones_with_the_other_sign() -> None:
    """The same share, positive."""
    extra = make_effect("counter_extra_pulses", wheel="rl", rate_per_s=3.0).wheel_slip(steady(15.0), car())
    missed = make_effect("counter_missed_pulses", wheel="rl", rate_per_s=3.0).wheel_slip(steady(15.0), car())

    np.testing.assert_allclose(extra, -missed)
    assert extra[0, 2] > 0.0
