"""Sufficient statistics of columns: those of dense least squares over a block's path and the parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.offline.dynamics.drives import folder, loaded
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics import columns
from tpmsd.offline.dynamics.columns import BlockGram, Probe, gram, model_derivatives
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.search import Search
from tpmsd.offline.dynamics.settings import SETTINGS

CHANNELS = ("yaw_rate", "accel_lat", "velocity_lat", "speed", "accel_long")


def dense_gram(search: Search, probes: list[Probe]) -> BlockGram:
    """Return the statistics by one dense least-squares problem per block, the path eliminated at the end."""
    setup, at, noise = search.setup, search.at, search.noise
    by_rate, by_output = model_derivatives(setup, search.theta, at, probes)
    time, total, states = setup.drive.time_s, at.path.shape[1], by_rate.shape[1]
    priors = 1.0 / np.concatenate([noise.start, noise.disturbance])
    informations, gradients = [], []
    for first, last in zip(setup.drive.starts, setup.drive.ends, strict=True):
        rows: list[FloatArray] = []  # derivatives by the path and by the parameters, residual
        for k in range(first, last):
            for j in range(at.reading_residual.shape[1]):
                if np.isfinite(at.reading_residual[k, j]):
                    of = np.zeros((last - first, total))
                    of[k - first] = at.outputs_by_state[k, j]
                    rows.append(
                        np.r_[of.ravel(), by_output[:, j, k], at.reading_residual[k, j]] / noise.outputs[j]
                    )
        for k in range(first, last - 1):
            dt = time[k + 1] - time[k]
            deviations = np.sqrt(noise.step_variance(np.array([dt]))[0])
            for i in range(total):
                of = np.zeros((last - first, total))
                of[k - first], of[k + 1 - first, i] = at.by_state[k, i], -1.0
                step = np.zeros(len(probes))
                if i < states:
                    step = (
                        by_rate[:, :, k] @ at.by_rates[0, k, i] + by_rate[:, :, k + 1] @ at.by_rates[1, k, i]
                    )
                rows.append(np.r_[of.ravel(), step, at.step_residual[k, i]] / deviations[i])
        for i in range(total):
            of = np.zeros((last - first, total))
            of[0, i] = 1.0
            pull = 0.0 if i < states else -at.path[first, i]
            rows.append(np.r_[of.ravel(), np.zeros(len(probes)), pull] * priors[i])
        path, parameters, value = np.split(np.array(rows), [of.size, -1], axis=1)
        orthogonal = np.linalg.qr(path)[0]
        left = parameters - orthogonal @ (orthogonal.T @ parameters)
        informations.append(left.T @ left)
        gradients.append(left.T @ value[:, 0])
    return BlockGram(np.array(informations), np.array(gradients))


@pytest.mark.parametrize("cached", [SETTINGS.values_at_once, 250, 1])
def test_statistics_are_those_of_dense_least_squares(
    tmp_path: Path, cached: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks are taken together as far as they fit, all of a short drive, a few of them, or each alone."""
    baseline, drive = loaded(folder(tmp_path / "d", (), "three-dof", 10.0, 1, forces=True), "three-dof")
    search = Search(Setup(baseline, drive.part(0, 240), CHANNELS))
    probes = [
        probe
        for term in search.offered()
        if term.name in {"mass_error", "gyro_delay", "road_bank", "accelerometer_position"}
        for probe in term.probes(search.theta, search.covariates)
    ]
    assert len(search.setup.drive.starts) > 2 and len(probes) > 3
    monkeypatch.setattr(columns, "SETTINGS", replace(SETTINGS, values_at_once=cached))
    found, dense = (
        gram(search.setup, search.theta, search.at, search.noise, probes),
        dense_gram(search, probes),
    )

    size = np.sqrt(np.einsum("bii->bi", dense.information))
    scaled = (found.information - dense.information) / size[:, :, None] / size[:, None]
    assert np.abs(scaled).max() < 1e-6
    assert np.abs((found.gradient - dense.gradient) / size).max() < 1e-5
