"""Each effect of vehicle dynamics against its closed form."""

from __future__ import annotations

import itertools
import math
import pkgutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.offline.dynamics.test_baselines import CAR, held, settled
from tpmsd.car.physics import dynamics_effects
from tpmsd.car.physics.baselines.base import Baseline
from tpmsd.car.physics.baselines.dugoff import grip_share
from tpmsd.car.physics.baselines.frame import Frame, sine
from tpmsd.car.physics.baselines.inputs import Inputs, Span, make_inputs
from tpmsd.car.physics.baselines.single_track import SingleTrack
from tpmsd.car.physics.baselines.table import BASELINES
from tpmsd.car.physics.baselines.three_dof import ThreeDof
from tpmsd.car.physics.dynamics_catalogue import DYNAMICS_EFFECTS, make_dynamics_effect
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.car.physics.dynamics_effects.time_spline import covariate_of
from tpmsd.car.physics.parameters import Parameter
from tpmsd.foundation.errors import ConfigError

G = 9.80665
X = np.array([[0.2, 0.15]])
U = replace(held(0.03, 22.0, -1.5), drive_n=np.array([500.0]), brake_n=np.array([900.0]))
FORCED = np.array([[0.2, 0.15, 22.0]])


def rates(name: str, model: Baseline | None = None, u: Inputs = U, **values: object) -> np.ndarray:
    """Return the change of the rates by an effect."""
    model = SingleTrack(CAR) if model is None else model
    x = FORCED if model.forces else X
    return np.asarray(model.rates(x, u, (make_dynamics_effect(name, **values),)) - model.rates(x, u, ()))[0]


def readings(name: str, output: str, u: Inputs = U, model: Baseline | None = None, **values: object) -> float:
    """Return the change of a reading by an effect."""
    model = SingleTrack(CAR) if model is None else model
    x = FORCED if model.forces else X
    return float(
        (model.read(x, u, (make_dynamics_effect(name, **values),))[output] - model.read(x, u, ())[output])[0]
    )


def front_angle() -> float:
    """Return the front slip angle of the probing state."""
    return 0.03 - (0.2 + CAR.front_m * 0.15) / 22.0


def rear_angle() -> float:
    """Return the rear slip angle."""
    return -(0.2 - CAR.rear_m * 0.15) / 22.0


@pytest.mark.parametrize("name", sorted(DYNAMICS_EFFECTS))
@pytest.mark.parametrize("kind", list(BASELINES))
def test_neutral_values_change_nothing(name: str, kind: str) -> None:
    """An effect at neutral leaves rates and readings as they are."""
    cls = DYNAMICS_EFFECTS[name]
    model = BASELINES[kind](CAR, kind == "three-dof")
    if cls.grid or cls.states:
        return  # at neutral they are not there
    neutral = {p.name: p.neutral for p in cls.parameters if isinstance(p, Parameter) and p.probe > 0.0}
    effect = cls(**neutral)
    x = FORCED if model.forces else X
    frame, plain = model.frame(x, U, (effect,)), model.frame(x, U, ())

    for key, value in plain.outputs.items():
        assert frame.outputs[key] == pytest.approx(value, rel=1e-12, abs=1e-12)
    for key in ("v", "r", "u"):
        assert frame.rates[key] == pytest.approx(plain.rates[key], rel=1e-12, abs=1e-12)


def typical(name: str) -> DynamicsEffect:
    """Return an effect at its usual size."""
    cls = DYNAMICS_EFFECTS[name]
    values = {p.name: p.typical for p in cls.parameters if isinstance(p, Parameter) and p.probe > 0.0}
    return cls(**values)


@pytest.mark.parametrize("kind", list(BASELINES))
def test_a_model_is_the_same_whichever_effect_was_found_first(kind: str) -> None:
    """Scale and bias, ratio and offset do not commute: the car has one order, so that a probe that puts
    its effect last differs by its parameter alone."""
    model = BASELINES[kind](CAR, kind == "three-dof")
    x = FORCED if model.forces else X
    classes = [cls for cls in DYNAMICS_EFFECTS.values() if cls.applies(model.nonlinear, model.forces)]
    names = [cls.name for cls in classes if not cls.states and cls.numbers()]
    for one, other in itertools.combinations([typical(name) for name in names], 2):
        first, second = (model.frame(x, U, theta) for theta in ((one, other), (other, one)))
        assert first.outputs == second.outputs, (one.name, other.name)
        assert first.rates == second.rates, (one.name, other.name)


@pytest.mark.parametrize("kind", list(BASELINES))
def test_an_evaluation_that_is_carried_on_is_that_of_the_whole_model(kind: str) -> None:
    """Models that differ in what follows the tyres' forces share what comes before, to the last bit."""
    model = BASELINES[kind](CAR, kind == "three-dof")
    x = np.tile(FORCED if model.forces else X, (3, 1))
    u = make_inputs(np.arange(3) * 0.02, np.full(3, 0.04), np.full(3, 22.0), np.full(3, 0.5))
    classes = [cls for cls in DYNAMICS_EFFECTS.values() if cls.applies(model.nonlinear, model.forces)]
    effects = [typical(cls.name) for cls in classes if not cls.states and cls.numbers()]
    first = next(one for one in effects if one.name == "mass_error")
    rolled = model.evaluate_to_tyre_forces(x, u, (first,))
    for effect in effects:
        theta = (first, effect) if effect is not first else (first,)
        carried, whole = model.frame(x, u, theta, rolled=rolled), model.frame(x, u, theta)
        assert all(np.array_equal(carried.outputs[k], v) for k, v in whole.outputs.items()), effect.name
        assert all(np.array_equal(carried.rates[k], v) for k, v in whole.rates.items()), effect.name
    assert rolled.has_same_early_effects((first, typical("yaw_moment"), typical("yaw_rate_bias")))
    assert not rolled.has_same_early_effects((first, typical("steering_offset")))
    assert not rolled.has_same_early_effects(())
    assert not rolled.has_same_early_effects((typical("mass_error"),))  # another object may have other values


@pytest.mark.parametrize("name", sorted(DYNAMICS_EFFECTS))
def test_every_effect_says_what_it_is(name: str) -> None:
    """Formula, sentence, units, a prior with its source for each fitted number, a drive that tells it."""
    cls = DYNAMICS_EFFECTS[name]

    assert cls.wording.formula
    assert cls.wording.sentence
    assert name == "unknown" or cls.wording.distinguished_by
    assert name == "unknown" or "Source:" in (cls.__doc__ or "")
    for p in cls.numbers():
        assert p.prior is not None
        assert len(p.prior.source) > 5
        assert p.unit
    assert set(cls.confounded_with) <= set(DYNAMICS_EFFECTS)


