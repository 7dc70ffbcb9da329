"""Derivatives along a path: those of delayed readings, those that are kept, and what probes share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.offline.dynamics.drives import folder, loaded
from tpmsd.car.physics.baselines.base import Theta
from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.columns import Probe, model_derivatives
from tpmsd.offline.dynamics.path import Setup, linear, smoothed
from tpmsd.offline.dynamics.search import Search

CHANNELS = ("yaw_rate", "accel_lat", "velocity_lat")
STEP = 1e-6


def setup_of(where: Path, model: str) -> Setup:
    baseline, drive = loaded(folder(where, (), model, 40.0, 4), model)
    return Setup(baseline, drive, CHANNELS)


def delays(gyro_s: float, accelerometer_s: float) -> Theta:
    return (
        make_dynamics_effect("gyro_delay", delay_s=gyro_s),
        make_dynamics_effect("accelerometer_delay", delay_s=accelerometer_s),
    )


def differences(setup: Setup, theta: Theta, path: FloatArray) -> FloatArray:
    """Return the derivatives of the readings by each column, (n, m, t), integrated back for each of them."""
    inputs = setup.inputs(theta)
    seen = setup.evaluate(path, inputs, theta)[1]
    out = []
    for k in range(path.shape[1]):
        moved = path.copy()
        moved[:, k] += STEP
        out.append((setup.evaluate(moved, inputs, theta)[1] - seen) / STEP)
    return np.moveaxis(np.array(out), (0, 1, 2), (2, 1, 0))


@pytest.mark.parametrize("model", ["single-track", "three-dof"])
@pytest.mark.parametrize("relaxation_m", [0.0, 0.3, 0.8])
@pytest.mark.parametrize(("gyro_s", "accelerometer_s"), [(0.03, 0.03), (0.02, 0.06), (-0.02, 0.05)])
def test_delayed_readings_by_the_chain_rule(
    tmp_path: Path, model: str, relaxation_m: float, gyro_s: float, accelerometer_s: float
) -> None:
    """To 0.5 % of those by differences through the whole integration, in the root of the mean square; to
    2.5 % where tyres forget within the age, and act to first order."""
    setup = setup_of(tmp_path / "d", model)
    tyres = (make_dynamics_effect("tyre_relaxation", length_m=relaxation_m),) if relaxation_m else ()
    theta = (*tyres, *delays(gyro_s, accelerometer_s))
    path = setup.start(theta)
    wanted, found = differences(setup, theta, path), linear(setup, theta, path).outputs_by_state

    size = np.sqrt(np.mean(wanted**2, axis=0))
    error = np.sqrt(np.mean((found - wanted) ** 2, axis=0))
    assert np.all(error <= (0.025 if tyres else 0.005) * size + 1e-9)


@pytest.mark.parametrize("model", ["single-track", "three-dof"])
@pytest.mark.parametrize("begun", [0.0, 1.0])
def test_derivatives_are_kept_only_where_they_hold(tmp_path: Path, model: str, begun: float) -> None:
    """On tyres that slide, from rest or from the readings: those of the smoothed path are within 2 % of those
    worked out there; kept from the start they are off by 8 to 50 %."""
    setup = setup_of(tmp_path / "d", model)
    theta = (make_dynamics_effect("tyre_saturation", friction=0.3),)
    found = smoothed(setup, theta, begun * setup.start(theta), Search(setup).noise)
    there = linear(setup, theta, found.path)

    for kept, wanted in (
        (found.by_state, there.by_state),
        (found.outputs_by_state, there.outputs_by_state),
    ):
        assert np.linalg.norm(kept - wanted) <= 0.02 * np.linalg.norm(wanted)


def test_instruments_read_in_the_earlier_states_that_are_known(tmp_path: Path) -> None:
    """Derivatives by what changes readings alone are those of models that are integrated back again."""
    setup = setup_of(tmp_path / "d", "single-track")
    theta = delays(0.03, 0.06)
    at = linear(setup, theta, setup.start(theta))
    offered = (
        make_dynamics_effect("yaw_rate_scale", scale=1.001),
        make_dynamics_effect("accelerometer_position", forward_m=0.01),
        make_dynamics_effect("compliance_steer", coefficient=1e-6),
    )
    probes = [Probe((*theta, effect), 1.0) for effect in offered]
    _, found = model_derivatives(setup, theta, at, probes)

    seen = setup.evaluate(at.path, setup.inputs(theta), theta)[1]
    for by, probe in zip(found, probes, strict=True):
        again = setup.evaluate(at.path, setup.inputs(probe.theta), probe.theta)[1]
        assert np.array_equal(by, (again - seen) * np.isfinite(at.reading_residual).T)
        assert np.any(by)
