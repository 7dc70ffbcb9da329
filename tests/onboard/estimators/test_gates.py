"""What is informative, which fixes are used, and where a pose comes from."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.estimators.world import RADIUS_M, TRACK_M, Receiver, World, soft_rear, straight
from tpmsd.car.config.model import FilterConfig
from tpmsd.onboard.estimators.gates.fix_gate import FixGate
from tpmsd.onboard.estimators.gates.motion_gate import CourseRate, MotionGate
from tpmsd.onboard.estimators.pose_start import PoseFinder
from tpmsd.onboard.timeline.tick import Fix, Tick

START_S = 5000.0


def tick(k: int, fixes: tuple[Fix, ...] = (), yaw_rate: float = math.nan, accel: float = math.nan) -> Tick:
    return Tick(
        k,
        START_S + 0.1 * k,
        0.1,
        np.full(4, 6.0),
        np.full(4, 0.05),
        fixes,
        yaw_rate_radps=yaw_rate,
        accel_long_mps2=accel,
    )


def fix_at(
    time_s: float, heading: float = math.nan, east: float = 0.0, north: float = 0.0, **more: float
) -> Fix:
    return Fix(
        time_s,
        0.5,
        east,
        north,
        more.get("std", 1.0),
        speed_mps=more.get("speed", math.nan),
        heading_rad=heading,
    )


# -- motion gate --------------------------------------------------------------------------------------------


def shares(drive_ticks: list[Tick]) -> list[bool]:
    """The gate's verdict over a drive, with odometry at nominal radii."""
    gate = MotionGate(FilterConfig())
    out = []
    for t in drive_ticks:
        left, right = t.rotation_rad[2] * RADIUS_M, t.rotation_rad[3] * RADIUS_M
        out.append(gate.update(t, (left + right) / 2 / t.dt_s, (right - left) / TRACK_M / t.dt_s))
    return out


@pytest.mark.parametrize("flag", ["brake_active", "abs_active", "esc_active"])
def test_nothing_is_learned_while_the_car_brakes(flag: str) -> None:
    """A flag of the car that is set in part of a tick closes the gate; one that is not set does not."""
    gate = MotionGate(FilterConfig())
    free = [gate.update(replace(tick(k), **{flag: 0.0}), 20.0, 0.0) for k in range(10)]
    braked = [gate.update(replace(tick(k), **{flag: 0.2}), 20.0, 0.0) for k in range(10, 20)]

    assert all(free[1:])
    assert not any(braked)


@pytest.mark.parametrize("course", [True, False])
@pytest.mark.parametrize("wheel", [2, 3])
def test_a_soft_rear_tyre_does_not_shut_the_gate(wheel: int, course: bool) -> None:
    """-3 % at one rear wheel looks like 5 m/s2 sideways to the wheels; where the receiver (by its courses, or
    its positions alone) says straight on, ticks stay informative."""
    ticks = soft_rear(wheel, Receiver(course=course, position_std_m=0.5, white_std_m=0.05)).drive().ticks
    wheels_say = abs(ticks[300].rotation_rad[3] - ticks[300].rotation_rad[2]) * RADIUS_M / TRACK_M / 0.1
    assert wheels_say * 28.0 > FilterConfig().max_accel_lat_mps2
    assert np.mean(shares(ticks)[210:]) > 0.95


def test_without_an_independent_yaw_rate_the_wheels_judge() -> None:
    """No receiver and no gyro: a bend, as far as anyone can tell."""
    world = World(
        duration_s=30.0,
        speed_mps=lambda t: np.full_like(t, 28.0),
        yaw_radps=lambda t: np.full_like(t, 0.2),
        teeth=math.inf,
        receiver=Receiver(outage=(0.0, 1e9)),
    )
    assert not any(shares(world.drive().ticks)[20:])


def test_hard_driving_is_not_informative() -> None:
    """Below the speed, above either acceleration or in a tight bend nothing is taught; gently it is."""
    cases = {
        "gentle": (lambda t: np.full_like(t, 20.0), lambda t: np.full_like(t, 0.05), True),
        "slow": (lambda t: np.full_like(t, 5.0), straight, False),
        "braking": (lambda t: 40.0 - 3.0 * t, straight, False),
        "bend": (lambda t: np.full_like(t, 20.0), lambda t: np.full_like(t, 0.2), False),
        "tight": (lambda t: np.full_like(t, 7.0), lambda t: np.full_like(t, 0.3), False),
    }
    for speed, yaw, informative in cases.values():
        world = World(duration_s=10.0, speed_mps=speed, yaw_radps=yaw, teeth=math.inf, offsets_m=(0.0,) * 4)
        assert [informative] * 50 == shares(world.drive().ticks)[50:]


def test_an_accelerometer_shuts_the_gate_alone() -> None:
    """A body that accelerates is not gentle, whatever the wheels say."""
    gate = MotionGate(FilterConfig())
    verdicts = [gate.update(tick(k, accel=2.5 if k > 20 else 0.0), 20.0, 0.0) for k in range(40)]
    assert all(verdicts[1:20])
    assert not any(verdicts[21:])


