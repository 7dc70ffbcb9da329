"""A negative control: the search for shapes over covariates that cannot act.

In: a `Regression` and its `Selection`. Out: the largest penalised gain of a spline term over any covariate
whose course was reversed in time, beyond the chosen model. It has the covariate's values, its slowness and
its error, but nothing in the drive depends on it: what it gains, the noise model leaves to chance (negative
controls: Lipsitch, Tchetgen Tchetgen and Cohen, Epidemiology 21, 2010). A finding, whose gain is divided by
its overdispersion, must gain more; the control is not divided, which errs on the safe side.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.hypotheses.penalties import spline_penalty
from tpmsd.offline.diagnosis.hypotheses.response import READINGS, first_hat, hat_functions, response_at
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.covariate_errors import expected

OF_TIME = ("time", "distance")
"""Reversed, they are what they were."""


def negative_control(regression: Regression, selection: Selection) -> float:
    """Return the largest penalised gain (nats) of a spline over covariates that cannot act; minus infinity
    without any."""
    gains = [gain for drive in regression.examined for gain in _penalised_gains(drive, selection.fit.design)]
    return max(gains, default=-np.inf)


def _penalised_gains(drive: DriveRegression, design: FloatArray) -> list[float]:
    """Return the penalised gains (nats) of one drive's spline terms, by covariate and wheel pattern."""
    windows = drive.reader.windows
    model = drive.whitened_design(design).reshape(windows.measured.size, -1)
    model = model[:, np.any(model != 0.0, axis=0)]
    basis = scipy.linalg.qr(model / np.linalg.norm(model, axis=0), mode="economic")[0]
    left = drive.white[:, :, 0].ravel()
    left = left - basis @ (basis.T @ left)
    read = [WHEELS[wheel] for wheel in drive.reader.recording.wheels]
    patterns = [
        *read,
        *(p for p, channel in READINGS.items() if np.isfinite(windows.measured[:, channel]).any()),
    ]
    out = []
    for covariate, knots in drive.knots.items():
        if covariate in OF_TIME:
            continue
        values = expected(windows.covariates[covariate], drive.stds.get(covariate, 0.0))
        hats = hat_functions(values[::-1], knots)
        columns = [response_at(drive.reader, p)[:, :, None] * hats[:, None, first_hat(p) :] for p in patterns]
        white = drive.whitened(np.concatenate(columns, axis=2)).reshape(left.size, -1)
        white -= basis @ (basis.T @ white)
        at = 0
        for column in columns:
            X = white[:, at : at + column.shape[2]]
            out.append(_gain_of_columns(X, left) - spline_penalty(X.shape[1]))
            at += X.shape[1]
    return out


def _gain_of_columns(X: FloatArray, y: FloatArray) -> float:
    """Return the log-likelihood gain (nats) of columns (n, k) on data (n,)."""
    size = np.maximum(np.linalg.norm(X, axis=0), 1e-150)
    score = (y @ X) / size
    gram = X.T @ X / np.outer(size, size) + SETTINGS.robustness.ridge * np.eye(len(size))
    return 0.5 * float(score @ np.linalg.solve(gram, score))
