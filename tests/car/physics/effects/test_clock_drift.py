"""A clock that drifts and is set."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.car.physics.catalogue import make_effect


def test_a_ramp_and_a_step_of_the_clock() -> None:
    """500 ppm are 50 ms after 100 s; set forward by a second at 200 s, it is 1.15 s ahead at 300 s."""
    effect = make_effect("clock_drift", rate=5e-4, step_s=1.0, at_s=200.0)

    assert pytest.approx([0.0, 0.05, 1.15]) == effect.clock_error_s(np.array([0.0, 100.0, 300.0])).tolist()
    assert [True, False] == [bool(type(effect).tolerance_note(rate, 1e-6, False)) for rate in (1e-4, 5e-4)]
