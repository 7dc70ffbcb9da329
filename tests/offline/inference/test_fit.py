"""Preparing and fitting as pure functions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.inference.fit import DriveNoise, fit, gram, redrawn, solved
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.prepared import Design, Prepared, design, prepare
from tpmsd.offline.inference.recording import Recording

EFFECT = "load_transfer_lateral"
COEFFICIENT = 2e-4


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Five minutes of mixed driving with load transfer."""
    physics: dict[str, dict[str, object]] = {EFFECT: {"coefficient": COEFFICIENT}}
    return recording_of(drive(Spec(duration_s=300.0, physics=physics, radius_spread_m=1e-3), 4))


@pytest.fixture(scope="module")
def prepared(recording: Recording) -> Prepared:
    return prepare(recording, recording.car)


@pytest.fixture(scope="module")
def model(prepared: Prepared) -> Design:
    """Radii and the load transfer that acts."""
    return design(prepared, {EFFECT: ExtendedModel((make_effect(EFFECT, coefficient=COEFFICIENT),))})


@pytest.fixture(scope="module")
def noise(prepared: Prepared) -> DriveNoise:
    return DriveNoise(Noise.first(prepared.recording.quantum_rad, prepared.reference.car.radius_m))


def test_the_same_drive_gives_the_same_bits(
    recording: Recording, prepared: Prepared, model: Design, noise: DriveNoise
) -> None:
    """Prepared and fitted twice, every array is equal to the last bit; the recording is as it was."""
    before = recording.rotation_rad.tobytes()
    again = prepare(recording, recording.car)
    first, second = fit([prepared], [model], [noise]), fit([again], [model], [noise])

    for name in ("values", "covariance", "log_likelihood"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()
    assert prepared.tick_residual_rad.tobytes() == again.tick_residual_rad.tobytes()
    assert recording.rotation_rad.tobytes() == before and recording.rotation_rad.flags.writeable


def test_nothing_that_was_prepared_or_fitted_can_be_changed(
    prepared: Prepared, model: Design, noise: DriveNoise
) -> None:
    """Arrays are read-only and records are frozen."""
    found = fit([prepared], [model], [noise])
    covariate = prepared.covariates["accel_lat"]
    arrays = [prepared.y, prepared.mask, prepared.windows.design, prepared.motion.speed_mps, model.columns]
    arrays += [prepared.tick_residual_rad, covariate.value, covariate.jacobian, covariate.std]
    arrays += [found.values, found.covariance, found.log_likelihood]

    assert [] == [array.shape for array in arrays if array.flags.writeable]
    with pytest.raises(dataclasses.FrozenInstanceError):
        prepared.y = found.values  # type: ignore[misc]


def test_what_acts_is_found_with_its_size(prepared: Prepared, model: Design, noise: DriveNoise) -> None:
    """The load transfer that was put in has the value 1 within four standard deviations, which are small."""
    found = fit([prepared], [model], [noise])
    value = found.values[found.keys.index(EFFECT), 0]

    assert found.std(EFFECT) < 0.2
    assert value == pytest.approx(1.0, abs=4.0 * found.std(EFFECT))


def test_replicates_scatter_as_the_covariance_says(
    prepared: Prepared, model: Design, noise: DriveNoise
) -> None:
    """Of 400 replicates drawn with a fixed design, mean and covariance of the values are those stated."""
    true = np.array([1e-3, -5e-4, 2e-4, 0.0, 0.7])
    many = redrawn(prepared, model, true, noise, np.random.default_rng(1), 400)
    found = fit([many], [model], [noise])
    factor = np.linalg.inv(np.linalg.cholesky(found.covariance))
    scaled = factor @ (found.values - true[:, None])

    assert (5, 400) == found.values.shape and (400,) == found.log_likelihood.shape
    assert np.abs(scaled.mean(axis=1)).max() < 4.0 / np.sqrt(400)
    assert np.cov(scaled) == pytest.approx(np.eye(5), abs=0.25)


def test_drives_with_a_key_in_common_are_one_regression() -> None:
    """Two drives with a shared and an own value each, and a prior, equal one stacked least squares."""
    rng = np.random.default_rng(2)
    A, B = rng.standard_normal((30, 2)), rng.standard_normal((40, 2))
    a, b = rng.standard_normal((30, 3)), rng.standard_normal((40, 3))
    found = solved([gram(("x", "p"), a, A), gram(("q", "x"), b, B)], {"q": (0.5, 0.1)})
    rows = np.zeros((71, 3))
    rows[:30, :2], rows[30:70, [2, 0]], rows[70, 2] = A, B, 10.0
    y = np.concatenate([a, b, np.full((1, 3), 5.0)])
    expected, misfit, *_ = np.linalg.lstsq(rows, y, rcond=None)

    assert ("x", "p", "q") == found.keys
    assert found.values == pytest.approx(expected)
    assert found.covariance == pytest.approx(np.linalg.inv(rows.T @ rows))
    assert found.log_likelihood == pytest.approx(-0.5 * (misfit + 2.0 * np.log(0.1)))


def test_what_no_drive_tells_is_refused() -> None:
    """A column of nothing, and two that are one, raise with their keys."""
    X = np.ones((5, 1))
    y = np.arange(5.0)[:, None]

    with pytest.raises(ValueError, match="nothing tells b"):
        solved([gram(("a", "b"), y, np.hstack([X, 0.0 * X]))], {})
    with pytest.raises(ValueError, match="do not tell a b apart"):
        solved([gram(("a", "b"), y, np.hstack([X, X]))], {})
