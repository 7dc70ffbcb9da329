"""The bank's arithmetic: compiled code and NumPy arrays give the same."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.estimators.test_error_state import NOMINAL, TRACK_M
from tpmsd.car.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.onboard.estimators.bank import measurements
from tpmsd.onboard.estimators.bank.batched_kalman import Weights, square_weights
from tpmsd.onboard.estimators.bank.error_state import GYRO, PSI, SLIP, ProcessModel, TickMotion, side_by_side
from tpmsd.onboard.estimators.bank.jump_hypotheses import JUMPS, Bank
from tpmsd.onboard.estimators.bank.kernel import (
    ArrayKernel,
    BankKernel,
    CompiledKernel,
    HalfKernel,
    compiled,
)
from tpmsd.onboard.estimators.bank.marginal import MarginalPieces
from tpmsd.onboard.estimators.bank.mixture import MixturePieces
from tpmsd.onboard.estimators.build import build_filter
from tpmsd.onboard.estimators.gates.fix_gate import igg3_weights
from tpmsd.onboard.estimators.table import TABLE
from tpmsd.onboard.timeline.tick import Fix, Tick

ARRAYS = ArrayKernel()
SAME = 1e-11
"""Relative: both round alike but for the order of sums."""


@pytest.fixture
def fast() -> BankKernel:
    """The compiled kernel."""
    if compiled is None:
        pytest.skip("the compiled kernel is not built here (no compiler, or no headers of Python)")
    return CompiledKernel(compiled)


@pytest.fixture
def half() -> HalfKernel:
    """The compiled kernel that keeps one triangle of the covariances."""
    if compiled is None:
        pytest.skip("the compiled kernel is not built here (no compiler, or no headers of Python)")
    return HalfKernel(compiled)


def some_bank(count: int, wheels: int, seed: int) -> Bank:
    """Hypotheses as they occur, each with a covariance of its own."""
    rng = np.random.default_rng(seed)
    bank = JUMPS.begin(count, NOMINAL[:wheels])
    size = bank.mean.shape[1]
    scale = np.sqrt(np.maximum(np.diag(bank.covariance[0]), 1e-4))
    for place in range(count):
        root = rng.standard_normal((size, size)) * scale[:, None]
        bank.covariance[place] += root @ root.T
    bank.mean += rng.standard_normal((count, size)) * scale
    bank.log_weights[:] = rng.uniform(-20.0, 0.0, count)
    bank.noise_factor[:] = rng.uniform(0.5, 2.0, count)
    return bank


def copied(bank: Bank) -> Bank:
    """One that shares nothing with it and lies in memory as it does."""
    mean, covariance = side_by_side(*bank.mean.shape), side_by_side(*bank.covariance.shape)
    mean[:], covariance[:] = bank.mean, bank.covariance
    other = replace(bank, mean=mean, covariance=covariance, log_weights=bank.log_weights.copy())
    other.noise_factor[:] = bank.noise_factor
    return other


def assert_alike(one: Bank, other: Bank) -> None:
    """Equal but for rounding, each number against the spread of its place."""
    scale = np.sqrt(np.einsum("ijj->ij", one.covariance))
    assert np.all(np.abs(one.mean - other.mean) <= SAME * (np.abs(one.mean) + scale))
    assert np.all(np.abs(one.covariance - other.covariance) <= SAME * scale[:, :, None] * scale[:, None, :])
    np.testing.assert_allclose(one.log_weights, other.log_weights, rtol=SAME, atol=SAME)


@pytest.mark.parametrize("count", [1, 40, 100])
@pytest.mark.parametrize("wheels", [2, 4])
@pytest.mark.parametrize("driven_rear", [False, True])
def test_a_tick_moves_the_bank_equally(fast: BankKernel, count: int, wheels: int, driven_rear: bool) -> None:
    """Both kernels propagate banks of any size alike, by wheels, independent, steering and load transfer."""
    process = ProcessModel(NOMINAL[:wheels], TRACK_M, driven_rear)
    for seed, (informative, independent, known, curvature) in enumerate(
        [
            *((True, None, True, None), (False, None, False, None), (True, 0.01, False, None)),
            *((False, 0.02, True, 0.05), (True, 0.02, False, 0.05)),
        ]
    ):
        rear = np.array([6.0, 6.1])
        motion = TickMotion(0.1, rear, 0.7, -1.2, informative, 0.998, independent, known, curvature)
        one = some_bank(count, wheels, seed)
        other = copied(one)
        drift = process.drift_at(one.level * np.random.default_rng(seed).uniform(0.1, 2.0, one.level.shape))
        expected = ARRAYS.propagate(process, one, motion, 1.4, drift)
        assert pytest.approx(expected, rel=SAME) == fast.propagate(process, other, motion, 1.4, drift)
        assert_alike(one, other)


@pytest.mark.parametrize("frozen_from", [None, SLIP])
@pytest.mark.parametrize("weights", [square_weights, igg3_weights])
def test_a_measurement_updates_the_bank_equally(
    fast: BankKernel, frozen_from: int | None, weights: Weights
) -> None:
    """Rows common to all hypotheses and rows of each, frozen states, outliers: both kernels agree."""
    rng = np.random.default_rng(7)
    for count, wheels, each in [(40, 4, False), (40, 4, True), (100, 2, True), (1, 2, False)]:
        one = some_bank(count, wheels, count)
        other = copied(one)
        size = one.mean.shape[1]
        row = side_by_side(count, size) if each else np.zeros(size)
        row[..., [0, 5, size - 1]] = rng.standard_normal((count, 3) if each else 3)
        innovation = rng.standard_normal(count) * rng.choice([0.1, 100.0], count)
        scalar = measurements.Scalar(innovation, row, 0.3)
        ARRAYS.update(one, scalar, frozen_from, weights)
        fast.update(other, scalar, frozen_from, weights)
        assert_alike(one, other)


def lower_torn(bank: Bank) -> None:
    """Make the lower triangles of the covariances what must not matter."""
    size = bank.mean.shape[1]
    bank.spread[np.tril_indices(size, -1)] = 1e3


@pytest.mark.parametrize("count", [1, 64, 200])
@pytest.mark.parametrize("wheels", [2, 4])
@pytest.mark.parametrize("driven_rear", [False, True])
@pytest.mark.parametrize("apart_rad", [0.01, 1.0])
def test_one_triangle_moves_equally(
    half: HalfKernel, count: int, wheels: int, driven_rear: bool, apart_rad: float
) -> None:
    """The kernel that keeps the upper triangle propagates as the arrays do, whatever stands in the lower one,
    with headings close to each other (directions by a series) and far apart."""
    process = ProcessModel(NOMINAL[:wheels], TRACK_M, driven_rear)
    for seed, (informative, independent, known, curvature) in enumerate(
        [
            *((True, None, True, None), (False, None, False, None), (True, 0.01, False, None)),
            *((False, 0.02, True, 0.05), (True, 0.02, False, 0.05)),
        ]
    ):
        motion = TickMotion(
            0.1, np.array([6.0, 6.1]), 0.7, -1.2, informative, 0.998, independent, known, curvature
        )
        one = some_bank(count, wheels, seed)
        one.mean[:, PSI] = 2.0 + apart_rad * np.linspace(-1.0, 1.0, count)
        other = copied(one)
        lower_torn(other)
        drift = process.drift_at(one.level * np.random.default_rng(seed).uniform(0.1, 2.0, one.level.shape))
        expected = ARRAYS.propagate(process, one, motion, 1.4, drift)
        assert pytest.approx(expected, rel=SAME) == half.propagate(process, other, motion, 1.4, drift)
        half.complete(other)
        assert_alike(one, other)


@pytest.mark.parametrize("frozen_from", [None, SLIP])
@pytest.mark.parametrize("weights", [square_weights, igg3_weights])
def test_one_triangle_is_updated_equally(half: HalfKernel, frozen_from: int | None, weights: Weights) -> None:
    """Rows common to all and rows of each, frozen states, outliers and places that the measurement says
    nothing of: the upper triangle is that of the arrays."""
    rng = np.random.default_rng(7)
    for count, wheels, each in [(40, 4, False), (40, 4, True), (100, 2, True), (1, 2, False)]:
        one = some_bank(count, wheels, count)
        one.covariance[:, GYRO, :] = one.covariance[:, :, GYRO] = 0.0
        one.covariance[:, GYRO, GYRO] = 1e-6
        other = copied(one)
        lower_torn(other)
        size = one.mean.shape[1]
        row = side_by_side(count, size) if each else np.zeros(size)
        row[..., [0, 5, size - 1]] = rng.standard_normal((count, 3) if each else 3)
        innovation = rng.standard_normal(count) * rng.choice([0.1, 100.0], count)
        scalar = measurements.Scalar(innovation, row, 0.3)
        ARRAYS.update(one, scalar, frozen_from, weights)
        half.update(other, scalar, frozen_from, weights)
        half.complete(other)
        assert_alike(one, other)


def test_one_triangle_keeps_its_variances_positive(half: HalfKernel) -> None:
    """A variance that rounding made negative is raised, as the arrays do."""
    one = some_bank(40, 4, 2)
    one.covariance[3, 5, 5] = -1e-12
    other = copied(one)
    ARRAYS.symmetrise(one)
    half.symmetrise(other)
    half.complete(other)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-12)
    assert one.covariance[3, 5, 5] > 0.0


def test_the_mixture_is_summed_equally(fast: BankKernel) -> None:
    """Mean, variances and the effective number agree, with weights far apart and with one hypothesis."""
    for count, wheels in [(40, 4), (100, 2), (1, 4)]:
        bank = some_bank(count, wheels, count)
        one, other = ARRAYS.summary(bank), fast.summary(bank)
        np.testing.assert_allclose(other.mean, one.mean, rtol=SAME, atol=SAME)
        np.testing.assert_allclose(other.radii_m2, one.radii_m2, rtol=1e-9)
        expected = [one.east_m2, one.north_m2, one.heading_rad2, one.effective]
        found = [other.east_m2, other.north_m2, other.heading_rad2, other.effective]
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_covariances_are_made_symmetric_equally(fast: BankKernel) -> None:
    """Both kernels take the mean of both halves and raise variances that rounding made negative."""
    one = some_bank(40, 4, 2)
    one.covariance += 1e-9 * np.random.default_rng(2).standard_normal(one.covariance.shape)
    one.covariance[3, 5, 5] = -1e-12
    other = copied(one)
    ARRAYS.symmetrise(one)
    fast.symmetrise(other)
    np.testing.assert_array_equal(other.covariance, one.covariance)
    assert one.covariance[3, 5, 5] > 0.0


def test_positions_are_predicted_equally(fast: BankKernel) -> None:
    """The antenna's position and its derivatives agree in a bend, with the antenna off the axle."""
    bank = some_bank(40, 4, 1)
    fix = Fix(time_s=10.0, fraction=0.3, east_m=1.0, north_m=2.0, position_std_m=1.0)
    tick = Tick(100, 10.05, 0.1, np.full(4, 6.0), np.full(4, 0.05))
    now = measurements.Present(19.0, 0.2, 1.5, -0.4)
    for expected, found in zip(
        ARRAYS.antenna_position(bank, fix, tick, now),
        fast.antenna_position(bank, fix, tick, now),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=SAME, atol=SAME)


