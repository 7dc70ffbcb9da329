"""Each effect of the catalogue against a calculation by hand, and its sign."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.car.physics.motions import accelerating, car, steady
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.car.physics.covariates import covariate
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.forward import (
    antenna_truth,
    gyro_rates,
    shown_counts,
    wheel_angles,
    wheel_rates,
)
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Motion
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FL, FR, RL, RR, WHEELS


def only(effect: Effect) -> ExtendedModel:
    """The model of one effect."""
    return ExtendedModel((effect,))


def test_centrifugal_growth_is_k_v_squared_on_every_wheel() -> None:
    """2.1e-6 s2/m at 30 m/s is 1.89 mm on all wheels."""
    change = make_effect("centrifugal_growth", coefficient=2.1e-6).radius_change_m(steady(30.0), car())

    assert pytest.approx(np.full((1001, 4), 1.89e-3), rel=1e-12) == change


def test_thermal_growth_follows_its_time_constant() -> None:
    """After one time constant a tyre has 63.2 % of the growth, at the start none."""
    motion = steady(duration_s=10.0)
    change = make_effect("thermal_growth", amplitude_m=1e-3, time_constant_s=10.0).radius_change_m(
        motion, car()
    )

    assert [0.0] * 4 == change[0].tolist()
    assert pytest.approx([1e-3 * (1 - math.exp(-1))] * 4) == change[-1]


def test_braking_loads_the_front_and_shrinks_it() -> None:
    """At -2 m/s2 and c = 5e-5 s2 the front loses 0.1 mm and the rear gains as much."""
    change = make_effect("load_transfer_longitudinal", coefficient=5e-5).radius_change_m(
        accelerating(-2.0), car()
    )

    assert pytest.approx([-1e-4, -1e-4, 1e-4, 1e-4]) == change[100]


def test_gravity_on_a_slope_transfers_load_as_acceleration_does() -> None:
    """At constant speed up a slope of 5 degrees the rear carries g*sin(5 deg) worth of load."""
    slope = math.radians(5.0)
    change = make_effect("load_transfer_longitudinal", coefficient=5e-5).radius_change_m(
        steady(grade_rad=slope), car()
    )

    assert pytest.approx(-5e-5 * 9.80665 * math.sin(slope)) == change[0, RL]


@pytest.mark.parametrize(("yaw_rate", "outer"), [(0.1, (FR, RR)), (-0.1, (FL, RL))])
def test_the_outer_wheels_shrink_in_a_bend(yaw_rate: float, outer: tuple[int, int]) -> None:
    """In a left turn the right wheels are loaded and shrink; in a right turn the left ones."""
    change = make_effect("load_transfer_lateral", coefficient=4e-5).radius_change_m(
        steady(20.0, yaw_rate), car()
    )[0]
    expected = np.full(4, 8e-5)
    expected[list(outer)] = -8e-5

    assert pytest.approx(expected) == change


def test_the_stiffer_axle_in_roll_takes_the_greater_share_of_the_load() -> None:
    """With d = c / 4 in front the wheels there change by 5 / 4 of c * a_y, those at the rear by 3 / 4."""
    made = make_effect("load_transfer_lateral", coefficient=4e-5, front_more=1e-5)
    change = made.radius_change_m(steady(20.0, 0.1), car())[0]

    assert pytest.approx(np.array([1e-4, -1e-4, 6e-5, -6e-5])) == change


@pytest.mark.parametrize(
    ("driven", "wheels"), [("front", (FL, FR)), ("rear", (RL, RR)), ("all", (FL, FR, RL, RR))]
)
def test_driven_wheels_slip_forwards_under_drive_force(driven: str, wheels: tuple[int, ...]) -> None:
    """omega * r = v * (1 + c a + d v^2) on driven wheels alone: 3.6e-4 * 1.5 + 1e-6 * 100 at 10 m/s."""
    effect = make_effect("longitudinal_slip", slip_per_accel=3.6e-4, slip_per_speed2=1e-6)
    motion, vehicle = accelerating(1.5), car(driven)
    excess = wheel_rates(motion, vehicle, only(effect))[0] * 0.316 / 10.0 - 1.0
    expected = np.zeros(4)
    expected[list(wheels)] = 3.6e-4 * 1.5 + 1e-6 * 100.0

    assert pytest.approx(expected, abs=1e-12) == excess


def test_driven_wheels_turn_slower_when_the_engine_brakes() -> None:
    """Slip acts for either sign of the acceleration."""
    slip = make_effect("longitudinal_slip", slip_per_accel=1e-3).wheel_slip(accelerating(-2.0), car())

    assert pytest.approx([-2e-3, -2e-3, 0.0, 0.0]) == slip[10]


def test_driven_wheels_slip_when_climbing_at_constant_speed() -> None:
    """The drive force that holds a car on a slope slips as the same force in acceleration does."""
    slip = make_effect("longitudinal_slip", slip_per_accel=1e-3).wheel_slip(steady(grade_rad=0.05), car())

    assert pytest.approx(1e-3 * 9.80665 * math.sin(0.05)) == slip[0, FL]


def test_the_rear_axle_drifts_to_the_outside() -> None:
    """In a left turn at 2 m/s2 and c = 5e-3 the axle moves 10 mrad to the right of the body's heading."""
    motion = steady(20.0, 0.1)
    truth = antenna_truth(motion, car(), only(make_effect("lateral_slip", coefficient=5e-3)))
    course = np.arctan2(truth.north_mps, truth.east_mps)

    assert pytest.approx(-0.01) == course[0] - motion.heading_rad[0]
    assert pytest.approx(20.0 / math.cos(0.01)) == math.hypot(truth.east_mps[0], truth.north_mps[0])