def test_the_catalogue_has_what_the_public_formats_name() -> None:
    """Every effect of section 6 of the public formats is there."""
    named = """
        rolling_resistance aero_drag aero_downforce mass_error yaw_inertia_error cornering_stiffness_error
        drive_force_error brake_force_error cg_position_error cg_height_error tyre_relaxation tyre_saturation
        load_dependent_stiffness roll_steer compliance_steer camber_thrust roll_dynamics steering_ratio_error
        steering_offset steering_delay road_grade road_bank side_wind head_wind locked_differential yaw_moment
        yaw_rate_bias yaw_rate_scale gyro_delay accelerometer_bias accelerometer_tilt accelerometer_position
    """

    assert set(named.split()) <= set(DYNAMICS_EFFECTS)
    files = {one.name for one in pkgutil.iter_modules([str(Path(dynamics_effects.__path__[0]))])}
    assert len(set(DYNAMICS_EFFECTS) & files) >= len(named.split()) - 4  # slopes and winds share a file


def test_forces_of_the_longitudinal_effects() -> None:
    """du/dt loses c g, rho A u^2 / (2 m), and gains the share of a force."""
    model = ThreeDof(CAR, forces=True)

    assert rates("rolling_resistance", model, coefficient=0.012)[2] == pytest.approx(-0.012 * G)
    assert rates("aero_drag", model, drag_area_m2=0.7)[2] == pytest.approx(
        -0.5 * 1.2041 * 0.7 * 22.0**2 / 1480.0
    )
    assert rates("drive_force_error", model, relative=0.1)[2] == pytest.approx(50.0 / 1480.0, rel=0.03)
    assert rates("brake_force_error", model, relative=0.1)[2] == pytest.approx(-90.0 / 1480.0, rel=0.03)
    assert rates("road_grade", model, knots=(0.0, 9.0), heights=(0.04, 0.04))[2] == pytest.approx(
        -G * math.sin(0.04)
    )
    area, density = (
        make_dynamics_effect("aero_drag", drag_area_m2=0.7),
        make_dynamics_effect("air_density_error", relative=0.05),
    )
    more = model.rates(FORCED, U, (area, density)) - model.rates(FORCED, U, ())
    assert more[0, 2] == pytest.approx(-0.5 * 1.05 * 1.2041 * 0.7 * 22.0**2 / 1480.0)
    wind = rates("head_wind", model, speed_mps=10.0)
    assert wind[2] == pytest.approx(-0.5 * 1.2041 * 0.65 * (32.0**2 - 22.0**2) / 1480.0)


def test_wheels_resist_rolling_by_their_loads() -> None:
    """The outer wheels turn the car out of the bend, together by c h for m u r; without a resistance they do
    not, nor does the resistance alone."""
    resists = make_dynamics_effect("rolling_resistance", coefficient=0.012)
    model = ThreeDof(CAR, forces=True)
    plain = model.rates(FORCED, U, (resists,))
    side = 1480.0 * 22.0 * 0.15

    turned = model.rates(FORCED, U, (resists, make_dynamics_effect("wheel_resistance", coefficient=1.0)))

    assert (turned - plain)[0] == pytest.approx([0.0, -0.012 * CAR.height_m * side / 2350.0, 0.0])
    assert rates("wheel_resistance", model, coefficient=1.0) == pytest.approx([0.0, 0.0, 0.0])
    assert rates("rolling_resistance", model, coefficient=0.012)[1] == pytest.approx(0.0)


def test_forces_of_the_lateral_effects() -> None:
    """dv/dt and dr/dt change by the forces of the closed forms."""
    side = 0.5 * 1.2041 * 4.5 * 22.0 * 8.0
    assert rates("side_wind", speed_mps=8.0)[:2] == pytest.approx([side / 1480.0, 0.25 * side / 2350.0])
    assert rates("road_bank", knots=(0.0, 9.0), heights=(0.03, 0.03))[:2] == pytest.approx(
        [-G * math.sin(0.03), 0.0]
    )
    lock = 0.3 * 85_000.0 * 1.53**2 / 2.0 * 0.15 / 22.0
    assert rates("locked_differential", coefficient=0.3)[:2] == pytest.approx([0.0, -lock / 2350.0])
    assert rates("yaw_moment", coefficient=0.05)[:2] == pytest.approx([0.0, 0.05 * 1480.0 * -1.5 / 2350.0])
    base = CAR.wheelbase_m
    loads = (
        np.array([CAR.rear_m, CAR.front_m]) * 1480.0 * G / base
        + np.array([1.0, -1.0]) * 1480.0 * 1.5 * 0.54 / base
    )
    push = -0.05 * loads * 22.0 * 0.15 / G
    moment = (CAR.front_m * push[0] - CAR.rear_m * push[1]) / 2350.0
    assert rates("camber_thrust", coefficient=0.05)[:2] == pytest.approx([push.sum() / 1480.0, moment])


def test_changes_of_the_car() -> None:
    """Mass, inertia, stiffness and lengths enter as in Riekert's equations."""
    front, rear = CAR.cornering_front_n * front_angle(), CAR.cornering_rear_n * rear_angle()
    v_rate, r_rate = (front + rear) / 1480.0, (CAR.front_m * front - CAR.rear_m * rear) / 2350.0
    assert rates("mass_error", relative=0.1)[:2] == pytest.approx([v_rate / 1.1 - v_rate, 0.0])
    assert rates("yaw_inertia_error", relative=0.2)[:2] == pytest.approx([0.0, r_rate / 1.2 - r_rate])
    both = rates("cornering_stiffness_error", front=0.1, rear=-0.2)
    assert both[0] == pytest.approx((0.1 * front - 0.2 * rear) / 1480.0)
    assert both[1] == pytest.approx((0.1 * CAR.front_m * front + 0.2 * CAR.rear_m * rear) / 2350.0)
    ahead = CAR.cornering_front_n * (0.03 - (0.2 + (CAR.front_m - 0.05) * 0.15) / 22.0)
    behind = CAR.cornering_rear_n * -(0.2 - (CAR.rear_m + 0.05) * 0.15) / 22.0
    moved = rates("cg_position_error", forward_m=0.05)
    assert moved[0] == pytest.approx((ahead + behind - front - rear) / 1480.0)


