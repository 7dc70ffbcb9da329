"""Minimum detectable losses of pressure.

In: the covariances of what is judged. Out: `DetectableLoss`: the smallest loss of one tyre, and of all alike,
that would raise an alarm.

A loss s of the wheels p (1 for each) is known with the standard deviation (p' C^-1 p)^-1/2; let it be d of
these. Its log-likelihood ratio to none is normal about d^2 / 2 with the standard deviation d; in nine of ten
drives it must outweigh its prior odds and those asked for. And the loss must be known to exceed the
threshold as surely, wherever in these nine of ten the estimate lies.

What another load or a trailer may do is confounded with a loss of all alike. With d_r by the drive model r,
which has the probability w_r beside a loss, none is left with the sum of w_r exp(-d_r^2 / 2): so a model of
small w_r in which d_r is small decides on large losses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.tyre import TyreModel
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.settings import JUDGE


@dataclass(frozen=True, slots=True)
class DetectableLoss:
    """Smallest losses that would be seen, as shares of the pressure; 1 where not even a flat tyre would."""

    one_tyre: float
    """Minimum detectable loss of the wheel that is known worst."""
    all_tyres: float
    one_axle: float = 1.0
    """Smallest loss on both tyres of the axle that is known worse."""
    each_m: tuple[float, ...] = ()
    """Minimum detectable loss of radius of each monitored wheel, m."""


@dataclass(frozen=True, slots=True)
class JointLoss:
    """Moments of a relative loss of several wheels alike, by m drive models."""

    information: FloatArray
    """(m,)"""
    weight: FloatArray
    """(m,) probability of each beside such a loss; their sum is 1."""

    @classmethod
    def from_changes(
        cls, change_m: FloatArray, covariance_m2: FloatArray, log_weight: FloatArray, radius_m: FloatArray
    ) -> JointLoss:
        """Return the moments by changes (m, d), their covariances (m, d, d) and the log weights (m,) of the
        models if none has changed; radius_m (d,), 0 for the wheels that lose nothing."""
        of_all = np.broadcast_to(radius_m, change_m.shape)[:, :, None]
        solved = np.linalg.solve(covariance_m2, of_all)[:, :, 0]
        information = solved @ radius_m
        jointly = log_weight + 0.5 * np.einsum("md,md->m", solved, change_m) ** 2 / information
        weight = np.exp(jointly - jointly.max())
        return cls(information, weight / weight.sum())


@dataclass(frozen=True, slots=True)
class LossDetectability:
    """Arguments of `minimum_detectable_losses`: what minimum detectable losses are computed of once they are
    asked for."""

    one_m2: FloatArray
    whole: tuple[FloatArray, FloatArray, FloatArray] | None
    """Changes (m, d), covariances (m, d, d) and log weights (m,) of all alike; None where they are not
    judged."""
    lost: tuple[FloatArray, ...]
    """(d,) each: radii of the wheels that lose alike, first those of all."""
    radius_m: FloatArray
    tyres: list[TyreModel]
    threshold: float
    probability: float

    def losses(self) -> DetectableLoss:
        """Return the minimum detectable losses."""
        similar = (
            ()
            if self.whole is None
            else tuple(JointLoss.from_changes(*self.whole, lost) for lost in self.lost)
        )
        common = self.radius_m, self.tyres, self.threshold, self.probability
        return minimum_detectable_losses(self.one_m2, similar[0] if similar else None, *common, similar[1:])


def minimum_detectable_losses(
    one_m2: FloatArray,
    similar: JointLoss | None,
    radius_m: FloatArray,
    tyres: list[TyreModel],
    threshold: float,
    probability: float,
    axles: tuple[JointLoss, ...] = (),
) -> DetectableLoss:
    """Return the minimum detectable losses. `one_m2` (d, d): covariance by which one tyre is judged;
    `similar`: moments of a loss of all alike, None where it is not judged; radius_m (d,); `threshold`
    relative; `probability` of an alarm; `axles`: moments of a loss of both tyres of each, empty where they
    are not judged."""
    priors = JUDGE.prior_by_size
    # The information of a loss of one wheel alone is an element of the diagonal.
    of_each = radius_m**2 * np.linalg.inv(one_m2).diagonal()
    alone = [JointLoss(np.array([known]), np.ones(1)) for known in of_each]
    smallest = [_smallest_detectable(one, threshold, probability, priors[0]) for one in alone]
    each_m = tuple((np.array(smallest) * radius_m).tolist())
    single = _mean_pressure_loss(max(smallest), radius_m, tyres)
    if similar is None:
        return DetectableLoss(single, 1.0, each_m=each_m)
    all_tyres = _smallest_detectable(similar, threshold, probability, priors[radius_m.size - 1])
    pairs = [_smallest_detectable(axle, threshold, probability, priors[1]) for axle in axles]
    worst = _mean_pressure_loss(max(pairs), radius_m, tyres) if pairs else 1.0
    return DetectableLoss(single, _mean_pressure_loss(all_tyres, radius_m, tyres), worst, each_m)


def _smallest_detectable(known: JointLoss, threshold: float, probability: float, prior: float) -> float:
    """Return the smallest relative loss that raises an alarm where a loss has these moments."""
    std = 1.0 / np.sqrt(known.information)
    nats = math.log(probability / (1.0 - probability)) - math.log(prior / JUDGE.losses[2])
    short = JUDGE.detectable_stds
    # Alone, a model asks for d^2 / 2 - short d = nats; in a sum for at most so much.
    most = (short + math.sqrt(short**2 + 2.0 * nats)) * float(std.max())
    losses = np.linspace(0.0, 1.01 * most, JUDGE.detectable_losses)
    d = losses[:, None] / std
    left = np.exp(short * d - 0.5 * d**2) @ known.weight
    seen = float(losses[int(np.flatnonzero(left > math.exp(-nats))[-1]) + 1])
    return max(seen, threshold + 2.0 * short * float(std[known.weight.argmax()]))


def _mean_pressure_loss(loss: float, radius_m: FloatArray, tyres: list[TyreModel]) -> float:
    """Return the share of the pressure that a relative loss of radius stands for, mean of the tyres, at most
    1."""
    lost_m = (loss * radius_m).tolist()
    shares = [tyre.pressure_loss(-one_m)[0] for tyre, one_m in zip(tyres, lost_m, strict=True)]
    return min(sum(shares) / len(shares), 1.0)
