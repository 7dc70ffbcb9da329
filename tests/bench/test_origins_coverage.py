"""Coverage of intervals by origin."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bench.campaigns.offline.origins_coverage import (
    EFFECTS,
    KIND,
    TOGETHER,
    as_reported,
    errors,
    known,
    table,
)
from bench.worlds.spec import Spec, draw_spec


def _row(**findings: dict[str, Any]) -> dict[str, Any]:
    """A drive with a smaller tyre at the rear left and a late receiver, and what was found."""
    return {
        "origin": "kinematic",
        "kind": KIND,
        "verdict": "mismatch",
        "truth": {
            "radius_change": {"wheel": "rl", "deviation_m": -1e-3, "onset_s": 100.0},
            "gnss_latency": {"latency_s": 0.1},
        },
        "findings": [{"effect": name, **each} for name, each in findings.items()],
    }


def _radius(wheel: str, deviation_m: float) -> dict[str, Any]:
    return {
        "where": {"wheels": [wheel]},
        "parameters": {"wheel": [wheel, None], "deviation_m": [deviation_m, 1e-4], "onset_s": [90.0, 1.0]},
    }


def test_effects_are_drawn_that_the_bus_can_show() -> None:
    """Three of the six on every drive, and a gyro's scale on drives with a gyro alone."""
    drawn = [known(draw_spec(rng, with_gyro=False), rng) for rng in map(np.random.default_rng, range(30))]

    assert {TOGETHER} == {len(each) for each in drawn}
    assert set(EFFECTS) - {"yaw_rate_scale"} == {name for each in drawn for name in each}


def test_a_latency_is_reported_beyond_the_age_of_the_wheels_frames() -> None:
    """A mean over 40 ms is 20 ms old, and a low-pass of 10 ms is 10 ms old; frames of counts come late."""
    spec = Spec(arrival_jitter_s=0.002, speed_window_s=0.04, speed_filter_s=0.01, wheel_signal="speeds")
    counted = replace(
        spec, speed_window_s=0.0, speed_filter_s=0.0, wheel_signal="counts", frame_jitter_s=5e-4
    )
    truth = {"gnss_latency": {"latency_s": 0.1}}

    assert as_reported(truth, spec)["gnss_latency"]["latency_s"] == pytest.approx(0.1 + 0.002 - 0.03)
    assert as_reported(truth, counted)["gnss_latency"]["latency_s"] == pytest.approx(0.1 + 0.002 - 0.0005)
    assert {"gnss_latency": {"latency_s": 0.1}} == truth


def test_errors_are_those_of_effects_found_where_they_act() -> None:
    """The size of the right wheel in standard deviations; no onset, and nothing of another wheel or name."""
    assert [("radius_change deviation_m", pytest.approx(3.0))] == list(
        errors(_row(radius_change=_radius("rl", -0.7e-3)))
    )
    assert [] == list(errors(_row(radius_change=_radius("rr", -1e-3))))
    assert [] == list(errors(_row(wear={"where": {"wheels": ["rl"]}, "parameters": {"rate": [1.0, 0.1]}})))


def test_the_table_counts_names_and_intervals() -> None:
    """Two drives with two effects each: one interval with the truth, one without, and a false name."""
    late = {"where": {"wheels": []}, "parameters": {"latency_s": [0.11, 0.01]}}
    wear = {"where": {"wheels": ["rl"]}, "parameters": {"rate": [1.0, 0.1]}}
    reported = table([_row(gnss_latency=late, wear=wear), _row(radius_change=_radius("rl", -0.7e-3))])

    assert "| kinematic | 2 | 2/4 = 50.0 % [6.8, 93.2] | 1 | 1/2 = 50.0 % [1.3, 98.7] | 2.24 |" in reported
    assert "gnss_latency latency_s +1.00 (1/1)" in reported
    assert "" == table([{**_row(), "kind": "null"}])
