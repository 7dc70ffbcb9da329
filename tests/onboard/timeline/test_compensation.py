"""Known physics is taken out of the ticks by the catalogue's own forward models."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from tpmsd.car.config.model import CanConfig, Config, GnssConfig, VehicleConfig
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.onboard.timeline.compensation import Compensation, uncompensated_effects, with_model_constants
from tpmsd.onboard.timeline.tick import Fix, Tick

RADIUS = 0.3
CONFIG = Config(
    VehicleConfig((RADIUS,) * 4, 1.5, 1.4, 2.6, driven_axle="front", teeth_per_rev=48),
    CanConfig({}, Path("bus.dbc")),
    GnssConfig(antenna_forward_m=1.0, antenna_left_m=0.0, latency_s=0.1),
)


def _ticks(speed_mps: float, seconds: float = 6.0, yaw_rate: float = 0.0, **fields: float) -> list[Tick]:
    """Steady driving on wheels of nominal radius, with a fix in the last tick."""
    rear = np.array([speed_mps - yaw_rate * 0.75, speed_mps + yaw_rate * 0.75])
    speeds = np.array([speed_mps, speed_mps, rear[0], rear[1]])
    ticks = [
        Tick(k, 0.1 * k, 0.1, speeds * 0.1 / RADIUS, np.full(4, 0.01), yaw_rate_radps=yaw_rate, **fields)
        for k in range(1, round(seconds / 0.1))
    ]
    end = ticks[-1]
    fix = Fix(end.time_s, 1.0, 0.0, 0.0, 1.0, heading_rad=0.4)
    return [
        *ticks,
        Tick(end.index + 1, end.time_s + 0.1, 0.1, end.rotation_rad, np.full(4, 0.01), (fix,), **fields),
    ]


def _last(model: ExtendedModel, ticks: list[Tick]) -> Tick:
    compensation = Compensation(CONFIG, model)
    return [compensation.apply(tick) for tick in ticks][-1]


def test_centrifugal_growth_is_taken_out_of_the_rotation() -> None:
    """A wheel grown by k v^2 turns less; the compensated rotation is that of the nominal radius."""
    k, speed = 2e-6, 30.0
    grown = RADIUS + k * speed**2
    ticks = _ticks(speed * RADIUS / grown)  # the rotation of the grown wheel at 30 m/s
    out = _last(ExtendedModel((make_effect("centrifugal_growth", coefficient=k),)), ticks)
    # The speed itself is read off the grown wheels: an error of second order, 2 (k v^2 / r)^2.
    assert out.rotation_rad * RADIUS / 0.1 == pytest.approx(np.full(4, speed), rel=1e-4)


def test_drive_slip_is_taken_out_of_the_driven_wheels_alone() -> None:
    """Front-driven: the front wheels' extra rotation d v^2 goes, the rear wheels stay."""
    d, speed = 3e-6, 25.0
    slip = make_effect("longitudinal_slip", slip_per_accel=0.0, slip_per_speed2=d)
    out = _last(ExtendedModel((slip,)), _ticks(speed))
    expected = np.array([1 / (1 + d * speed**2)] * 2 + [1.0, 1.0]) * speed
    assert out.rotation_rad * RADIUS / 0.1 == pytest.approx(expected, rel=1e-6)


def test_the_fault_itself_is_never_compensated() -> None:
    """A radius_change in the model leaves the ticks as they are, so that a leak stays visible."""
    ticks = _ticks(20.0)
    fault = make_effect("radius_change", wheel="rl", deviation_m=-0.002, onset_s=0.0, duration_s=0.0)
    assert np.array_equal(ticks[-1].rotation_rad, _last(ExtendedModel((fault,)), ticks).rotation_rad)


def test_gyro_errors_are_inverted() -> None:
    """reading = scale * truth + bias comes back as the truth."""
    model = ExtendedModel(
        (make_effect("yaw_rate_bias", bias=0.004), make_effect("yaw_rate_scale", scale=1.05))
    )
    ticks = _ticks(15.0, yaw_rate=1.05 * 0.1 + 0.004)
    assert _last(model, ticks[:-1]).yaw_rate_radps == pytest.approx(0.1, abs=1e-12)


