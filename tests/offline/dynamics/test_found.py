"""What the diagnosis names on drives of an independent world, and on a real car."""

from __future__ import annotations

import gc
import math
import tempfile
import weakref
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import fdtrc, stdtr

from bench.worlds.lively_car import CarSpec, vehicle_tables
from bench.worlds.varied_cars import Case, Sensors, drives
from tests.offline.dynamics.drives import diagnosed, folder, hidden, loaded
from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.baselines.single_track import SingleTrack
from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.car.physics.dynamics_effects.time_spline import DynamicsUnknown
from tpmsd.offline.dynamics.certify import replicate
from tpmsd.offline.dynamics.columns import BlockGram, Probe, gram
from tpmsd.offline.dynamics.diagnose import diagnose_dynamics
from tpmsd.offline.dynamics.document import dynamics_document
from tpmsd.offline.dynamics.evidence import Addition, PriorColumns, Statistics
from tpmsd.offline.dynamics.findings import odds_of_neutral_values, relative_block_spread, unexplained_ratio
from tpmsd.offline.dynamics.located import _best_spans, _refine_span
from tpmsd.offline.dynamics.model_statistics import ModelStatistics, p_value_of_distance
from tpmsd.offline.dynamics.path import Setup, path_cost, smoothed
from tpmsd.offline.dynamics.result import CONSISTENT, INSUFFICIENT, MISMATCH
from tpmsd.offline.dynamics.search import Search
from tpmsd.offline.dynamics.stages import _grow, log_marginal_likelihood, prior_precision
from tpmsd.offline.dynamics.summary import summary_sentences
from tpmsd.offline.dynamics.terms import drop_points_without_rows, hat_functions, spline_term, term_of
from tpmsd.offline.signals.write import signals_text

SINGLE = {
    "mass_error": {"relative": 0.12},
    "yaw_inertia_error": {"relative": 0.2},
    "cornering_stiffness_error": {"front": -0.15, "rear": 0.1},
    "tyre_relaxation": {"length_m": 0.5},
    "steering_delay": {"delay_s": 0.04},
    "yaw_rate_scale": {"scale": 1.03},
    "accelerometer_position": {"forward_m": 0.5},
    "yaw_moment": {"coefficient": 0.06},
}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A folder for the drives."""
    return str(tmp_path_factory.mktemp("drives"))


def test_loads_that_follow_the_instant_are_no_finding(root: str) -> None:
    """Such a car is as configured: that loads wait for the steady bend is the baseline's simplification."""
    found = diagnosed(root, hidden(instant_loads={"coefficient": 1.0}), "three-dof", forces=True)

    assert found.verdict == CONSISTENT
    assert "instant_loads" in [one.effect for one in found.nuisances]


def test_axles_steer_as_a_body_rolls_that_takes_time_for_it(root: str) -> None:
    """Without the lag a softer axle, inertia and delays would be taken for it, one after the other."""
    steered = {"coefficient": 0.0008, "front": 0.0006}
    lag = {"delay_s": 0.07, "square_s2": 0.01}
    found = diagnosed(root, hidden(roll_steer=steered, roll_lag=lag))

    assert [one.effect for one in found.findings] == ["roll_steer"]
    for name, value in steered.items():
        number = found.findings[0].parameters[name]
        assert abs(number.value - value) < 2.0 * number.std + 2e-5
    (nuisance,) = (one for one in found.nuisances if one.effect == "roll_lag")
    assert nuisance.parameters["delay_s"].value == pytest.approx(0.07, abs=0.01)


def test_gusts_are_named_one_by_one(root: str) -> None:
    """Three gusts of eight seconds: a spline over time would explain all at once."""
    gusts = {"speed_mps": -8.0, "onset_s": 15.0, "duration_s": 8.0, "every_s": 30.0}
    found = diagnosed(root, hidden(side_wind=gusts), duration_s=90.0)

    assert [one.effect for one in found.findings] == ["side_wind"] * 3
    onsets = sorted(one.parameters["onset_s"].value for one in found.findings)
    assert onsets == pytest.approx([15.0, 45.0, 75.0], abs=1.5)
    for one in found.findings:
        assert abs(one.parameters["speed_mps"].value + 8.0) < 3.0 * one.parameters["speed_mps"].std


