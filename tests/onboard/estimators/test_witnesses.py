"""Slope of the road and trust in the gyro: closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpmsd.car.physics.grade import MAX_GRADE, MIN_SPAN_M, WINDOW_M, GradeTracker
from tpmsd.onboard.estimators.bank.error_state import ProcessModel, TickMotion, initial_state
from tpmsd.onboard.estimators.gates.gyro_check import GyroCheck


def _climb(tracker: GradeTracker, sine: float, metres: int, noise: float = 0.0, start: float = 0.0) -> None:
    rng = np.random.default_rng(1)
    for step in range(metres // 4):
        tracker.move(4.0)
        tracker.update(start + sine * 4.0 * (step + 1) + noise * rng.standard_normal())


@pytest.mark.parametrize("sine", [-0.12, -0.03, 0.0, 0.06])
def test_the_slope_is_height_over_distance(sine: float) -> None:
    """On an even slope the sine is exact, and the horizontal part is its cosine."""
    tracker = GradeTracker()
    _climb(tracker, sine, 300)
    assert tracker.sine == pytest.approx(sine, abs=1e-12)
    assert tracker.horizontal == pytest.approx(math.cos(math.asin(sine)), abs=1e-12)


def test_noisy_heights_make_no_slope() -> None:
    """Half a metre of white height noise on a level road costs less than a tenth of a tenth of a per cent of
    way."""
    tracker = GradeTracker()
    _climb(tracker, 0.0, 2000, noise=0.5)
    assert tracker.horizontal == pytest.approx(1.0, abs=1e-4)


def test_a_standing_car_and_missing_heights_change_nothing() -> None:
    """Heights without way, and NaN, are left out."""
    tracker = GradeTracker()
    _climb(tracker, 0.05, 300)
    before = tracker.sine
    for _ in range(500):
        tracker.update(-100.0)
    tracker.update(math.nan)
    assert before == tracker.sine


def test_a_leap_of_the_height_is_bounded() -> None:
    """No road is steeper than the limit, whatever the receiver says."""
    tracker = GradeTracker()
    _climb(tracker, 3.0, 300)
    assert MAX_GRADE == tracker.sine
    tracker.reset()
    assert tracker.horizontal == 1.0


def test_the_slope_is_the_least_squares_line_of_the_window() -> None:
    """Over 60 km of hills, with a gap: at every height that of a polynomial fitted to the last 200 m."""
    rng = np.random.default_rng(3)
    tracker, distance = GradeTracker(), 0.0
    points: list[tuple[float, float]] = []
    worst, fitted = 0.0, 0
    for step in range(15000):
        if step == 9000:
            tracker.reset()
            points = []
        metres = rng.uniform(2.1, 6.0)
        distance += metres
        up = 1500.0 + 40.0 * math.sin(distance / 900.0) + rng.standard_normal()
        tracker.move(metres)
        tracker.update(up)
        points = [(at, height) for at, height in points if distance - at <= WINDOW_M] + [(distance, up)]
        if step % 50 == 49 and distance - points[0][0] >= MIN_SPAN_M:
            at, height = np.array(points).T
            worst = max(worst, abs(tracker.sine - np.polyfit(at - distance, height, 1)[0]))
            fitted += 1
    assert fitted > 290
    assert worst < 1e-9


def _drive(
    check: GyroCheck, scale: float, bias: float = 0.0, wheel_noise: float = 0.0, seconds: int = 120
) -> None:
    """Bends of up to 0.1 rad/s; `scale` is what the signal says per true yaw rate."""
    rng = np.random.default_rng(2)
    for step in range(1200):
        true = 0.1 * math.sin(step / 70.0)
        check.update(scale * true + bias, true + wheel_noise * rng.standard_normal(), 0.1)


@pytest.mark.parametrize(
    ("scale", "trusted"), [(1.0, True), (1.04, True), (-1.0, False), (math.radians(1), False), (57.3, False)]
)
def test_a_yaw_rate_in_another_unit_or_sign_is_not_trusted(scale: float, trusted: bool) -> None:
    """Degrees for radians, radians for degrees and a sensor upside down are told from a yaw rate."""
    check = GyroCheck()
    _drive(check, scale)
    assert trusted is check.trusted


def test_bias_and_coarse_counters_do_not_cost_the_trust() -> None:
    """The slope is free of the bias, and noise of the wheels, the explained variable, does not flatten it."""
    check = GyroCheck()
    _drive(check, 1.0, bias=0.05, wheel_noise=0.1)
    assert check.slope == pytest.approx(1.0, abs=0.15)
    assert check.trusted


def test_a_frozen_or_untried_gyro_is_not_trusted() -> None:
    """A constant signal, a straight road and missing readings say nothing."""
    frozen, straight = GyroCheck(), GyroCheck()
    _drive(frozen, 0.0, bias=0.01)
    for _ in range(1000):
        straight.update(1e-4, 0.0, 0.1)
        straight.update(math.nan, 0.1, 0.1)
    assert not frozen.trusted
    assert not straight.trusted
    assert not GyroCheck().trusted


@pytest.mark.parametrize("horizontal", [1.0, 0.995])
def test_the_map_sees_the_horizontal_part_of_the_distance_and_all_of_the_turn(horizontal: float) -> None:
    """On a slope the pose moves by the cosine of the way rolled; the wheels' difference still turns."""
    nominal = np.full(2, 0.3)
    model = ProcessModel(nominal, 1.5, driven_rear=False)
    mean, _ = initial_state(1, nominal)
    motion = TickMotion(0.1, np.array([6.0, 6.1]), 0.0, 0.0, True, horizontal)
    distance, turn = model.travel_and_turn(mean, motion)
    assert distance[0] == pytest.approx(6.05 * 0.3 * horizontal)
    assert turn[0] == pytest.approx(0.1 * 0.3 / 1.5)
