"""Random sequences with a correlation in time.

In: a Generator, a length, a standard deviation and a time constant. Out: stationary Gauss-Markov noise.
"""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from tpmsd.foundation.wheels import FloatArray


def gauss_markov(
    rng: np.random.Generator, count: int, step_s: float, std: float, time_constant_s: float, columns: int
) -> FloatArray:
    """Return (count, columns) stationary first-order Gauss-Markov noise of standard deviation `std` and
    correlation time `time_constant_s`.

    x[k+1] = phi x[k] + sqrt(1 - phi^2) std w[k], phi = exp(-step / time constant): its autocorrelation at a
    lag of one time constant is 1/e. `scipy.signal.lfilter` gives the same bits, but takes longer to import
    than a short drive takes to simulate.
    """
    phi = float(np.exp(-step_s / time_constant_s))
    white = rng.standard_normal((count, columns))
    drive = np.sqrt(1 - phi**2) * white
    drive[:1] = white[:1]
    for column in drive.T:
        column[:] = list(accumulate(column.tolist(), lambda before, own: phi * before + own))
    return np.asarray(std * drive)
