"""Ages of counts in a rhythm of each wheel's own are found by their lines and taken out."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tests.offline.inference.test_count_age import DT_S, RADIUS_M, distance_at, recording
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.prepared.admission import corrected_reader
from tpmsd.offline.inference.count_rhythm import rhythm_of, without_rhythms
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference

TIME_S: FloatArray = np.arange(4001, dtype=np.float64) * DT_S
SPEED = 20.0 + 8.0 * np.sin((TIME_S[1:] - 0.5 * DT_S) / 25.0)
HZ, PHASES = np.array([0.310, 0.3125, 0.3104, 0.3090]), np.array([0.1, 0.45, 0.3, 0.8])


def sawtooth(amplitude_s: float, hz: float, phase: float = 0.0, time_s: FloatArray = TIME_S) -> FloatArray:
    """Age at the ticks' edges."""
    return np.asarray(amplitude_s * np.mod(hz * time_s + phase, 1.0))


def latched_apart(amplitude_s: float = 0.0199) -> Recording:
    """Counts of wheels whose ages sweep over the same time, each with a clock and a phase of its own."""
    return of_wheels([sawtooth(amplitude_s, hz, at) for hz, at in zip(HZ, PHASES, strict=True)])


def of_wheels(ages_s: list[FloatArray]) -> Recording:
    """Counts of wheels with these ages."""
    drives = [recording(age_s) for age_s in ages_s]
    rotation = np.stack([one.rotation_rad[:, k] for k, one in enumerate(drives)], axis=1)
    return dataclasses.replace(drives[0], rotation_rad=rotation)


def ages_s(one: Recording) -> FloatArray:
    """(n + 1, 4) age by which the wheels' ways lag, its slow part taken out."""
    rolled = np.concatenate([np.zeros((1, 4)), np.cumsum(one.rotation_rad * RADIUS_M, axis=0)])
    late = ((distance_at(TIME_S) - distance_at(TIME_S[:1]))[:, None] - rolled) / np.append(SPEED, SPEED[-1:])[
        :, None
    ]
    slow = np.stack([np.convolve(age, np.ones(97) / 97.0, mode="same") for age in late.T], axis=1)
    return np.asarray(late - slow)


@pytest.mark.parametrize("hz", [0.31, 1.7, 8.4])
def test_a_sawtooth_is_found_with_its_frequency_and_its_height(hz: float) -> None:
    """Frequency to a hundredth of a cycle over the drive; of frequencies beyond 5 Hz the age falls slowly."""
    one = recording(sawtooth(0.012, hz))

    found = rhythm_of(one.rotation_rad[:, 2] * RADIUS_M[2], SPEED, DT_S)

    assert found is not None
    assert found.hz == pytest.approx(hz, abs=2e-5)
    assert found.amplitude_s == pytest.approx(0.012, rel=0.05)


def test_each_wheels_own_age_is_taken_out() -> None:
    """Of a deviation of P / sqrt(12), 5.7 ms, the counts' own 0.6 ms are left, and no sweep of it."""
    before, after = (ages_s(one)[60:-60] for one in (latched_apart(), without_rhythms(latched_apart())))

    assert np.all(before.std(axis=0) > 5e-3)
    assert np.all(after.std(axis=0) < 1e-3)


def test_a_fall_that_comes_late_is_placed_where_it_is() -> None:
    """Two ticks after its time an age falls: the edges between would be off by the whole of it."""
    ages = [sawtooth(0.0199, hz, at) for hz, at in zip(HZ, PHASES, strict=True)]
    for age in ages:
        for fall in np.flatnonzero(np.diff(age) < 0.0)[5::10]:
            age[fall + 1 : fall + 3] += 0.0199

    left = ages_s(without_rhythms(of_wheels(ages)))[60:-60]

    assert np.quantile(np.abs(left), 0.999) < 4e-3


@pytest.mark.parametrize("hz", [0.11, 0.31, 1.7])
def test_one_clock_for_all_wheels_is_no_rhythm_of_their_own(hz: float) -> None:
    """The age that they share is left to `without_common_age`; clocks a tenth of a cycle apart are two."""
    shared = recording(sawtooth(0.0066, hz))
    apart = of_wheels([sawtooth(0.0066, hz, at) for at in (0.0, 0.0, 0.1, 0.1)])

    assert without_rhythms(shared) is shared
    assert without_rhythms(apart) is not apart


@pytest.mark.parametrize(
    "age_s",
    [
        np.zeros(len(TIME_S)),
        np.full(len(TIME_S), 0.012),
        0.006 * np.random.default_rng(5).random(len(TIME_S)),
        0.002 * np.sin(2.0 * math.pi * 1.3 * TIME_S),
    ],
    ids=["none", "constant", "without a rhythm", "one line: an uneven ring at constant speed"],
)
def test_what_is_no_sawtooth_is_left_alone(age_s: FloatArray) -> None:
    """The very same recording."""
    one = recording(age_s)

    assert without_rhythms(one) is one


def test_speeds_have_no_counts_and_no_rhythm() -> None:
    """Signals without a resolution of counts are left alone."""
    one = recording(sawtooth(0.0199, 0.31), counted=False)

    assert without_rhythms(one) is one


def test_the_reference_motion_turns_no_more_than_the_car() -> None:
    """Without a gyro, wheels latched apart make a yaw rate that the car has not."""
    sound = recording_of(drive(Spec(duration_s=400.0, road="motorway", with_gyro=False), 5))
    inertial = {name: np.full(sound.ticks, np.nan) for name in sound.inertial}
    sound = dataclasses.replace(sound, inertial=inertial)
    rate = np.concatenate([sound.rotation_rad[:1], sound.rotation_rad]) / sound.dt_s
    late = [
        rate[:, k] * sawtooth(0.0199, hz, at, sound.edges_s)
        for k, (hz, at) in enumerate(zip(HZ, PHASES, strict=True))
    ]
    aged = dataclasses.replace(
        sound, rotation_rad=sound.rotation_rad - np.diff(np.stack(late, axis=1), axis=0)
    )

    true = reference(sound).motion.yaw_rate_radps
    raw, mended = (one.motion.yaw_rate_radps for one in (reference(aged), corrected_reader(aged).reference))

    assert (raw - true).std() > 0.02
    assert (mended - true).std() < 0.005