def test_a_drive_without_wind_has_no_empty_span(root: str) -> None:
    """Where no span of wind is likely the best one still has a length."""
    setup = Setup(*loaded(folder(Path(root) / "calm", duration_s=30.0), "single-track"), ("yaw_rate",))
    wind = (make_dynamics_effect("side_wind", speed_mps=1.0),)
    span = _refine_span(Search(setup), wind, (20.0, 25.0 + 1e-7), 6.0, 1e9)

    assert 17.5 <= span.onset_s <= 22.5
    assert span.duration_s >= 0.5


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("model", ["single-track", "three-dof"])
def test_a_null_drive_has_no_finding(root: str, model: str, seed: int) -> None:
    """The same equations in other code, with the sensors' noise: consistent."""
    found = diagnosed(root, (), model, 40.0, seed)

    assert found.verdict == CONSISTENT
    assert found.findings == ()


@pytest.mark.parametrize("name", sorted(SINGLE))
def test_a_concealed_effect_is_named_with_its_size(root: str, name: str) -> None:
    """Alone, surely, within four standard deviations of the truth."""
    found = diagnosed(root, hidden(**{name: SINGLE[name]}))

    assert found.verdict == MISMATCH
    assert [one.effect for one in found.findings] == [name]
    assert found.findings[0].confidence > 0.9
    for parameter, truth in SINGLE[name].items():
        got = found.findings[0].parameters[parameter]
        assert abs(got.value - truth) < 4.0 * got.std


def test_forces_make_speed_an_output_and_drag_and_mass_are_reported(root: str) -> None:
    """The 3-DOF car with given forces: the drag area is found from speed and longitudinal acceleration."""
    found = diagnosed(root, hidden(aero_drag={"drag_area_m2": 0.65}), "three-dof", 40.0, 1, True)

    assert "speed" in found.outputs
    assert [one.effect for one in found.findings] == ["aero_drag"]
    assert found.findings[0].parameters["drag_area_m2"].value == pytest.approx(0.65, abs=0.03)


def test_a_gust_is_found_with_its_span(root: str) -> None:
    """Side wind from 20 to 35 s."""
    found = diagnosed(root, hidden(side_wind={"speed_mps": 9.0, "onset_s": 20.0, "duration_s": 15.0}))

    assert [one.effect for one in found.findings] == ["side_wind"]
    (span,) = found.findings[0].where.time_spans
    assert span[0] == pytest.approx(20.0, abs=1.5)
    assert span[1] == pytest.approx(35.0, abs=1.5)
    values = found.findings[0].parameters
    for name, truth in (("speed_mps", 9.0), ("onset_s", 20.0), ("duration_s", 15.0)):
        assert abs(values[name].value - truth) < 3.5 * values[name].std


def test_a_tilted_mount_reads_as_a_bias_does(root: str) -> None:
    """Gravity along a tilted axis is a constant: whichever of the two is named lists the other."""
    found = diagnosed(root, hidden(accelerometer_bias={"lat_mps2": 0.25}))

    (finding,) = found.findings
    assert {"accelerometer_bias", "accelerometer_tilt"} == {finding.effect, *finding.indistinguishable_from}
    assert finding.confidence < 0.9


def test_a_gust_between_the_blocks_that_judge_predictions_is_found(root: str) -> None:
    """A long drive is predicted on every other block; a wind in one of the rest is no less of a finding."""
    gust = {"speed_mps": 9.0, "onset_s": 41.0, "duration_s": 8.0}
    found = diagnosed(root, hidden(side_wind=gust), duration_s=170.0)

    assert [one.effect for one in found.findings] == ["side_wind"]
    assert found.findings[0].confidence > 0.8


def test_air_of_another_density_is_no_finding(root: str) -> None:
    """Drag of a large body as configured, at 0 degrees Celsius: 7 % more force, and nothing to find."""
    dense = hidden(aero_drag={"drag_area_m2": 2.14}, instant_loads={"coefficient": 1.0})
    where = folder(Path(root) / "dense", dense, "three-dof", 40.0, 1, True)
    tables = where / "vehicle.toml"
    tables.write_text(tables.read_text(encoding="utf-8") + "drag_area_m2 = 2.0\n", encoding="utf-8")

    found = diagnose_dynamics(*loaded(where, "three-dof"))

    assert (found.verdict, found.findings) == (CONSISTENT, ())
    (density,) = [one for one in found.nuisances if one.effect == "air_density_error"]
    assert abs(density.parameters["relative"].value - 0.07) < 0.03


