"""Which losses of pressure would be seen now.

In: the covariances of what is judged. Out: `Sight`: the smallest loss of one tyre, and of all alike, that
would raise an alarm.

A loss s of the wheels p (1 for each) is known with the standard deviation (p' C^-1 p)^-1/2. Its expected
log-likelihood ratio to none is half of its square in standard deviations; it must outweigh its prior odds and
those asked for. And it must reach the threshold, which a standard deviation below it does not for sure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.monitor.settings import JUDGE
from tpmsd.physics.tyre import TyreModel
from tpmsd.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class Sight:
    """Smallest losses that would be seen, as shares of the pressure; 1 where not even a flat tyre would."""

    one_tyre: float
    """Of the wheel that is known worst."""
    all_tyres: float


def sight(
    one_m2: FloatArray,
    all_m2: FloatArray | None,
    radius_m: FloatArray,
    tyres: list[TyreModel],
    threshold: float,
    probability: float,
) -> Sight:
    """`one_m2` and `all_m2` (d, d): covariance by which one tyre and all alike are judged, None where they
    are not; radius_m (d,); `threshold` relative; `probability` asked for."""
    d = radius_m.size
    single = max(
        _smallest(one_m2, radius_m * row, threshold, probability, JUDGE.prior_by_size[0]) for row in np.eye(d)
    )
    if all_m2 is None:
        return Sight(_pressure(single, radius_m, tyres), 1.0)
    alike = _smallest(all_m2, radius_m, threshold, probability, JUDGE.prior_by_size[d - 1])
    return Sight(_pressure(single, radius_m, tyres), _pressure(alike, radius_m, tyres))


def _smallest(
    covariance_m2: FloatArray, pattern_m: FloatArray, threshold: float, probability: float, prior: float
) -> float:
    """Relative loss of the wheels of a pattern (d,), m per relative loss."""
    std = 1.0 / math.sqrt(float(pattern_m @ np.linalg.solve(covariance_m2, pattern_m)))
    nats = math.log(probability / (1.0 - probability)) - math.log(prior / JUDGE.losses[2])
    return max(math.sqrt(2.0 * nats) * std, threshold + std)


def _pressure(loss: float, radius_m: FloatArray, tyres: list[TyreModel]) -> float:
    """Share of the pressure that a relative loss of radius stands for, mean of the tyres."""
    shares = [tyre.pressure_loss(-loss * float(r), 0.0)[0] for tyre, r in zip(tyres, radius_m, strict=True)]
    return min(float(np.mean(shares)), 1.0)
