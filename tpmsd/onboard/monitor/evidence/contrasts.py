"""Log-likelihood of a change by contrast: all wheels against the receiver, front and rear, left and right.

In: a change of the wheels with its covariance, and what is supposed lost. Out: for each contrast its part
of the log-likelihood ratio. Nothing here decides anything.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import IS_FRONT, IS_LEFT, FloatArray


def contrast_rows(wheels: list[int]) -> dict[str, FloatArray]:
    """Return the weights (d,) of the wheels in each contrast, by name; together they are a basis."""
    index = np.array(wheels)
    front, left = IS_FRONT[index], IS_LEFT[index]
    out = {"receiver_all_wheels": np.full(index.size, 1.0 / index.size)}
    if front.any():
        out["front_minus_rear"] = np.where(front, 0.5, -0.5)
        out["fl_minus_fr"] = np.where(front, np.where(left, 1.0, -1.0), 0.0)
    out["rl_minus_rr"] = np.where(~front, np.where(left, 1.0, -1.0), 0.0)
    return out


def contrast_gains(
    rows: dict[str, FloatArray], change_m: FloatArray, covariance_m2: FloatArray, expected_m: FloatArray
) -> dict[str, float]:
    """Return the log-likelihood ratio (nats) of the change `expected_m` (d,) to none, by contrast; their sum
    is that of all of them.

    Errors of contrasts are correlated. So they are whitened from the last to the first, differences between
    wheels before the receiver: each adds its part given those before it (chain rule of the likelihood).
    """
    names = list(rows)[::-1]
    basis = np.stack([rows[name] for name in names])
    whitener = np.linalg.inv(np.linalg.cholesky(basis @ covariance_m2 @ basis.T))
    seen, mean = whitener @ (basis @ change_m), whitener @ (basis @ expected_m)
    parts = 0.5 * seen**2 - 0.5 * (seen - mean) ** 2
    return {name: float(parts[names.index(name)]) for name in rows}
