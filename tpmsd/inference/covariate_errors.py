"""How well a drive knows the covariates that effects depend on.

In: the `Reader` of a drive, a `Noise`. Out: the standard deviation of each covariate in a window. Covariates
are estimated like everything else: they share noise with the residual, and no shape over a covariate can be
told that is finer than the covariate's own error (errors in variables: Carroll, Ruppert, Stefanski and
Crainiceanu, Measurement Error in Nonlinear Models, 2006, chapter 3). Within a window a covariate also varies,
while the responses of shapes are taken at its mean.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.inference.noise import Noise
from tpmsd.inference.trajectory import SLOPE_ERROR, WINDOW_S
from tpmsd.inference.whitening import Whitener
from tpmsd.inference.windows import Reader
from tpmsd.physics.covariates import covariate
from tpmsd.physics.motion import GRAVITY_MPS2
from tpmsd.wheels import FloatArray


def covariate_stds(reader: Reader, noise: Noise) -> dict[str, float]:
    """Standard deviation of each covariate in a window, SI units: the median of its error's, from the
    smoother of the whole drive, with its usual variation within a window. Time and way are given."""
    windows, motion, car = reader.windows, reader.reference.motion, reader.reference.car
    made = Whitener.of(windows, noise, np.isfinite(windows.measured))
    speed_std, yaw_std = made.motion_stds().T
    speed, yaw = np.maximum(windows.covariates["speed"], 1.0), windows.covariates["yaw_rate"]
    pull_std = math.sqrt(2.0) * speed_std / WINDOW_S
    steer_std = car.steering_ratio * car.geometry.wheelbase_m * yaw_std / speed
    errors: dict[str, FloatArray] = {
        "speed": speed_std,
        "yaw_rate": yaw_std,
        "accel_lat": np.hypot(speed * yaw_std, yaw * speed_std),
        "accel_long": np.hypot(pull_std, GRAVITY_MPS2 * SLOPE_ERROR),
        "grade": np.full(len(windows), SLOPE_ERROR),
        "steering": steer_std,
        "steering_rate": math.sqrt(2.0) * steer_std / WINDOW_S,
    }
    out = {}
    for name in windows.covariates:
        if name in ("time", "distance", "accel_kinematic"):
            out[name] = 0.0
            continue
        error = 0.0 if name in motion.measured or name not in errors else float(np.median(errors[name]))
        out[name] = math.hypot(error, _within(reader, covariate(motion, car, name)))
    return out


def _within(reader: Reader, values: FloatArray) -> float:
    """Median over the windows of a covariate's standard deviation within one."""
    mean = reader.over_windows(values)
    square = reader.over_windows(np.square(values - np.mean(values)))
    centred = np.square(mean - np.mean(values))
    return float(np.sqrt(np.median(np.maximum(square - centred, 0.0))))
