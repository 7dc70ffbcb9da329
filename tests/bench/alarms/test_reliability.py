"""The reliability table, on drives whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.campaigns.onboard.alarms.play import LegResult
from bench.campaigns.onboard.alarms.reliability import EDGES, THRESHOLD, counts, reliability
from bench.worlds.trip_cars import draw_car
from bench.worlds.trips import Driven, Leg, drive_leg


@pytest.fixture(scope="module")
def driven() -> Driven:
    """Thirty seconds; fl has lost the threshold, fr half of it, the rear nothing, all from 10 s on."""
    made = drive_leg(draw_car(np.random.default_rng(4), "development", 4), Leg(1, "track", 30.0))
    lost = np.zeros_like(made.lost_m)
    after = np.arange(len(lost)) >= 500
    lost[after, 0] = 1.0001 * THRESHOLD * made.radius_m[after, 0]
    lost[after, 1] = 0.5 * THRESHOLD * made.radius_m[after, 1]
    return replace(made, lost_m=lost)


def test_classes_hold_what_was_reported_and_what_was_so(driven: Driven) -> None:
    """Before the loss nothing is so; after it fl is, and fr by half. 0.3 falls into 0.2 to 0.5, 1 into the
    last class, an edge into the class above it."""
    outcome = LegResult(probabilities=[(5.0, (0.3, 0.0, 0.0, 0.0)), (20.0, (1.0, 0.3, 0.2, 0.005))])
    by_class = counts(driven, outcome)
    assert len(EDGES) - 1 == len(by_class)
    assert [3.0, pytest.approx(0.8), pytest.approx(0.5, abs=1e-3)] == by_class[3]
    assert [1.0, 1.0, 1.0] == by_class[-1]
    assert [4.0, pytest.approx(0.005), 0.0] == by_class[0]
    assert 8.0 == sum(row[0] for row in by_class)


def test_rows_add_up_by_instants_and_count_their_drives(driven: Driven) -> None:
    """Two drives, of which one has told 0.3; a row without counts is passed over."""
    one = {"reliability": counts(driven, LegResult(probabilities=[(20.0, (0.3, 0.3, 0.0, 0.0))]))}
    two = {"reliability": counts(driven, LegResult(probabilities=[(20.0, (0.0, 0.0, 0.0, 0.0))]))}
    table = {row["from"]: row for row in reliability([one, two, {}])}
    assert (1, 2) == (table[0.2]["drives"], table[0.2]["instants"])
    assert (0.3, 0.75) == pytest.approx((table[0.2]["stated"], table[0.2]["true"]), abs=1e-3)
    assert (2, 6) == (table[0.0]["drives"], table[0.0]["instants"])
    assert table[0.5]["stated"] is None
