"""A counter that misses pulses."""

from __future__ import annotations

import numpy as np
import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_missed_pulses_are_a_share_that_falls_with_speed() -> None:
    """Two of 48 pulses per revolution at 20 m/s, 10.07 turns a second, are 0.41 %; at 40 m/s half of that."""
    effect = make_effect("counter_missed_pulses", wheel="fr", rate_per_s=2.0)
    slow, fast = (effect.wheel_slip(steady(v), car())[0] for v in (20.0, 40.0))

    assert pytest.approx([0.0, -2.0 / (48.0 * 20.0 / (2 * np.pi * 0.316)), 0.0, 0.0]) == slow.tolist()
    assert pytest.approx(slow / 2.0) == fast
