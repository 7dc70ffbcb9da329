"""Effects are found by name on drives whose world has its own equations for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from bench.worlds.course import Course
from bench.worlds.instruments import Drive, observe
from bench.worlds.kinematic import Spec, course
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.assessment.result import Finding
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.inference.recording import Recording

FRONT, REAR = np.array([1.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, 1.0])


def driven(spec: Spec, seed: int) -> tuple[Course, np.random.Generator]:
    """Where the car went, and the generator for what the instruments add."""
    rng = np.random.default_rng(seed)
    return course(spec, rng), rng


def findings(recording: Recording) -> dict[str, Finding]:
    """By effect, in the order of the report."""
    return {one.effect: one for one in diagnose([recording]).findings}


def numbers(finding: Finding) -> dict[str, tuple[float, float]]:
    """Values and standard deviations of its parameters."""
    pairs = {name: (one.value, one.std) for name, one in finding.parameters.items()}
    return {name: (v, s) for name, (v, s) in pairs.items() if isinstance(v, float) and s is not None}


def test_a_tyre_of_brushes_is_a_slip_curve() -> None:
    """A brush tyre (Pacejka 2012, section 3.2) on a wet road: stiffness, and where the grip ends."""
    spec = Spec(duration_s=400.0, road="city", driven="front", stops=True)
    trip, rng = driven(spec, 2)
    most, slope = 2.2, 4e-3
    slips = np.linspace(0.0, 3.0 * slope * most, 4001)
    share = slips / slips[-1]
    forces = most * (3.0 * share - 3.0 * share**2 + share**3)
    slip = np.sign(trip.force) * np.interp(np.abs(trip.force), forces, slips)

    found = findings(recording_of(observe(replace(trip, spin=slip[:, None] * FRONT), spec, rng, 2)))

    assert ["drive_slip_curve"] == list(found)
    values = numbers(found["drive_slip_curve"])
    assert pytest.approx(slope, rel=0.25) == values["slip_per_accel"][0]
    assert pytest.approx(most, rel=0.25) == values["saturation_mps2"][0]


def test_linear_slip_is_no_curve() -> None:
    """The simpler of two that explain as much is named."""
    spec = Spec(duration_s=240.0, road="city", driven="front", stops=True)
    trip, rng = driven(spec, 2)

    found = findings(
        recording_of(observe(replace(trip, spin=4e-3 * trip.force[:, None] * FRONT), spec, rng, 2))
    )

    assert ["longitudinal_slip"] == list(found)
    assert "drive_slip_curve" not in found["longitudinal_slip"].indistinguishable_from


def test_drive_on_one_axle_and_brakes_on_both_are_two_effects() -> None:
    """Each wheel slips in proportion to its own force, as in a car: neither effect alone explains that."""
    spec = Spec(duration_s=300.0, road="mixed", driven="rear", stops=True)
    trip, rng = driven(spec, 8)
    power, braking = np.maximum(trip.force, 0.0)[:, None], np.maximum(-trip.force, 0.0)[:, None]
    slip = 6e-3 * power * REAR - braking * (5e-3 * FRONT + 3e-3 * REAR)

    found = findings(recording_of(observe(replace(trip, spin=slip), spec, rng, 8)))

    assert {"brake_slip", "longitudinal_slip"} == set(found)
    values = numbers(found["longitudinal_slip"]) | numbers(found["brake_slip"])
    for name, truth in (("slip_per_accel", 6e-3), ("front", 5e-3), ("rear", 3e-3 - 6e-3)):
        assert pytest.approx(truth, abs=3.0 * values[name][1]) == values[name][0]
        assert values[name][1] < 1.5e-3  # the load that moves with the force is not known beside the slip


def test_drive_on_one_axle_and_brakes_on_the_other_are_two_effects() -> None:
    """As of a motor in front and a parking brake: the front wheels roll freely under the brakes, which their
    slip under drive force does not know."""
    spec = Spec(duration_s=300.0, road="mixed", driven="front", stops=True)
    trip, rng = driven(spec, 8)
    power, braking = np.maximum(trip.force, 0.0)[:, None], np.maximum(-trip.force, 0.0)[:, None]
    slip = 9e-3 * (power * FRONT - braking * REAR)

    found = findings(recording_of(observe(replace(trip, spin=slip), spec, rng, 8)))

    assert {"brake_slip", "longitudinal_slip"} == set(found)
    values = numbers(found["longitudinal_slip"]) | numbers(found["brake_slip"])
    for name, truth in (("slip_per_accel", 9e-3), ("front", -9e-3), ("rear", 9e-3)):
        assert pytest.approx(truth, rel=0.1) == values[name][0]


def test_tyres_as_stiff_as_their_load_are_slip_and_no_load() -> None:
    """Force shifts load, and a tyre is as stiff against slip as it is loaded. No load changes radii so much:
    of the impossible sign it does not stand in for slip."""
    spec = Spec(duration_s=300.0, road="mixed", driven="front", stops=True)
    trip, rng = driven(spec, 8)
    power, braking = np.maximum(trip.force, 0.0)[:, None], np.maximum(-trip.force, 0.0)[:, None]
    shift = 0.04 * trip.force[:, None]
    slip = 9e-3 * (power / (1.0 - shift) * FRONT - braking / (1.0 + shift) * REAR)

    found = findings(recording_of(observe(replace(trip, spin=slip), spec, rng, 8)))

    assert "brake_slip" in found and {"longitudinal_slip", "drive_slip_curve"} & set(found)
    assert "load_transfer_longitudinal" not in found
    values = numbers(found["brake_slip"])
    for name, truth in (("front", -9e-3), ("rear", 9e-3)):
        assert pytest.approx(truth, abs=3.0 * values[name][1]) == values[name][0]


def test_people_who_got_in_behind_are_a_load() -> None:
    """Rear wheels of 0.4 mm less radius after the longest stop turn faster from there on."""
    spec = Spec(duration_s=420.0, road="mixed", stops=True)
    trip, rng = driven(spec, 3)
    recording = recording_of(observe(trip, spec, rng, 3))
    moving = trip.time_s[trip.speed > 0.2]
    after = recording.edges_s[:-1] >= moving[1 + int(np.argmax(np.diff(moving)))]
    turns = recording.rotation_rad * (1.0 + (4e-4 / spec.radius_m) * after[:, None] * REAR)

    found = findings(replace(recording, rotation_rad=turns))

    assert ["load_static"] == list(found)
    value, std = numbers(found["load_static"])["rear_m"]
    assert pytest.approx(-4e-4, abs=max(3.0 * std, 4e-6)) == value


def test_chains_are_distinguished_from_wheels_that_lock() -> None:
    """A driven axle that turns slower by 2.8 % for two minutes and a half."""
    spec = Spec(duration_s=280.0, road="city", driven="front")
    trip, rng = driven(spec, 4)
    recording = recording_of(observe(trip, spec, rng, 4))
    on = (recording.edges_s[:-1] > 80.0) & (recording.edges_s[:-1] < 230.0)

    found = findings(
        replace(recording, rotation_rad=recording.rotation_rad * (1 - 0.028 * on[:, None] * FRONT))
    )

    assert ["chains"] == list(found)
    assert ("fl", "fr") == found["chains"].where.wheels
    assert pytest.approx(-0.028, abs=1e-3) == numbers(found["chains"])["slip"][0]


def test_a_tilted_gyro_is_identified_by_crests() -> None:
    """Its axis is tilted by 0.08 rad to the side; the world rotates the vector of the turning rate."""
    spec = Spec(duration_s=500.0, road="rural", hilly=0.04)
    trip, rng = driven(spec, 3)
    seen = observe(trip, spec, rng, 3)
    pitching = -np.gradient(seen.grade, seen.time_s)
    tilted = replace(seen, gyro=np.cos(0.08) * seen.gyro + np.sin(0.08) * pitching)

    found = findings(recording_of(tilted))

    assert "gyro_misalignment" in found
    value, std = numbers(found["gyro_misalignment"])["sideways_rad"]
    assert pytest.approx(0.08, abs=3.0 * std) == value
    assert {"gyro_misalignment", "road_grade", "yaw_rate_scale"} >= set(found)


def smoothed(seen: Drive, time_constant_s: float) -> Drive:
    """The receiver's velocity through a recursive filter, epoch by epoch, along east and north."""
    step = float(np.median(np.diff(seen.fix_true_s)))
    new = 1.0 - np.exp(-step / time_constant_s)
    known = np.isfinite(seen.fix_course_math)
    course_rad = np.where(known, seen.fix_course_math, 0.0)
    along = [
        lfilter([new], [1.0, new - 1.0], x, zi=[(1.0 - new) * x[0]])[0]
        for x in (seen.fix_speed * np.cos(course_rad), seen.fix_speed * np.sin(course_rad))
    ]
    return replace(
        seen,
        fix_speed=np.hypot(*along),
        fix_course_math=np.where(known, np.arctan2(along[1], along[0]), np.nan),
    )