def test_changes_of_the_tyres() -> None:
    """Load transfer, compliance, roll steer and friction change the side forces by their formulas."""
    front, rear = CAR.cornering_front_n * front_angle(), CAR.cornering_rear_n * rear_angle()
    z = 2.0 * 0.54 * 22.0 * 0.15 / G / np.array([1.53, 1.51])
    lost = -0.4 * z**2 * np.array([front, rear])
    assert rates("load_dependent_stiffness", coefficient=0.4)[0] == pytest.approx(lost.sum() / 1480.0)
    k = 0.002 * CAR.wheelbase_m / (1480.0 * CAR.rear_m)
    less = front / (1.0 + k * CAR.cornering_front_n) - front
    assert rates("compliance_steer", coefficient=0.002)[0] == pytest.approx(less / 1480.0)
    assert rates("roll_steer", coefficient=0.001)[0] == pytest.approx(
        CAR.cornering_rear_n * 0.001 * 3.3 / 1480.0
    )
    k = -0.1 + 0.2 * (22.0**2 - 16.0**2) / (22.0**2 + 16.0**2)
    turned = CAR.cornering_rear_n * k * 0.03
    assert rates("rear_axle_steering", coefficient=-0.1, by_speed=0.2)[:2] == pytest.approx(
        [turned / 1480.0, -CAR.rear_m * turned / 2350.0]
    )
    # On four wheels at a small angle it is the same force, but for Dugoff's law at the tyres' load.
    four = rates("rear_axle_steering", ThreeDof(CAR), coefficient=-0.01)[:2]
    assert four == pytest.approx(rates("rear_axle_steering", coefficient=-0.01)[:2], rel=0.1)
    assert rates("unknown", on="force_rear", over="steering", knots=(0.0, 0.1), heights=(0.0, 1.0))[
        :2
    ] == pytest.approx([0.3, -CAR.rear_m * 0.3 * 1480.0 / 2350.0])
    load = 1480.0 * G * CAR.rear_m / CAR.wheelbase_m + 1480.0 * 1.5 * 0.54 / CAR.wheelbase_m
    lam = 0.3 * load / (2.0 * abs(front))
    share = (2.0 - lam) * lam if lam < 1.0 else 1.0
    assert lam < 1.0
    change = rates("tyre_saturation", friction=0.3)
    assert change[1] == pytest.approx(CAR.front_m * front * (share - 1.0) / 2350.0, rel=0.25)
    assert abs(rates("tyre_saturation", friction=3.0)).max() < 1e-12


def test_height_and_downforce_act_by_the_loads_at_the_limit() -> None:
    """On the 3-DOF car a higher centre of gravity costs side force, downforce gives some."""
    model, hard = ThreeDof(CAR), held(0.12, 22.0)
    high = readings("cg_height_error", "accel_lat", hard, model, height_m=0.2)
    pressed = readings("aero_downforce", "accel_lat", hard, model, front_m2=1.0, rear_m2=1.0)

    assert high < 0.0 < pressed


def test_a_share_of_the_drive_force_costs_its_axle_side_force() -> None:
    """With the drive force at the rear the slips F / (C - F) change axles; a share of 1 has a derivative."""
    hard = replace(held(0.12, 22.0, 3.0), drive_n=np.array([4000.0]))
    model = ThreeDof(CAR, forces=True)
    moved = model.frame(FORCED, hard, (make_dynamics_effect("drive_share_error", relative=-1.0),))
    rear = ThreeDof(replace(CAR, drive_front_share=0.0), forces=True).frame(FORCED, hard, ())

    assert moved.rates["r"] == pytest.approx(rear.rates["r"])
    assert abs(rates("drive_share_error", model, hard, relative=0.001)[1]) > 0.0
    assert not DYNAMICS_EFFECTS["drive_share_error"].applies(nonlinear=False, forces=True)


def test_a_relaxed_slip_angle_follows_with_its_length() -> None:
    """d(alpha')/dt = u / L (alpha - alpha'), and the force is that of alpha'."""
    model = SingleTrack(CAR)
    effect = make_dynamics_effect("tyre_relaxation", length_m=0.5)
    x = np.array([[0.2, 0.15, 0.01, -0.002]])
    found = model.rates(x, U, (effect,))[0]

    assert found[2] == pytest.approx(22.0 / 0.5 * (front_angle() - 0.01))
    assert found[3] == pytest.approx(22.0 / 0.5 * (rear_angle() + 0.002))
    force = CAR.cornering_front_n * 0.01 - CAR.cornering_rear_n * 0.002
    assert found[0] == pytest.approx(force / 1480.0 - 22.0 * 0.15)


@pytest.mark.parametrize("kind", list(BASELINES))
def test_a_length_is_looked_for_with_the_lag_that_it_has_along_a_drive(kind: str) -> None:
    """Beside a recorded path the relaxed angles are those that the states would have, at walking pace too."""
    model = BASELINES[kind](CAR)
    time_s = np.arange(0.0, 20.0, 0.02)
    speed = np.linspace(3.0, 25.0, len(time_s))
    u = make_inputs(time_s, 0.05 * np.sin(2.0 * time_s), speed)
    path = np.stack([0.1 * np.sin(2.0 * time_s - 0.3), 0.2 * np.sin(2.0 * time_s - 0.1)], axis=1)
    effect = make_dynamics_effect("tyre_relaxation", length_m=0.8)
    angle = model.frame(path, u, ()).angle
    ends = angle if len(angle) == 2 else 0.5 * (angle[[0, 2]] + angle[[1, 3]])
    relaxed = [ends[:, 0]]
    for k in range(len(time_s) - 1):
        rate = (ends[:, k + 1] - ends[:, k]) / 0.02
        lag = ends[:, k] - relaxed[-1]
        for _ in range(40):
            lag = lag + 0.0005 * (rate - speed[k + 1] / 0.8 * lag)
        relaxed.append(ends[:, k + 1] - lag)
    whole = np.concatenate([path, np.array(relaxed)], axis=1)
    with_states = model.frame(whole, u, (effect,)).angle
    seen = model.frame(path, u, (effect,), ("v", "r")).angle

    assert seen == pytest.approx(with_states, abs=0.01 * float(np.max(np.abs(angle))))
    assert float(np.max(np.abs(angle - seen))) > 0.2 * float(np.max(np.abs(angle)))


