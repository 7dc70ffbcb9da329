"""Measurement models: each row is the derivative of its prediction, over states and moments."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank import measurements
from tpmsd.onboard.estimators.bank.error_state import (
    BE,
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
    initial_state,
)
from tpmsd.onboard.estimators.bank.measurements import Present
from tpmsd.onboard.estimators.odometry_block import Block, BlockBuilder
from tpmsd.onboard.estimators.published.gnss_likelihood import block_measurements
from tpmsd.onboard.timeline.tick import Fix, Tick

NOMINAL = np.full(4, 0.316)
TRACK_M = 1.52
QUIET = settings(derandomize=True, deadline=None, max_examples=40)
START_S = 1000.0


def some_state(seed: int) -> tuple[FloatArray, FloatArray]:
    """(1, n) mean as it occurs, and the prior's standard deviations (n,)."""
    mean, cov = initial_state(1, NOMINAL)
    std = np.sqrt(np.diag(cov[0]))
    rng = np.random.default_rng(seed)
    mean[0, LAT:] += 0.5 * std[LAT:] * rng.standard_normal(std.size - LAT)
    mean[0, [E, N]] = 100.0 * rng.standard_normal(2)
    mean[0, PSI] = rng.uniform(-3, 3)
    std[:LAT] = [1.0, 1.0, 0.1, 1.0, 1.0]
    return mean, std


def derivative(innovation: Callable[[FloatArray], float], mean: FloatArray, std: FloatArray) -> FloatArray:
    """Of the prediction (minus that of the innovation) by each state."""
    out = np.empty(std.size)
    for k in range(std.size):
        up, down = mean.copy(), mean.copy()
        up[0, k] += 1e-4 * std[k]
        down[0, k] -= 1e-4 * std[k]
        out[k] = (innovation(down) - innovation(up)) / (2e-4 * std[k])
    return out


def moment(fraction: float = 0.4) -> tuple[Fix, Tick]:
    fix = Fix(START_S, fraction, 3.0, -4.0, 1.5, speed_mps=20.0, heading_rad=0.7)
    return fix, Tick(1, START_S + 0.06, 0.1, np.full(4, 6.0), np.full(4, 0.05), (fix,))


PRESENT = st.builds(
    Present,
    speed_mps=st.floats(6.0, 40.0),
    yaw_rate_radps=st.floats(-0.3, 0.3),
    antenna_forward_m=st.floats(-1.0, 3.0),
    antenna_left_m=st.floats(-1.0, 1.0),
)


@QUIET
@given(PRESENT, st.floats(0.0, 1.0), st.integers(0, 10_000))
def test_rows_of_the_antennas_position(now: Present, fraction: float, seed: int) -> None:
    """East and north of the antenna, derived by every state."""
    mean, std = some_state(seed)
    fix, tick = moment(fraction)
    *_, east_row, north_row = measurements.antenna_position(mean, fix, tick, now)
    for place, row in ((0, east_row), (1, north_row)):

        def off(at: FloatArray, place: int = place) -> float:
            return -float(measurements.antenna_position(at, fix, tick, now)[place][0])

        assert derivative(off, mean, std) == pytest.approx(row[0], rel=1e-4, abs=1e-4)


def test_the_antenna_is_where_it_was() -> None:
    """At the tick's end the antenna is at its arms; earlier in it, and the older the fix, further back."""
    mean, _ = initial_state(1, NOMINAL)
    mean[0, [LAT, FWD]] = 0.0
    mean[0, [E, N, PSI]] = [10.0, 20.0, math.pi / 2]
    now = Present(20.0, 0.0, 1.5, 0.5)
    east, north, _, _ = measurements.antenna_position(mean, *moment(1.0), now)
    assert (9.5, 21.5) == pytest.approx((float(east[0]), float(north[0])))
    mean[0, LAT] = 0.1
    east, north, _, _ = measurements.antenna_position(mean, *moment(0.5), now)
    assert (9.5, 21.5 - 20.0 * 0.15) == pytest.approx((float(east[0]), float(north[0])))


