"""Which losses of pressure would be seen now.

In: the covariances of what is judged. Out: `Sight`: the smallest loss of one tyre, and of all alike, that
would raise an alarm.

A loss s of the wheels p (1 for each) is known with the standard deviation (p' C^-1 p)^-1/2; let it be d of
these. Its log-likelihood ratio to none is normal about d^2 / 2 with the standard deviation d; in nine of ten
drives it must outweigh its prior odds and those asked for. And the loss must be known to exceed the
threshold as surely, wherever in these nine of ten the estimate lies.
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
    priors = JUDGE.prior_by_size
    # The information of a loss of one wheel alone is an element of the diagonal.
    of_each = radius_m**2 * np.linalg.inv(one_m2).diagonal()
    single = _pressure(_smallest(float(of_each.min()), threshold, probability, priors[0]), radius_m, tyres)
    if all_m2 is None:
        return Sight(single, 1.0)
    of_all = float(radius_m @ np.linalg.solve(all_m2, radius_m))
    alike = _smallest(of_all, threshold, probability, priors[radius_m.size - 1])
    return Sight(single, _pressure(alike, radius_m, tyres))


def _smallest(information: float, threshold: float, probability: float, prior: float) -> float:
    """Relative loss that is seen where a relative loss has this information, 1."""
    std = 1.0 / math.sqrt(information)
    nats = math.log(probability / (1.0 - probability)) - math.log(prior / JUDGE.losses[2])
    short = JUDGE.sight_stds
    return max((short + math.sqrt(short**2 + 2.0 * nats)) * std, threshold + 2.0 * short * std)


def _pressure(loss: float, radius_m: FloatArray, tyres: list[TyreModel]) -> float:
    """Share of the pressure that a relative loss of radius stands for, mean of the tyres."""
    lost_m = (loss * radius_m).tolist()
    shares = [tyre.pressure_loss(-one_m)[0] for tyre, one_m in zip(tyres, lost_m, strict=True)]
    return min(sum(shares) / len(shares), 1.0)