def test_a_rolling_body_settles_at_the_lateral_acceleration() -> None:
    """In a steady bend q = a_y and nothing else has changed; its natural frequency is the parameter's, faster
    by what the car gives way."""
    model = SingleTrack(CAR)
    effect = make_dynamics_effect("roll_dynamics", frequency_hz=1.5, damping=0.3, coupling=0.2)
    u = held(0.01, 20.0)
    x = np.zeros((1, 4))
    for _ in range(1000):
        x = model.step(x, u, (effect,), 0.02)
    plain = settled(model, u)

    assert x[0, :2] == pytest.approx(plain[0], rel=1e-3)
    assert x[0, 2] == pytest.approx(20.0 * x[0, 1], rel=1e-3)
    off = model.rates(x + np.array([[0.0, 0.0, 0.1, 0.0]]), u, (effect,))[0]
    assert off[3] == pytest.approx(-((2 * math.pi * 1.5) ** 2) * 0.1 / 0.8, rel=1e-2)


@pytest.mark.parametrize("sprung_height", [380.0, 620.0])
def test_a_swinging_body_moves_the_car_as_the_coupled_equations_say(sprung_height: float) -> None:
    """m a - m_s h p'' = F and I_x p'' + c p' + k p = m_s h a, a = dv/dt + u r: with F a sine of W a, and with
    it what an accelerometer reads at the axis, is F / m over 1 + C W^2 / (k / I_x - W^2 + i c W / I_x), of
    coupling C = (m_s h)^2 / (m I_x); at the height of the centre of gravity it reads F / m."""
    rolling, spring, damper, mass = 700.0, 55_000.0, 4_000.0, CAR.mass_kg
    coupling = sprung_height**2 / (mass * rolling)
    natural = math.sqrt(spring / rolling)
    values = {
        "frequency_hz": natural / (2.0 * math.pi),
        "damping": 0.5 * damper / math.sqrt(spring * rolling),
        "coupling": coupling,
    }
    model, time_s, wave = SingleTrack(CAR), np.arange(6000) * 0.002, 2.0 * math.pi * 1.1
    push = 2.0 * np.exp(1j * wave * time_s)
    step, u = 0.002, held(0.0, 20.0)
    out = {}
    for height in (0.0, 1.0):
        roll = make_dynamics_effect("roll_dynamics", **values, sensor_height=height)
        reached, rate, read, moved = 0.0, 0.0, [], []
        for one in push.imag:
            steer = replace(u, steer_rad=np.array(one * mass / CAR.cornering_front_n))
            frame = model.frame(np.array([[0.0, 0.0, reached, rate]]), steer, (roll,))
            read.append(float(frame.outputs["accel_lat"][0]))
            moved.append(float(frame.rates["v"][0]))
            rate += step * float(frame.rates["roll_rate_q"][0])  # semi-implicit
            reached += step * rate
        out[height] = np.array(read), np.array(moved)
    gain = 1.0 / (1.0 + coupling * wave**2 / (natural**2 - wave**2 + 1j * damper * wave / rolling))
    settled_part = slice(4000, None)

    assert out[0.0][1][settled_part] == pytest.approx((gain * push).imag[settled_part], abs=0.03)
    assert out[0.0][0][settled_part] == pytest.approx((gain * push).imag[settled_part], abs=0.03)
    assert out[1.0][0] == pytest.approx(push.imag, abs=1e-9)
    assert abs(gain - 1.0) > 0.1


def test_a_body_without_coupling_does_nothing() -> None:
    """Neutral are all frequencies, dampings and places of the sensor, where coupling is 0."""
    for values in ({"frequency_hz": 1.0}, {"damping": 0.8}, {"sensor_height": 0.0}):
        roll = make_dynamics_effect("roll_dynamics", coupling=0.0, **values)
        state = np.array([[0.2, 0.15, 0.4, 0.3]])
        frame, plain = SingleTrack(CAR).frame(state, U, (roll,)), SingleTrack(CAR).frame(X, U, ())
        assert frame.rates["v"][0] == plain.rates["v"][0]
        assert frame.outputs["accel_lat"][0] == plain.outputs["accel_lat"][0]


def test_what_instruments_read() -> None:
    """Bias, scale, tilt, position and roll change the readings alone."""
    model = SingleTrack(CAR)
    plain = model.frame(X, U, ())
    lat, turn = float(plain.outputs["accel_lat"][0]), float(plain.rates["r"][0])

    assert readings("yaw_rate_bias", "yaw_rate", bias=0.004) == pytest.approx(0.004)
    assert readings("yaw_rate_scale", "yaw_rate", scale=1.03) == pytest.approx(0.03 * 0.15)
    assert readings("accelerometer_bias", "accel_lat", lat_mps2=0.2) == pytest.approx(0.2)
    across = SingleTrack(CAR).read(X, U, ())["accel_lat"][0]  # the recorded a_x of -1.5 holds 0.05 of it
    gravity = G * math.sin(0.03)
    assert readings("accelerometer_tilt", "accel_lat", roll_rad=0.03) == pytest.approx(gravity)
    assert readings("accelerometer_tilt", "accel_lat", pitch_rad=0.03) == pytest.approx(0.0)
    driven = ThreeDof(CAR, forces=True)
    assert readings("accelerometer_tilt", "accel_long", U, driven, pitch_rad=0.03) == pytest.approx(gravity)
    turned = readings("accelerometer_tilt", "accel_lat", yaw_rad=0.05)
    assert turned == pytest.approx(-0.05 * (-1.5 - 0.05 * across))
    assert readings("accelerometer_position", "accel_lat", forward_m=0.5) == pytest.approx(0.5 * turn)
    assert readings("accelerometer_roll", "accel_lat", coefficient=0.05) == pytest.approx(0.05 * lat)
    assert readings("velocity_position", "velocity_lat", forward_m=0.4) == pytest.approx(0.4 * 0.15)
    assert readings("velocity_position", "side_slip", forward_m=0.4) == pytest.approx(0.4 * 0.15 / 22.0)
    assert abs(rates("accelerometer_bias", lat_mps2=0.2)).max() == 0.0


