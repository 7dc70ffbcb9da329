"""Errors of the covariates that effects depend on.

In: the `Reader` of a drive, a `Noise`. Out: the standard deviation of each covariate in a window. Covariates
are estimated like everything else: they share noise with the residual, and no shape over a covariate can be
found that is finer than the covariate's own error (errors in variables: Carroll, Ruppert, Stefanski and
Crainiceanu, Measurement Error in Nonlinear Models, 2006, chapter 3). A shape is one over the value to be
expected: on a straight road all of the lateral acceleration is error.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.smoothing import gaussian
from tpmsd.offline.inference.trajectory import SLOPE_ERROR, WINDOW_S, ReferenceTrajectory
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import Reader, Windows

MAX_BINS = 100_000
BIN_STDS, KERNEL_BINS = 0.25, 2.0
"""Bins of a covariate's density in standard deviations of its error, and the kernel's in bins: half a
standard deviation blurs the density by an eighth of the error's variance."""


def expected(values: FloatArray, std: float) -> FloatArray:
    """Return the (n,) expectation of a covariate that was estimated as `values` with that standard deviation.

    Regression calibration (Carroll and others 2006, chapter 4), by Tweedie's formula E[x | z] = z + std^2 d
    log f(z) / dz (Efron, Journal of the American Statistical Association 106, 2011), f the density of what
    was estimated. Where values are many and near each other they draw together, and where they are spread
    farther than their error nothing happens.
    """
    if std <= 0.0 or not len(values):
        return values
    width = max(BIN_STDS * std, float(np.ptp(values)) / MAX_BINS)
    first = float(values.min()) - 4.0 * std
    count = int((float(values.max()) + 4.0 * std - first) / width) + 1
    number = np.bincount(((values - first) / width).astype(int), minlength=count).astype(np.float64)
    density = gaussian(number, KERNEL_BINS)
    score = np.gradient(np.log(np.maximum(density, 1e-9)), width)
    middle = first + (np.arange(count) + 0.5) * width
    moved = values + std**2 * np.interp(values, middle, score)
    return np.asarray(np.clip(moved, values.min(), values.max()))


def covariate_stds(reader: Reader, noise: Noise) -> dict[str, float]:
    """Return the standard deviation of each covariate's error in a window, SI units: the median over the
    drive."""
    errors = covariate_errors(reader.windows, reader.reference, noise)
    return {name: float(np.median(values)) for name, values in errors.items()}


def covariate_errors(windows: Windows, about: ReferenceTrajectory, noise: Noise) -> dict[str, FloatArray]:
    """Return the (w,) standard deviation of each covariate's error, SI units, from the smoother of all
    channels; zero for covariates that are given (time and distance) or read from the bus."""
    made = Whitener.of(windows, noise, np.isfinite(windows.measured))
    stds = np.concatenate([made.motion_stds(), np.zeros((len(windows), 1))], axis=1)
    out = {
        name: np.sqrt(np.square(jacobian * stds).sum(axis=1))
        for name, jacobian in covariate_jacobians(windows, about).items()
    }
    slope = np.full(len(windows), SLOPE_ERROR)
    # Rates are differences of neighbouring windows; slopes are determined by heights, not by the motion.
    rates = {
        "accel_long": np.hypot(math.sqrt(2.0) * stds[:, 0] / WINDOW_S, GRAVITY_MPS2 * slope),
        "grade": slope,
    }
    if "steering" in out:
        rates["steering_rate"] = math.sqrt(2.0) * out["steering"] / WINDOW_S
    for name, values in rates.items():
        if name in out and name not in about.motion.measured:
            out[name] = values
    return out


def covariate_jacobians(windows: Windows, about: ReferenceTrajectory) -> dict[str, FloatArray]:
    """Return the (w, 3) derivative of each covariate by the errors of speed, yaw rate and heading of its own
    window; zero for covariates that are given or read from the bus."""
    out = {name: np.zeros((len(windows), 3)) for name in windows.covariates}
    speed, yaw = np.maximum(windows.covariates["speed"], 1.0), windows.covariates["yaw_rate"]
    lever = about.car.steering_ratio * about.car.geometry.wheelbase_m
    one, none = np.ones(len(windows)), np.zeros(len(windows))
    closed = {
        "speed": (one, none),
        "yaw_rate": (none, one),
        "accel_lat": (yaw, speed),
        "steering": (none, lever / speed),
    }
    for name, (by_speed, by_yaw) in closed.items():
        if name in out and name not in about.motion.measured:
            out[name][:, 0], out[name][:, 1] = by_speed, by_yaw
    return out
