"""The baselines against closed forms, an independent world and each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.worlds.lively_car import CarSpec, Concealed, drive
from tpmsd.car.physics.baselines.base import MIN_MPS, Baseline, Theta
from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.exponential import MAX_DECAY, exponential_step
from tpmsd.car.physics.baselines.inputs import Inputs, Span, make_inputs
from tpmsd.car.physics.baselines.names import DYNAMICS_BASELINES
from tpmsd.car.physics.baselines.single_track import SingleTrack
from tpmsd.car.physics.baselines.table import BASELINES
from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.drive import DynamicsDrive
from tpmsd.offline.dynamics.simulate import simulated_outputs

CAR = DynamicCar(1480.0, 2350.0, 1.18, 1.46, 105_000.0, 128_000.0, 0.54, 1.53, 1.51, 85_000.0)


def held(steer_rad: float, speed_mps: float, accel_mps2: float = 0.0, rows: int = 1) -> Inputs:
    """Return constant inputs."""
    time = np.arange(rows) * 0.02
    ones = np.ones(rows)
    return make_inputs(time, steer_rad * ones, speed_mps * ones, accel_mps2 * ones)


def settled(baseline: Baseline, u: Inputs, theta: tuple[object, ...] = ()) -> FloatArray:
    """Return the state after ten seconds."""
    x = np.zeros((1, 2))
    for _ in range(500):
        x = baseline.step(x, u, theta, 0.02)  # type: ignore[arg-type]
    return x


@pytest.mark.parametrize("speed", [8.0, 20.0, 35.0])
def test_a_steady_bend_has_the_yaw_gain_of_the_closed_form(speed: float) -> None:
    """r / delta = u / (l + K u^2) with K = m / l (b / C_f - a / C_r), and a_y = u r."""
    base = CAR.wheelbase_m
    gradient = CAR.mass_kg / base * (CAR.rear_m / CAR.cornering_front_n - CAR.front_m / CAR.cornering_rear_n)
    model = SingleTrack(CAR)
    x = settled(model, held(0.01, speed))
    read = model.read(x, held(0.01, speed), ())

    assert x[0, 1] == pytest.approx(0.01 * speed / (base + gradient * speed**2), rel=1e-6)
    assert read["accel_lat"][0] == pytest.approx(speed * x[0, 1], rel=1e-6)


def test_the_four_wheels_are_the_linear_car_where_nothing_slides() -> None:
    """A thousandth of a radian: the 3-DOF car turns as the single-track car to half a per cent."""
    states = [settled(kind(CAR), held(0.001, 20.0)) for kind in BASELINES.values()]

    assert states[1] == pytest.approx(states[0], rel=5e-3)


@pytest.mark.parametrize("name", list(BASELINES))
def test_leading_axes_broadcast_over_time_and_parameters(name: str) -> None:
    """One call for all rows, and one for all values of a parameter, give what single calls give."""
    model = BASELINES[name](CAR)
    rng = np.random.default_rng(3)
    x = rng.normal(0.0, [0.3, 0.1], (5, 2))
    u = make_inputs(np.arange(5) * 0.02, rng.normal(0.0, 0.02, 5), np.linspace(8.0, 30.0, 5))
    together = model.step(x, u, (), 0.02)
    alone = [model.step(x[k], u.take(np.array(k)), (), 0.02) for k in range(5)]  # type: ignore[arg-type]
    values = np.array([[-0.1], [0.0], [0.2]])
    many = model.step(x, u, (make_dynamics_effect("yaw_inertia_error", relative=values),), 0.02)
    one = model.step(x, u, (make_dynamics_effect("yaw_inertia_error", relative=0.2),), 0.02)

    assert together == pytest.approx(np.array(alone), rel=1e-4, abs=1e-7)
    assert many.shape == (3, 5, 2)
    assert many[2] == pytest.approx(one, rel=1e-12)


def test_a_span_changes_linearly() -> None:
    """The inputs at half of a step are the mean of its ends."""
    u = make_inputs(np.array([0.0, 0.02]), np.array([0.0, 0.1]), np.array([10.0, 11.0]))
    middle = Span(u.take(slice(0, 1)), u.take(slice(1, 2))).at(0.5)

    assert middle.steer_rad[0] == pytest.approx(0.05)
    assert middle.speed_mps[0] == pytest.approx(10.5)


@pytest.mark.parametrize("name", list(BASELINES))
def test_a_run_on_the_inputs_alone_is_the_independent_world(name: str) -> None:
    """What is left of yaw rate and lateral acceleration in half a minute is the noise of the sensors."""
    spec = CarSpec()
    made = drive(spec, Concealed(), np.random.default_rng(5), name, 30.0)
    columns = made.columns
    car = DynamicCar(
        spec.m, spec.iz, spec.a, spec.b, spec.cf, spec.cr, spec.h, spec.tf, spec.tr, spec.cx, spec.mu, 1.0
    )
    steer = columns["steering_wheel_angle_rad"] / spec.ratio
    inputs = make_inputs(columns["time_s"], steer, columns["speed_mps"], columns["accel_long_mps2"])
    outputs = {"yaw_rate": columns["yaw_rate_radps"]}
    out = simulated_outputs(BASELINES[name](car), DynamicsDrive("w", inputs, outputs))
    yaw, lat = columns["yaw_rate_radps"], columns["accel_lat_mps2"]

    assert np.std(out["yaw_rate"] - yaw) == pytest.approx(0.002, rel=0.1)  # the sensor's noise
    assert np.std(out["accel_lat"] - lat) == pytest.approx(0.05, rel=0.1)
    assert np.std(yaw) > 0.05


def test_a_car_at_walking_pace_is_not_singular() -> None:
    """Below the least speed slip angles are those of the least speed: rates stay finite."""
    model = SingleTrack(CAR)
    rates = model.rates(np.array([[0.0, 0.0]]), held(0.1, 0.0), ())

    assert np.all(np.isfinite(rates))
    assert model.rates(np.array([[0.0, 0.0]]), held(0.1, MIN_MPS), ()) == pytest.approx(rates)


@pytest.mark.parametrize("length_m", [0.05, 0.3, 1.5])
def test_slip_angles_that_follow_at_once_need_no_short_steps(
    length_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step of 20 ms at 60 m/s, lags of 1 to 25 ms: from states that follow nothing yet it is that of a
    hundred steps to a fortieth of the change."""
    asked: list[float] = []
    original = SingleTrack.rates

    def counted(self: SingleTrack, x: FloatArray, u: Inputs, theta: Theta) -> FloatArray:
        asked.append(1.0)
        return original(self, x, u, theta)

    model = SingleTrack(CAR)
    slip = make_dynamics_effect("tyre_relaxation", length_m=length_m)
    theta = (slip, make_dynamics_effect("tyre_saturation", friction=0.9))
    start, end = held(0.02, 60.0), held(0.03, 59.5)
    x = np.array([[0.3, 0.1, 0.01, 0.004]])
    fine = x
    for k in range(100):
        span = (Span(start, end).at(k / 100.0), Span(start, end).at((k + 1) / 100.0))
        fine = model.step(fine, Span(*span), theta, 0.0002)
    monkeypatch.setattr(SingleTrack, "rates", counted)

    found = model.step(x, Span(start, end), theta, 0.02)

    assert found - x == pytest.approx(fine - x, rel=2.5e-2, abs=1e-6)
    assert len(asked) <= 4 * max(math.ceil(60.0 * 0.02 / length_m / MAX_DECAY), 1)