def test_the_receiver_sees_the_horizontal_of_a_slope() -> None:
    """On a slope of 0.1 rad 200 m of road are 200*cos(0.1) m on the map and 200*sin(0.1) m up."""
    truth = antenna_truth(steady(20.0, grade_rad=0.1), car(), only(make_effect("road_grade")))

    assert pytest.approx(200 * math.cos(0.1)) == truth.east_m[-1]
    assert pytest.approx(200 * math.sin(0.1)) == truth.up_m[-1]


CURVE = {"covariate": "speed", "knots": [10.0, 20.0, 30.0], "heights": [0.0, -1e-3, 4e-4]}


@pytest.mark.parametrize(
    ("speed", "height"),
    [(5.0, 0.0), (10.0, 0.0), (15.0, -5e-4), (20.0, -1e-3), (27.0, -2e-5), (30.0, 4e-4), (40.0, 4e-4)],
)
def test_a_spline_term_is_linear_between_its_knots_and_constant_beyond(speed: float, height: float) -> None:
    """At each speed the radii of its wheels change by the chord's height, with their signs; others stay."""
    effect = make_effect("unknown", on="fl -rr", **CURVE)

    assert (
        pytest.approx([height, 0.0, 0.0, -height], abs=1e-12)
        == (effect.radius_change_m(steady(speed), car())[0])
    )


def test_a_spline_term_on_a_reading_leaves_the_motion_as_it_is() -> None:
    """The receiver's speed reads 1 m/s more, its course 0.1 rad more to the left, its position is right."""
    shape = {"covariate": "speed", "knots": [0.0, 40.0]}
    model = ExtendedModel(
        (
            make_effect("unknown", on="gnss_speed", heights=[0.0, 2.0], **shape),
            make_effect("unknown", on="gnss_course", heights=[0.1, 0.1], **shape),
            make_effect("unknown", on="yaw_rate", heights=[0.0, 0.02], **shape),
        )
    )
    truth, plain = (antenna_truth(steady(20.0), car(), m) for m in (model, ExtendedModel()))

    assert pytest.approx(21.0) == math.hypot(truth.shown_east_mps[0], truth.shown_north_mps[0])
    assert pytest.approx(0.1) == math.atan2(truth.shown_north_mps[0], truth.shown_east_mps[0])
    assert (plain.east_m[-1], plain.north_m[-1]) == (truth.east_m[-1], truth.north_m[-1])
    assert pytest.approx(0.01) == gyro_rates(steady(20.0), car(), model)[0]
    assert np.array_equal(
        wheel_rates(steady(20.0), car(), model), wheel_rates(steady(20.0), car(), ExtendedModel())
    )


@pytest.mark.parametrize(
    ("name", "motion", "value"),
    [
        ("accel_long", accelerating(1.5), 1.5),
        ("accel_long", steady(20.0, grade_rad=0.05), 9.80665 * math.sin(0.05)),
        ("accel_lat", steady(20.0, 0.1), 2.0),
        ("yaw_rate", steady(20.0, 0.1), 0.1),
        ("grade", steady(grade_rad=0.05), 0.05),
        ("time", steady(), 3.0),
        ("distance", steady(20.0), 60.0),
        ("steering", steady(20.0, 0.1), 14.0 * math.atan(2.63 * 0.1 / 20.0)),
        ("steering_rate", steady(20.0, 0.1), 0.0),
        ("torque", replace(steady(), measured={"torque": np.full(1001, 80.0)}), 80.0),
    ],
)
def test_covariates_are_what_their_names_say(name: str, motion: Motion, value: float) -> None:
    """Each covariate after three seconds of a motion that is known."""
    assert pytest.approx(value, abs=1e-9) == covariate(motion, car(steering_ratio=14.0), name)[300]


