"""The campaign of masked losses: its situations and its scores."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bench.campaigns.onboard.masking import SITUATIONS, resized, scored, table
from bench.cli import main


def test_resized_wheels_turn_by_the_ratio_of_the_radii() -> None:
    """A wheel that is 1 % of 0.3 m larger turns by 1 / 1.01; after its tyre has lost 20 % of the pressure the
    radius is 0.46 % smaller again, with a ramp of ten seconds."""
    what = SITUATIONS[0]
    time_s = np.arange(0.0, 600.0, 1.0)
    radius_m = np.full(4, 0.3)
    angle = np.tile(50.0 * time_s[:, None], (1, 4))
    turned = resized(angle, time_s, radius_m, what)
    assert 50.0 * 0.3 / 0.305 == pytest.approx(float(turned[100, 0] - turned[99, 0]))
    assert 50.0 * 0.3 / (0.305 - 0.0046 * 0.3) == pytest.approx(float(turned[500, 1] - turned[499, 1]))
    assert turned[500, 0] == pytest.approx(turned[500, 3])


@pytest.mark.parametrize(
    ("row", "verdict"),
    [
        ({"deflation": {"fr": 360.0}, "radius_deviation": {}, "asked_s": None}, "found"),
        ({"deflation": {"fr": 950.0}, "radius_deviation": {}, "asked_s": 400.0}, "asked"),
        ({"deflation": {"fr": 360.0, "rr": 400.0}, "radius_deviation": {}, "asked_s": None}, "wrong"),
        ({"deflation": {}, "radius_deviation": {"fl": 310.0}, "asked_s": 950.0}, "silent"),
    ],
)
def test_what_was_said_is_scored(row: dict[str, Any], verdict: str) -> None:
    """A loss is found by its own alarm within ten minutes, else asked, else silent: a deviation of other
    wheels does not count, and the deflation of another wheel is wrong."""
    found = scored(row | {"question": None}, SITUATIONS[0])
    assert verdict == found["verdict"]
    line = {"generator": "trips", "situation": SITUATIONS[0].name, "false_before": [], **found}
    assert f"1 {verdict}" in table([line])


def test_an_unknown_generator_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    """One line, exit code 2."""
    with pytest.raises(SystemExit, match="2"):
        main(["run", "masking", "--generator", "none"])
    assert (
        "no such generator: none; there are trips, kinematic, simulator, multibody" in capsys.readouterr().err
    )