@QUIET
@given(PRESENT, st.floats(0.0, 1.0), st.integers(0, 10_000))
def test_row_of_the_course(now: Present, fraction: float, seed: int) -> None:
    """The course, derived by every state, within what is second order in the swing of the antenna."""
    mean, std = some_state(seed)
    fix, tick = moment(fraction)
    scalar = measurements.course(mean, fix, tick, now, 0.01, 0.2)

    def off(at: FloatArray) -> float:
        return float(measurements.course(at, fix, tick, now, 0.01, 0.2).innovation[0])

    numeric = derivative(off, mean, std)
    assert np.all(np.abs(numeric - scalar.row) * std <= 0.02 * np.abs(numeric) * std + 2e-4)
    assert -math.pi <= scalar.innovation[0] < math.pi
    assert scalar.variance > 0.01**2


def test_the_course_of_an_antenna_ahead_of_the_axle() -> None:
    """In a left turn an antenna 2 m ahead moves left of the heading by yaw rate times arm over speed."""
    mean, _ = initial_state(1, NOMINAL)
    mean[0, [LAT, LATV, FWD]] = 0.0
    mean[0, PSI] = 0.2
    now = Present(20.0, 0.2, 2.0, 0.0)
    fix, tick = moment(1.0)
    scalar = measurements.course(mean, fix, tick, now, 0.0, 1.0)
    assert fix.heading_rad - (0.2 + math.atan(0.2 * 2.0 / 20.0)) == pytest.approx(scalar.innovation[0])


def block(seed: int, radii: FloatArray, accel: float = 0.8) -> Block:
    """A second of a bend, with Doppler speeds and a gyro."""
    rng = np.random.default_rng(seed)
    builder = BlockBuilder([2, 3, 0, 1], NOMINAL, WheelPositions(1.5, TRACK_M, 2.63))
    made = None
    for k in range(1, 13):
        time_s = START_S + 0.1 * k
        rotation = 6.0 + 0.02 * k + np.array([-0.04, 0.04, -0.03, 0.05]) + 0.01 * rng.standard_normal(4)
        fix = Fix(time_s - 0.03, 0.7, 0.0, 0.0, 1.0, speed_mps=19.0 + 0.8 * 0.1 * k)
        tick = Tick(k, time_s, 0.1, rotation, np.full(4, 0.05), (fix,), yaw_rate_radps=0.15)
        builder.add_fix(fix, tick)
        made = builder.add(tick, True, radii, accel) or made
    assert made is not None
    return made


def check(scalar_of: Callable[[FloatArray], measurements.Scalar], seed: int, slack: float) -> None:
    """The row against the derivative; what is left out is a small share, or small beside the noise."""
    mean, std = some_state(seed)
    scalar = scalar_of(mean)
    numeric = derivative(lambda at: float(scalar_of(at).innovation[0]), mean, std)
    allowed = 0.03 * np.abs(numeric) * std + slack * math.sqrt(scalar.variance)
    assert np.all(np.abs(numeric - scalar.row) * std <= allowed)


@QUIET
@given(st.integers(0, 10_000), st.booleans(), st.floats(-1.0, 1.0), st.floats(0.97, 1.0))
def test_row_of_the_distance_by_doppler(seed: int, driven: bool, left_m: float, horizontal: float) -> None:
    """The way by Doppler, derived by radii, lags and slip."""
    made = block(seed, np.zeros(4))
    check(lambda at: measurements.doppler_distance(at, made, NOMINAL, left_m, horizontal, driven), seed, 0.02)


@QUIET
@given(st.integers(0, 10_000), st.sampled_from([-1.0, 0.0, 1.0]), st.sampled_from([2, 3]))
def test_row_of_a_front_wheel(seed: int, driven: float, place: int) -> None:
    """A front wheel's path against the rear pair's hub path, derived by radii, track and slip."""
    made = block(seed, np.zeros(4))
    front = made.front[place - 2]
    assert front is not None
    check(lambda at: measurements.front_wheel(at, made, front, place, driven, 0.14), seed, 0.02)


