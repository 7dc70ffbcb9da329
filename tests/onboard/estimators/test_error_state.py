"""The process model: its Jacobian by finite differences, its noise, its prior."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.car.physics.effect import Parameter
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.calibration.joint import PRIOR as CALIBRATION_PRIOR
from tpmsd.onboard.estimators.bank.error_state import (
    BE,
    BN,
    FWD,
    GAIN,
    GYRO,
    LAT,
    LATV,
    LOAD,
    MU,
    PSI,
    SLIP,
    TRK,
    E,
    N,
    ProcessModel,
    TickMotion,
    drift_covariance,
    initial_state,
)
from tpmsd.onboard.estimators.settings import SETTINGS

NOMINAL = np.array([0.316, 0.318, 0.314, 0.315])
TRACK_M = 1.52
TICK_S = 0.1


def some_state(count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """States as they occur, and a covariance that is none of the prior's."""
    mean, cov = initial_state(count, NOMINAL)
    rng = np.random.default_rng(seed)
    mean[:, [E, N]] = 1000.0 * rng.standard_normal((count, 2))
    mean[:, PSI] = rng.uniform(-4, 4, count)
    mean[:, [BE, BN]] = rng.standard_normal((count, 2))
    mean[:, [TRK, SLIP]] += 0.01 * rng.standard_normal((count, 2))
    mean[:, LOAD] += 1e-4 * rng.standard_normal(count)
    mean[:, MU:] += 0.002 * rng.standard_normal((count, 4))
    return mean, cov


def motions() -> st.SearchStrategy[TickMotion]:
    return st.builds(
        TickMotion,
        dt_s=st.just(TICK_S),
        rear_rad=st.tuples(st.floats(0.5, 12.0), st.floats(0.97, 1.03)).map(
            lambda pair: np.array([pair[0], pair[0] * pair[1]])
        ),
        accel_long_mps2=st.floats(-2.0, 2.0),
        accel_lat_mps2=st.floats(-3.0, 3.0),
        informative=st.booleans(),
        steered_curvature=st.one_of(st.none(), st.floats(-0.15, 0.15)),
    )


def propagated(model: ProcessModel, mean: FloatArray, cov: FloatArray, motion: TickMotion) -> FloatArray:
    """The covariance after a tick; the arguments stay."""
    after = cov.copy()
    model.propagate(mean.copy(), after, motion, 1.0)
    return after


@settings(derandomize=True, deadline=None, max_examples=30)
@given(motions(), st.booleans(), st.integers(0, 1000))
def test_the_jacobian_is_the_derivative_of_the_motion(
    motion: TickMotion, driven_rear: bool, seed: int
) -> None:
    """Each state's small change moves all states as the Jacobian says, over motions and states."""
    model = ProcessModel(NOMINAL, TRACK_M, driven_rear)
    mean, prior = some_state(1, seed)
    size = mean.shape[1]
    std = np.sqrt(np.maximum(np.diag(prior[0]), 1e-4))
    std[[TRK, SLIP, LOAD]] = np.sqrt(np.diag(prior[0]))[[TRK, SLIP, LOAD]]
    std[MU:] = np.sqrt(np.diag(prior[0]))[MU:]
    nothing = np.zeros((1, size, size))
    noise = propagated(model, mean, nothing, motion)[0]
    jacobian, numeric = np.empty((size, size)), np.empty((size, size))
    for k in range(size):
        # F P F' of one state's variance alone is the outer product of the Jacobian's column.
        one = nothing.copy()
        one[0, k, k] = 1.0
        outer = propagated(model, mean, one, motion)[0] - noise
        jacobian[:, k] = outer[:, k] / math.sqrt(outer[k, k])
        step = 1e-4 * std[k]
        moved = np.repeat(mean, 2, axis=0)
        moved[:, k] += [-step, step]
        model.propagate(moved, np.zeros((2, size, size)), motion, 1.0)
        numeric[:, k] = (moved[1] - moved[0]) / (2 * step)
    off = np.abs(numeric - jacobian) * std
    effect = np.abs(numeric) * std
    distance = float(motion.rear_rad.mean() * 0.316)
    # Left out is what is second order in a tick: an unknown turn across half the way.
    assert np.all(off[[E, N]] <= 0.03 * effect[[E, N]] + 0.003 * distance)
    # The radii's effect on a steered turn is left to the noise, which is 2 % of a turn.
    slack = (
        1e-4 if motion.steered_curvature is None else 0.02 * abs(distance * motion.steered_curvature) + 1e-4
    )
    # The track's factor on the load's share of the turn is left out: a product of two errors.
    product = np.abs(mean[0, LOAD] * model.load_turn(motion)) * std[TRK] * (np.arange(size) == TRK)
    assert np.all(off[PSI] <= 0.03 * effect[PSI] + slack + product)
    assert jacobian[BE:] == pytest.approx(numeric[BE:], abs=1e-6)


