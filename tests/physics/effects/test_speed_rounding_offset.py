"""Speeds that are rounded."""

from __future__ import annotations

import pytest

from tests.physics.motions import car, steady
from tpmsd.physics.catalogue import make_effect


def test_an_offset_weighs_more_at_low_speed() -> None:
    """-0.05 m/s is -0.5 % at 10 m/s on every wheel."""
    share = make_effect("speed_rounding_offset", offset_mps=-0.05).wheel_slip(steady(10.0), car())[0]

    assert pytest.approx([-5e-3] * 4) == share.tolist()