def test_side_slip_turns_the_course_back_into_the_heading() -> None:
    """In a left bend the course leaves the heading by -c a_y; the heading of the fix is put right by that."""
    c, speed, yaw_rate = 0.004, 20.0, 0.1
    model = ExtendedModel((make_effect("lateral_slip", coefficient=c),))
    ticks = [*_ticks(speed, yaw_rate=yaw_rate)]
    assert _last(model, ticks).fixes[0].heading_rad == pytest.approx(0.4 + c * speed * yaw_rate, rel=0.01)


def test_a_wrong_number_of_teeth_is_put_right_on_its_wheel() -> None:
    """47 teeth where 48 are configured: the wheel really turned further than its counts say."""
    model = ExtendedModel((make_effect("tone_ring_error", wheel="fr", teeth_per_rev=47),))
    ticks = _ticks(20.0)
    ratio = _last(model, ticks).rotation_rad / ticks[-1].rotation_rad
    assert ratio == pytest.approx([1.0, 48 / 47, 1.0, 1.0])


def _shape(on: str, covariate: str, heights: list[float], knots: tuple[float, float] = (0.0, 40.0)) -> Effect:
    return make_effect("unknown", on=on, covariate=covariate, knots=knots, heights=heights)


def test_a_spline_term_is_taken_out_of_its_wheels_with_their_signs() -> None:
    """Half way between the knots a wheel is 0.5 mm larger, its neighbour smaller: both are put right."""
    model = ExtendedModel((_shape("rl -rr", "speed", [0.0, 1e-3]),))
    ticks = _ticks(20.0)
    ratio = _last(model, ticks).rotation_rad / ticks[-1].rotation_rad
    assert ratio == pytest.approx([1.0, 1.0, 1 + 5e-4 / RADIUS, 1 - 5e-4 / RADIUS], rel=1e-9)


def test_a_spline_term_is_taken_out_of_readings() -> None:
    """Speed, course and yaw rate lose what the shapes say at 20 m/s: 1 m/s, 0.1 rad and 0.01 rad/s."""
    model = ExtendedModel(
        (
            _shape("gnss_speed", "speed", [0.0, 2.0]),
            _shape("gnss_course", "speed", [0.0, 0.2]),
            _shape("yaw_rate", "speed", [0.0, 0.02]),
        )
    )
    fix = Fix(6.0, 1.0, 0.0, 0.0, 1.0, speed_mps=21.0, heading_rad=0.5)
    ticks = [*_ticks(20.0)[:-1]]
    last = Tick(60, 6.0, 0.1, ticks[-1].rotation_rad, np.full(4, 0.01), (fix,), yaw_rate_radps=0.01)
    out = _last(model, [*ticks, last])
    assert (out.fixes[0].speed_mps, out.fixes[0].heading_rad) == pytest.approx((20.0, 0.4))
    assert out.yaw_rate_radps == pytest.approx(0.0, abs=1e-9)


def test_a_spline_term_over_torque_follows_the_bus() -> None:
    """At 100 of 200 Nm half the shape is taken out; without a reading none."""
    model = ExtendedModel((_shape("fl fr", "torque", [0.0, 1e-3], (0.0, 200.0)),))
    reported, silent = _ticks(20.0, drive_torque_nm=100.0), _ticks(20.0)
    wired = dataclasses.replace(CONFIG, can=CanConfig({"drive_torque": "A.B"}, Path("bus.dbc")))
    half, none = (
        [Compensation(wired, model).apply(tick) for tick in ticks][-1].rotation_rad / ticks[-1].rotation_rad
        for ticks in (reported, silent)
    )
    assert half == pytest.approx([1 + 5e-4 / RADIUS] * 2 + [1.0] * 2)
    assert none.tolist() == [1.0] * 4


@pytest.mark.parametrize(
    ("effect", "note"),
    [
        (
            make_effect("radius_change", wheel="rl", deviation_m=-0.002),
            "radius_change is not compensated: the radius of rl is what is watched, and its change the fault "
            "itself",
        ),
        (
            _shape("rl", "time", [0.0, -1e-3]),
            "unknown is not compensated: a shape over time belongs to the drive on which it was found",
        ),
        (
            _shape("fl fr rl rr", "temperature", [0.0, 1e-3]),
            "unknown is not compensated: it depends on temperature, and the bus has no ambient_temp",
        ),
    ],
)
def test_what_stays_is_said(effect: Effect, note: str) -> None:
    """The fault, shapes over time and shapes over what the bus does not tell stay, and one line says so."""
    model = ExtendedModel((effect,))
    ticks = _ticks(20.0)
    assert uncompensated_effects(CONFIG, model) == [note]
    assert np.array_equal(ticks[-1].rotation_rad, _last(model, ticks).rotation_rad)


