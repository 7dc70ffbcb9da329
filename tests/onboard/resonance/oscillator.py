"""A damped oscillator driven by white noise, exactly sampled: a resonance whose frequency is known.

x'' + 2 z w0 x' + w0^2 x = white noise,   density of x' proportional to f^2 / ((f0^2 - f^2)^2 + (2 z f0
f)^2)
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.signal import lfilter

from tpmsd.foundation.wheels import FloatArray


def jitter(
    rng: np.random.Generator, seconds: float, rate_hz: float, frequency_hz: float, damping: float, std: float
) -> FloatArray:
    """(n,) velocity of the oscillator with this standard deviation."""
    w0 = 2.0 * math.pi * frequency_hz
    system = np.array([[0.0, 1.0], [-w0 * w0, -2.0 * damping * w0]])
    step = expm(system / rate_hz)
    stationary = solve_continuous_lyapunov(system, -np.diag([0.0, 1.0]))
    root = np.linalg.cholesky(stationary - step @ stationary @ step.T)
    count = round(seconds * rate_hz)
    noise = root @ rng.normal(size=(2, count))
    # Both states have the poles of `step`; x'_k follows from the noises of steps k and k - 1.
    poles = [1.0, -float(np.trace(step)), float(np.linalg.det(step))]
    late = step[1, 0] * noise[0] - step[0, 0] * noise[1]
    speed = lfilter([1.0], poles, noise[1] + np.concatenate([[0.0], late[:-1]]))
    return np.asarray(speed * (std / math.sqrt(stationary[1, 1])))
