"""The gate that judges by slip, and the weights of fixes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.estimators.world import (
    OFFSETS_M,
    RADIUS_M,
    TRACK_M,
    VEHICLE,
    Receiver,
    World,
    errors_m,
    run,
    soft_rear,
)
from tpmsd.car.config.model import FilterConfig, GnssConfig
from tpmsd.onboard.estimators.bank.batched_kalman import square_weights
from tpmsd.onboard.estimators.build import build_filter
from tpmsd.onboard.estimators.gates.fix_gate import FIX_WEIGHTS, igg3_weights
from tpmsd.onboard.estimators.gates.motion_gate import MotionGate
from tpmsd.onboard.estimators.gates.slip_gate import SlipGate, make_gate
from tpmsd.onboard.timeline.tick import Tick

SLIP = FilterConfig(gate="slip")


def tick(k: int, accel: float = 0.0, yaw_rate: float = math.nan, steer: float = math.nan) -> Tick:
    return Tick(
        k,
        5000.0 + 0.1 * k,
        0.1,
        np.full(4, 6.0),
        np.full(4, 0.05),
        yaw_rate_radps=yaw_rate,
        accel_long_mps2=accel,
        steering_wheel_angle_rad=steer,
    )


def verdict(gate: MotionGate, accel: float, wheels_yaw_radps: float = 0.0, steer: float = math.nan) -> bool:
    """After two seconds of the same motion at 20 m/s."""
    out = False
    for k in range(20):
        out = gate.update(tick(k, accel, steer=steer), 20.0, wheels_yaw_radps)
    return out


def test_the_configuration_chooses_the_gate() -> None:
    """Thresholds unless asked otherwise."""
    assert type(make_gate(FilterConfig(), VEHICLE)) is MotionGate
    assert type(make_gate(SLIP, VEHICLE)) is SlipGate


@pytest.mark.parametrize(
    ("driven", "accel", "informative"),
    [
        ("rear", 0.3, True),
        ("rear", 0.8, False),
        ("all", 0.8, True),
        ("rear", -0.6, True),
        ("front", -2.0, False),
        ("all", 2.0, False),
    ],
)
def test_the_same_force_costs_two_driven_wheels_more_slip(
    driven: str, accel: float, informative: bool
) -> None:
    """Two driven wheels carry m a with twice the slip of four; braking is shared by all."""
    assert informative == verdict(SlipGate(SLIP, replace(VEHICLE, driven_axle=driven)), accel)


def test_side_slip_closes_the_gate() -> None:
    """The rear axle's slip angle grows with lateral acceleration until it is too much."""
    gate = SlipGate(FilterConfig(gate="slip", max_side_slip_rad=0.015), VEHICLE)
    assert verdict(gate, 0.0, 0.05)
    assert not verdict(gate, 0.0, 0.2)


def test_a_bend_at_constant_speed_is_driven_with_slip() -> None:
    """Steered wheels' side force points backwards a little; what drives against it slips."""
    settings = FilterConfig(gate="slip", max_wheel_slip=0.001)
    vehicle = replace(VEHICLE, driven_axle="rear")
    bend = {"accel": 0.0, "wheels_yaw_radps": 0.2}
    assert verdict(SlipGate(settings, vehicle), **bend)
    assert not verdict(SlipGate(settings, vehicle), **bend, steer=0.06 * (vehicle.steering_ratio or 1.0))


def test_without_any_inertial_signal_the_wheels_tell_the_slip() -> None:
    """No accelerometer, no gyro, no steering: braking shows in the wheels' own speed."""
    gate = SlipGate(SLIP, replace(VEHICLE, steering_ratio=None))
    steady = [gate.update(tick(k, math.nan), 20.0, 0.0) for k in range(1, 40)]
    braking = [gate.update(tick(k, math.nan), 20.0 - 0.4 * (k - 40), 0.0) for k in range(40, 60)]
    assert all(steady[1:])
    assert not any(braking[8:])


@pytest.mark.parametrize("wheel", [2, 3])
def test_a_soft_rear_tyre_does_not_shut_the_slip_gate(wheel: int) -> None:
    """As for the thresholds: the wheels alone would see a bend, the receiver does not."""
    gate = SlipGate(SLIP, VEHICLE)
    taught = []
    for t in soft_rear(wheel, Receiver(position_std_m=0.5, white_std_m=0.05)).drive().ticks:
        left, right = t.rotation_rad[2] * RADIUS_M, t.rotation_rad[3] * RADIUS_M
        taught.append(gate.update(t, (left + right) / 2 / t.dt_s, (right - left) / TRACK_M / t.dt_s))
    assert np.mean(taught[210:]) > 0.95


# -- weights of fixes ---------------------------------------------------------------------------------------


def test_square_weights_are_those_of_huber_squared() -> None:
    """1 up to 2.5 sigma, then (2.5 / v)^2."""
    assert [1.0, 1.0, 0.25, 0.0625] == pytest.approx(list(square_weights(np.array([0.0, 2.5, 5.0, 10.0]))))


def test_igg3_weights_divide() -> None:
    """Three zones, and never quite zero."""
    weights = igg3_weights(np.array([1.0, 2.5, 4.0, 5.0, 80.0]))
    assert [1.0, 1.0, 2.5 / 4.0 * (1.0 / 2.5) ** 2] == pytest.approx(list(weights[:3]))
    assert 0.0 < weights[3] == weights[4] < 1e-5


@pytest.mark.parametrize("weights", list(FIX_WEIGHTS))
def test_a_good_drive_is_learned_with_either(weights: str) -> None:
    """Without bad fixes both find the radii."""
    world = World(duration_s=240.0)
    drive = world.drive()
    settings = FilterConfig(fix_weights=weights)
    filter_ = build_filter(VEHICLE, GnssConfig(), settings, np.random.default_rng(1), True)
    last = errors_m(drive, run(filter_, drive.ticks))[-1]
    assert np.abs(last).max() < 0.6e-3 < max(np.abs(OFFSETS_M))


def test_igg3_weights_hold_against_reflected_fixes() -> None:
    """In three of ten seconds Doppler speed and course are wrong: with the IGG-III weights the radii are off
    by less than two thirds of what they are with the squares."""
    world = World(duration_s=240.0)
    drive = world.drive()
    ticks = []
    for t in drive.ticks:
        wrong = 40.0 < t.time_s - drive.ticks[0].time_s and t.time_s % 10.0 < 3.0
        fixes = tuple(
            replace(f, speed_mps=f.speed_mps + 0.8, heading_rad=f.heading_rad + 0.1) if wrong else f
            for f in t.fixes
        )
        ticks.append(replace(t, fixes=fixes))
    off = {}
    for weights in FIX_WEIGHTS:
        settings = FilterConfig(fix_weights=weights)
        filter_ = build_filter(VEHICLE, GnssConfig(), settings, np.random.default_rng(1), True)
        late = errors_m(drive, run(filter_, ticks))[1200:]
        off[weights] = float(np.sqrt((late**2).mean()))
    assert off["igg3"] < 2 / 3 * off["square"]