def driven(
    kernel: BankKernel, seconds: int, method: str = "gaussian-sum"
) -> list[tuple[list[float], list[float]]]:
    """Radii and pose tick by tick of a filter with this kernel: bends, a soft tyre, fixes at 2 Hz."""
    vehicle = VehicleConfig(
        wheel_radius_m=(0.316,) * 4, track_front_m=1.53, track_rear_m=TRACK_M, wheelbase_m=2.63
    )
    row = TABLE[method]
    if isinstance(row.pieces, MarginalPieces):
        mixture = replace(row.pieces.mixture, kernel=kernel)
        row = replace(row, pieces=replace(row.pieces, mixture=mixture))
    else:
        assert isinstance(row.pieces, MixturePieces)
        row = replace(row, pieces=replace(row.pieces, kernel=kernel))
    rng = np.random.default_rng(3)
    estimator = build_filter(vehicle, GnssConfig(), FilterConfig(), rng, True, row)
    east = north = heading = 0.0
    out = []
    for index in range(1, 10 * seconds):
        time_s = 0.1 * index
        speed, rate = 20.0, 0.05 * math.sin(time_s / 7.0)
        east, north = east + 0.1 * speed * math.cos(heading), north + 0.1 * speed * math.sin(heading)
        heading += 0.1 * rate
        hub = 0.1 * (speed + rate * TRACK_M / 2 * np.array([-1.0, 1.0, -1.0, 1.0]))
        radius = 0.316 - np.array([0.0, 0.0, 0.003 if index > 5 * seconds else 0.0, 0.0])
        rotation = hub / radius + 0.01 * rng.standard_normal(4)
        fixes: tuple[Fix, ...] = ()
        if index % 5 == 0:
            noise = rng.standard_normal(4) * [1.0, 1.0, 0.05, 0.005]
            fixes = (
                Fix(
                    *(time_s, 1.0, east + noise[0], north + noise[1], 1.2),
                    speed_mps=speed + noise[2],
                    heading_rad=heading + noise[3],
                ),
            )
        tick = Tick(index, time_s, 0.1, rotation, np.full(4, 0.05), fixes, yaw_rate_radps=rate)
        said = estimator.step(tick)
        out.append(
            ([*said.deviation_m, *said.covariance_m2.ravel()], [said.east_m, said.north_m, said.heading_rad])
        )
    return out


