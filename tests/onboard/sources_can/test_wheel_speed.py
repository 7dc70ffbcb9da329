"""Integration of wheel speeds: exact for even changes, and no fault moves the angle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.onboard.sources_can.build import RADIUS_M, rotations
from tpmsd.onboard.sources.can.faults import FaultLog
from tpmsd.onboard.sources.events import Event
from tpmsd.onboard.sources.wheel_speed import FrozenSpeeds, WheelSpeedIntegrator

PERIOD_S = 0.02


class Wheel:
    """An integrator with what came out of it."""

    def __init__(self) -> None:
        self.faults = FaultLog()
        self.integrator = WheelSpeedIntegrator(1, RADIUS_M, self.faults)
        self.out: list[Event] = []

    def feed(self, time_s: float, speed_mps: float) -> None:
        self.integrator.update(time_s, speed_mps / RADIUS_M, PERIOD_S, self.out)

    @property
    def distances_m(self) -> list[float]:
        return [sample.angle_rad * RADIUS_M for sample in rotations(self.out)]


@settings(derandomize=True, deadline=None, max_examples=50)
@given(
    st.floats(0.0, 40.0),
    st.floats(-4.0, 4.0),
    st.lists(st.floats(0.001, 0.05), min_size=5, max_size=100),
)
def test_an_even_change_of_speed_is_integrated_exactly(
    speed_mps: float, acceleration: float, intervals: list[float]
) -> None:
    """The way is v t + a t^2 / 2 at any spacing of the readings."""
    wheel, time_s = Wheel(), 0.0
    wheel.feed(0.0, speed_mps)
    for interval in intervals:
        time_s += interval
        wheel.feed(time_s, speed_mps + acceleration * time_s)

    assert speed_mps * time_s + acceleration * time_s**2 / 2 == pytest.approx(wheel.distances_m[-1], abs=1e-9)
    assert {0.0} == {sample.quantum_rad for sample in rotations(wheel.out)}
    assert {} == wheel.faults.counts


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.data())
def test_odd_and_late_readings_move_nothing(data: st.DataObject) -> None:
    """With odd values and late stamps thrown in, the way is that of the sound readings alone."""
    sound, disturbed = Wheel(), Wheel()
    for step in range(200):
        time_s, speed_mps = step * PERIOD_S, 20.0 + 5.0 * math.sin(step * PERIOD_S)
        fault = data.draw(st.sampled_from([""] * 8 + ["odd", "late"])) if step % 3 == 2 else ""
        if fault == "odd":
            disturbed.feed(time_s, data.draw(st.sampled_from([-18.8, 0.0, 60.0, 163.0, 400.0])))
            continue
        if fault == "late":
            disturbed.feed(time_s - 1.5 * PERIOD_S, 0.0)
        sound.feed(time_s, speed_mps)
        disturbed.feed(time_s, speed_mps)

    assert rotations(sound.out) == rotations(disturbed.out)
    assert set(disturbed.faults.counts) <= {"fr.jump", "fr.late"}


def test_a_new_level_begins_a_segment() -> None:
    """Where the speed stays at the impossible value, it is accepted, but the distance before it is another
    one."""
    wheel = Wheel()
    for step in range(50):
        wheel.feed(step * PERIOD_S, 20.0 if step < 25 else 45.0)

    assert [0] * 25 + [1] * 24 == [sample.segment for sample in rotations(wheel.out)]
    assert 23 * PERIOD_S * 45.0 == pytest.approx(wheel.distances_m[-1])
    assert {"fr.jump": 1} == dict(wheel.faults.counts)


def test_a_gap_beyond_the_time_out_begins_a_segment() -> None:
    """A lost frame is bridged; a silence of more than ten periods is not."""
    wheel = Wheel()
    for time_s in (0.0, 0.02, 0.06, 0.08, 0.29, 0.31):
        wheel.feed(time_s, 10.0)

    assert [0.0, 0.2, 0.6, 0.8, 0.0, 0.2] == pytest.approx(wheel.distances_m)
    assert [0, 0, 0, 0, 1, 1] == [sample.segment for sample in rotations(wheel.out)]


def test_a_dead_sensor_is_stuck_at_zero() -> None:
    """Zero is no speed of a wheel while two others roll."""
    wheel = Wheel()
    wheel.feed(0.0, 0.0)
    wheel.feed(0.02, 0.0)

    assert 0.0 == wheel.integrator.still_since
    assert wheel.integrator.is_stuck(0.4, [9.0, 9.0, 9.0], [0.0] * 3) is None
    assert wheel.integrator.is_stuck(0.6, [9.0, 9.0, 9.0], [0.0] * 3) is True
    assert wheel.integrator.is_stuck(0.6, [9.0, 0.0, 0.0], [9.0, 0.0, 0.0]) is False
    assert wheel.integrator.is_stuck(0.6, [9.0], [0.0]) is True


def test_a_constant_speed_is_stuck_only_if_the_others_change() -> None:
    """On a smooth road a speed may be exactly constant for long; while the others brake it may not."""
    wheel = Wheel()
    wheel.feed(0.0, 20.0)
    wheel.feed(0.02, 20.0)

    assert wheel.integrator.is_stuck(60.0, [1200.0] * 3, [0.3, -0.2, 0.1]) is False
    assert wheel.integrator.is_stuck(1.5, [20.0] * 3, [-5.0] * 3) is None
    assert wheel.integrator.is_stuck(2.5, [40.0] * 3, [-5.0] * 3) is True


def test_a_stuck_speed_begins_a_segment_when_it_moves_again() -> None:
    """Nothing is emitted in between."""
    wheel = Wheel()
    wheel.feed(0.0, 20.0)
    wheel.integrator.mark_stuck()
    wheel.feed(0.02, 20.0)
    wheel.feed(0.04, 25.0)
    wheel.feed(0.06, 25.0)

    assert [(0, 0.0), (1, 0.0), (1, 0.5)] == [
        (sample.segment, pytest.approx(sample.angle_rad * RADIUS_M)) for sample in rotations(wheel.out)
    ]


def frozen_after_s(noise_mps: float) -> float:
    """How long after 100 s of bends and changing speed an even 20 m/s is taken for frozen (at most 60 s).

    The wheels' noise has this standard deviation, their resolution is 0.01 km/h.
    """
    rng = np.random.default_rng(1)
    wheels = (Wheel(), Wheel())
    frozen = FrozenSpeeds(tuple(wheel.integrator for wheel in wheels))
    for step in range(8000):
        time_s = step * PERIOD_S
        drive_s = min(time_s, 100.0)
        for wheel, side in zip(wheels, (1.0, -1.0), strict=True):
            speed_mps = 20.0 + 4.0 * math.sin(2.0 * math.pi * drive_s / 50.0)
            speed_mps += side * 0.3 * math.sin(2.0 * math.pi * drive_s / 20.0)
            speed_mps += noise_mps * rng.normal() if time_s < 100.0 else 0.0
            wheel.feed(time_s, round(speed_mps * 360.0) / 360.0)
        if frozen.judge(time_s):
            return time_s - 100.0
    return 60.0


def test_even_speeds_are_frozen_only_where_speeds_have_noise() -> None:
    """Constant for a minute: a simulator's cruise where readings have no noise, a sender that hangs else."""
    assert 60.0 == frozen_after_s(0.0)
    assert frozen_after_s(0.01) < 2.1