def test_ages_of_readings_and_of_the_steering() -> None:
    """A reading that is T old is that of a state T earlier, to second order; the steering is read ahead."""
    model = SingleTrack(CAR)
    time = np.arange(200) * 0.01
    steer = 0.02 * np.sin(2.0 * math.pi * 0.8 * time)
    u = make_inputs(time, steer, np.full(200, 20.0))
    x = np.zeros((200, 2))
    for k in range(199):
        span = Span(u.take(slice(k, k + 1)), u.take(slice(k + 1, k + 2)))
        x[k + 1] = model.step(x[k : k + 1], span, (), 0.01)[0]
    late = model.read(x, u, (make_dynamics_effect("gyro_delay", delay_s=0.03),))["yaw_rate"]
    lat = model.read(x, u, (make_dynamics_effect("accelerometer_delay", delay_s=0.03),))["accel_lat"]
    now = model.read(x, u, ())
    older = make_dynamics_effect("accelerometer_delay", delay_s=0.08)
    both = model.read(x, u, (make_dynamics_effect("gyro_delay", delay_s=0.03), older))
    ahead = model.read(x, u, (make_dynamics_effect("gyro_delay", delay_s=-0.03), older))
    shifted = make_dynamics_effect("steering_delay", delay_s=0.05).shift_series(u)

    assert late[20:] == pytest.approx(now["yaw_rate"][17:-3], abs=2e-4)
    assert lat[20:] == pytest.approx(now["accel_lat"][17:-3], abs=2e-2)
    assert np.array_equal(both["yaw_rate"], late)
    assert both["accel_lat"][20:] == pytest.approx(now["accel_lat"][12:-8], abs=2e-2)
    assert np.array_equal(ahead["accel_lat"], model.read(x, u, (older,))["accel_lat"])
    assert shifted.steer_rad[50] == pytest.approx(steer[45])


def test_inputs_are_shifted_once_for_models_that_differ_in_other_effects() -> None:
    """Models with one delay of the steering share their inputs, and so what is interpolated of them."""
    time = 0.01 * np.arange(200)
    u = make_inputs(time, 0.02 * np.sin(3.0 * time))

    def late(delay_s: float) -> Inputs:
        return make_dynamics_effect("steering_delay", delay_s=delay_s).shift_series(u)

    first = late(0.05)
    assert late(0.05) is first
    assert not np.array_equal(late(0.06).steer_rad, first.steer_rad)
    assert np.array_equal(late(0.05).steer_rad, first.steer_rad)


def test_steering_ratio_and_offset() -> None:
    """The ratio divides the angle; the offset is that of the recorded angle, through the ratio."""
    front = CAR.cornering_front_n / 1480.0
    assert rates("steering_ratio_error", ratio=1.2)[0] == pytest.approx(front * (0.03 / 1.2 - 0.03))
    model = SingleTrack(replace(CAR, steering_ratio=15.0))
    assert rates("steering_offset", model, offset_rad=0.15)[0] == pytest.approx(-front * 0.01)


def test_a_term_without_a_name_adds_its_spline() -> None:
    """On an equation per inertia, over a covariate; on an output as it is."""
    values = {"on": "moment", "over": "speed", "knots": (10.0, 30.0), "heights": (0.0, 0.4)}
    assert rates("unknown", **values)[1] == pytest.approx(0.24)
    seen = {"on": "yaw_rate", "over": "accel_long", "knots": (-3.0, 0.0), "heights": (0.2, 0.0)}
    assert readings("unknown", "yaw_rate", **seen) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("gyro_delai", {}),
        ("gyro_delay", {"delay": 0.1}),
        ("gyro_delay", {"delay_s": 9.0}),
        ("unknown", {"on": "roof"}),
        ("road_bank", {"knots": (1.0, 0.0), "heights": (0.0, 0.0)}),
    ],
)
def test_what_is_no_effect_is_refused(name: str, values: dict[str, object]) -> None:
    """A wrong name, parameter, value, place or order of knots is one line."""
    with pytest.raises(ConfigError, match="effect"):
        make_dynamics_effect(name, **values)


def test_the_sine_by_the_tangent_is_the_sine() -> None:
    """Within rounding, and of the angle's sign, for every angle within a half turn."""
    angle = np.linspace(-math.pi, math.pi, 2001)

    assert sine(angle) == pytest.approx(np.sin(angle), rel=1e-14, abs=1e-15)
    assert np.array_equal(sine(-angle), -sine(angle))


def test_a_brush_tyre_and_dugoff_s_are_the_ends_of_the_tyre_s_shape() -> None:
    """Brush: F / L = 1 - (1 - C t / 3 L)^3, L = mu F_z ([Pacejka 2012], eq. 3.11); 1 once all slides."""
    limit = 2000.0
    for slope in (600.0, 3000.0, 5900.0, 9000.0):
        share = grip_share(np.array([slope]), 1.0, np.array([limit]), 1.0)
        x = min(slope / (3.0 * limit), 1.0)
        assert share[0] * slope == pytest.approx(limit * (1.0 - (1.0 - x) ** 3))
    plain = grip_share(np.array([3000.0]), 1.0, np.array([limit]))
    brush = grip_share(np.array([3000.0]), 1.0, np.array([limit]), 1.0)
    between = grip_share(np.array([3000.0]), 1.0, np.array([limit]), 0.5)
    assert between[0] == pytest.approx(0.5 * (plain[0] + brush[0]))


def test_wheels_give_way_to_the_force_of_finite_angles() -> None:
    """With C / (1 + k C) at the front in C's place the car moves alike, its angles finite or small."""
    stiff, coefficient = CAR.cornering_front_n, 0.002
    k = coefficient * (CAR.front_m + CAR.rear_m) / (CAR.mass_kg * CAR.rear_m)
    turned = make_dynamics_effect("large_angles", coefficient=1.0)
    gives = make_dynamics_effect("compliance_steer", coefficient=coefficient)
    softer = make_dynamics_effect("cornering_stiffness_error", front=1.0 / (1.0 + k * stiff) - 1.0, rear=0.0)
    at, inputs = np.array([[-0.3, 0.6]]), held(0.25, 7.0, 1.0)
    for others in ((), (turned,)):
        found, expected = (SingleTrack(CAR).rates(at, inputs, (*others, one)) for one in (gives, softer))
        assert found == pytest.approx(expected, rel=1e-12)


