"""Information of each range of speeds about the radii.

In: the drives with their whitened columns. Out: `SpeedRange`s. After whitening, a range's information on the
four radii is the Gram matrix of their columns over its windows; its inverse is the covariance that these
seconds alone would give (generalised least squares, motion and receiver's errors eliminated).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from tpmsd.car.physics.catalogue import RADIUS
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.result import SpeedRange
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.settings import SETTINGS


def speed_ranges(drives: Sequence[DriveRegression]) -> tuple[SpeedRange, ...]:
    """Return the ranges in which the drives were compared, the slowest first."""
    out = []
    for low, high in pairwise(SETTINGS.report.speeds_mps):
        seconds, information = 0, 0.0
        for drive in drives:
            speed = drive.reader.windows.covariates["speed"]
            inside = (speed >= low) & (speed < high)
            seconds += int(inside.sum())
            information += _radius_information(drive, inside)
        if seconds:
            std_m = float(1.0 / np.sqrt(information)) if information > 0.0 else None
            out.append(SpeedRange((low, high), float(seconds), std_m))
    return tuple(out)


def _radius_information(drive: DriveRegression, inside: np.ndarray) -> float:
    """Return the information (1/m2) on a radius jointly with the others, the median over wheels; 0 if it is
    singular."""
    at = [k for k, name in enumerate(drive.names) if name[0] == RADIUS.name]
    rows: FloatArray = drive.white[inside][:, :, at].reshape(-1, len(at))
    gram = rows.T @ rows
    if np.linalg.matrix_rank(gram, hermitian=True) < len(at):
        return 0.0
    return float(np.median(1.0 / np.diag(np.linalg.inv(gram))))
