"""The radii this car had when it was known to be in order.

In: radius estimates while learning. Out: a frozen baseline, and changes against it with their covariance.
Frozen, not tracked: a baseline that followed the radii would follow a slow leak too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tpmsd.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class Baseline:
    """Radius minus nominal of each wheel when learning ended."""

    deviation_m: FloatArray
    covariance_m2: FloatArray

    def to_json(self) -> dict[str, Any]:
        """Plain numbers (NaN as None) for the state file."""
        return {
            "deviation_m": [None if np.isnan(x) else float(x) for x in self.deviation_m],
            "covariance_m2": [[None if np.isnan(x) else float(x) for x in row] for row in self.covariance_m2],
        }

    @classmethod
    def from_json(cls, saved: dict[str, Any], wheels: list[int]) -> Baseline:
        """Back from the state file; ValueError if it is not a baseline of these wheels (their indices)."""
        nan = float("nan")
        try:
            deviation = np.array([nan if x is None else float(x) for x in saved["deviation_m"]])
            covariance = np.array(
                [[nan if x is None else float(x) for x in row] for row in saved["covariance_m2"]]
            )
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"the saved baseline is not one: {error}") from error
        if deviation.shape != (4,) or covariance.shape != (4, 4) or np.any(np.abs(deviation) > 0.1):
            raise ValueError("the saved baseline has another shape or is absurd")
        own = covariance[np.ix_(wheels, wheels)]
        if not (np.all(np.isfinite(deviation[wheels])) and np.all(np.isfinite(own))):
            raise ValueError("the saved baseline lacks a wheel")
        if np.linalg.eigvalsh((own + own.T) / 2)[0] < -1e-12 or not np.allclose(own, own.T, atol=1e-12):
            raise ValueError("the saved baseline has no covariance")
        return cls(deviation, covariance)