def test_inputs_held_over_a_step_are_no_finding(tmp_path: Path) -> None:
    """A linear car that answers its steering in steps of 10 ms is the baseline: no instrument is late."""
    rng, step, car, speed, count = np.random.default_rng(3), 0.01, CarSpec(), 20.0, 6000
    time = step * np.arange(count)
    waves = ((0.2, 0.0), (0.7, 1.0), (1.6, 2.0))
    steer = np.sum([0.012 * np.sin(2.0 * np.pi * f * time + phase) for f, phase in waves], axis=0)

    def rates(v: float, r: float, angle: float) -> tuple[float, float, float]:
        front, rear = car.cf * (angle - (v + car.a * r) / speed), -car.cr * (v - car.b * r) / speed
        pull = (front + rear) / car.m
        return pull - speed * r, (car.a * front - car.b * rear) / car.iz, pull

    v = r = 0.0
    rows = []
    for angle in steer:
        dv, dr, pull = rates(v, r, angle)
        rows.append((r + rng.normal(0.0, 0.002), pull + rng.normal(0.0, 0.03)))
        middle = rates(v + 0.5 * step * dv, r + 0.5 * step * dr, angle)
        v, r = v + step * middle[0], r + step * middle[1]
    yaw, across = np.transpose(rows)
    columns = {"time_s": time, "road_wheel_angle_rad": steer, "speed_mps": np.full(count, speed)}
    columns |= {"yaw_rate_radps": yaw, "accel_lat_mps2": across}
    (tmp_path / "signals.csv").write_text(signals_text(columns), encoding="utf-8")
    (tmp_path / "vehicle.toml").write_text(vehicle_tables(car), encoding="utf-8")

    found = diagnose_dynamics(*loaded(tmp_path, "single-track"))

    assert (found.verdict, found.findings) == (CONSISTENT, ())
    (held,) = [one for one in found.nuisances if one.effect == "held_inputs"]
    assert abs(held.parameters["step_s"].value - step) < 0.001


def test_two_effects_are_found_together(root: str) -> None:
    """A gyro's scale and a longer relaxation, both."""
    both = hidden(yaw_rate_scale={"scale": 1.04}, tyre_relaxation={"length_m": 0.6})
    found = diagnosed(root, both)

    assert {"yaw_rate_scale", "tyre_relaxation"} == {one.effect for one in found.findings}
    assert len(found.steps) == 3
    assert found.outputs["yaw_rate"].rms_after < found.outputs["yaw_rate"].rms_before


def test_what_no_effect_describes_is_located(root: str) -> None:
    """A yaw moment by the square of speed and the turn's sign has no name: located, and no name is sure."""
    found = diagnosed(root, hidden(beyond={"moment_per_speed2": -4e-4}), duration_s=100.0)

    assert found.verdict == MISMATCH
    assert "unknown" in [one.effect for one in found.findings]
    assert [] == [one.effect for one in found.findings if one.confidence > 0.9 and one.effect != "unknown"]


def test_the_odds_of_a_selection_integrate_its_priors(tmp_path: Path) -> None:
    """A spline's constant, slope and deviations have variances 1, 1 and w^2 of its size; a value of unit
    information about 0 with gradient g and prior precision p has g^2 / 2 (1 + p) - log((1 + p) / p) / 2."""
    spline = spline_term(DynamicsUnknown(knots=(-1.0, 0.0, 1.0), heights=(0.0, 0.0, 0.0)), 2.0)
    covariance = np.linalg.inv(prior_precision(spline, 0.5))
    assert covariance[0] == pytest.approx([4.0 * (1.0 + 1.0 + 0.25), 4.0, 0.0])

    baseline, _ = loaded(folder(tmp_path / "d", duration_s=10.0), "single-track")
    term = term_of(make_dynamics_effect("yaw_rate_scale", scale=1.0), baseline)
    (precision,) = term.prior()[1]
    value = 0.5 * 9.0 / (1.0 + precision) - 0.5 * math.log((1.0 + precision) / precision)
    assert log_marginal_likelihood([term], np.ones((1, 1)), np.full(1, 3.0)) == pytest.approx(value)