@QUIET
@given(st.integers(0, 10_000))
def test_row_of_the_gyro(seed: int) -> None:
    """The gyro's turn, derived by radii, track, load, bias and gain."""
    made = block(seed, np.zeros(4))
    check(lambda at: measurements.gyro_turn(at, made, TRACK_M, 0.14), seed, 0.02)


def test_perfect_instruments_leave_no_innovation() -> None:
    """With true radii in the state and in the block, straight on: way, gyro and front wheels all agree."""
    mean, _ = initial_state(1, NOMINAL)
    mean[0, LAT:MU] = 0.0
    true = np.array([0.002, 0.002, -0.001, 0.003])
    mean[0, MU:] = true
    builder = BlockBuilder([2, 3, 0, 1], NOMINAL, WheelPositions(TRACK_M, TRACK_M, 2.63))
    made = None
    for k in range(1, 13):
        time_s = START_S + 0.1 * k
        rotation = np.full(4, math.nan)
        rotation[[2, 3, 0, 1]] = 2.0 / (NOMINAL + true)
        fix = Fix(time_s - 0.03, 0.7, 0.0, 0.0, 1.0, speed_mps=20.0)
        tick = Tick(k, time_s, 0.1, rotation, np.full(4, 0.05), (fix,), yaw_rate_radps=0.0)
        builder.add_fix(fix, tick)
        # The block need not be formed at the true radii: the row carries it there.
        made = builder.add(tick, True, np.array([0.0, 0.001, 0.0, 0.001]), 0.0) or made
    assert made is not None
    scalars = [
        measurements.doppler_distance(mean, made, NOMINAL, 0.0, 1.0, False),
        measurements.gyro_turn(mean, made, TRACK_M, 0.0),
    ]
    for place, front in enumerate(made.front, start=2):
        assert front is not None
        scalars.append(measurements.front_wheel(mean, made, front, place, 1.0, 0.0))
    for scalar in scalars:
        assert 0.0 == pytest.approx(float(scalar.innovation[0]), abs=5e-4)  # second order of the hub


def test_a_wrong_track_shows_in_bends_alone() -> None:
    """TRK acts on the turn: rows of gyro and front wheels by the track are proportional to it, and to the
    independent turn, not to what these wheels read."""
    mean, _ = initial_state(1, NOMINAL)
    made = block(1, np.zeros(4))
    row = measurements.gyro_turn(mean, made, TRACK_M, 0.14).row
    assert (0.14, 0.14) == (row[TRK], row[GAIN])
    left, right = made.front
    assert left is not None
    assert right is not None
    rows = [
        measurements.front_wheel(mean, made, front, place, 0.0, 0.14).row[TRK]
        for place, front in ((2, left), (3, right))
    ]
    assert [-0.14 * 1.5 / 2, 0.14 * 1.5 / 2] == pytest.approx(rows)
    assert (0.0, 0.0, 0.0) == (row[E], row[BE], row[SLIP])
    assert row[LOAD] * made.heading_change_rad < 0.0


def test_the_gyro_of_a_standing_car_tells_its_bias_alone() -> None:
    """Nothing has turned: radii, track and load are in no row, and nothing is divided by the distance."""
    mean, _ = initial_state(1, NOMINAL)
    stood = replace(block(1, np.zeros(4)), angle_rad=np.zeros(4), distance_m=0.0, heading_change_rad=0.0)
    row = measurements.gyro_turn(mean, stood, TRACK_M, 0.0).row
    assert {GYRO: stood.duration_s} == {k: value for k, value in enumerate(row) if value != 0.0}


def take(mean: FloatArray, spread: FloatArray, scalar: measurements.Scalar) -> None:
    """Kalman's update of mean (1, n) and covariance (n, n), in place."""
    across = spread @ scalar.row
    gain = across / (scalar.row @ across + scalar.variance)
    mean[0] += gain * scalar.innovation[0]
    spread -= np.outer(gain, across)


