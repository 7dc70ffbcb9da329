"""The worlds that the diagnosis is judged in, against closed forms and the program's reader."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from bench.worlds import multibody
from bench.worlds.course import hub_speeds, wheel_rates
from bench.worlds.folder import wheel_messages, write_folder
from bench.worlds.kinematic import course, drive
from bench.worlds.latch import latched_at
from bench.worlds.spec import FINE_TEETH, Spec, draw_spec
from tpmsd.interfaces.cli.diagnose import read_recording

BUSES = {
    "8 bit": {"count_bits": 8, "wheel_hz": 50.0},
    "10 bit, two messages, out of step": {"count_bits": 10, "split_wheels": True, "wheel_hz": 100.0},
    "16 bit at 20 Hz": {"wheel_hz": 20.0, "inertial_hz": 100.0},
    "counts latched every 7 ms": {"latch_period_s": 0.007, "latch_jitter_s": 1e-4},
    "fine encoders": {"teeth": FINE_TEETH},
    "speeds of 0.01 km/h": {"wheel_signal": "speeds", "wheel_hz": 100.0},
    "speeds of 0.05 km/h at 25 Hz": {"wheel_signal": "speeds", "speed_step_kmh": 0.05, "wheel_hz": 25.0},
    "lost and repeated frames": {"lost_share": 0.01, "repeated_share": 0.01},
    "no inertial signals": {"with_gyro": False, "with_accel": False, "with_steering": False},
    "a host clock that is off": {"host_offset_s": -12.5, "host_age": 0.0},
}


@pytest.mark.parametrize("bus", list(BUSES))
def test_each_bus_is_read_as_it_was_driven(bus: str, tmp_path: Path) -> None:
    """The wheels' whole way is that of the drive to within a permille, and fixes lie where they were."""
    fixed = {key: value for key, value in BUSES[bus].items() if key != "host_age"}
    spec = Spec(duration_s=120.0, **fixed)  # type: ignore[arg-type]
    true = drive(spec, 5)
    write_folder(true, tmp_path)
    recording = read_recording(tmp_path)
    known = np.isfinite(recording.rotation_rad).all(axis=1)
    edges = recording.edges_s
    rear = np.stack([np.interp(edges, true.time_s, true.shown_rad[:, k]) for k in range(4)], axis=1)
    expected = np.diff(rear, axis=0)[known].sum(axis=0)

    assert known.mean() > 0.9
    assert recording.rotation_rad[known].sum(axis=0) == pytest.approx(expected, rel=1e-3)
    assert np.isfinite(recording.inertial["yaw_rate_radps"]).any() == spec.with_gyro
    assert len(recording.fix_time_s) == pytest.approx(len(true.fix_true_s), abs=15)


@pytest.mark.parametrize("apart", [False, True])
def test_a_latched_count_is_between_nothing_and_a_period_old(apart: bool) -> None:
    """Ages fill the latch's period evenly; of one unit they are alike on all wheels, of several they are not;
    a rhythm of the frames gives one age, one a permille off it sweeps over the period and falls back."""
    sent_s = np.arange(0.0, 60.0, 0.01)
    spec = Spec(latch_period_s=0.0037, latch_phase=0.3, latch_apart=apart)
    ages = np.stack([sent_s - latched_at(sent_s, spec, 4, wheel) for wheel in range(4)])

    assert (0.0 <= ages.min()) and (ages.max() < 0.0037 * 1.001)
    assert ages.mean(axis=1) == pytest.approx(0.5 * 0.0037, rel=0.05)
    assert bool((ages == ages[0]).all()) is not apart

    same = Spec(latch_period_s=0.005, latch_phase=0.5)
    assert sent_s - latched_at(sent_s, same, 4, 0) == pytest.approx(0.0025, abs=1e-6)
    beat = dataclasses.replace(same, latch_period_s=0.005 * 1.001)
    falls = np.diff(sent_s - latched_at(sent_s, beat, 4, 0)) < -0.0025
    sweeps = np.diff(sent_s - latched_at(sent_s, beat, 4, 0)) > 0.0025
    # Ten microseconds a frame: the whole period in five seconds.
    assert 12 == pytest.approx(max(falls.sum(), sweeps.sum()), abs=1)
    assert 0 == min(falls.sum(), sweeps.sum())