def test_what_is_taken_out_needs_no_word() -> None:
    """Nothing is said of effects that are compensated."""
    model = ExtendedModel(
        (make_effect("centrifugal_growth", coefficient=1e-6), _shape("rl", "speed", [0, 0]))
    )
    assert uncompensated_effects(CONFIG, model) == []


def test_constants_go_into_the_configuration() -> None:
    """Tracks, antenna and latency of the model are what the core is configured with."""
    model = ExtendedModel(
        (
            make_effect("track_width_error", rear_m=0.03, front_m=-0.02),
            make_effect("antenna_lever_arm", forward_m=0.3, left_m=-0.1),
            make_effect("gnss_latency", latency_s=0.15),
        )
    )
    config = with_model_constants(CONFIG, model)
    assert config.vehicle.track_rear_m == pytest.approx(CONFIG.vehicle.track_rear_m + 0.03)
    assert config.vehicle.track_front_m == pytest.approx(CONFIG.vehicle.track_front_m - 0.02)
    assert (config.gnss.antenna_forward_m, config.gnss.antenna_left_m) == pytest.approx((1.3, -0.1))
    assert config.gnss.latency_s == pytest.approx(0.25)


def test_missing_readings_stay_missing() -> None:
    """NaN in a tick neither spreads nor disappears."""
    model = ExtendedModel((make_effect("centrifugal_growth", coefficient=2e-6),))
    ticks = _ticks(20.0)
    gone = Tick(999, 10.0, 0.1, np.array([math.nan, 6.0, math.nan, 6.0]), np.full(4, 0.01))
    compensation = Compensation(CONFIG, model)
    for tick in ticks:
        compensation.apply(tick)
    out = compensation.apply(gone)
    assert np.isnan(out.rotation_rad).tolist() == [True, False, True, False]
    assert np.all(np.isfinite(compensation.apply(ticks[-1]).rotation_rad))


@pytest.mark.parametrize("gap_s", [0.0, 0.5])
def test_a_grade_is_forgotten_in_a_gap(gap_s: float) -> None:
    """On 5 % the rear wheels shrink by c g sin(slope); behind a gap the slope, and that, is not known."""
    coefficient, sine = 1e-4, 0.05
    compensation = Compensation(
        CONFIG, ExtendedModel((make_effect("load_transfer_longitudinal", coefficient=coefficient),))
    )
    for tick in _ticks(20.0, 12.0)[:-1]:
        fix = Fix(tick.time_s, 1.0, 0.0, 0.0, 1.0, up_m=sine * 20.0 * tick.time_s)
        compensation.apply(dataclasses.replace(tick, fixes=(fix,)))
    later = dataclasses.replace(tick, index=999, time_s=tick.time_s + 0.1, fixes=(), gap_s=gap_s)
    ratio = compensation.apply(later).rotation_rad / later.rotation_rad
    change = 0.0 if gap_s else coefficient * GRAVITY_MPS2 * sine / RADIUS
    assert ratio == pytest.approx([1.0 + change, 1.0 + change, 1.0 - change, 1.0 - change], abs=1e-6)


@pytest.mark.parametrize(("gap_s", "rate"), [(0.0, 0.2), (1.0, 0.0)])
def test_the_rate_of_steering_is_that_of_the_last_ticks_without_a_gap(gap_s: float, rate: float) -> None:
    """A spline over it is taken out of the gyro; a change across a gap is no rate."""
    model = ExtendedModel((_shape("yaw_rate", "steering_rate", [0.0, 1.0], (0.0, 1.0)),))
    ticks = [
        dataclasses.replace(tick, steering_wheel_angle_rad=0.02 * k, gap_s=gap_s, yaw_rate_radps=0.0)
        for k, tick in enumerate(_ticks(20.0, 20.0))
    ]
    out = _last(model, ticks)
    assert out.yaw_rate_radps == pytest.approx(-rate, abs=1e-3)


