"""A drive prepared once, and fits of its fixed design, as pure functions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bench.campaigns.offline.fixed_design import (
    Design,
    DriveNoise,
    Prepared,
    design,
    fit,
    prepare,
    redrawn,
)
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.inference.noise import Noise
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
