"""Changes of radii that may have begun at any sample of a drive, beside all that is nuisance on it.

In: a `RadiusReference` as the drive began, and its samples. Out: for each hypothesis of one its size with
covariance, all nuisance parameters estimated beside it, and the log-likelihood of the drive without any.

A generalised likelihood ratio [Willsky 1976]: one Kalman filter without a change, and for each hypothesis of
a change the sensitivity F of that filter to it. With the innovation v, its covariance S and the gain K of the
filter, a change d of the radii by the share g of the moment adds to what the filter sees

    v:  J d    with  J = g - h F          F <- F + K J

and its information and estimate are sums of J' S^-1 J and J' S^-1 v. So growth, slip and load that this drive
shows are no change, and what they leave open widens its covariance. A step is g = 1 from its onset on, a ramp
the number of samples since (the leak of half an hour); a ramp's change is that of the last sample.

Wheels may be of another size since before the drive (`sizes`) and a tyre lose air on it. With the step at the
first sample as J_0, a change x p of the radii since then, x normal with mean m and variance s^2, adds

    b = p' sum J_0' S^-1 v + m / s^2,    i = p' (sum J_0' S^-1 J_0) p + 1 / s^2,    c = p' sum J_0' S^-1 J

and x integrated out leaves of the change its information less c c' / i and its sum less c b / i.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.baseline.reference import SIZE, Innovation, RadiusReference
from tpmsd.onboard.monitor.evidence.sizes import TyreSizeChange
from tpmsd.onboard.monitor.sampling.slip_sums import Slope
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, JUDGE


@dataclass(frozen=True, slots=True)
class Changes:
    """Under r rows of sizes, of n hypotheses."""

    change: FloatArray
    """(r, n, d) by now."""
    covariance: FloatArray
    """(r, n, d, d)"""
    log_weight: FloatArray
    """(r, n) log of the prior weight of row and onset, and of what the row adds to the likelihood of the
    drive if no tyre has lost air."""
    size: FloatArray
    """(r,) of each row, if no tyre has lost air, and ..."""
    size_variance: FloatArray
    """(r,)"""


class _Marginalized(NamedTuple):
    """Sums of `Changes` before the changes are solved for."""

    information: FloatArray
    vector: FloatArray
    log_gain: FloatArray
    size: FloatArray
    variance: FloatArray


class ChangeBank:
    """One change hypothesis of a drive. Radii are relative to nominal throughout."""

    def __init__(self, reference: RadiusReference, scatter: FloatArray) -> None:
        """`scatter` (d, d): covariance that this change hypothesis adds to every sample; `reference` is used
        up.
        """
        d = len(scatter)
        self._reference, self._scatter = reference, scatter
        self.samples = 0
        self.log_likelihood = 0.0
        """Log-likelihood of all samples if no tyre has changed."""
        self._onset = np.empty(0, dtype=np.intp)
        self._ramp = np.empty(0, dtype=np.bool_)
        self._sensitivity = np.empty((0, SIZE, d))
        self._information = np.empty((0, d, d))
        self._vector = np.empty((0, d))
        self._shared_with_first = np.empty((0, d, d))
        """Information that each hypothesis shares with the step at the first sample."""

    def update(
        self, deviation: FloatArray, noise: FloatArray, h: FloatArray, elapsed_s: float, sizes: TyreSizeChange
    ) -> None:
        """Update all hypotheses by a sample: (d,), its covariance (d, d) and features (d, SIZE); `elapsed_s`
        of driving since the one before."""
        left = self._reference.predict(elapsed_s)
        self._sensitivity *= left[:, None]
        self._add_hypotheses(len(deviation))
        found = self._reference.correct(deviation, noise + self._scatter, h)
        share = np.where(self._ramp, self.samples - self._onset, 1.0)
        seen = share[:, None, None] * np.eye(len(deviation)) - h @ self._sensitivity
        self._add_measurement(seen, found)
        self.samples += 1
        self._prune(sizes)

    def update_slip(self, slope: Slope) -> None:
        """Update by a slip slope: it holds no change of radii, but separates slip from change in the
        samples."""
        found, h = self._reference.learn_slip(slope)
        seen = -(h @ self._sensitivity)
        self._add_measurement(seen, found)

    def _add_measurement(self, seen: FloatArray, found: Innovation) -> None:
        """Update sums and sensitivities by a measurement, of which a change adds `seen` (n, m, d) to the
        filter's innovation."""
        weighted = seen.transpose(0, 2, 1) @ np.linalg.inv(found.spread)
        self._information += weighted @ seen
        self._shared_with_first += weighted[0] @ seen
        self._vector += weighted @ found.value
        self._sensitivity += found.gain @ seen
        _, log_volume = np.linalg.slogdet(found.spread)
        squares = found.value @ np.linalg.solve(found.spread, found.value)
        self.log_likelihood -= 0.5 * float(squares + log_volume)

    def _add_hypotheses(self, d: int) -> None:
        """Add a step with this sample, and a ramp that begins with the one before."""
        self._onset = np.append(self._onset, [self.samples, self.samples - 1])
        self._ramp = np.append(self._ramp, [False, True])
        self._sensitivity = np.concatenate([self._sensitivity, np.zeros((2, SIZE, d))])
        self._information = np.concatenate([self._information, np.zeros((2, d, d))])
        self._vector = np.concatenate([self._vector, np.zeros((2, d))])
        self._shared_with_first = np.concatenate([self._shared_with_first, np.zeros((2, d, d))])

    def _prune(self, sizes: TyreSizeChange) -> None:
        """Keep the hypotheses of the start, those too young to be judged, and the likeliest of the others,
        each under the size that fits it best."""
        age = self.samples - self._onset
        keep = (self._onset <= 0) | (age <= JUDGE.full_samples)
        if bool(keep.all()):
            return
        rest = self._marginalized(sizes, np.ones_like(keep))
        gains = 0.5 * np.einsum(
            "rnd,rnde,rne->rn", rest.vector, _regularised_inverse(rest.information), rest.vector
        )
        gain = np.max(gains + (sizes.log_prior + rest.log_gain)[:, None], axis=0)
        for of_shape in (self._ramp, ~self._ramp):
            others = np.flatnonzero(~keep & of_shape)
            keep[others[np.argsort(-gain[others])][: DRIVE_EVIDENCE.kept]] = True
        self._onset, self._ramp = self._onset[keep], self._ramp[keep]
        self._sensitivity, self._information = self._sensitivity[keep], self._information[keep]
        self._vector, self._shared_with_first = self._vector[keep], self._shared_with_first[keep]

    def changes(self, sizes: TyreSizeChange) -> Changes:
        """Return the changes by the hypotheses that are old enough, under each of the rows of sizes."""
        age = self.samples - self._onset
        old = age >= JUDGE.full_samples
        rest = self._marginalized(sizes, old)
        scale = np.where(self._ramp, age - 1.0, 1.0)[old]
        covariance = _regularised_inverse(rest.information)
        change = np.einsum("rnde,rne->rnd", covariance, rest.vector)
        first = self._onset[old] <= 0
        share = np.where(
            first,
            DRIVE_EVIDENCE.start_prior / max(int(first.sum()), 1),
            (1.0 - DRIVE_EVIDENCE.start_prior) / max(int((~first).sum()), 1),
        )
        log_share = np.log(share) - math.log(float(share.sum()) if share.size else 1.0)
        return Changes(
            change * scale[:, None],
            covariance * scale[:, None, None] ** 2,
            sizes.log_prior[:, None] + rest.log_gain[:, None] + log_share,
            rest.size,
            rest.variance,
        )

    def change_since_first(self) -> tuple[FloatArray, FloatArray]:
        """Return the change since the first sample (d,) and its covariance (d, d), by all samples so far."""
        covariance = _regularised_inverse(self._information[:1])[0]
        return covariance @ self._vector[0], covariance

    def _marginalized(self, sizes: TyreSizeChange, chosen: NDArray[np.bool_]) -> _Marginalized:
        """Return the moments of the chosen hypotheses with the sizes integrated out; r rows, n hypotheses."""
        with np.errstate(divide="ignore"):
            own = np.where(sizes.variance > 0.0, 1.0 / sizes.variance, np.inf)
        information, vector = self._information[chosen], self._vector[chosen]
        if not self._onset.size:
            return _Marginalized(information[None], vector[None], np.zeros(1), np.zeros(1), np.zeros(1))
        pattern = sizes.pattern
        seen = np.einsum("rd,de,re->r", pattern, self._information[0], pattern)
        variance = 1.0 / (seen + own)
        own_mean = np.where(np.isfinite(own), own, 0.0) * sizes.mean
        size = variance * (pattern @ self._vector[0] + own_mean)
        log_gain = 0.5 * (size**2 / np.maximum(variance, 1e-300) - sizes.mean * own_mean)
        log_gain -= 0.5 * np.log1p(seen * sizes.variance)
        shared = np.einsum("rd,nde->rne", pattern, self._shared_with_first[chosen])
        return _Marginalized(
            information - variance[:, None, None, None] * shared[..., None] * shared[..., None, :],
            vector - shared * size[:, None, None],
            log_gain,
            size,
            variance,
        )

    def reference_fitted_jointly(self, row: int, index: int, sizes: TyreSizeChange) -> RadiusReference:
        """Return the car's reference fitted jointly with the change at this row and index of `changes`.

        The filter without a change is off by F d; d is known with the covariance C:  x - F d,  P + F C F'.
        A size since the first sample is a second one, known beside d.
        """
        chosen = np.zeros(self._onset.size, dtype=np.bool_)
        k = int(np.flatnonzero(self.samples - self._onset >= JUDGE.full_samples)[index])
        chosen[k] = True
        rest = self._marginalized(sizes, chosen)
        covariance = _regularised_inverse(rest.information[row])[0]
        change = covariance @ rest.vector[row, 0]
        of_size = self._sensitivity[0] @ sizes.pattern[row]
        size, variance = float(rest.size[row]), float(rest.variance[row])
        shared = sizes.pattern[row] @ self._shared_with_first[k]
        sensitivity = self._sensitivity[k] - variance * np.outer(of_size, shared)
        out = self._reference.copy()
        out.mean = out.mean - size * of_size - sensitivity @ change
        spread = out.covariance + sensitivity @ covariance @ sensitivity.T
        spread = spread + variance * np.outer(of_size, of_size)
        out.covariance = (spread + spread.T) / 2
        return out


def _regularised_inverse(information: FloatArray) -> FloatArray:
    """Return the inverse (..., d, d) of information matrices, regularised so that one of hardly any
    information is no failure."""
    largest = np.trace(information, axis1=-2, axis2=-1)[..., None, None]
    return np.linalg.inv(information + DRIVE_EVIDENCE.min_std * largest * np.eye(information.shape[-1]))
