"""Random sequences with a correlation in time.

In: a Generator, a length, a standard deviation and a time constant. Out: stationary Gauss-Markov noise.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from tpmsd.foundation.wheels import FloatArray


def gauss_markov(
    rng: np.random.Generator, count: int, step_s: float, std: float, time_constant_s: float, columns: int
) -> FloatArray:
    """Return (count, columns) stationary first-order Gauss-Markov noise with this standard deviation and
    correlation time.

    x[k+1] = phi x[k] + sqrt(1 - phi^2) std w[k], phi = exp(-step / time constant): its autocorrelation at a
    lag of one time constant is 1/e.
    """
    phi = float(np.exp(-step_s / time_constant_s))
    white = rng.standard_normal((count, columns))
    drive = np.sqrt(1 - phi**2) * white
    drive[:1] = white[:1]
    return std * np.asarray(lfilter([1.0], [1.0, -phi], drive, axis=0))
