"""A scale that changes with speed."""

from __future__ import annotations

import pytest

from tests.physics.motions import car, steady
from tpmsd.physics.catalogue import make_effect


def test_the_error_grows_with_speed() -> None:
    """1e-4 s/m at 30 m/s is 0.3 % on every wheel."""
    share = make_effect("speed_scale_nonlinearity", per_mps=1e-4).wheel_slip(steady(30.0), car())[0]

    assert pytest.approx([3e-3] * 4) == share.tolist()