def test_finite_angles_turn_the_forces_of_the_front_wheels() -> None:
    """F_y = F_f cos(d) + F_x sin(d) + F_r with F_f = C_f (d - atan((v + a r) / u)); the coefficient is 1.

    F_x is the front's share of m a_x + F_f sin(d): the wheels pull against the turned side force as well.
    """
    steer, speed, ax, v, r = 0.2, 8.0, -2.0, -0.1, 0.5
    found = SingleTrack(CAR).rates(
        np.array([[v, r]]), held(steer, speed, ax), (make_dynamics_effect("large_angles", coefficient=1.0),)
    )[0]
    front = CAR.cornering_front_n * (steer - math.atan((v + CAR.front_m * r) / speed))
    rear = -CAR.cornering_rear_n * math.atan((v - CAR.rear_m * r) / speed)
    pull = CAR.mass_kg * ax + front * math.sin(steer)
    along = (CAR.brake_front_share if pull < 0.0 else CAR.drive_front_share) * pull
    turned = front * math.cos(steer) + along * math.sin(steer)

    assert found[0] == pytest.approx((turned + rear) / CAR.mass_kg - speed * r)
    moment = CAR.front_m * turned - CAR.rear_m * rear
    assert found[1] == pytest.approx(moment / CAR.yaw_inertia_kgm2)
    assert not DYNAMICS_EFFECTS["large_angles"].applies(nonlinear=True, forces=False)


def test_steered_wheels_turn_their_forces_by_all_of_the_angle() -> None:
    """F_x and F_y are the sums of the wheels' forces, the front ones turned by 0.5 rad."""
    frame = ThreeDof(CAR, forces=True).frame(FORCED, replace(U, steer_rad=np.array(0.5)), ())
    along, side = frame.along[:, 0], frame.side[:, 0]
    cos, sin = math.cos(0.5), math.sin(0.5)

    pull = along[:2].sum() * sin + side[:2].sum() * cos + side[2:].sum()
    assert frame.outputs["accel_lat"][0] == pytest.approx(pull / CAR.mass_kg)
    ahead = along[:2].sum() * cos - side[:2].sum() * sin + along[2:].sum()
    assert frame.outputs["accel_long"][0] == pytest.approx(ahead / CAR.mass_kg)


def test_held_steering_acts_half_a_step_late() -> None:
    """The rates are those of an angle half a step younger, and an acceleration reads as it did."""
    step, rate = 0.01, 0.4
    quick = replace(held(0.05, 20.0), steer_rate_radps=np.array(rate))
    late = replace(quick, steer_rad=quick.steer_rad - 0.5 * step * rate)
    theta = (make_dynamics_effect("held_inputs", step_s=step),)
    for model in (SingleTrack(CAR), ThreeDof(CAR, forces=False)):
        found, plain = model.frame(X, quick, theta), model.frame(X, quick, ())
        expected = model.frame(X, late, ())
        for name in ("v", "r"):
            change = found.rates[name] - plain.rates[name]
            assert change == pytest.approx(expected.rates[name] - plain.rates[name], rel=0.05)
        assert found.outputs["accel_lat"] == plain.outputs["accel_lat"]


def test_an_error_of_the_drive_slip_is_one_of_the_longitudinal_stiffness() -> None:
    """Twice the slip of a force is half the stiffness."""
    hard = replace(held(0.12, 22.0, 3.0), drive_n=np.array([4000.0]))
    soft = replace(CAR, longitudinal_n=0.5 * CAR.longitudinal_n)
    moved = ThreeDof(CAR, forces=True).frame(
        FORCED, hard, (make_dynamics_effect("drive_slip_error", relative=1.0),)
    )

    assert moved.rates["r"] == pytest.approx(ThreeDof(soft, forces=True).frame(FORCED, hard, ()).rates["r"])
    assert not DYNAMICS_EFFECTS["drive_slip_error"].applies(nonlinear=False, forces=True)


def test_the_magic_formula_is_the_sine_of_its_author() -> None:
    """F = L sin(C atan(b - E (b - atan b))), b = D / (C L), C = 1.3, E = -0.5 ([Pacejka 2012], eq. 4.49)."""
    limit = 2000.0
    for slope in (300.0, 2000.0, 7000.0):
        share = grip_share(np.array([slope]), 1.0, np.array([limit]), -1.0)
        b = slope / (1.3 * limit)
        force = limit * math.sin(1.3 * math.atan(b + 0.5 * (b - math.atan(b))))
        assert share[0] * slope == pytest.approx(force)


def test_a_longitudinal_force_takes_side_force_by_the_ellipse() -> None:
    """With the coefficient 1 a limit of mu F_z sqrt(1 - (F_x / mu F_z)^2); braked wheels in a bend."""
    braked = replace(held(0.15, 20.0, -4.0), brake_n=np.array([4.0 * CAR.mass_kg]))
    frame = ThreeDof(CAR, forces=True).frame(
        FORCED, braked, (make_dynamics_effect("combined_slip", coefficient=1.0),)
    )
    pull = -0.5 * CAR.brake_front_share * 4.0 * CAR.mass_kg
    limit = CAR.friction * float(frame.load[0][0])
    linear = 0.5 * CAR.cornering_front_n * math.tan(float(frame.angle[0][0]))
    left = math.sqrt(1.0 - (pull / limit) ** 2)
    share = grip_share(np.abs(np.array([linear])), CAR.friction, np.array([limit * left / CAR.friction]))

    assert frame.side[0][0] == pytest.approx(linear * share[0])


def test_two_wheels_of_unequal_load_carry_less_than_two_of_equal_load() -> None:
    """An axle with a limit carries the mean of its wheels' forces, whose loads are F_z / 2 (1 +- z)."""
    limited = make_dynamics_effect("tyre_saturation", friction=0.8, shape=1.0)
    frame = SingleTrack(CAR).frame(
        np.array([[0.1, 0.4]]),
        held(0.1, 20.0),
        (limited, make_dynamics_effect("wheel_loads", coefficient=1.0)),
    )
    z = 2.0 * CAR.height_m * 20.0 * 0.4 / (9.80665 * CAR.track_front_m)
    linear = CAR.cornering_front_n * float(frame.angle[0][0])
    load = float(frame.load[0][0])
    inner, outer = (
        grip_share(np.array([abs(linear)]), 0.8, np.array([load * (1.0 + s * z)]), 1.0) for s in (-1, 1)
    )

    assert frame.side[0][0] == pytest.approx(0.5 * linear * float(inner[0] + outer[0]))
    alone = SingleTrack(CAR).frame(np.array([[0.1, 0.4]]), held(0.1, 20.0), (limited,))
    assert abs(frame.side[0][0]) < abs(alone.side[0][0])


