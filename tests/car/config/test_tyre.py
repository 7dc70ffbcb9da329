"""The table [tyre]: what is read, and what is said of mistakes in it."""

from __future__ import annotations

import pytest

from tests.car.config.conftest import GOOD_TOML, Make
from tpmsd.car.config.load import ConfigProblems, load_config


def test_a_tyre_is_read(make: Make) -> None:
    """Size and load, or a measured curve."""
    text = '[tyre]\nsize = " 205/60R15 91V"\nload_n = 4200\npressure_kpa = 230\nstiffness_npm = 2.1e5\n'
    path = make(text=GOOD_TOML + text + "curve_pressure_percent = [10, 20.5]\ncurve_radius_mm = [0.6, 1.4]\n")
    tyre = load_config(path).tyre
    assert ("205/60R15 91V", 4200.0, 230.0, 2.1e5) == (
        tyre.size,
        tyre.load_n,
        tyre.pressure_kpa,
        tyre.stiffness_npm,
    )
    assert ((10.0, 20.5), (0.6, 1.4)) == (tyre.curve_pressure_percent, tyre.curve_radius_mm)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('size = "15 inch"', "not a tyre's size"),
        ("size = 205", "not a text"),
        ("pressure_kpa = 2.2", "out of range"),
        ("curve_pressure_percent = 20", "not a list"),
        ("curve_pressure_percent = [20]", "too short"),
        ("curve_pressure_percent = [20, 10]", "not rising"),
        ("curve_pressure_percent = [20, 100]", "out of range"),
        ("curve_pressure_percent = [10, 20]", "differ in length"),
        ("curve_pressure_percent = [10, 20]\ncurve_radius_mm = [1, 2, 3]", "differ in length"),
    ],
)
def test_each_mistake_is_named(make: Make, line: str, said: str) -> None:
    """One line says what is wrong with the table."""
    with pytest.raises(ConfigProblems, match=said):
        load_config(make(text=f"{GOOD_TOML}[tyre]\n{line}\n"))
