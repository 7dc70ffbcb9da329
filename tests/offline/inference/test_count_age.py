"""An age that all counts share is told and taken out; what is none stays bit for bit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.motion import Car
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.count_age import common_age, without_common_age
from tpmsd.offline.inference.recording import Recording

TEETH, DT_S, RADIUS_M = 48, 0.1, np.array([0.30, 0.301, 0.302, 0.299])
TIME_S = np.arange(4001) * DT_S


def distance_at(time_s: FloatArray) -> FloatArray:
    """A car at 12 to 28 m/s: the integral of 20 + 8 sin(t / 25 s)."""
    return 20.0 * time_s - 200.0 * np.cos(time_s / 25.0)


def recording(age_s: FloatArray, counted: bool = True) -> Recording:
    """Counts that were read `age_s` (n + 1,) before the ticks' edges."""
    angle = distance_at(TIME_S - age_s)[:, None] / RADIUS_M + np.array([0.0, 0.03, 0.05, 0.09])
    step = 2 * math.pi / TEETH
    shown = np.floor(angle / step) * step if counted else angle
    nothing = np.zeros(0)
    return Recording(
        car=Car(RADIUS_M, WheelPositions(1.5, 1.5, 2.6), np.ones(4, dtype=np.bool_), TEETH, 0.0, 0.0),
        dt_s=DT_S,
        start_s=0.0,
        rotation_rad=np.diff(shown, axis=0),
        quantum_rad=np.full(4, step / math.sqrt(6.0) if counted else 0.0),
        inertial={},
        fix_time_s=nothing,
        east_m=nothing,
        north_m=nothing,
        up_m=nothing,
        speed_mps=nothing,
        course_rad=nothing,
    )


def latched(period_s: float) -> FloatArray:
    """Age since the last multiple of a period that beats against the ticks."""
    return np.asarray(np.mod(TIME_S, period_s))


def errors_m(one: Recording) -> FloatArray:
    """(n + 1,) way by the mean of the wheels less the true one, its slow part taken out."""
    rolled = np.concatenate([[0.0], np.cumsum((one.rotation_rad * RADIUS_M).mean(axis=1))])
    off = rolled - distance_at(TIME_S)
    return np.asarray(off - np.convolve(off, np.ones(51) / 51.0, mode="same"))[50:-50]


@pytest.mark.parametrize("period_s", [0.0173, 0.0191])
def test_a_latched_age_is_reported_and_taken_out(period_s: float) -> None:
    """Ages uniform over a period P have the deviation P / sqrt(12); of the error at most 0.4 is left."""
    drive = recording(latched(period_s))
    age = common_age(drive)
    assert age is not None
    assert age.std_s == pytest.approx(period_s / math.sqrt(12.0), rel=0.4)
    before, after = errors_m(drive).std(), errors_m(without_common_age(drive)).std()
    assert before > 0.07
    assert after < 0.4 * before


def test_the_wheels_keep_their_differences() -> None:
    """What is taken out is common: ratios of the wheels' ways stay, by a millimetre in eight kilometres."""
    drive = recording(latched(0.0165))
    before, after = (one.rotation_rad.sum(axis=0) * RADIUS_M for one in (drive, without_common_age(drive)))
    assert np.ptp(after - before) < 1e-3 * 8.0


@pytest.mark.parametrize("age_s", [0.0, 0.012])
def test_without_a_rhythm_nothing_is_touched(age_s: float) -> None:
    """No age, and one that is always the same (which is an age of the fixes): the very same recording."""
    drive = recording(np.full(len(TIME_S), age_s))
    assert without_common_age(drive) is drive


def test_speeds_have_no_counts_and_no_age() -> None:
    """Signals without a resolution of counts are left alone."""
    drive = recording(latched(0.0165), counted=False)
    assert without_common_age(drive) is drive