def test_wheel_loads_follow_the_accelerations_of_the_instant() -> None:
    """In a turn-in dv/dt is most of a_y: dF = m a_y h b / (l t), a_y = F_y / m with these loads."""
    entering, state = replace(held(0.06, 25.0), drive_n=np.array([2000.0])), np.array([[0.0, 0.05, 25.0]])
    instant = (make_dynamics_effect("instant_loads", coefficient=1.0),)
    frame = ThreeDof(CAR, forces=True).frame(state, entering, instant)
    across, ahead = float(frame.outputs["accel_lat"][0]), float(frame.outputs["accel_long"][0])
    base = CAR.front_m + CAR.rear_m
    transfer = CAR.mass_kg * across * CAR.height_m * CAR.rear_m / (base * CAR.track_front_m)
    rise = 0.5 * CAR.mass_kg * ahead * CAR.height_m / base

    assert across > 2.0 * 25.0 * 0.05
    assert 0.5 * (frame.load[1] - frame.load[0])[0] == pytest.approx(transfer, rel=0.002)
    rest = 0.5 * CAR.mass_kg * G * CAR.rear_m / base
    assert 0.5 * (frame.load[1] + frame.load[0])[0] == pytest.approx(rest - rise, abs=10.0)
    # A single-track's tyres are linear: they do not feel their loads.
    offered = [one for one in (SingleTrack, ThreeDof) if type(instant[0]).applies(one.nonlinear, False)]
    assert [ThreeDof] == offered


def test_wheels_that_turn_with_the_roll_follow_the_accelerations_of_the_instant() -> None:
    """Slip angles serve every round where no effect makes them of the loads; roll steer is c * a_y."""
    entering, state = held(0.06, 25.0), np.array([[0.0, 0.05]])
    instant = make_dynamics_effect("instant_loads", coefficient=1.0)
    plain = ThreeDof(CAR).frame(state, entering, (instant,))
    turned = ThreeDof(CAR).frame(
        state, entering, (instant, make_dynamics_effect("roll_steer", coefficient=0.002))
    )
    by_roll = float(turned.angle[2][0] - plain.angle[2][0])

    assert by_roll == pytest.approx(0.002 * float(turned.outputs["accel_lat"][0]), rel=0.01)
    idle = make_dynamics_effect("roll_steer", coefficient=0.0)
    same = ThreeDof(CAR).frame(state, entering, (instant, idle))
    assert same.outputs["accel_lat"][0] == pytest.approx(float(plain.outputs["accel_lat"][0]), rel=1e-12)


def test_angles_that_no_load_changes_are_found_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Relaxed slip angles serve every round of the loads, to the last digit; roll steer's do not."""
    entering, state = held(0.06, 25.0), np.array([[0.0, 0.05, 0.03, 0.01]])
    slip = make_dynamics_effect("tyre_relaxation", length_m=0.3)
    loads = make_dynamics_effect("instant_loads", coefficient=1.0)
    turning = make_dynamics_effect("roll_steer", coefficient=0.002)
    found: list[float] = []
    original = ThreeDof._fill_slip_angles

    def counted(self: ThreeDof, frame: Frame) -> None:
        found.append(1.0)
        original(self, frame)

    monkeypatch.setattr(ThreeDof, "_fill_slip_angles", counted)
    once = ThreeDof(CAR).rates(state, entering, (slip, loads))
    assert len(found) == 1
    monkeypatch.setattr(type(slip), "reads_loads", True)
    found.clear()
    assert ThreeDof(CAR).rates(state, entering, (slip, loads)).tolist() == once.tolist()
    each_round = len(found)
    assert each_round > 1
    monkeypatch.setattr(type(slip), "reads_loads", False)
    found.clear()
    ThreeDof(CAR).rates(state, entering, (slip, loads, turning))
    assert len(found) == each_round


def test_forces_of_wheels_that_give_way_turn() -> None:
    """They turn by -k F / (1 + k C), F and C force and stiffness of their axle, as wheels that steer so."""
    coefficient, model = 0.003, ThreeDof(CAR, forces=True)
    k = coefficient * CAR.wheelbase_m / (CAR.mass_kg * CAR.rear_m)
    gives = make_dynamics_effect("compliance_steer", coefficient=coefficient)
    force = 0.5 * CAR.cornering_front_n * float(model.frame(FORCED, U, ()).angle[:2, 0].sum())
    steered = U.steer_rad - k * force / (1.0 + k * CAR.cornering_front_n)

    found = model.rates(FORCED, U, (gives,))

    assert found == pytest.approx(model.rates(FORCED, replace(U, steer_rad=steered), ()), rel=1e-9)


def test_forces_of_turned_wheels_point_where_these_do() -> None:
    """Front wheels that roll steer turns are front wheels steered so; forces of the rear ones turn with them,
    or not, where a simulation adds the turn to the slip angle alone."""
    model, accel = ThreeDof(CAR, forces=True), 22.0 * 0.15
    front = make_dynamics_effect("roll_steer", front=0.002)
    steered = replace(U, steer_rad=U.steer_rad - 0.002 * accel)
    assert model.rates(FORCED, U, (front,)) == pytest.approx(model.rates(FORCED, steered, ()), rel=1e-12)
    along, alone = (
        model.frame(FORCED, U, (make_dynamics_effect("roll_steer", coefficient=0.002, directed=to),))
        for to in (1.0, 0.0)
    )
    turned, side = 0.002 * accel, float(along.side[2][0] + along.side[3][0])
    drag = float(np.asarray(along.force_x - alone.force_x)[0])
    assert drag == pytest.approx(-turned * side, rel=1e-6)
    assert along.side == pytest.approx(alone.side, rel=1e-12)


def test_a_body_may_roll_by_all_of_the_lateral_acceleration() -> None:
    """m a = F + k a, solved for a: wheels that steer by c * a_y and -c_f * a_y have k = C_r c - C_f c_f,
    those that push outwards in proportion to their load are a heavier car with the same loads."""
    model, still = SingleTrack(CAR), replace(U, accel_long_mps2=np.zeros(1))
    front, rear = CAR.cornering_front_n * front_angle(), CAR.cornering_rear_n * rear_angle()
    mass, inertia = CAR.mass_kg, CAR.yaw_inertia_kgm2
    turned = make_dynamics_effect("roll_steer", coefficient=0.0006, front=0.0009, instant=1.0)
    gain_f, gain_r = -0.0009 * CAR.cornering_front_n, 0.0006 * CAR.cornering_rear_n
    across = (front + rear) / (mass - gain_f - gain_r)
    moment = CAR.front_m * (front + gain_f * across) - CAR.rear_m * (rear + gain_r * across)

    assert model.read(X, still, (turned,))["accel_lat"][0] == pytest.approx(across, rel=1e-3)
    assert model.rates(X, still, (turned,))[0, 1] == pytest.approx(moment / inertia, rel=2e-3)
    rolling = make_dynamics_effect("camber_thrust", coefficient=0.05, instant=1.0)
    heavier = make_dynamics_effect("mass_error", relative=0.05)
    one, other = (model.rates(X, still, (effect,)) for effect in (rolling, heavier))
    assert one == pytest.approx(other, rel=1e-9)
    steady = make_dynamics_effect("camber_thrust", coefficient=0.05)
    assert abs(model.rates(X, still, (steady,))[0, 0] - other[0, 0]) > 0.01
    assert rates("yaw_moment", lateral_m=0.1) == pytest.approx([0.0, 0.1 * (front + rear) / inertia])


