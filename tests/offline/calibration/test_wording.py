"""The summary of a calibration, as the command prints it."""

from __future__ import annotations

import math

import pytest

from tpmsd.offline.calibration.result import EstimatedEffect, FittedGeometry, WheelResult
from tpmsd.offline.calibration.wording import document, summary

LATENCY = {"latency@0": EstimatedEffect(0.07, 0.01, "s"), "load_lateral": EstimatedEffect(2e-4, 1e-5, "s2")}


@pytest.mark.parametrize(
    ("drives", "latency"),
    [
        (("monday",), "gnss_latency, latency_s"),
        (("monday", "tuesday"), "gnss_latency, latency_s of monday"),
    ],
)
def test_effects_bear_the_names_of_the_catalogue(drives: tuple[str, ...], latency: str) -> None:
    """With their parameter; of what belongs to one of several drives, to which. Values stand in a column."""
    wheels = {wheel: WheelResult(0.31, 1e-4) for wheel in ("rl", "rr")}
    nan = math.nan
    found = FittedGeometry(
        "joint", drives, wheels, 1e-5, 1.5, 0.01, nan, nan, 20.0, 6, "still", 9.0, 1.0, LATENCY, []
    )
    rows = [row for row in summary(found).splitlines() if row.startswith("  ")]

    assert [latency, "load_transfer_lateral, coefficient"] == [row.split("  +")[0].strip() for row in rows]
    assert 1 == len({row.index("+") for row in rows})


def test_radii_of_a_bus_that_states_speeds_come_with_those_they_rest_on() -> None:
    """Pasted by hand without them they would be the bus's own, and the deviations what they were before."""
    wheels = {wheel: WheelResult(0.31, 1e-4) for wheel in ("rl", "rr")}
    nan = math.nan
    found = FittedGeometry(
        "joint", ("monday",), wheels, 1e-5, 1.5, 0.01, nan, nan, 20.0, 6, "still", 9.0, 1.0, {}, []
    )
    stated = summary(found, {"rl": 0.32, "rr": 0.33})
    assert "in [calibration]: bus_radius_rl_m = 0.32, bus_radius_rr_m = 0.33" in stated
    assert 0.33 == document(found, {"rl": 0.32, "rr": 0.33})["wheels"]["rr"]["bus_radius_m"]
    assert "bus_radius" not in summary(found) + str(document(found))
