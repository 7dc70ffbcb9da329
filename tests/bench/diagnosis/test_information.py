"""What a drive identifies, against closed forms."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.offline.diagnosis.draw import draw_case
from bench.campaigns.offline.diagnosis.information import explained, gram, without
from bench.campaigns.offline.diagnosis.make import make
from bench.campaigns.offline.diagnosis.signals import windows_of
from bench.campaigns.offline.diagnosis.truth import nuisances, truth_of
from bench.worlds.course import Course
from bench.worlds.instruments import observe
from bench.worlds.spec import FINE_TEETH, Spec

SPEED = 20.0


def straight(seconds: int) -> Course:
    time_s = np.arange(seconds * 50 + 1) * 0.02
    still = np.zeros_like(time_s)
    return Course(
        time_s=time_s,
        speed=still + SPEED,
        yaw=still,
        grade=still,
        heading=still,
        accel=still,
        a_lat=still,
        bend=still,
        beta=still,
    )


def test_a_leak_on_a_straight_has_the_information_of_the_closed_form() -> None:
    """Without gyro and receiver, speed and yaw rate take two of the four wheels' directions.

    Half the energy of one wheel's change remains; calibration takes the mean of a step in the middle, which
    leaves a quarter of its square. Over noise of rough^2 * way that is n * change^2 * v / (16 rough^2).
    """
    spec = Spec(
        track_front_m=1.5,
        track_rear_m=1.5,
        teeth=100 * FINE_TEETH,
        frame_jitter_s=0.0,
        rough=3e-3,
        with_gyro=False,
        outages_per_hour=0.0,
    )
    course = straight(200)
    windows = windows_of(course, observe(course, spec, np.random.default_rng(1), 1))
    windows = dataclasses.replace(windows, read=windows.read & (np.arange(9) < 4))
    leak = {"radius_change": {"wheel": "rl", "deviation_m": -1e-3, "onset_s": 100.0, "duration_s": 0.0}}
    change = windows.channels(leak) - windows.channels({})
    columns = np.concatenate([change[:, :, None], nuisances(windows)], axis=2)
    G = without(gram(windows, columns), list(range(1, columns.shape[2])))
    relative = 1e-3 / (spec.radius_m - 1e-3)

    expected = 200 * relative**2 * SPEED / (16 * spec.rough**2)
    assert 0.5 * G[0, 0] == pytest.approx(expected, rel=0.01)


def test_a_column_explains_its_own_multiple_and_nothing_of_what_is_at_right_angles() -> None:
    """Projection by a Gram matrix."""
    G = np.array([[4.0, 8.0, 0.0], [8.0, 16.0, 0.0], [0.0, 0.0, 1.0]])

    assert (2.0, 0.0) == (pytest.approx(explained(G, 0, [1])), explained(G, 0, [2]))
    assert without(G, [1])[0, 0] == pytest.approx(0.0, abs=1e-9)


def test_a_latency_cannot_be_detected_at_constant_speed(tmp_path: Path) -> None:
    """Without any change of speed or course GNSS latency only moves the position: far below the bar."""
    case = draw_case("gnss_latency", 1.0, 5)
    case = dataclasses.replace(case, spec=dataclasses.replace(case.spec, duration_s=300.0))
    reported = truth_of(case, make(case, tmp_path).windows).effects[0].gain
    course = straight(300)
    drive = observe(course, case.spec, np.random.default_rng(1), 1)
    still = truth_of(case, windows_of(course, drive)).effects[0].gain

    assert still < 1e-3 * reported


def test_growth_and_warm_up_are_rivals_where_speed_rises_with_time(tmp_path: Path) -> None:
    """The alternative is named, and the margin is far below the gain."""
    effect = truth_of(
        case := draw_case("habit:centrifugal_growth", 1.0, 100000), make(case, tmp_path).windows
    ).effects[0]

    assert "thermal_growth" == effect.alternative
    assert effect.margin < 0.3 * effect.gain
