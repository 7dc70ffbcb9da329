"""Counters that miscount: rings of another number of teeth, and counts lost at walking pace."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.prepared.admission import corrected_reader
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.rings.low_speed import low_speed_losses

BELOW_MPS = 2.4


@cache
def city() -> Recording:
    """Five minutes of a town with stops."""
    return recording_of(drive(Spec(duration_s=400.0, road="city", stops=True), 5))


@pytest.mark.parametrize(
    ("counted", "counts"),
    [
        ((44, 44, 44, 44), (44.0, 44.0, 44.0, 44.0)),
        ((96, 96, 96, 96), (96.0, 96.0, 96.0, 96.0)),
        ((48, 48, 44, 48), (None, None, 44.0, None)),
        ((48, 60, 48, 48), (None, 60.0, None, None)),
        ((48, 48, 48, 48), (None, None, None, None)),
    ],
)
def test_a_ring_of_any_number_of_teeth_is_counted_right(
    counted: tuple[int, ...], counts: tuple[float | None, ...]
) -> None:
    """Angles by 48 teeth configured are put right; radii that differ by less are left alone."""
    recording = city()
    wrong = replace(recording, rotation_rad=recording.rotation_rad * (np.array(counted) / 48.0))

    right = corrected_reader(wrong).recording

    assert counts == right.counts_per_rev
    np.testing.assert_allclose(right.rotation_rad, recording.rotation_rad, rtol=1e-12)


def blind(below_mps: float) -> Recording:
    """The same drive with counters that stand below a speed."""
    recording = city()
    speed = recording.rotation_rad.mean(axis=1) / recording.dt_s * recording.car.radius_m[0]
    return replace(recording, rotation_rad=np.where(speed[:, None] < below_mps, 0.0, recording.rotation_rad))


def test_counts_lost_below_a_speed_are_found() -> None:
    """All wheels, all of their counts, and the speed within its interval."""
    recording = blind(BELOW_MPS)

    found = low_speed_losses(recording, reference(recording).car.radius_m)

    assert found is not None
    assert ("fl", "fr", "rl", "rr") == found.wheels
    assert pytest.approx(1.0, abs=0.05) == found.share
    assert abs(found.below_mps - BELOW_MPS) < 2.0 * found.below_std_mps < 1.5


def test_the_speeds_are_those_of_the_wheel_that_loses() -> None:
    """A rougher wheel behind it, which is read from a higher speed on, changes nothing."""
    recording, radius_m = blind(BELOW_MPS), reference(blind(BELOW_MPS)).car.radius_m
    rough = recording.rotation_rad.copy()
    rough[:, 3] += 0.5 * np.random.default_rng(1).standard_normal(len(rough))

    smooth_losses = low_speed_losses(recording, radius_m)
    rough_losses = low_speed_losses(replace(recording, rotation_rad=rough), radius_m)

    assert smooth_losses is not None
    assert rough_losses is not None
    assert rough_losses.speeds_mps[0] == pytest.approx(smooth_losses.speeds_mps[0], abs=0.05)


def test_a_single_stop_loses_nothing() -> None:
    """A receiver whose speed is late at one stop, the only one that it reads: nobody knows how it errs."""
    recording = city()
    slow = recording.speed_mps < 4.0
    first = recording.fix_time_s[slow][0] // 20.0
    one_stop = recording.fix_time_s // 20.0 == first
    late_mps = np.where(slow & one_stop, 2.0 * recording.speed_mps, recording.speed_mps)
    read = replace(recording, speed_mps=np.where(slow & ~one_stop, np.nan, late_mps))

    assert np.count_nonzero(slow & one_stop) >= 3
    assert low_speed_losses(read, reference(read).car.radius_m) is None


def test_whole_counters_lose_nothing() -> None:
    """The receiver's speed and the wheels' agree down to walking pace."""
    assert low_speed_losses(city(), reference(city()).car.radius_m) is None