def test_a_selection_that_comes_round_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where each term that is added makes the one before superfluous, models would repeat for ever."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=20.0), "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat")))
    search.record_stage()
    scaled, biased = (
        term_of(make_dynamics_effect(name), baseline) for name in ("yaw_rate_scale", "yaw_rate_bias")
    )
    steps = 0

    def forward(threshold: float) -> bool:
        nonlocal steps
        steps += 1
        assert steps < 10, "the selection goes round"
        search.terms = [biased if search.terms == [scaled] else scaled]
        return True

    monkeypatch.setattr(search, "forward_step", forward)
    monkeypatch.setattr(search, "fit_until_converged", lambda: None)
    monkeypatch.setattr(search, "record_stage", lambda: None)
    _grow(search, 10.0, 10, lambda share: None)

    assert steps == 3


@dataclass(frozen=True)
class SteeredRear(DynamicsEffect):
    """Rear road-wheel angle = 0.06 times the size of the front one, to the left: no effect of the
    catalogue."""

    name = "steered_rear"

    def adapt_angles(self, frame: Frame) -> None:
        """Turn the rear axle."""
        frame.angle = frame.angle + np.stack([np.zeros_like(frame.steer), 0.06 * np.abs(frame.steer)])


def test_several_names_do_not_stand_in_for_one_cause_without_a_name(tmp_path: Path) -> None:
    """Rear wheels that turn one way in all bends are the rear axle's side force over steering: no
    stiffness, centre of gravity or ratio is named for them."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=40.0), "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat")))
    drive = replicate(search, (SteeredRear(),), np.random.default_rng(2))

    found = diagnose_dynamics(baseline, drive)

    assert [(one.effect, one.acts_on) for one in found.findings] == [("unknown", "force_rear")]
    assert found.findings[0].where.covariate in ("steering", "yaw_rate")  # alike at a usual speed
    assert "side force of the rear axle over " in " ".join(summary_sentences(found))


def test_a_model_found_before_leaves_nothing(root: str, tmp_path: Path) -> None:
    """With the effects that were found in the baseline, the same drive is consistent."""
    where = folder(tmp_path / "d", hidden(mass_error={"relative": 0.12}), duration_s=60.0)
    baseline, drive = loaded(where, "single-track")
    first = diagnose_dynamics(baseline, drive)
    again = diagnose_dynamics(baseline, drive, first.effects)

    assert [one.effect for one in first.findings] == ["mass_error"]
    assert again.verdict == CONSISTENT


def test_a_short_drive_is_not_judged(tmp_path: Path) -> None:
    """Five seconds are insufficient data."""
    found = diagnose_dynamics(*loaded(folder(tmp_path / "d", duration_s=5.0), "single-track"))

    assert found.verdict == INSUFFICIENT
    assert "8 s" in found.reason


@pytest.mark.parametrize(
    ("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")]
)
def test_times_in_another_unit_are_called_so(tmp_path: Path, factor: float, unit: str) -> None:
    """Rows too far apart are the reason, not a car that stands; where a unit makes them usual it is named."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=10.0), "single-track")
    inputs = replace(drive.inputs, time_s=factor * drive.time_s)
    found = diagnose_dynamics(baseline, replace(drive, inputs=inputs))

    assert found.verdict == INSUFFICIENT
    assert "s apart" in found.reason
    assert f"is time_s in {unit}?" in found.reason


def test_a_column_is_the_derivative_of_the_innovations_of_a_kalman_filter(tmp_path: Path) -> None:
    """Gradient and information of a parameter equal the differences of the smoother's own cost."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=20.0), "single-track")
    setup = Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat"))
    search = Search(setup)

    def cost(relative: float) -> float:
        theta = (make_dynamics_effect("yaw_inertia_error", relative=relative),)
        return path_cost(setup, smoothed(setup, theta, search.at.path, search.noise), search.noise)

    h = 0.02
    effect = make_dynamics_effect("yaw_inertia_error", relative=1e-3)
    found = gram(setup, (), search.at, search.noise, [Probe((effect,), 1e-3)])
    low, middle, high = cost(-h), cost(0.0), cost(h)

    assert found.information.sum() == pytest.approx(0.5 * (high - 2 * middle + low) / h**2, rel=0.05)
    assert found.gradient.sum() == pytest.approx(
        -0.5 * (high - low) / (2 * h), abs=0.05 * found.information.sum() * h
    )


@pytest.mark.parametrize(("delay_s", "unusual"), [(0.03, False), (-0.05, False), (0.1, True)])
def test_a_size_that_no_car_has_is_reported(tmp_path: Path, delay_s: float, unusual: bool) -> None:
    """Three prior standard deviations of a gyro's delay are 0.09 s."""
    baseline, _ = loaded(folder(tmp_path / "d", duration_s=10.0), "single-track")

    assert term_of(make_dynamics_effect("gyro_delay", delay_s=delay_s), baseline).unusual is unusual