def test_counts_in_frames_are_those_of_the_last_latch(tmp_path: Path) -> None:
    """At 20 m/s of a latch of 20 ms every wheel's count is up to 0.4 m behind, and 0.2 m in the mean."""
    plain = Spec(duration_s=60.0, steady=True, teeth=100.0, frame_jitter_s=0.0)
    late = dataclasses.replace(plain, latch_period_s=0.0193)
    (now,), (then,) = (wheel_messages(drive(spec, 5)) for spec in (plain, late))
    moved = np.interp(now.time_s, (true := drive(plain, 5)).time_s, true.speed) > 5.0
    behind = (now.raw - then.raw)[moved] * 2.0 * math.pi * plain.radius_m / 100.0
    expected = 0.5 * 0.0193 * float(np.interp(now.time_s[moved], true.time_s, true.speed).mean())

    assert behind.min() >= -0.02
    assert behind.mean(axis=0) == pytest.approx(np.full(4, expected), rel=0.1)


def test_a_car_in_a_bend_turns_its_wheels_by_geometry() -> None:
    """A left bend: the outer rear wheel exceeds the inner by track times yaw rate."""
    spec = Spec(duration_s=60.0)
    road = course(spec, np.random.default_rng(2))
    hubs = hub_speeds(road, spec)

    assert hubs[:, 3] - hubs[:, 2] == pytest.approx(spec.track_rear_m * road.yaw, abs=1e-12)
    assert wheel_rates(road, spec)[:, 2] == pytest.approx(hubs[:, 2] / spec.radius_m)


def test_drawn_drives_differ_and_hide_no_physics() -> None:
    """Cars, buses and receivers of fifty seeds: every kind of bus and receiver turns up."""
    specs = [draw_spec(np.random.default_rng(seed)) for seed in range(50)]

    assert {"counts", "speeds"} == {spec.wheel_signal for spec in specs}
    assert {1.0, 5.0, 10.0} == {spec.receiver_hz for spec in specs}
    assert {True, False} == {spec.with_gyro for spec in specs} == {spec.with_course for spec in specs}
    assert 50 == len({spec.radius_m for spec in specs})
    assert all(600.0 <= spec.duration_s <= 1200.0 and not spec.physics for spec in specs)


@pytest.fixture(scope="module")
def integrated() -> tuple[multibody.Course, object]:
    """Half a minute of the rear-driven car."""
    return multibody.course_of(multibody.integrated(2, "mixed", 30.0, 1), multibody.parameters(2)), None


def test_the_multibody_car_follows_its_bends_and_slides_outwards(
    integrated: tuple[multibody.Course, object],
) -> None:
    """Yaw rate is that of the steered curvature but for tyre slip; in a left bend the axle drifts right."""
    road, _ = integrated
    turning = np.abs(road.yaw) > 0.05

    assert turning.sum() > 50
    assert road.yaw[turning] == pytest.approx((road.speed * road.bend)[turning], rel=0.25)
    drift = road.beta + 0.0 * road.yaw
    assert np.polyfit(road.a_lat, drift, 1)[0] < -1e-3


def test_the_multibody_car_slips_when_it_brakes(integrated: tuple[multibody.Course, object]) -> None:
    """Wheels turn slower than they roll in proportion to the braking, the front ones most (66 % of it)."""
    road, _ = integrated
    assert road.spin is not None
    braking = road.accel < -0.3
    slope = [np.polyfit(road.accel[braking], road.spin[braking, k], 1)[0] for k in range(4)]

    assert min(slope) > 5e-4
    assert min(slope[:2]) > max(slope[2:])


def test_a_mirrored_course_turns_the_other_way_with_left_and_right_exchanged(
    integrated: tuple[multibody.Course, object],
) -> None:
    """Twice mirrored is the same."""
    road, _ = integrated
    other = multibody.mirrored(road)
    assert road.hubs is not None
    assert other.hubs is not None

    assert other.yaw == pytest.approx(-road.yaw)
    assert other.hubs[:, 0] == pytest.approx(road.hubs[:, 1])
    for name, value in vars(multibody.mirrored(other)).items():
        if value is not None:
            assert value == pytest.approx(getattr(road, name)), name


def test_wandering_radii_have_the_size_that_was_asked_for() -> None:
    """Four wheels for long: the relative drift's standard deviation."""
    spec = Spec(duration_s=1200.0, radius_drift=1e-3, radius_drift_tau_s=20.0, frame_jitter_s=0.0)
    still = dataclasses.replace(spec, radius_drift=0.0)
    with_it, without = (np.diff(drive(each, 8).shown_rad[::50], axis=0) for each in (spec, still))
    moving = without.min(axis=1) > 10.0
    relative = (with_it / without - 1.0)[moving]

    assert float(relative.std()) == pytest.approx(1e-3, rel=0.2)
    assert math.isclose(float(relative.mean()), 0.0, abs_tol=5e-4)
