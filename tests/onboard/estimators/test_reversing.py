"""Cars that reverse, on buses whose wheel signals bear a sign and on those whose do not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.estimators.world import Drive, Receiver, World, errors_m, estimator, run
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.gates.reversing import ReverseWatch
from tpmsd.onboard.timeline.tick import Fix, Tick

KNOTS_S = (0, 3, 5, 14, 16, 20, 40, 95, 105, 110, 112, 121, 123, 127, 145, 240)
SPEEDS_MPS = (0, 0, -1.4, -1.4, 0, 0, 19, 22, 0, 0, -1.6, -1.6, 0, 0, 20, 21)
"""Backs out of a parking space, drives, stops, turns round in three moves, drives on."""


def speed(time_s: FloatArray) -> FloatArray:
    return np.interp(time_s, KNOTS_S, SPEEDS_MPS)


def yaw(time_s: FloatArray) -> FloatArray:
    turning = ((time_s > 6) & (time_s < 13)) | ((time_s > 113) & (time_s < 120))
    bends = 0.05 * np.sin(time_s / 11.0) * np.clip((speed(time_s) - 8.0) / 8.0, 0.0, 1.0)
    return np.where(turning, 0.17, bends)


def reversing(seed: int, receiver: Receiver = Receiver()) -> Drive:  # noqa: B008
    world = World(duration_s=240.0, seed=seed, speed_mps=speed, yaw_radps=yaw, receiver=receiver)
    return world.drive()


def without_sign(tick: Tick) -> Tick:
    return replace(tick, rotation_rad=np.abs(tick.rotation_rad))


@pytest.mark.parametrize("signed", [True, False])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_heading_and_radii_after_reversing(seed: int, signed: bool) -> None:
    """Out of a parking space and turned round on the way, the heading is right, and the radii stay."""
    drive = reversing(seed)
    ticks = drive.ticks if signed else [without_sign(tick) for tick in drive.ticks]
    filter_ = estimator("gaussian-sum", drive.world)
    estimates = run(filter_, ticks)

    assert 0 == filter_.counts["lost_pose"]
    at = [k for k in range(len(ticks)) if speed(np.array([0.1 * k]))[0] > 5.0]
    apart = [math.remainder(estimates[k].heading_rad - drive.pose[k, 2], 2 * math.pi) for k in at]
    assert 0.15 > np.nanmax(np.abs(apart))
    assert 0.9 < np.mean(np.isfinite(apart))
    error = errors_m(drive, estimates)
    assert 1.5e-3 > np.abs(error[-1]).max()
    before, after = (round(10 * t) for t in (94, 150))
    assert 1.0e-3 > np.abs(error[after] - error[before]).max()


def fix(time_s: float, course_rad: float, speed_mps: float = 1.4) -> Fix:
    return Fix(time_s, 0.5, 0.0, 0.0, 1.0, speed_mps=speed_mps, heading_rad=course_rad)


def rest(watch: ReverseWatch) -> None:
    for _ in range(10):
        watch.update_speed(0.0, 0.1)


def test_from_standstill_to_standstill() -> None:
    """Two courses against the heading say backward, until the car stands again."""
    watch = ReverseWatch()
    rest(watch)
    watch.update_speed(1.4, 0.1)
    watch.compare_course(fix(1.0, 3.1), 0.0)
    assert not watch.backward
    watch.compare_course(fix(1.5, 3.2), 0.0)
    assert watch.backward
    watch.update_speed(1.4, 0.1)
    assert watch.backward
    rest(watch)
    assert not watch.backward


def test_a_course_along_the_heading_settles_it() -> None:
    """Once the car was seen to drive forward, no course turns it before it stands again."""
    watch = ReverseWatch()
    watch.update_speed(1.4, 0.1)
    watch.compare_course(fix(1.0, 0.4), 0.0)
    for time_s in (1.5, 2.0, 2.5):
        watch.compare_course(fix(time_s, math.pi), 0.0)
    assert not watch.backward


@pytest.mark.parametrize("speed_mps", [-1.0, 9.0])
def test_signed_signals_and_fast_cars_are_not_asked(speed_mps: float) -> None:
    """A negative speed shows that the signals bear a sign; cars do not reverse at 9 m/s."""
    watch = ReverseWatch()
    watch.update_speed(speed_mps, 0.1)
    for time_s in (1.0, 1.5, 2.0):
        watch.compare_course(fix(time_s, math.pi), 0.0)
    assert not watch.backward


def test_without_course_or_too_slow_nothing_is_reported() -> None:
    """NaN courses and creeping decide neither way."""
    watch = ReverseWatch()
    watch.update_speed(1.0, 0.1)
    for time_s in (1.0, 1.5, 2.0):
        watch.compare_course(fix(time_s, math.nan), 0.0)
        watch.compare_course(fix(time_s, math.pi, 0.3), 0.0)
        watch.compare_course(fix(time_s, math.pi, math.nan), 0.0)
    assert not watch.backward
    assert watch.undecided