def test_wheels_that_spin_under_a_quiet_accelerometer_are_not_informative() -> None:
    """On ice the rear wheels gain 40 % within 0.2 s and lose it half a second later, while the body feels
    nothing: the gate shuts with the first of them, and opens again within three seconds."""
    gate = MotionGate(FilterConfig())
    speeds = [20.0] * 50 + [24.0] + [28.0] * 5 + [24.0] + [20.0] * 40
    verdicts = [gate.update(tick(k, accel=0.0), speed, 0.0) for k, speed in enumerate(speeds)]
    assert all(verdicts[1:50])
    assert not any(verdicts[50:57])
    assert all(verdicts[87:])


def test_the_smoothed_speed_follows_in_half_a_second() -> None:
    """A step of the speed is followed as 1 - exp(-t / 0.5 s)."""
    gate = MotionGate(FilterConfig())
    gate.update(tick(0), 10.0, 0.0)
    for k in range(1, 11):
        gate.update(tick(k), 20.0, 0.0)
    assert 10.0 + 10.0 * (1 - math.exp(-2.0)) == pytest.approx(gate.speed_mps)


def test_course_rate_by_courses_and_across_north() -> None:
    """Courses that turn steadily, also through pi, give their rate; a pause begins again."""
    rate = CourseRate()
    for k in range(200):
        rate.update(fix_at(0.1 * k, heading=math.remainder(3.0 + 0.02 * k, 2 * math.pi)))
    assert 0.2 == pytest.approx(rate.rate_radps)
    rate.update(fix_at(60.0, heading=1.0))
    assert 0.2 == pytest.approx(rate.rate_radps)
    assert rate.time_s < 21.0


def test_course_rate_by_positions() -> None:
    """Without courses, chords of a circle turn at its rate."""
    rate = CourseRate()
    speed, yaw = 15.0, -0.1
    for k in range(150):
        angle = yaw * 0.1 * k
        radius = speed / yaw
        rate.update(fix_at(0.1 * k, east=radius * math.sin(angle), north=radius * (1 - math.cos(angle))))
    assert yaw == pytest.approx(rate.rate_radps, rel=1e-3)


# -- fix gate -----------------------------------------------------------------------------------------------


def test_fixes_near_their_expectation_are_used_and_far_ones_rejected() -> None:
    """The limit grows with what is known of the difference."""
    gate = FixGate()
    assert "use" == gate.judge(10.0, 1.0, 0.0)
    assert "reject" == gate.judge(12.0, 1.0, 1.0)
    assert "use" == gate.judge(12.0, 4.0, 2.0)
    assert (1, False) == (gate.rejected, gate.rejecting)


def test_a_receiver_that_insists_is_believed() -> None:
    """Refused for longer than eight seconds without a good one between: the pose is what is lost."""
    gate = FixGate()
    verdicts = [gate.judge(100.0, 1.0, 0.5 * k) for k in range(20)]
    assert ["reject"] * 17 == verdicts[:17]
    assert "lost" == verdicts[17]
    gate.reset()
    assert "reject" == gate.judge(100.0, 1.0, 60.0)


def test_one_good_fix_ends_the_doubt() -> None:
    """Refusals are counted from the last good fix on."""
    gate = FixGate()
    for k in range(100):
        assert "lost" != gate.judge(0.0 if k % 10 == 0 else 100.0, 1.0, 0.5 * k)


# -- pose ---------------------------------------------------------------------------------------------------


def test_a_course_at_speed_is_a_pose() -> None:
    """One fix with course and speed is enough; its course is taken."""
    start = PoseFinder().update(fix_at(1.0, heading=0.4, speed=10.0), True)
    assert start is not None
    assert (0.4, 0.07) == pytest.approx((start.heading_rad, start.heading_std_rad))


def test_a_course_at_walking_pace_is_noise() -> None:
    """Slow courses are rejected."""
    assert PoseFinder().update(fix_at(1.0, heading=0.4, speed=1.0), True) is None


def test_positions_alone_tell_the_heading_by_their_chord() -> None:
    """Without courses, the chord is waited for until it stands out of the noise, then taken."""
    finder = PoseFinder()
    found = None
    for k in range(100):
        found = finder.update(fix_at(0.1 * k, east=0.6 * k, north=0.8 * k, std=1.0), True)
        if found is not None:
            break
    assert found is not None
    assert math.atan2(0.8, 0.6) == pytest.approx(found.heading_rad)
    assert 4 <= k <= 8


def test_a_standing_car_has_no_heading() -> None:
    """Wandering fixes of a parked car never make a pose, however far they wander."""
    finder = PoseFinder()
    rng = np.random.default_rng(1)
    for k in range(500):
        east, north = 10.0 * rng.standard_normal(2)
        assert finder.update(fix_at(0.2 * k, east=float(east), north=float(north)), False) is None
