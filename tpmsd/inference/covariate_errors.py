"""How well a drive knows the covariates that effects depend on.

In: the `Reader` of a drive, a `Noise`. Out: the standard deviation of each covariate in a window. Covariates
are estimated like everything else: they share noise with the residual, and no shape over a covariate can be
told that is finer than the covariate's own error (errors in variables: Carroll, Ruppert, Stefanski and
Crainiceanu, Measurement Error in Nonlinear Models, 2006, chapter 3).
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.inference.noise import Noise
from tpmsd.inference.trajectory import SLOPE_ERROR, WINDOW_S
from tpmsd.inference.whitening import Whitener
from tpmsd.inference.windows import Reader
from tpmsd.physics.motion import GRAVITY_MPS2
from tpmsd.wheels import FloatArray


def covariate_stds(reader: Reader, noise: Noise) -> dict[str, float]:
    """Standard deviation of each covariate's error in a window, SI units: the median over the drive, from the
    smoother of all channels. Zero of what is given (time and way) or read from the bus."""
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
        told = name in motion.measured or name not in errors
        out[name] = 0.0 if told else float(np.median(errors[name]))
    return out