def test_the_mean_moves_as_the_paper_says() -> None:
    """Eqs (6)-(7), heading at mid-step: a known way and turn move the pose by their chord."""
    model = ProcessModel(NOMINAL, TRACK_M, False)
    mean, cov = initial_state(1, NOMINAL)
    mean[:, [LAT, LATV, SLIP]] = 0.0
    mean[0, MU : MU + 2] = [0.001, -0.002]
    mean[0, PSI] = 0.5
    rear = np.array([6.0, 6.3])
    model.propagate(mean, cov, TickMotion(TICK_S, rear, 0.0, 0.0, True), 1.0)
    left, right = 6.0 * 0.317, 6.3 * 0.316
    distance, turn = (left + right) / 2, (right - left) / TRACK_M
    assert [
        distance * math.cos(0.5 + turn / 2),
        distance * math.sin(0.5 + turn / 2),
        0.5 + turn,
    ] == pytest.approx(mean[0, :3].tolist())


@pytest.mark.parametrize("turn_radps", [-0.2, 0.03, 0.1])
@pytest.mark.parametrize("coefficient_s2", [0.0, 1e-4, 1.4e-3])
def test_the_turn_of_a_leaning_car_needs_no_other_instrument(
    coefficient_s2: float, turn_radps: float
) -> None:
    """Radii of +- c * a_y, of usual cars and of one that leans 14 times as much: the wheels' turn without it
    is the car's, at once, whatever the smoothed lateral acceleration says."""
    model = ProcessModel(NOMINAL, TRACK_M, False)
    mean, _ = initial_state(1, NOMINAL)
    mean[0, LOAD] = coefficient_s2
    nominal_m, speed_mps = NOMINAL[:2], 20.0
    lean_m = coefficient_s2 * speed_mps * turn_radps
    rolled_m = speed_mps + turn_radps * TRACK_M / 2 * np.array([-1.0, 1.0])
    rear_rad = TICK_S * rolled_m / (nominal_m + lean_m * np.array([1.0, -1.0]))
    late = TickMotion(
        TICK_S, rear_rad, 0.0, 0.0, True, independent_heading_change_rad=0.0, lateral_known=False
    )

    _, turn = model.travel_and_turn(mean, late)

    assert turn_radps * TICK_S == pytest.approx(turn[0], rel=3e-3)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(
    st.floats(5.0, 100.0),
    st.floats(-0.02, 0.02),
    st.floats(0.0, 1.5e-3),
    st.floats(-0.004, 0.004),
)
def test_a_leaning_cars_radii_turn_it_by_their_share(
    wheel_radps: float, apart: float, coefficient_s2: float, offset_m: float
) -> None:
    """Heading by radii and load transfer: the covariance of one step of each is the derivative's square."""
    model = ProcessModel(NOMINAL, TRACK_M, False)
    mean, _ = initial_state(1, NOMINAL)
    mean[0, [LOAD, MU]] = coefficient_s2, offset_m
    rear_rad = wheel_radps * TICK_S * np.array([1.0, 1.0 + apart])
    free = TickMotion(TICK_S, rear_rad, 0.0, 0.0, True, lateral_known=False)
    turn = float(model.travel_and_turn(mean, free)[1][0])
    speed_mps = float(rear_rad @ NOMINAL[:2]) / (2 * TICK_S)
    motion = replace(free, accel_lat_mps2=speed_mps * turn / TICK_S)
    size = mean.shape[1]
    still = propagated(model, mean, np.zeros((1, size, size)), motion)
    for place, step in ((LOAD, 1e-8), (MU, 1e-7), (MU + 1, 1e-7)):
        one = np.zeros((1, size, size))
        one[0, place, place] = 1.0
        by_state = math.sqrt((propagated(model, mean, one, motion) - still)[0, PSI, PSI])
        moved = mean.copy()
        moved[0, place] += step
        numeric = (float(model.travel_and_turn(moved, free)[1][0]) - turn) / step
        assert abs(numeric) == pytest.approx(by_state, rel=0.01, abs=1e-3)