def test_a_receiver_that_smooths_is_distinguished_from_one_that_lags() -> None:
    """A recursive filter of 1 s; its own half step is all the lag there may be beside it."""
    spec = Spec(duration_s=300.0, road="city", stops=True)
    trip, rng = driven(spec, 5)

    found = findings(recording_of(smoothed(observe(trip, spec, rng, 5), 1.0)))

    assert "gnss_smoothing" == next(iter(found))
    assert pytest.approx(1.0, abs=0.12) == numbers(found["gnss_smoothing"])["time_constant_s"][0]
    assert {"gnss_smoothing", "velocity_lag"} >= set(found)


def test_two_frames_of_one_reading_are_no_finding() -> None:
    """Front wheels that are read with the rear ones and stamped 0.9 ms later are not delayed."""
    spec = Spec(duration_s=600.0, road="mixed", driven="front", stops=True)
    trip, rng = driven(spec, 9)
    recording = recording_of(observe(trip, spec, rng, 9))
    rate = recording.rotation_rad / recording.dt_s
    later = 9e-4 * np.diff(0.5 * (rate + np.roll(rate, 1, axis=0)), axis=0, append=rate[-1:])

    assert [] == list(findings(replace(recording, rotation_rad=recording.rotation_rad - later * FRONT)))
