"""Both filters on the same drives: what is counted, and what the pairs that differ say."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import pytest

from bench.campaigns.onboard import filters

ROWS: list[dict[str, Any]] = [
    {"what": "loss", "method": method, "name": f"drive {k}", "found": k in found, "delay_s": 10.0 * k + late}
    for method, found, late in (("gaussian-sum", {0, 1, 2, 3}, 5.0), ("mpf-pn", {0, 1, 4}, 20.0))
    for k in range(6)
]


def case(method: str, detected: bool, onset: str, fast_s: float, named: list[str]) -> dict[str, Any]:
    return {
        "what": "case",
        "method": method,
        "name": f"case {onset}",
        "detected": detected,
        "onset": onset,
        "fast_s": fast_s,
        "named": named,
        "right_wheel": named == ["rl"],
        "false_before": [],
    }


def test_pairs_are_counted_where_the_filters_differ() -> None:
    """Of six drives the first alone finds 2 and 3, the second alone 4: with one of three, McNemar's exact
    p-value is 1; the medians are those of what each has found."""
    found = filters.figures(ROWS)
    assert (4, 6) == (found["gaussian-sum"]["losses"]["hits"], found["gaussian-sum"]["losses"]["of"])
    assert 3 == found["mpf-pn"]["losses"]["hits"]
    assert 20.0 == found["gaussian-sum"]["median_loss_delay_s"]
    assert 30.0 == found["mpf-pn"]["median_loss_delay_s"]
    assert {"pairs": 6, "first_alone": 2, "second_alone": 1, "p": 1.0} == filters.pairs(found)


def test_eight_against_none_is_no_chance() -> None:
    """Eight drives that the first alone finds: p = 2 / 2^8."""
    rows = [
        {"what": "loss", "method": method, "name": f"{k}", "found": method == "gaussian-sum", "delay_s": 1.0}
        for k in range(8)
        for method in filters.METHODS
    ]
    assert 2.0 / 256.0 == pytest.approx(filters.pairs(filters.figures(rows))["p"])


def test_what_one_filter_alone_has_played_is_left_out() -> None:
    """A run that was cut short compares whole pairs; slow leaks do not count for the delay."""
    rows = [
        case("gaussian-sum", True, "fast", 10.0, ["rl"]),
        case("mpf-pn", True, "fast", 30.0, ["fr"]),
        case("gaussian-sum", True, "slow", 500.0, ["rl"]),
        case("mpf-pn", False, "slow", math.nan, []),
        case("gaussian-sum", True, "start", 90.0, ["rl"]),
    ]
    found = filters.figures(rows)
    assert (2, 2) == (found["gaussian-sum"]["detected"]["hits"], found["gaussian-sum"]["detected"]["of"])
    assert (10.0, 30.0) == tuple(found[method]["median_delay_s"] for method in filters.METHODS)
    assert (0, 1) == tuple(found[method]["wrong_wheel"]["hits"] for method in filters.METHODS)
    assert "false `deflation`" not in filters.markdown(found)  # no kilometre was driven
    assert "| of those announced, with a wrong wheel | 0/2 [0.0, " in filters.markdown(found)


def test_either_filter_plays_every_piece() -> None:
    """The plan holds each piece twice, side by side."""
    parser = argparse.ArgumentParser()
    filters.options(parser)
    units = filters.plan(parser.parse_args(["--cars", "1", "--losses", "a"]))
    assert [unit[1:] for unit in units[::2]] == [unit[1:] for unit in units[1::2]]
    assert {"gaussian-sum"} == {unit[0] for unit in units[::2]}
    assert {"cases", "kinds", "loss"} == {unit[1] for unit in units}


@pytest.mark.parametrize("method", filters.METHODS)
def test_a_loss_in_a_real_drive_is_found_by_either(recordings: Path, method: str) -> None:
    """1.4 mm within a minute on a recorded motorway: found, on its wheel, in the ten minutes of UN R141."""
    (row,) = filters.work((method, "loss", str(recordings / "van-motorway-b"), 2, 60))
    assert (method, True, "rl") == (row["method"], row["found"], row["wheel"])
    assert 0.0 < row["delay_s"] < 600.0
