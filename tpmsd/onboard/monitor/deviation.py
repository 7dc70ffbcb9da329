"""Is a wheel of another size than was learned? A comparison of hypotheses, with slip as a rival.

In: the present change of the radii with its covariance, and the drive models with their probabilities. Out:
for each wheel the probability that its size is off by more than the limit, of either sign.

Model: change = harmless + slip + x * (radius on the wheels of subset S). S is nothing, one wheel (a spare, a
mixed tyre), an axle (chains) or all; x is normal. A driven axle that pulls at low grip slips by centimetres
for seconds, as chains and other tyres would have it: as long as the drive is too short to tell, both are
weighed by how often they occur; later by the drive as a whole.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.grip import Grip
from tpmsd.onboard.monitor.nuisance import log_normal
from tpmsd.onboard.monitor.probability import normal_cdf
from tpmsd.onboard.monitor.settings import JUDGE


class Deviation:
    """Of one car."""

    def __init__(self, wheels: list[int], radius_m: FloatArray, limit_m: FloatArray, grip: Grip) -> None:
        """radius_m, limit_m (d,): nominal radii and the change from which a wheel deviates."""
        self._limit_m, self._grip = limit_m, grip
        groups: dict[tuple[int, ...], None] = {(wheel,): None for wheel in wheels}
        groups |= {tuple(w for w in wheels if w // 2 == axle): None for axle in range(2)}
        groups |= {tuple(wheels): None}
        groups.pop((), None)
        self._resized = np.array([[float(w in group) for w in wheels] for group in groups]) * radius_m
        """(s, d)"""

    def probabilities(
        self, change_m: FloatArray, covariance_m2: FloatArray, models: dict[str, float]
    ) -> FloatArray:
        """(d,) of a change (d,) whose covariance (d, d) holds what is harmless. `models`: probability of each
        drive model; empty while the drive is too short to tell."""
        harmless_m2, log_chance = self._grip.pulling(covariance_m2, models)
        variance = JUDGE.resized_std**2
        sizes = self._resized[:, :, None] * self._resized[:, None, :] * variance
        total_m2 = harmless_m2[:, None] + sizes
        log_none = log_chance + log_normal(change_m, harmless_m2)
        log_resized = np.stack([log_normal(change_m, one) for one in total_m2]) + log_chance[:, None]
        log_resized += math.log(JUDGE.prior_resized)
        top = max(float(log_none.max()), float(log_resized.max()))
        none, resized = np.exp(log_none - top), np.exp(log_resized - top)
        resized /= float(none.sum() + resized.sum())
        # Of the size x given the change: Kalman's gain, mean and variance.
        gain = np.linalg.solve(total_m2, self._resized[None, :, :, None])[..., 0] * variance
        mean = gain @ change_m
        std = np.sqrt(np.maximum(variance - variance * np.einsum("msd,sd->ms", gain, self._resized), 1e-30))
        out = np.zeros(change_m.size)
        for (model, group), chance in np.ndenumerate(resized):
            for wheel in np.flatnonzero(self._resized[group]):
                limit = self._limit_m[wheel] / self._resized[group, wheel]
                x, s = float(mean[model, group]), float(std[model, group])
                out[wheel] += chance * (normal_cdf((-limit - x) / s) + normal_cdf((x - limit) / s))
        return np.minimum(out, 1.0)