@pytest.mark.parametrize(("delay_s", "least", "most"), [(0.03, 0.9, 1.0), (0.1, 0.4, 0.7), (0.12, 0.0, 0.2)])
def test_odds_of_a_stand_in_grow_with_the_size(
    tmp_path: Path, delay_s: float, least: float, most: float
) -> None:
    """Probability of the name by the prior of 0.03 s against Cauchy's density: 0.97, 0.54, 0.13."""
    baseline, _ = loaded(folder(tmp_path / "d", duration_s=10.0), "single-track")
    term = term_of(make_dynamics_effect("gyro_delay", delay_s=delay_s), baseline)

    assert least < 1.0 / (1.0 + np.exp(term.proxy_nats)) < most


def test_columns_that_act_in_different_blocks_are_shared(tmp_path: Path) -> None:
    """Basis functions over time give the same statistics together as each in a model of its own."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=30.0), "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat")))
    time = drive.time_s
    boxes = [np.asarray((time >= k) & (time < k + 3.0), dtype=np.float64) for k in range(0, 30, 3)]

    one = (make_dynamics_effect("side_wind", speed_mps=1.0),)
    shared = [Probe(one, 1.0, box) for box in boxes]
    apart = [Probe((make_dynamics_effect("side_wind", speed_mps=1.0),), 1.0, box) for box in boxes]
    together, single = (gram(search.setup, (), search.at, search.noise, some) for some in (shared, apart))

    assert len(together.gradient[0]) == len(boxes)
    assert together.gradient == pytest.approx(single.gradient, rel=1e-9, abs=1e-9)
    assert together.information == pytest.approx(single.information, rel=1e-9, abs=1e-9)


def test_what_was_looked_at_is_not_looked_at_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While the model stands, one set of columns serves every question, with the answers of each alone."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=30.0), "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat")))
    assert search.try_terms([term_of(make_dynamics_effect("yaw_rate_scale", scale=1.01), baseline)])
    offered, asked = search.offered(), []
    alone = search.look(offered[:5])
    monkeypatch.setattr(
        "tpmsd.offline.dynamics.search.gram", lambda *args: asked.append(len(args[4])) or gram(*args)
    )

    search.look(offered)
    few, again = search.look(offered[:5]), search.look(offered)

    assert len(asked) == 1
    assert [few.score(k) for k in range(5)] == pytest.approx([alone.score(k) for k in range(5)], rel=1e-6)
    assert few.evidence(0) == pytest.approx(alone.evidence(0), rel=1e-6)
    assert [term.key for term in again.offered] == [term.key for term in offered]

    assert search.try_terms([*search.terms])
    search.look(offered)
    assert len(asked) > 2  # the fit, and the new model


def test_what_was_left_behind_takes_no_memory(tmp_path: Path) -> None:
    """A path that is given up is freed at once, with its factor: no cycle of references waits for a
    collection."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=20.0), "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate",)))
    search.at.weighted(search.setup, search.noise)
    gc.disable()
    try:
        left = weakref.ref(search.at)
        search.at = smoothed(search.setup, (), search.at.path, search.noise)
        search.looked = None
        assert left() is None
    finally:
        gc.enable()