def test_a_drive_gives_the_same_estimates(fast: BankKernel) -> None:
    """Over a drive with bends and a loss of radius both kernels keep the same hypotheses: radii agree to a
    billionth of a millimetre."""
    for (radii, pose), (other_radii, other_pose) in zip(driven(ARRAYS, 90), driven(fast, 90), strict=True):
        np.testing.assert_allclose(other_radii, radii, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(other_pose, pose, atol=1e-8)


def test_particles_give_the_same_estimates(half: HalfKernel) -> None:
    """Over the same drive MPF-PN keeps the same particles with arrays and with the kernel of one triangle."""
    by_arrays, by_half = (driven(kernel, 60, "mpf-pn") for kernel in (ARRAYS, half))
    for (radii, pose), (other_radii, other_pose) in zip(by_arrays, by_half, strict=True):
        np.testing.assert_allclose(other_radii, radii, rtol=1e-6, atol=1e-11)
        np.testing.assert_allclose(other_pose, pose, atol=1e-7)


def test_arrays_of_another_layout_are_refused(fast: BankKernel) -> None:
    """Arrays that are no bank raise ValueError and are left alone."""
    bank = some_bank(40, 4, 1)
    scattered = replace(bank, mean=bank.mean.copy(order="C"))
    smaller = replace(bank, log_weights=bank.log_weights[:-1].copy())
    rounded = replace(bank, mean=bank.mean.astype(np.float32))
    for odd in (scattered, smaller, rounded):
        before = odd.mean.copy()
        with pytest.raises((ValueError, BufferError)):
            fast.summary(odd)
        with pytest.raises((ValueError, BufferError)):
            fast.update(odd, measurements.Scalar(np.zeros(40), np.zeros(18), 1.0), None, square_weights)
        np.testing.assert_array_equal(odd.mean, before)


@pytest.mark.parametrize("frozen_from", [float("nan"), -1.0, 1e300, float("inf")])
@pytest.mark.usefixtures("fast")
def test_a_row_that_is_no_row_is_refused(frozen_from: float) -> None:
    """A first frozen state that is no index of the state, NaN included, raises ValueError."""
    assert compiled is not None
    bank = some_bank(40, 4, 1)
    before = bank.mean.copy()
    mean, covariance = bank.state, bank.spread
    given = (mean, covariance, bank.log_weights, np.zeros(40), np.zeros(len(mean)))
    for update in (compiled.update, compiled.update_half):
        with pytest.raises(ValueError, match="do not belong together"):
            update(*given, 1.0, frozen_from, 1e9, 4.0)
    np.testing.assert_array_equal(bank.mean, before)


@pytest.mark.usefixtures("fast")
def test_arrays_that_share_memory_are_refused() -> None:
    """An array that is written to while another of the call reads it raises ValueError."""
    assert compiled is not None
    bank = some_bank(40, 4, 1)
    mean, covariance = bank.state, bank.spread
    for innovation, row in ((bank.log_weights, np.zeros(len(mean))), (np.zeros(40), mean)):
        given = (mean, covariance, bank.log_weights, innovation, row)
        with pytest.raises(ValueError, match="shares memory"):
            compiled.update(*given, 1.0, float(len(mean)), 1e9, 4.0)