def test_a_spline_term_over_what_nobody_measured_does_not_act() -> None:
    """Without a thermometer a shape over temperature changes nothing."""
    effect = make_effect("unknown", on="rl", covariate="temperature", knots=[270, 300], heights=[1e-3, 1e-3])

    assert not np.any(effect.radius_change_m(steady(), car()))


def test_latency_adds_up() -> None:
    """Two latencies are as old as their sum."""
    model = ExtendedModel(
        (make_effect("gnss_latency", latency_s=0.085), make_effect("gnss_latency", latency_s=0.02))
    )

    assert pytest.approx(0.105) == model.fix_age_s()


def test_a_lever_arm_moves_the_antenna_and_its_velocity() -> None:
    """Forward 1 m, left 0.5 m, heading north: at (-0.5, 1); a left turn adds (-0.1, -0.05) m/s."""
    motion = steady(20.0, 0.1, heading_rad=math.pi / 2)
    effect = make_effect("antenna_lever_arm", forward_m=1.0, left_m=0.5)
    truth = antenna_truth(motion, car(), only(effect))

    assert pytest.approx((-0.5, 1.0)) == (truth.east_m[0], truth.north_m[0])
    assert pytest.approx((-0.1, 20.0 - 0.05)) == (truth.east_mps[0], truth.north_mps[0])


def test_a_lever_arm_adds_to_the_configured_one() -> None:
    """The effect is true minus configured."""
    vehicle = car(antenna_forward_m=1.0, antenna_left_m=-0.3)
    effect = make_effect("antenna_lever_arm", forward_m=0.2, left_m=0.1)
    truth = antenna_truth(steady(), vehicle, only(effect))

    assert pytest.approx((1.2, -0.2)) == (truth.east_m[0], truth.north_m[0])


def test_a_wider_rear_track_spreads_the_rear_speeds() -> None:
    """With 4 cm more rear track the rear wheels' speeds differ by yaw rate * (track + 0.04)."""
    rates = wheel_rates(steady(20.0, 0.2), car(), only(make_effect("track_width_error", rear_m=0.04)))[0]
    plain = wheel_rates(steady(20.0, 0.2), car(), ExtendedModel())[0]

    assert pytest.approx(0.2 * (1.52 + 0.04) / 0.316) == rates[RR] - rates[RL]
    assert plain[[FL, FR]].tolist() == rates[[FL, FR]].tolist()


def test_an_eccentric_ring_errs_once_per_revolution() -> None:
    """The counter shows theta + A sin(theta): A ahead at a quarter turn, A behind at three."""
    effect = make_effect("tone_ring_error", wheel="rl", amplitude_rad=0.01)
    quarters = np.pi / 2 * np.arange(4)

    assert pytest.approx([0.0, 0.01, 0.0, -0.01], abs=1e-15) == effect.tooth_angle_error_rad(quarters, RL)
    assert [0.0] * 4 == effect.tooth_angle_error_rad(quarters, RR).tolist()


def test_a_ring_with_a_tooth_less_counts_less() -> None:
    """47 teeth in place of 48 count 47 per revolution, on that wheel alone."""
    model = only(make_effect("tone_ring_error", wheel="fr", teeth_per_rev=47))
    turn = np.array([2 * np.pi])

    assert [48.0, 47.0, 48.0, 48.0] == [
        pytest.approx(shown_counts(turn, wheel, car(), model)[0]) for wheel in range(4)
    ]


def test_bias_and_scale_of_the_gyro_act_on_the_truth_alone() -> None:
    """reading = 1.02 * truth + 0.003, in whatever order the effects are listed."""
    bias, scale = make_effect("yaw_rate_bias", bias=0.003), make_effect("yaw_rate_scale", scale=1.02)
    truth = np.array([0.0, 0.5, -0.5])
    expected = [0.003, 0.513, -0.507]

    assert pytest.approx(expected) == ExtendedModel((bias, scale)).read_yaw_rate(truth)
    assert pytest.approx(expected) == ExtendedModel((scale, bias)).read_yaw_rate(truth)


def test_a_leak_ramps_and_stays() -> None:
    """-2 mm from 2 s over 4 s: nothing before, half at 4 s, all from 6 s, on its wheel alone."""
    effect = make_effect("radius_change", wheel="rr", deviation_m=-2e-3, onset_s=2.0, duration_s=4.0)
    change = effect.radius_change_m(steady(), car())

    assert pytest.approx([0.0, 0.0, -1e-3, -2e-3, -2e-3]) == change[[0, 200, 400, 600, 1000], RR]
    assert 0.0 == np.abs(change[:, :RR]).max()


def test_a_step_is_there_from_its_onset() -> None:
    """A change of no duration is complete at the onset itself."""
    effect = make_effect("radius_change", wheel="fl", deviation_m=1e-3, onset_s=2.0)
    change = effect.radius_change_m(steady(), car())[:, FL]

    assert (0.0, 1e-3) == (change[199], change[200])