def test_a_decay_alone_is_exact() -> None:
    """x' = -k x, and x' = -k (x - t), from small constants to large ones."""
    constants = np.array([1e-6, 0.3, 0.999, 1.001, 40.0])
    for driven in (0.0, 1.0):

        def rates(at: FloatArray, fraction: float, driven: float = driven) -> FloatArray:
            return -constants[:, None] * (at - driven * fraction)

        x = np.full((5, 1), 2.0)
        found = exponential_step(x, rates(x, 0.0), rates, np.ones((5, 1)), {0: constants})[:, 0]

        power = np.exp(-constants)
        lag = driven * (constants + np.expm1(-constants)) / constants
        assert found == pytest.approx(2.0 * power + lag, rel=1e-9)


@pytest.mark.parametrize("delay_s", [0.05, 0.15, -0.15])
def test_what_tyres_have_forgotten_does_not_show_in_a_delayed_reading(delay_s: float) -> None:
    """At 50 m/s a relaxation of 0.3 m forgets in 6 ms; over 0.15 s back an error would grow by e^25.

    The reading is that of the earlier path to 1 %, and 1e-6 rad of a relaxed angle do not move it by 1e-4.
    """
    model = SingleTrack(CAR)
    time = np.arange(0.0, 6.0, 0.01)
    u = make_inputs(time, 0.02 * np.sin(2.0 * time), np.full(len(time), 50.0))
    relaxed = make_dynamics_effect("tyre_relaxation", length_m=0.3)
    path = [np.zeros(4)]
    for k in range(len(time) - 1):
        span = Span(u.take(slice(k, k + 1)), u.take(slice(k + 1, k + 2)))
        path.append(model.step(path[-1][None], span, (relaxed,), 0.01)[0])
    x = np.array(path)
    theta = (relaxed, make_dynamics_effect("gyro_delay", delay_s=delay_s))

    read = model.read(x, u, theta)["yaw_rate"]
    moved = model.read(x + np.array([0.0, 0.0, 1e-6, 0.0]), u, theta)["yaw_rate"]

    inside = slice(100, -100)
    wanted = np.interp(time - delay_s, time, x[:, 1])
    assert np.max(np.abs(read - wanted)[inside]) < 0.01 * np.max(np.abs(wanted))
    assert np.max(np.abs(moved - read)) < 1e-4


@pytest.mark.parametrize("delay_s", [0.03, 0.09, -0.05])
def test_a_delayed_reading_is_the_earlier_one(delay_s: float) -> None:
    """Against the undelayed reading of the same run at a tenth of the step, interpolated: to 0.6 %."""
    readings = []
    for step in (0.02, 0.002):
        time = np.arange(0.0, 6.0, step)
        steer = 0.03 * np.sin(2.0 * np.pi * 0.9 * time) + 0.01 * np.sin(2.0 * np.pi * 2.3 * time)
        inputs = make_inputs(time, steer, np.full(len(time), 22.0), np.zeros(len(time)))
        empty = {"yaw_rate": np.zeros(len(time)), "accel_lat": np.zeros(len(time))}
        drive = DynamicsDrive("made", inputs, empty)
        effects = [
            make_dynamics_effect(name, delay_s=delay_s) for name in ("gyro_delay", "accelerometer_delay")
        ]
        readings.append((time, simulated_outputs(SingleTrack(CAR), drive, effects if step == 0.02 else ())))
    (time, late), (fine, plain) = readings
    inner = (time > 1.0) & (time < 5.0)

    for name in ("yaw_rate", "accel_lat"):
        wanted = np.interp(time - delay_s, fine, plain[name])
        apart = np.abs(late[name] - wanted)[inner]
        assert apart.max() < 0.006 * np.abs(wanted).max()


def test_the_names_on_the_command_line_are_those_of_the_table() -> None:
    """The names, which are known before the models are loaded, are the models' own, in their order."""
    assert tuple(BASELINES) == DYNAMICS_BASELINES
