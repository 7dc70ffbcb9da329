"""The tyre model: closed forms, sizes of the Magic Formula, and the way back from radius to pressure."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.config.model import TyreConfig
from tpmsd.car.physics.tyre import TyreModel, radius_change_for_pressure_loss, stiffness, tyre_model
from tpmsd.foundation.errors import ConfigError

REFERENCE_M = 0.304
MAGIC_FORMULA_MM = ((0.20, -1.41), (0.25, -1.84), (0.30, -2.31))
"""205/60R15 at 4 kN, 220 kPa and 20 m/s."""


@pytest.mark.parametrize(("loss", "change_mm"), MAGIC_FORMULA_MM)
def test_an_unknown_tyre_has_the_sizes_of_the_magic_formula(loss: float, change_mm: float) -> None:
    """The default passes through all three sizes."""
    assert change_mm == pytest.approx(1e3 * radius_change_for_pressure_loss(loss), abs=0.01)
    model = tyre_model(TyreConfig(), REFERENCE_M)
    assert change_mm == pytest.approx(1e3 * model.radius_change_m(loss), abs=0.01)


@pytest.mark.parametrize(("loss", "change_mm"), MAGIC_FORMULA_MM)
def test_a_tyre_by_its_size_is_within_three_per_cent(loss: float, change_mm: float) -> None:
    """Rhyne's stiffness and the share of deflection that shows in the rolling radius agree with them."""
    model = tyre_model(TyreConfig(size="205/60R15"), REFERENCE_M)
    assert change_mm == pytest.approx(1e3 * model.radius_change_m(loss), rel=0.03)


def test_stiffness_by_hand() -> None:
    """205/60R15 at 220 kPa: 0.00028 * 220 * sqrt(0.79 * 205 * (246 + 381)) + 3.45 = 23.1 kgf/mm."""
    total, share = stiffness("205/60R15", 220e3)
    air = 0.00028 * 220.0 * math.sqrt(0.79 * 205.0 * 627.0)
    assert (air + 3.45) * 9806.65 == pytest.approx(total)
    assert air / (air + 3.45) == pytest.approx(share)


def test_the_form_is_that_of_two_springs() -> None:
    """A load on a stiffness whose share B comes from the air: the deflection's change, times H."""
    load, vertical, share, lost = 4500.0, 2.2e5, 0.7222, 0.35
    model = tyre_model(TyreConfig(stiffness_npm=vertical, load_n=load), REFERENCE_M)
    deeper = load / (vertical * (1 - share + share * (1 - lost))) - load / vertical
    assert -0.39 * deeper == pytest.approx(model.radius_change_m(lost))


@settings(derandomize=True, deadline=None)
@given(st.floats(0.01, 0.9), st.sampled_from(["205/60R15", "315/80R22.5", "P225/45ZR17 91Y", "195/65 R15"]))
def test_there_and_back(lost: float, size: str) -> None:
    """The pressure told from a radius is the one that made it, for tyres of any size."""
    model = tyre_model(TyreConfig(size=size), REFERENCE_M)
    assert lost == pytest.approx(model.pressure_loss(model.radius_change_m(lost))[0])


@settings(derandomize=True, deadline=None)
@given(st.floats(-0.05, 0.05), st.floats(0.0, 0.01))
def test_what_is_reported_is_always_a_share(change_m: float, std_m: float) -> None:
    """Whatever the radius did: a share between -1 and 1, with a finite uncertainty, rising with the loss."""
    for tyre in (TyreConfig(), TyreConfig(curve_pressure_percent=(10, 30), curve_radius_mm=(0.5, 2.0))):
        model = tyre_model(tyre, 0.316)
        loss, std = model.pressure_loss(change_m, std_m)
        assert -1.0 <= loss <= 1.0
        assert 0.0 <= std <= 1.0
        assert model.pressure_loss(change_m - 1e-4, std_m)[0] >= loss


def test_the_uncertainty_is_that_of_radius_and_model() -> None:
    """At a loss of 20 %: the radius's through the slope A/(1 - B x)^2, and a quarter of the loss."""
    model = TyreModel(6.0e-3, 0.7, (), 0.25)
    lost, std = model.pressure_loss(model.radius_change_m(0.2), 1e-4)
    slope = 6.0e-3 / (1 - 0.7 * 0.2) ** 2
    assert 0.2 == pytest.approx(lost)
    assert math.hypot(1e-4 / slope, 0.05) == pytest.approx(std)


def test_a_measured_curve_is_followed() -> None:
    """Between its points in a straight line, from nothing lost; beyond them with the last slope."""
    tyre = TyreConfig(curve_pressure_percent=(10.0, 20.0), curve_radius_mm=(0.5, 1.5))
    model = tyre_model(tyre, 0.316)
    assert [-0.25e-3, -0.5e-3, -1.0e-3, -2.5e-3] == pytest.approx(
        [model.radius_change_m(x) for x in (0.05, 0.10, 0.15, 0.30)]
    )
    assert 0.15 == pytest.approx(model.pressure_loss(-1.0e-3)[0])


def test_what_is_not_known_is_reported_of_nobody() -> None:
    """NaN in, NaN out."""
    assert all(math.isnan(x) for x in tyre_model(TyreConfig(), 0.316).pressure_loss(math.nan))


@pytest.mark.parametrize("size", ["", "15", "205-60-15", "205/60"])
def test_a_size_that_is_none_is_named(size: str) -> None:
    """One line says what a size looks like."""
    with pytest.raises(ConfigError, match="not of the form"):
        stiffness(size, 220e3)