def test_camber_thrust_is_shared_by_stiffness_and_may_spare_the_rear() -> None:
    """The car's weight is shared as C_f to C_r; upright rear wheels push with nothing."""
    push = -0.05 * 1480.0 * 22.0 * 0.15
    share = CAR.cornering_front_n / (CAR.cornering_front_n + CAR.cornering_rear_n)
    load = (CAR.rear_m * G - CAR.height_m * -1.5) / (CAR.wheelbase_m * G)
    for values, front, rear in (
        ({"by_stiffness": 1.0}, share, 1.0 - share),
        ({"rear": 0.0}, load, 0.0),
        ({"by_stiffness": 1.0, "rear": 0.0}, share, 0.0),
    ):
        moment = (CAR.front_m * front - CAR.rear_m * rear) * push
        expected = [(front + rear) * push / 1480.0, moment / 2350.0]
        assert rates("camber_thrust", coefficient=0.05, **values)[:2] == pytest.approx(expected)


def test_wheels_may_give_way_by_the_lateral_acceleration() -> None:
    """They turn by -c * a_y, and m a_y = F - C_f c a_y is solved for a_y."""
    front, rear = CAR.cornering_front_n * front_angle(), CAR.cornering_rear_n * rear_angle()
    across = (front + rear) / (1480.0 + 0.0002 * CAR.cornering_front_n)
    less = -0.0002 * CAR.cornering_front_n * across

    changed = rates("compliance_steer", coefficient=0.0002, by_accel=1.0)

    assert changed == pytest.approx([less / 1480.0, CAR.front_m * less / 2350.0], rel=2e-3)


def test_roll_lags_the_lateral_acceleration_by_a_second_order_step() -> None:
    """p settles at a_y; after a step of a_y it is 1 - exp(-D w t) (cos(w_d t) + D w / w_d sin(w_d t)) of it,
    w_d = w sqrt(1 - D^2), and the effects of roll take it for a_y."""
    frequency, damping, accel = 2.0 * math.pi * 1.5, 0.3, 4.0
    lag = make_dynamics_effect("roll_lag", delay_s=2.0 * damping / frequency, square_s2=frequency**-2)
    model, hold = SingleTrack(CAR), held(0.0, 20.0)
    steady = accel * CAR.mass_kg / CAR.cornering_front_n
    reached, rate, step = 0.0, 0.0, 0.0002
    for k in range(1, 20_001):
        u = replace(hold, steer_rad=np.array(steady))
        change = model.rates(np.array([[0.0, 0.0, reached, rate]]), u, (lag,))[0]
        assert change[2] == rate
        rate += step * change[3]  # semi-implicit
        reached += step * rate
        if k in (500, 1500, 4000):
            swing = frequency * math.sqrt(1.0 - damping**2)
            decay, angle = math.exp(-damping * frequency * k * step), swing * k * step
            closed = math.cos(angle) + damping * frequency / swing * math.sin(angle)
            assert reached == pytest.approx(accel * (1.0 - decay * closed), abs=0.01)
    assert reached == pytest.approx(accel, abs=1e-3)
    steered = make_dynamics_effect("roll_steer", coefficient=0.002)
    angles = [
        model.frame(np.array([[0.0, 0.0, 1.5, 0.0]]), hold, theta).angle for theta in ((lag, steered), (lag,))
    ]
    assert angles[0][1] - angles[1][1] == pytest.approx(0.002 * 1.5)


def test_roll_along_a_recording_lags_to_second_order() -> None:
    """Without its states p = a_y - delay * da_y/dt - square * d2a_y/dt2: of sin(w t) at the rate w."""
    time_s = np.arange(400) * 0.005
    swing = 2.0 * math.pi * 0.5
    u = make_inputs(time_s, np.zeros(400), np.full(400, 20.0))
    path = np.stack([np.zeros(400), 0.1 * np.sin(swing * time_s)], axis=1)
    steered = make_dynamics_effect("roll_steer", coefficient=0.002)
    lag = make_dynamics_effect("roll_lag", delay_s=0.07, square_s2=0.01)
    lagged, plain = (
        SingleTrack(CAR).frame(path, u, theta, ("v", "r")).angle for theta in ((steered, lag), (lag,))
    )
    sin, cos = np.sin(swing * time_s), np.cos(swing * time_s)
    expected = 0.002 * 2.0 * (sin - 0.07 * swing * cos + 0.01 * swing**2 * sin)

    assert (lagged - plain)[1][5:-5] == pytest.approx(expected[5:-5], abs=1e-5)


def test_the_rate_of_the_speed_is_the_specific_force_and_v_r() -> None:
    """Where no accelerometer is recorded, F_x / m = du/dt - v r."""
    moving = held(0.1, 20.0, -2.0)
    state = np.array([[0.5, 0.4]])

    assert float(np.asarray(ThreeDof(CAR).frame(state, moving, ()).accel_long)[0]) == -2.0
    of_speed = ThreeDof(CAR, of_speed=True).frame(state, moving, ())
    assert np.asarray(of_speed.accel_long)[0] == pytest.approx(-2.0 - 0.5 * 0.4)


def test_a_covariate_does_not_share_the_noise_of_a_reading() -> None:
    """Over its own noisy reading an output has errors that grow with it; the forces have that noise not."""
    frame = ThreeDof(CAR, forces=True).frame(FORCED, U, ())

    assert covariate_of(frame, "accel_long") == pytest.approx((500.0 - 900.0) / CAR.mass_kg)
    assert float(np.asarray(covariate_of(ThreeDof(CAR).frame(X, U, ()), "accel_long"))[0]) == -1.5