def test_a_long_drive_is_looked_at_in_blocks_spread_over_it(tmp_path: Path) -> None:
    """Memory and time are those of the rows that are kept; knots in the pauses between change nothing."""
    _, drive = loaded(folder(tmp_path / "d", duration_s=60.0), "single-track")
    few = drive.bounded(1000)

    assert drive.bounded(len(drive.time_s)) is drive
    assert 800 <= len(few.time_s) <= 1000
    assert len(few.starts) == pytest.approx(len(drive.starts) / 3, abs=1)
    assert few.time_s[0] < 10.0 and few.time_s[-1] > 50.0
    assert np.array_equal(few.inputs.steer_rad, drive.inputs.steer_rad[np.isin(drive.time_s, few.time_s)])
    assert f"the drive has {len(drive.time_s)} rows: {len(few.time_s)} of them" in few.notes[-1]

    knots = np.arange(0.0, 61.0, 0.5)
    kept = drop_points_without_rows(knots, few.time_s)
    assert len(kept) < len(knots)
    of_all = {
        at: hat for at, hat in zip(knots, hat_functions(few.time_s, tuple(knots)), strict=True) if hat.any()
    }
    of_kept = dict(zip(kept, hat_functions(few.time_s, tuple(kept)), strict=True))
    assert all(np.allclose(of_kept[at], hat, atol=1e-12) for at, hat in of_all.items())