def test_reading_errors_move_no_common_radius() -> None:
    """Twenty minutes straight on without a fix, wheels read within 0.05 rad and a gyro of the usual noise:
    nothing tells how large all wheels are, so their level stays within its prior's standard deviation, which
    does not shrink. With the rotations that were read in the rows it goes 36 mm away."""
    rng = np.random.default_rng(4)
    mean, covariance = initial_state(1, NOMINAL)
    mean[0, LAT:MU], spread = 0.0, covariance[0]
    prior_m = math.sqrt(spread[MU:, MU:].mean())
    builder = BlockBuilder([2, 3, 0, 1], NOMINAL, WheelPositions(1.5, TRACK_M, 2.63))
    reading = 0.05 * rng.standard_normal((12_001, 4))
    for k in range(1, 12_001):
        rotation = 2.0 / NOMINAL + reading[k] - reading[k - 1]  # what one tick lacks the next one has
        yaw_rate = 0.006 * rng.standard_normal()
        tick = Tick(k, START_S + 0.1 * k, 0.1, rotation, np.full(4, 0.07), yaw_rate_radps=yaw_rate)
        made = builder.add(tick, True, mean[0, MU:], 0.0)
        if made is None:
            continue
        turn = made.gyro_heading_change_rad
        take(mean, spread, measurements.gyro_turn(mean, made, TRACK_M, turn))
        for place, front in enumerate(made.front, start=2):
            assert front is not None
            take(mean, spread, measurements.front_wheel(mean, made, front, place, 0.0, turn))
    assert abs(mean[0, MU:].mean()) < prior_m
    assert math.sqrt(spread[MU:, MU:].mean()) > 0.9 * prior_m


def test_reading_errors_move_no_common_radius_of_the_published_filters() -> None:
    """The same half an hour for the rear pair by Kalman's update alone, as the augmented filters do it: with
    the rotations that were read in the rows both radii go 28 mm down."""
    rng = np.random.default_rng(5)
    nominal = NOMINAL[:2]
    prior_m = 0.01 * math.sqrt(nominal @ nominal / 4.0)
    mean, spread = np.zeros(2), np.diag((0.01 * nominal) ** 2)
    reading = 0.05 * rng.standard_normal((1801, 2))
    shape = block(1, np.zeros(4))
    for k in range(1800):
        angle = 20.0 / nominal + reading[k + 1] - reading[k]
        gyro = 0.002 * rng.standard_normal()
        made = replace(
            shape,
            angle_rad=angle,
            doppler_distance_m=math.nan,
            gyro_heading_change_rad=gyro,
            reading_heading_change_rad=0.05 * math.hypot(*nominal) * math.sqrt(2.0) / TRACK_M,
        )
        (seen,) = block_measurements(made, 0.0, nominal, TRACK_M)
        across = spread @ seen.by_radius
        gain = across / (seen.by_radius @ across + seen.variance)
        mean += gain * (seen.residual - seen.by_radius @ mean)
        spread -= np.outer(gain, across)
    assert abs(mean.mean()) < 0.5 * prior_m


def test_what_both_radii_scaled_alike_change_by_a_gyro() -> None:
    """The turn of the rear wheels, by that share of the turn that the gyro tells; nothing of a standing
    car."""
    nominal = NOMINAL[:2]
    made = replace(block(1, np.zeros(4)), doppler_distance_m=math.nan, gyro_heading_change_rad=0.14)
    (seen,) = block_measurements(made, 0.0, nominal, TRACK_M)
    assert 0.14 == pytest.approx(seen.by_radius @ nominal)
    (stood,) = block_measurements(replace(made, angle_rad=np.zeros(4)), 0.0, nominal, TRACK_M)
    assert [0.0, 0.0] == stood.by_radius.tolist()


def test_what_all_radii_scaled_alike_change() -> None:
    """All radii larger by a share: the turn of the rear wheels by that share of the independent turn, the
    front wheels' paths against the rear pair's not at all."""
    mean, _ = initial_state(1, NOMINAL)
    made = block(1, np.zeros(4))
    assert 0.14 == pytest.approx(measurements.gyro_turn(mean, made, TRACK_M, 0.14).row[MU:] @ NOMINAL)
    for place, front in enumerate(made.front, start=2):
        assert front is not None
        row = measurements.front_wheel(mean, made, front, place, 0.0, 0.14).row
        assert 0.0 == pytest.approx(row[MU:] @ NOMINAL, abs=1e-12)
