"""Sufficient statistics of a calibration: the quadratic log-likelihood of the car's parameters on one drive.

In: one `Recording` and the configured `Vehicle`. Out: `DriveStatistics`: information matrix and vector of the
car's parameters, without the prior, so that those of many drives may simply be added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.calibration.checks import check_fit, check_recordings
from tpmsd.offline.calibration.equations import PARAMETERS
from tpmsd.offline.calibration.joint import PRIOR, JointFit, fit
from tpmsd.offline.calibration.nominal import Vehicle
from tpmsd.offline.inference.recording import Recording

REFERENCE_SPEED_MPS = 20.0
"""The radii of all drives are stated at this speed, about the mean of mixed driving; each drive's own speed
would mix growth into them."""
INFORMATIVE = 1e-3
"""A direction of which the data hold less than this share of the prior's information is undetermined: the
difference of two inverse matrices does not hold more digits."""


@dataclass(frozen=True)
class DriveStatistics:
    """log likelihood = const + vector @ theta - theta @ information @ theta / 2."""

    names: tuple[str, ...]
    """p parameters, as in `equations.PARAMETERS`: radii, tracks and gyro gain relative to the configured
    values, the others in SI units."""
    information: FloatArray
    """(p, p) positive semidefinite."""
    vector: FloatArray
    """(p,)"""


def drive_statistics(
    recording: Recording, start: Vehicle, progress: Callable[[float], None] = lambda share: None
) -> DriveStatistics:
    """Return the statistics of one drive; `RefusedError` where it cannot be calibrated from, with the
    reason."""
    check_recordings([recording], start)
    found = fit([recording], start, progress)
    check_fit([recording], found)
    return statistics_of(found, start)


def statistics_of(found: JointFit, start: Vehicle) -> DriveStatistics:
    """Return the likelihood's statistics of a fit of one drive: without the prior, radii at the reference
    speed.
    """
    indices = [k for k, name in enumerate(found.names) if name.split("@")[0] in PARAMETERS]
    names = tuple(found.names[k].split("@")[0] for k in indices)
    prior = np.array([PRIOR[name] for name in names])
    posterior = np.linalg.inv(found.covariance[np.ix_(indices, indices)])
    # In units of the prior's standard deviations every entry is of the same kind.
    scale = prior[:, 1]
    white = scale[:, None] * posterior * scale - np.eye(len(names))
    vector = scale * (posterior @ found.values[indices]) - prior[:, 0] / scale
    values, vectors = np.linalg.eigh(0.5 * (white + white.T))
    kept = vectors[:, values > INFORMATIVE]
    white = (kept * values[values > INFORMATIVE]) @ kept.T
    vector = kept @ (kept.T @ vector)
    turn = np.eye(len(names))
    growth = names.index("growth")
    for wheel, radius_m in zip(WHEELS, start.radius_m, strict=True):
        # radius at the drive's speed = radius at the reference speed + growth * (v^2 - v_ref^2)
        squares = found.reference_speed_mps**2 - REFERENCE_SPEED_MPS**2
        turn[names.index(f"radius_{wheel}"), growth] = squares / radius_m
    information = white / np.outer(scale, scale)
    return DriveStatistics(names, turn.T @ information @ turn, turn.T @ (vector / scale))