def test_a_covariance_stays_symmetric_where_the_pose_is_not_known() -> None:
    """Of variances of 1e7 m2 each tick's rounding leaves 1e-9 m2: both halves are rounded alike."""
    model = ProcessModel(NOMINAL, TRACK_M, False)
    mean, covariance = initial_state(20, NOMINAL)
    covariance[:, [E, N], [E, N]] = 1e7
    for k in range(100):
        turn = 0.01 * math.sin(k)
        model.propagate(
            mean, covariance, TickMotion(TICK_S, np.array([6.0, 6.0 + turn]), 0.0, 0.0, True), 1.0
        )
        mean[:, PSI] += np.linspace(0.0, 1.0, 20)

    np.testing.assert_array_equal(covariance, covariance.transpose(0, 2, 1))


def test_steering_replaces_the_wheels_turn() -> None:
    """With a steered curvature the turn is way times curvature, eq. (38c): radii no longer turn the car."""
    model = ProcessModel(NOMINAL, TRACK_M, False)
    mean, _ = initial_state(1, NOMINAL)
    mean[0, MU] = 0.01
    motion = TickMotion(TICK_S, np.array([1.0, 1.0]), 0.0, 0.0, False, steered_curvature=0.1)
    distance, turn = model.travel_and_turn(mean, motion)
    assert (0.326 + 0.318) / 2 == pytest.approx(distance[0])
    assert 0.1 * distance[0] == pytest.approx(turn[0])


def test_load_transfer_has_the_catalogues_sign() -> None:
    """In a left bend (a_y > 0) right wheels shrink by c a_y and left ones grow: way as before, too much turn
    in the wheels is taken back."""
    model = ProcessModel(NOMINAL, TRACK_M, False)
    mean, _ = initial_state(1, NOMINAL)
    rear, accel, c = np.array([6.0, 6.2]), 2.0, 1e-4
    motion = TickMotion(TICK_S, rear, 0.0, accel, True)
    mean[0, LOAD] = 0.0
    _, plain = model.travel_and_turn(mean, motion)
    mean[0, LOAD] = c
    _, loaded = model.travel_and_turn(mean, motion)
    left, right = 6.0 * (0.316 + c * accel), 6.2 * (0.318 - c * accel)
    assert (right - left) / TRACK_M == pytest.approx(float(loaded[0]), abs=1e-9)
    assert float(loaded[0]) < float(plain[0])


def test_driven_rear_wheels_turn_faster_than_they_roll() -> None:
    """omega r = v (1 + c a): under drive the way is shorter than the roll, by the slip of a driven rear axle
    alone."""
    motion = TickMotion(TICK_S, np.array([6.0, 6.0]), 1.5, 0.0, True)
    mean, _ = initial_state(1, NOMINAL)
    mean[0, SLIP] = 0.01
    roll = 6.0 * (0.316 + 0.318) / 2
    for driven, expected in ((True, roll / (1 + 0.01 * 1.5)), (False, roll)):
        distance, _ = ProcessModel(NOMINAL, TRACK_M, driven).travel_and_turn(mean, motion)
        assert expected == pytest.approx(float(distance[0]), rel=3e-4)