def test_a_smaller_wheel_turns_faster() -> None:
    """1 % less radius, 1/0.99 times the angle."""
    effect = make_effect("radius_change", wheel="rl", deviation_m=-0.00316)
    angles = wheel_angles(steady(), car(), only(effect))[-1]

    assert pytest.approx(angles[RR] / 0.99) == angles[RL]


@pytest.mark.parametrize("name", sorted(set(EFFECTS) - {"unknown"}))
def test_an_effect_acts_through_one_or_two_hooks(name: str) -> None:
    """Every effect overrides one or two hooks of the base class and leaves the others neutral."""
    hooks = {
        key
        for key, value in vars(Effect).items()
        if callable(value)
        and not key.startswith("_")
        and key not in ("values", "unit_of", "not_compensated", "left_in")
    }

    own = {hook for hook in hooks if getattr(EFFECTS[name], hook) is not vars(Effect)[hook]}
    assert len(own) in (1, 2)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_effect_names_its_source(name: str) -> None:
    """The docstring of an effect's class has its equation's source (the fault's is a paper too)."""
    assert "Source:" in (EFFECTS[name].__doc__ or "")


def test_effects_combine_whatever_their_order() -> None:
    """Radius changes and slips of several effects are sums."""
    growth = make_effect("centrifugal_growth", coefficient=1e-6)
    warm = make_effect("thermal_growth", amplitude_m=5e-4)
    slip = make_effect("longitudinal_slip", slip_per_accel=1e-3)
    motion = accelerating(1.0)
    one = wheel_rates(motion, car(), ExtendedModel((growth, warm, slip)))
    other = wheel_rates(motion, car(), ExtendedModel((slip, warm, growth)))
    radius = 0.316 + 1e-6 * motion.speed_mps**2 + 5e-4 * (1 - np.exp(-motion.time_s / 600))
    by_hand = motion.speed_mps * (1 + 1e-3) / radius

    assert pytest.approx(one, rel=1e-14) == other
    assert pytest.approx(by_hand) == one[:, WHEELS.index("fl")]


def test_spinning_wheels_turn_faster_within_their_span_alone() -> None:
    """omega * r = v * (1 + slip) on the named wheels from the onset on for so long."""
    motion = steady(20.0)
    event = make_effect("wheel_spin", wheels="front", slip=0.012, onset_s=10.0, duration_s=5.0)
    rates = wheel_rates(motion, car(), only(event))
    free = wheel_rates(motion, car(), ExtendedModel())
    inside = (motion.time_s >= 10.0) & (motion.time_s < 15.0)

    np.testing.assert_allclose(rates[inside, :2] / free[inside, :2], 1.012, rtol=1e-12)
    np.testing.assert_array_equal(rates[~inside], free[~inside])
    np.testing.assert_array_equal(rates[:, 2:], free[:, 2:])


def test_a_wheel_that_stands_does_not_turn() -> None:
    """A slip of -1 is a locked wheel; no event has the sign of the other."""
    motion = steady(20.0)
    event = make_effect("wheel_lock", wheels="rl", slip=-1.0, onset_s=0.0, duration_s=1e3)

    assert 0.0 == float(np.abs(wheel_rates(motion, car(), only(event))[:, 2]).max())
    with pytest.raises(ConfigError, match=r"^effect wheel_spin: slip = -0.1 is outside 0 to 50 1$"):
        make_effect("wheel_spin", wheels="rl", slip=-0.1, onset_s=0.0, duration_s=1.0)
    with pytest.raises(
        ConfigError, match=r"^effect wheel_lock: wheels = 'middle' holds 'middle', wanted are "
    ):
        make_effect("wheel_lock", wheels="middle", slip=-0.1, onset_s=0.0, duration_s=1.0)


def test_an_older_speed_is_that_of_an_earlier_moment_and_its_position_is_not() -> None:
    """The lag moves speed and course; the fix's own age stays what it was."""
    model = ExtendedModel(
        (make_effect("velocity_lag", lag_s=0.2), make_effect("gnss_latency", latency_s=0.1))
    )

    assert (0.2, 0.1) == (model.velocity_age_s(), model.fix_age_s())


def test_a_blind_counter_shows_nothing_below_its_speed() -> None:
    """At 2 m/s a wheel that loses all counts below 2.5 m/s stands, at 3 m/s it turns as it does."""
    effect = make_effect("counter_lost_low_speed", wheels="rr", below_mps=2.5)

    assert [0.0, 0.0, 0.0, -1.0] == effect.wheel_slip(steady(2.0), car())[0].tolist()
    assert [0.0] * 4 == effect.wheel_slip(steady(3.0), car())[0].tolist()
