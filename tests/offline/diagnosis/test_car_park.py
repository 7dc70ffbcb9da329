"""Walking pace in a car park tells what walking pace can tell."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bench.worlds import awkward
from bench.worlds.instruments import observe
from bench.worlds.spec import Spec
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.reporting.information import speed_ranges
from tpmsd.offline.inference.recording import Recording


def parked(physics: dict[str, dict[str, float]], seed: int) -> Recording:
    """Aisles at 1 to 3.5 m/s for eight minutes."""
    rng = np.random.default_rng(seed)
    spec = replace(Spec(duration_s=480.0, physics=physics), tags=("car_park",))
    return recording_of(observe(awkward.course(spec, rng), spec, rng, seed))


def test_a_track_is_measured_between_parked_cars() -> None:
    """Tight corners measure a rear track that is 60 mm off; the report says which speeds told it."""
    diagnosis = diagnose([parked({"track_width_error": {"rear_m": 0.06}}, 3)])

    assert ["track_width_error"] == [finding.effect for finding in diagnosis.findings]
    assert pytest.approx(0.06, abs=0.004) == diagnosis.findings[0].parameters["rear_m"].value
    reported = {one.speed_mps: one for one in diagnosis.information}
    assert {(0.0, 2.5), (2.5, 5.0)} == set(reported)
    assert sum(one.driving_s for one in diagnosis.information) == diagnosis.driving_s > 200.0


def test_a_car_park_without_anything_is_consistent() -> None:
    """Neither corners nor slow counters make a finding."""
    diagnosis = diagnose([parked({}, 4)])

    assert ("consistent", ()) == (diagnosis.verdict, diagnosis.findings)


def test_seconds_at_a_speed_tell_what_their_whitened_columns_say() -> None:
    """Sixteen seconds of one reading with response 2 / m know a radius to 1 / (2 * 4) m."""
    speed = np.repeat([1.0, 12.0], 16)
    white = np.zeros((32, 9, 2))
    white[16:, 0, 1] = 2.0
    drive = SimpleNamespace(
        names=[("data",), ("radius_constant", "rl")],
        white=white,
        reader=SimpleNamespace(windows=SimpleNamespace(covariates={"speed": speed})),
    )

    slow, fast = speed_ranges([cast(DriveRegression, drive)])

    assert ((0.0, 2.5), 16.0, None) == (slow.speed_mps, slow.driving_s, slow.radius_std_m)
    assert ((10.0, 15.0), 16.0) == (fast.speed_mps, fast.driving_s)
    assert pytest.approx(1.0 / 8.0) == fast.radius_std_m