@settings(derandomize=True, deadline=None, max_examples=30)
@given(motions(), st.integers(0, 100))
def test_uncertainty_grows_with_the_distance(motion: TickMotion, seed: int) -> None:
    """A tick without a fix makes no variance smaller but that of the fading bias; the matrix stays a
    covariance."""
    model = ProcessModel(NOMINAL, TRACK_M, False)
    mean, cov = some_state(2, seed)
    before = cov.copy()
    for _ in range(5):
        model.propagate(mean, cov, motion, 2.0)
    own = np.diagonal(cov, axis1=1, axis2=2) - np.diagonal(before, axis1=1, axis2=2)
    assert np.all(np.delete(own, [BE, BN], axis=1) >= -1e-12)
    assert np.all(np.linalg.eigvalsh(cov) > -1e-9)


def test_the_bias_of_a_receiver_is_stationary() -> None:
    """The slow position error keeps the receiver's variance however long one drives; its mean fades."""
    model = ProcessModel(NOMINAL, TRACK_M, False)
    mean, cov = some_state(1, 1)
    mean[0, BE] = 5.0
    motion = TickMotion(TICK_S, np.array([6.0, 6.0]), 0.0, 0.0, True)
    ticks = round(SETTINGS.bias_tau_s / TICK_S)
    for _ in range(ticks):
        model.propagate(mean, cov, motion, 2.0)
    assert 5.0 / math.e == pytest.approx(mean[0, BE], rel=1e-6)
    for _ in range(10 * ticks):
        model.propagate(mean, cov, motion, 2.0)
    assert 4.0 == pytest.approx(cov[0, BE, BE], rel=1e-3)
    assert 4.0 == pytest.approx(cov[0, BN, BN], rel=1e-3)


def test_radii_wander_together_more_than_alone() -> None:
    """The growth of the radii's covariance is a covariance, largest for all wheels together."""
    drift = drift_covariance(4)
    assert np.all(np.linalg.eigvalsh(drift) > 0.0)
    together, axle, side = np.ones(4), np.array([1.0, 1, -1, -1]), np.array([1.0, -1, 1, -1])
    grown = [float(v @ drift @ v) / 4 for v in (together, axle, side)]
    assert grown[0] > grown[1] > grown[2]
    assert SETTINGS.drift_own_m**2 == pytest.approx(grown[2])
    assert drift_covariance(2) == pytest.approx(
        np.eye(2) * SETTINGS.drift_own_m**2 + SETTINGS.drift_common_m**2 * np.ones((2, 2))
    )


@pytest.mark.parametrize("wheels", [2, 4])
def test_the_prior_lets_a_nominal_radius_be_wrong(wheels: int) -> None:
    """A per cent per wheel, mostly common; each particle begins alike."""
    mean, cov = initial_state(3, NOMINAL[:wheels])
    radii = cov[0, MU:, MU:]
    assert (0.01 * NOMINAL[:wheels]) ** 2 == pytest.approx(np.diag(radii))
    assert 0.75 == pytest.approx(radii[0, 1] / math.sqrt(radii[0, 0] * radii[1, 1]))
    assert np.array_equal(cov[0], cov[2])
    assert np.array_equal(mean[0], mean[2])
    assert 0.0 == mean[0, FWD]


EFFECT_OF = {
    LAT: ("gnss_latency", "latency_s"),
    LATV: ("velocity_lag", "lag_s"),
    FWD: ("antenna_lever_arm", "forward_m"),
    GYRO: ("yaw_rate_bias", "bias"),
    GAIN: ("yaw_rate_scale", "scale"),
    SLIP: ("longitudinal_slip", "slip_per_accel"),
    LOAD: ("load_transfer_lateral", "coefficient"),
}


@pytest.mark.parametrize("place", sorted(EFFECT_OF))
def test_filter_and_effect_have_one_prior(place: int) -> None:
    """Each state that stands for an effect starts from that effect's prior, and so does the calibration."""
    effect, name = EFFECT_OF[place]
    parameter = next(one for one in EFFECTS[effect].parameters if one.name == name)
    assert isinstance(parameter, Parameter) and parameter.prior is not None
    expected = (parameter.prior.mean - parameter.neutral, parameter.prior.std)
    mean, covariance = initial_state(1, NOMINAL)

    assert (mean[0, place], math.sqrt(covariance[0, place, place])) == pytest.approx(expected)
    for known, what, _ in EFFECTS[effect].in_calibration:
        if what == name:
            assert CALIBRATION_PRIOR[known] == pytest.approx(expected)