def test_time_counts_from_the_beginning_of_the_first_tick() -> None:
    """Warming tyres are taken out by the time since the start, whatever the clock's origin."""
    amplitude_m, time_constant_s = 1e-3, 3.0
    thermal = make_effect("thermal_growth", amplitude_m=amplitude_m, time_constant_s=time_constant_s)
    ticks = [dataclasses.replace(tick, time_s=5000.0 + tick.time_s, fixes=()) for tick in _ticks(20.0)]
    ratio = _last(ExtendedModel((thermal,)), ticks).rotation_rad / ticks[-1].rotation_rad
    since_s = ticks[-1].time_s - 5000.0
    growth_m = amplitude_m * (1.0 - math.exp(-since_s / time_constant_s))
    assert RADIUS * (ratio - 1.0) == pytest.approx(np.full(4, growth_m), rel=0.02)


def _read(covariate: str, ticks: list[Tick], most: float, config: Config = CONFIG) -> list[float]:
    """Values of a covariate at each tick: a spline over it of slope one is all that the gyro has too much."""
    shape = _shape("yaw_rate", covariate, [-1.0, 1.0], (-most, most))
    compensation = Compensation(config, ExtendedModel((shape,)))
    return [most * (tick.yaw_rate_radps - compensation.apply(tick).yaw_rate_radps) for tick in ticks]


def _tick(k: int, speed_mps: float, yaw_rate: float = 0.0, config: Config = CONFIG, **fields: float) -> Tick:
    """The k-th tenth of a second, at a speed of the rear axle."""
    half_m = 0.5 * config.vehicle.track_rear_m
    speeds = speed_mps + yaw_rate * np.array([-0.75, 0.75, -half_m, half_m])
    return Tick(
        k, 0.1 * k, 0.1, speeds * 0.1 / RADIUS, np.full(4, 0.01), **{"yaw_rate_radps": yaw_rate, **fields}
    )


def test_speed_and_its_change_are_smoothed_over_half_a_second() -> None:
    """From 10 to 20 m/s at once: what is missing falls by exp(-dt / 0.5 s) each tick, and the acceleration is
    the smoothed change of the smoothed speed."""
    ticks = [_tick(k, 10.0 if k <= 20 else 20.0) for k in range(1, 41)]
    left = math.exp(-0.1 / 0.5)
    n = np.arange(21)
    speed = 20.0 - 10.0 * left**n
    accel = 10.0 * (1.0 - left) ** 2 / 0.1 * n * left ** (n - 1)
    assert [10.0] * 19 + speed.tolist() == pytest.approx(_read("speed", ticks, 40.0), abs=1e-9)
    assert [0.0] * 19 + accel.tolist() == pytest.approx(_read("accel_long", ticks, 40.0), abs=1e-9)


def test_the_rate_of_steering_is_smoothed_over_300_ms() -> None:
    """A wheel that begins to turn at 0.2 rad/s: 1 - exp(-t / 0.3 s) of it."""
    ticks = [_tick(k, 20.0, steering_wheel_angle_rad=0.02 * max(k - 5, 0)) for k in range(1, 16)]
    expected = [0.2 * (1.0 - math.exp(-0.1 * max(k - 5, 0) / 0.3)) for k in range(1, 16)]
    # The first angle has no rate yet.
    assert expected[1:] == pytest.approx(_read("steering_rate", ticks, 1.0)[1:], abs=1e-9)


@pytest.mark.parametrize("gyro", [True, False])
def test_the_yaw_rate_is_the_gyros_or_else_the_rear_wheels(gyro: bool) -> None:
    """From straight on into a bend of 0.1 rad/s: smoothed over half a second, with its lateral acceleration
    and the angle of a steering wheel of ratio 15."""
    rates = [0.0] * 10 + [0.1] * 20
    ticks = [_tick(k, 20.0, rate) for k, rate in enumerate(rates, 1)]
    if not gyro:
        ticks = [dataclasses.replace(tick, yaw_rate_radps=math.nan) for tick in ticks]
    expected = np.array([0.1 * (1.0 - math.exp(-0.1 * max(k - 10, 0) / 0.5)) for k in range(1, 31)])
    wheel = 15.0 * np.arctan(2.6 * expected / 20.0)
    for name, values in (("yaw_rate", expected), ("accel_lat", 20.0 * expected), ("steering", wheel)):
        shape = _shape("gnss_speed", name, [-1.0, 1.0], (-8.0, 8.0))
        compensation = Compensation(CONFIG, ExtendedModel((shape,)))
        fix = Fix(0.0, 1.0, 0.0, 0.0, 1.0, speed_mps=20.0, heading_rad=0.0)
        out = [compensation.apply(dataclasses.replace(tick, fixes=(fix,))) for tick in ticks]
        found = [8.0 * (20.0 - tick.fixes[0].speed_mps) for tick in out]
        assert values.tolist() == pytest.approx(found, abs=1e-6)


