"""Changes of radii that may have begun at any sample of a drive, beside all that is harmless on it.

In: a `Reference` as the drive began, and its samples. Out: for each hypothesis of one its size with
covariance, all harmless parameters estimated beside it, and the log-likelihood of the drive without any.

A generalised likelihood ratio [Willsky 1976]: one Kalman filter without a change, and for each hypothesis of
a change the sensitivity F of that filter to it. With the innovation v, its covariance S and the gain K of the
filter, a change d of the radii by the share g of the moment adds to what the filter sees

    v:  J d    with  J = g - h F          F <- F + K J

and its information and estimate are sums of J' S^-1 J and J' S^-1 v. So growth, slip and load that this drive
shows are no change, and what they leave open widens its covariance. A step is g = 1 from its onset on, a ramp
the number of samples since (the leak of half an hour); a ramp's change is that of the last sample.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.reference import SIZE, Innovation, Reference
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, JUDGE
from tpmsd.onboard.monitor.slip_sums import Slope


class ChangeBank:
    """One account of a drive. Radii are relative to nominal throughout."""

    def __init__(self, reference: Reference, scatter: FloatArray) -> None:
        """`scatter` (d, d): covariance that this account adds to every sample; `reference` is used up."""
        d = len(scatter)
        self._reference, self._scatter = reference, scatter
        self.samples = 0
        self.log_likelihood = 0.0
        """Of all samples, if no tyre has changed."""
        self._onset = np.empty(0, dtype=np.intp)
        self._ramp = np.empty(0, dtype=np.bool_)
        self._sensitivity = np.empty((0, SIZE, d))
        self._information = np.empty((0, d, d))
        self._vector = np.empty((0, d))

    def take(self, deviation: FloatArray, noise: FloatArray, h: FloatArray, elapsed_s: float) -> None:
        """Take a sample: (d,), its covariance (d, d) and features (d, SIZE); `elapsed_s` of driving since the
        one before."""
        left = self._reference.wander(elapsed_s)
        self._sensitivity *= left[:, None]
        self._add_hypotheses(len(deviation))
        found = self._reference.correct(deviation, noise + self._scatter, h)
        precision = np.linalg.inv(found.spread)
        share = np.where(self._ramp, self.samples - self._onset, 1.0)
        seen = share[:, None, None] * np.eye(len(deviation)) - h @ self._sensitivity
        weighted = seen.transpose(0, 2, 1) @ precision
        self._information += weighted @ seen
        self._vector += weighted @ found.value
        self._sensitivity += found.gain @ seen
        self._weigh(found)
        self.samples += 1
        self._prune()

    def take_slip(self, slope: Slope) -> None:
        """Take a slip slope: no change of radii is in it, but what it says of slip tells slip from change in
        the samples."""
        found, h = self._reference.learn_slip(slope)
        seen = -(h @ self._sensitivity)
        weighted = seen.transpose(0, 2, 1) / found.spread[0, 0]
        self._information += weighted @ seen
        self._vector += weighted @ found.value
        self._sensitivity += found.gain @ seen
        self._weigh(found)

    def _weigh(self, found: Innovation) -> None:
        _, log_volume = np.linalg.slogdet(found.spread)
        squares = found.value @ np.linalg.solve(found.spread, found.value)
        self.log_likelihood -= 0.5 * float(squares + log_volume)

    def _add_hypotheses(self, d: int) -> None:
        """A step with this sample, and a ramp that begins with the one before."""
        self._onset = np.append(self._onset, [self.samples, self.samples - 1])
        self._ramp = np.append(self._ramp, [False, True])
        self._sensitivity = np.concatenate([self._sensitivity, np.zeros((2, SIZE, d))])
        self._information = np.concatenate([self._information, np.zeros((2, d, d))])
        self._vector = np.concatenate([self._vector, np.zeros((2, d))])

    def _solved(self) -> FloatArray:
        """(n, d, d) covariance of each change."""
        d = self._vector.shape[1]
        largest = np.trace(self._information, axis1=1, axis2=2)[:, None, None]
        return np.linalg.inv(self._information + DRIVE_EVIDENCE.least_std * largest * np.eye(d))

    def _prune(self) -> None:
        """Keep the start, what is too young to be judged, and the likeliest of the others."""
        age = self.samples - self._onset
        keep = (self._onset <= 0) | (age <= JUDGE.full_samples)
        gain = np.einsum("nd,nde,ne->n", self._vector, self._solved(), self._vector)
        for of_shape in (self._ramp, ~self._ramp):
            others = np.flatnonzero(~keep & of_shape)
            keep[others[np.argsort(-gain[others])][: DRIVE_EVIDENCE.kept]] = True
        self._onset, self._ramp = self._onset[keep], self._ramp[keep]
        self._sensitivity, self._information = self._sensitivity[keep], self._information[keep]
        self._vector = self._vector[keep]

    def changes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of the hypotheses that are old enough: the change by now (n, d), its covariance (n, d, d) and
        the log of its prior weight among them (n,)."""
        age = self.samples - self._onset
        old = age >= JUDGE.full_samples
        size = np.where(self._ramp, age - 1.0, 1.0)[old]
        covariance = self._solved()[old]
        change = np.einsum("nde,ne->nd", covariance, self._vector[old])
        first = self._onset[old] <= 0
        share = np.where(
            first,
            DRIVE_EVIDENCE.start_prior / max(int(first.sum()), 1),
            (1.0 - DRIVE_EVIDENCE.start_prior) / max(int((~first).sum()), 1),
        )
        log_weight = np.log(share) - math.log(float(share.sum()) if share.size else 1.0)
        return change * size[:, None], covariance * size[:, None, None] ** 2, log_weight

    def reference_beside(self, place: int) -> Reference:
        """What the drive says of the car beside the change at this place of `changes`.

        The filter without a change is off by F d; d is known with the covariance C:  x - F d,  P + F C F'.
        """
        k = int(np.flatnonzero(self.samples - self._onset >= JUDGE.full_samples)[place])
        covariance = self._solved()[k]
        sensitivity = self._sensitivity[k]
        out = self._reference.copy()
        out.mean = out.mean - sensitivity @ covariance @ self._vector[k]
        spread = out.covariance + sensitivity @ covariance @ sensitivity.T
        out.covariance = (spread + spread.T) / 2
        return out
