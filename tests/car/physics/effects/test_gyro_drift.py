"""A zero that drifts."""

from __future__ import annotations

import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_the_zero_moves_with_time() -> None:
    """1e-6 rad/s2 is 1e-5 rad/s after ten seconds, none at the start; it belongs to its drive."""
    effect = make_effect("gyro_drift", rate=1e-6)
    error = effect.yaw_rate_error_radps(steady(20.0, 0.1), car())

    assert pytest.approx((0.0, 1e-5)) == (error[0], error[-1])
    assert effect.not_compensated(frozenset({"yaw_rate"})) is not None