@pytest.mark.parametrize(("ratio", "wheel"), [(None, 15.0), (18.0, 18.0)])
def test_the_steering_wheel_turns_by_the_cars_own_ratio(ratio: float | None, wheel: float) -> None:
    """As it is configured; else by a common one."""
    config = dataclasses.replace(CONFIG, vehicle=dataclasses.replace(CONFIG.vehicle, steering_ratio=ratio))
    ticks = [_tick(k, 20.0, 0.05) for k in range(1, 120)]
    angle = wheel * math.atan(2.6 * 0.05 / 20.0)
    # The shape is taken out of the gyro itself, whose smoothed rate is then 0.05 rad/s less that.
    (found,) = _read("steering", ticks, 40.0, config)[-1:]
    assert wheel * math.atan(2.6 * (0.05 - found / 40.0) / 20.0) == pytest.approx(found, abs=1e-6)
    assert angle > found > 0.9 * angle


@pytest.mark.parametrize(("speed_mps", "bends"), [(0.9, False), (1.1, True)])
def test_a_car_that_barely_moves_has_no_curvature(speed_mps: float, bends: bool) -> None:
    """Below 1 m/s the yaw rate over the speed is noise."""
    ticks = [_tick(k, speed_mps, 0.1) for k in range(1, 60)]
    assert bends == (_read("steering", ticks, 40.0)[-1] > 1.0)


def test_the_accelerometer_stands_before_the_wheels() -> None:
    """It reads the force itself, on a slope as well: the slope is not added a second time."""
    ticks = []
    for k in range(1, 200):
        fix = Fix(0.1 * k, 1.0, 0.0, 0.0, 1.0, up_m=0.05 * 2.0 * k)
        ticks.append(dataclasses.replace(_tick(k, 20.0, accel_long_mps2=0.7), fixes=(fix,)))
    assert 0.7 == pytest.approx(_read("accel_long", ticks, 5.0)[-1], abs=1e-9)
    assert math.asin(0.05) == pytest.approx(_read("grade", ticks, 1.0)[-1], abs=1e-6)
    blind = [dataclasses.replace(tick, accel_long_mps2=math.nan) for tick in ticks]
    assert GRAVITY_MPS2 * 0.05 == pytest.approx(_read("accel_long", blind, 5.0)[-1], abs=1e-5)


@pytest.mark.parametrize("kind", ["gnss_speed", "gnss_course"])
def test_an_error_of_speed_or_course_alone_is_taken_out(kind: str) -> None:
    """The other of the two stays as it is; a fix without it is borne."""
    ticks = [_tick(k, 20.0) for k in range(1, 30)]
    for speed_mps in (21.0, math.nan):
        fix = Fix(2.9, 1.0, 0.0, 0.0, 1.0, speed_mps=speed_mps, heading_rad=0.5)
        last = dataclasses.replace(ticks[-1], fixes=(fix,))
        (out,) = _last(ExtendedModel((_shape(kind, "speed", [0.0, 0.2]),)), [*ticks[:-1], last]).fixes
        faster, course = (0.1, 0.0) if kind == "gnss_speed" else (0.0, 0.1)
        assert (speed_mps - faster, 0.5 - course) == pytest.approx(
            (out.speed_mps, out.heading_rad), nan_ok=True
        )


def test_a_latency_is_never_negative() -> None:
    """A model that makes fixes younger than they are configured to be makes them no prophets."""
    model = ExtendedModel((make_effect("gnss_latency", latency_s=-0.25),))
    assert 0.0 == with_model_constants(CONFIG, model).gnss.latency_s
