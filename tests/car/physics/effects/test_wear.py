"""Treads that wear off."""

from __future__ import annotations

import pytest

from tests.car.physics.motions import car, steady
from tpmsd.car.physics.catalogue import make_effect


def test_all_tyres_lose_radius_with_the_distance() -> None:
    """2e-10 per metre are 8 mm after 40,000 km: 40 nm in 10 s at 20 m/s, on every wheel."""
    change = make_effect("wear", rate=2e-10).radius_change_m(steady(20.0), car())

    assert pytest.approx([-2e-10 * 200.0] * 4) == change[-1].tolist()
    assert [0.0] * 4 == change[0].tolist()


def test_no_ordinary_drive_shows_it() -> None:
    """It is no hypothesis below 500 km."""
    cls = type(make_effect("wear", rate=2e-10))

    assert [False, True] == [cls.observable(steady(v, duration_s=20.0), car()) for v in (30.0, 30_000.0)]