def test_the_shares_of_the_real_car(recorded_dynamics: Path) -> None:
    """The Ferrari: softer tyres than configured and a limit; yaw rate and lateral acceleration held out."""
    baseline, drive = loaded(recorded_dynamics / "ferrari-250lm", "single-track")
    half = drive.part(0, len(drive.time_s) // 4)
    found = diagnose_dynamics(baseline, half)
    names = {one.effect for one in found.findings}

    assert names & {"tyre_saturation", "load_dependent_stiffness"}
    assert names & {"cornering_stiffness_error", "compliance_steer"}
    for name in ("yaw_rate", "accel_lat"):
        assert found.outputs[name].rms_after < 0.6 * found.outputs[name].rms_before
        assert found.outputs[name].rating_after > found.outputs[name].rating_before
    assert np.isfinite(found.loglik_gain_per_s)


def test_finite_angles_are_fitted_and_are_no_finding() -> None:
    """Linear tyres at finite angles against small ones: every car has them; the coefficient is near 1."""
    case = Case(11, "linear", "lively", sensors=Sensors(rate_hz=20.0))
    (made,) = drives([case], 30.0)
    root = Path(tempfile.mkdtemp())
    (root / "signals.csv").write_text(signals_text(made.columns), encoding="utf-8")
    (root / "vehicle.toml").write_text(made.vehicle, encoding="utf-8")
    baseline, drive = loaded(root, "single-track")

    found = diagnose_dynamics(baseline, drive)

    assert (found.verdict, found.findings) == (CONSISTENT, ())
    assert [one.effect for one in found.nuisances] == ["large_angles"]
    coefficient = found.nuisances[0].parameters["coefficient"]
    assert abs(coefficient.value - 1.0) < 4.0 * coefficient.std
    assert dynamics_document(found, None)["nuisances"][0]["effect"] == "large_angles"
    assert "large_angles" in " ".join(summary_sentences(found))


def test_a_finished_model_stands_still(root: str) -> None:
    """A further fit moves a delay by a small part of its standard deviation."""
    baseline, drive = loaded(
        folder(Path(root) / "late", hidden(gyro_delay={"delay_s": 0.03})), "single-track"
    )
    setup = Setup(baseline, drive, ("yaw_rate", "accel_lat", "velocity_lat"))
    search = Search(setup)
    search.terms = [t for t in search.offered() if t.name == "gyro_delay" and not t.jump]

    search.fit_until_converged()
    before = search.terms[0].values()[0]
    search.fit()

    assert abs(search.terms[0].values()[0] - before) < 5e-5
    assert before == pytest.approx(0.03, abs=1.5e-3)


def test_a_model_whose_fit_runs_away_is_left_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A matrix that a runaway fit leaves singular ends the step and not the diagnosis."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=20.0), "single-track")
    search = Search(Setup(baseline, drive, ("yaw_rate", "accel_lat")))
    before = (search.at, search.noise, search.error)
    term = term_of(make_dynamics_effect("yaw_inertia_error", relative=0.1), baseline)

    def away(rounds: int = 3) -> None:
        raise np.linalg.LinAlgError("not positive definite")

    monkeypatch.setattr(search, "fit", away)
    assert not search.try_terms([term])
    assert search.terms == [] and (search.at, search.noise, search.error) == before


def test_a_name_is_no_surer_than_the_part_of_the_error_that_it_explains() -> None:
    """Slow errors of 2 and 1 variances, of which a name takes the first: odds of 1 to the root of 2. White
    noise of any size has none that lasts."""
    rng = np.random.default_rng(4)
    time_s = 0.02 * np.arange(4000)
    noise = 3.0 * rng.standard_normal((4000, 1))
    slow, other = np.sin(0.3 * time_s)[:, None], math.sqrt(2.0) * np.sin(0.7 * time_s)[:, None]
    readings, std = noise + math.sqrt(2.0) * (slow + other), np.array([1.0])

    half = unexplained_ratio(readings, np.zeros_like(noise), math.sqrt(2.0) * other, std, time_s)
    assert half == pytest.approx(math.sqrt(0.5), rel=0.1)
    assert unexplained_ratio(readings, np.zeros_like(noise), readings - noise, std, time_s) < 0.2


def test_a_value_that_differs_between_blocks_is_no_constant_of_the_car() -> None:
    """Ten blocks, a value of 4 with a spread of 2 beside noise of one: half."""
    overdispersion = 1.0 + 2.0**2
    distance = 10.0 * 4.0**2 / overdispersion

    assert relative_block_spread(overdispersion, distance, 10) == pytest.approx(0.5)
    assert relative_block_spread(1.0, distance, 10) == 0.0


def test_without_a_term_the_others_take_its_part() -> None:
    """Columns with a correlation of one half and a minimum where both are: without one of 0.1 the other,
    which the drive tells a thousand times better than its prior, grows by half of that."""
    names, car = ("mass_error", "yaw_inertia_error"), DynamicCar(1500.0, 2500.0, 1.2, 1.5, 8e4, 8e4)
    terms = [term_of(make_dynamics_effect(name, relative=0.1), SingleTrack(car)) for name in names]
    information = 1e6 * np.array([[1.0, 0.5], [0.5, 1.0]])
    columns = [PriorColumns((k,), *term.prior()) for k, term in enumerate(terms)]
    removal = [((k,), (-0.1,)) for k in range(2)]
    look = ModelStatistics(
        Statistics(BlockGram(information[None], np.zeros((1, 2)))), terms, columns, removal, [], []
    )

    (other,) = look.refitted_others(0)

    assert other.name == "yaw_inertia_error"
    assert other.value("relative") == pytest.approx(0.15, abs=1e-3)


def test_values_at_the_default_are_no_news() -> None:
    """F over blocks: one value is Student's t, 0 has a p-value of 1. Values at the default have even odds at
    best, those two standard deviations away exp(2)."""
    assert odds_of_neutral_values(80.0, 0.0) == 1.0
    assert odds_of_neutral_values(80.0, 4.0) == pytest.approx(math.exp(-2.0))
    assert odds_of_neutral_values(3.0, 400.0) == pytest.approx(math.exp(-3.0))
    assert p_value_of_distance(0.0, 1, 15) == 1.0
    assert p_value_of_distance(2.5**2, 1, 15) == pytest.approx(2.0 * float(stdtr(14, -2.5)))
    assert p_value_of_distance(9.0, 2, 15) == pytest.approx(float(fdtrc(2, 14, 4.5)))


def test_a_banked_road_is_asked_before_delays_of_instruments(root: str) -> None:
    """Alone and in the first step; a delay, which lets readings drift, would stand in for it."""
    found = diagnosed(root, hidden(road_bank={"amplitude_rad": 0.04}), "single-track", 60.0, 1152)

    assert [one.effect for one in found.findings] == ["road_bank"]
    assert [step.effects for step in found.steps] == [(), ("road_bank",)]


def test_spans_of_a_wind_do_not_overlap() -> None:
    """Independent boxes: a gust of 8 on boxes 4 to 6 and one of 6 on 15 and 16, of which the first is the
    best, and the second once the first is taken; a span over both would count the first twice."""
    pull = np.zeros(24)
    pull[4:7], pull[15:17] = 8.0, 6.0
    columns = PriorColumns(tuple(range(24)), np.zeros(24), np.full(24, 0.01))
    addition = Addition(np.eye(24), pull, np.zeros((1, 24)), columns, pull)

    apart = _best_spans(addition, 10.0, 1.0, np.zeros(24, dtype=bool), 4)
    beside = _best_spans(addition, 10.0, 1.0, np.arange(24) // 3 == 1, 4)

    assert [(4, 7), (15, 17)] == [span[:2] for span in apart]
    # Of the boxes 3 to 5, which are taken, nothing; of 6, which is left, its own.
    assert {(15, 17), (6, 7)} == {span[:2] for span in beside}
