"""Sufficient statistics of a drive: with the prior added they are the calibration itself."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import tpmsd
from tpmsd.offline.calibration.joint import PRIOR, JointFit, fit
from tpmsd.offline.calibration.nominal import Vehicle, vehicle_of
from tpmsd.offline.calibration.statistics import REFERENCE_SPEED_MPS, statistics_of
from tpmsd.offline.drives.playing import recording_of


@pytest.fixture(scope="module")
def fitted() -> tuple[JointFit, Vehicle]:
    drive = tpmsd.simulate(duration_s=120.0, seed=5, route="rural")
    start = vehicle_of(drive.config.vehicle)
    return fit([recording_of(drive)], start), start


def test_with_the_prior_they_are_the_fit(fitted: tuple[JointFit, Vehicle]) -> None:
    """Information plus the prior's gives the fit's values within 0.01 and stds within 1 % of each std."""
    found, start = fitted
    at_reference = dataclasses.replace(found, reference_speed_mps=REFERENCE_SPEED_MPS)
    reported = statistics_of(at_reference, start)
    mean, std = np.array([PRIOR[name] for name in reported.names]).T
    covariance = np.linalg.inv(reported.information + np.diag(1 / std**2))
    values = covariance @ (reported.vector + mean / std**2)
    place = [k for k, name in enumerate(found.names) if name.split("@")[0] in reported.names]
    expected = np.sqrt(np.diag(found.covariance)[place])

    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), expected, rtol=0.01)
    np.testing.assert_allclose((values - found.values[place]) / expected, 0.0, atol=0.01)
    assert np.linalg.eigvalsh(reported.information * np.outer(std, std)).min() > -1e-9


def test_radii_are_stated_at_one_speed(fitted: tuple[JointFit, Vehicle]) -> None:
    """Known growth moves a radius from the drive's speed to the reference speed by k (v^2 - v_ref^2) / r."""
    found, start = fitted
    own = statistics_of(dataclasses.replace(found, reference_speed_mps=REFERENCE_SPEED_MPS), start)
    reported = statistics_of(found, start)
    growth, wheel = reported.names.index("growth"), reported.names.index("radius_rl")
    squares = found.reference_speed_mps**2 - REFERENCE_SPEED_MPS**2
    theta = np.zeros(len(reported.names))
    theta[growth] = 1e-6
    same = theta.copy()
    same[[reported.names.index(f"radius_{name}") for name in ("fl", "fr", "rl", "rr")]] = (
        1e-6 * squares / start.radius_m
    )

    assert theta[wheel] == 0.0
    assert theta @ reported.information @ theta == pytest.approx(same @ own.information @ same)
    assert reported.vector @ theta == pytest.approx(own.vector @ same)
