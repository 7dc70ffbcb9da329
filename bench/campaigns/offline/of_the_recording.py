"""Names that a recording holds of its own, asked of the untouched recording at their own places.

In: an untouched recording, the same one with an effect concealed in it. Out: each finding of the latter, and
its values in both. A term that has its place already needs no search, so that the untouched recording may
hold it where its own diagnosis named nothing there, or another effect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.stages import examine
from tpmsd.offline.inference.least_squares import fitted
from tpmsd.offline.inference.recording import Recording

CHANCE = 1e-3
"""Probability at which chance makes a term's gain at one place."""
SIGMAS = 1.96
"""Standard deviations of the difference of two values that are the same."""


@dataclass(frozen=True)
class Paired:
    """A term of the recording with a concealed effect, fitted to the untouched one."""

    effect: str
    gain: float
    """Log-likelihood gain (nats) in the untouched recording, beside the other terms but the concealed one."""
    values: FloatArray
    """(k,) in the untouched recording."""
    stds: FloatArray
    """(k,)"""
    there: FloatArray
    """(k,) with the concealed effect."""
    stds_there: FloatArray
    """(k,)"""

    @property
    def own(self) -> bool:
        """Return whether the untouched recording holds the term: beyond chance, and of the same size."""
        beyond = 2.0 * self.gain > float(chi2.isf(CHANCE, len(self.values)))
        apart = np.abs(self.values - self.there) / np.hypot(self.stds, self.stds_there)
        return beyond and bool((apart <= SIGMAS).all())


def examined(recording: Recording) -> FoundTerms:
    """Diagnose one recording."""
    return examine(Regression(admitted_readers([recording])[0]), lambda done: None)


def paired(untouched: FoundTerms, found: FoundTerms, concealed: str, wheel: str = "") -> list[Paired]:
    """Fit the terms of a recording with a concealed effect (on a wheel, if it has one), less this, to the
    untouched recording."""
    drive, other = untouched.regression.drives[0], found.regression.drives[0]
    chosen = [
        one
        for one in found.selection.chosen
        if (one.term.effect, one.term.wheel if wheel else "") != (concealed, wheel)
    ]
    white = [drive.whitened(_at_windows_of(drive, other, one.term)) for one in chosen]
    nuisance = drive.whitened_design(untouched.regression.hypotheses.nuisance)
    out = []
    for k, one in enumerate(chosen):
        rest = [columns for j, columns in enumerate(white) if j != k]
        rows = np.concatenate([drive.white[:, :, :1], nuisance, *rest, white[k]], axis=2)
        flat = rows.reshape(-1, rows.shape[2])
        gram, own = flat.T @ flat, white[k].shape[2]
        values, gain = fitted(gram)
        _, without = fitted(gram[:-own, :-own])
        scale = np.sqrt(np.maximum(np.diag(gram)[1:], 1e-300))
        inner = gram[1:, 1:] / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))
        stds = (np.sqrt(np.diag(np.linalg.inv(inner))) / scale)[-own:]
        out.append(Paired(one.term.effect, gain - without, values[-own:], stds, one.values, one.stds))
    return out


def _at_windows_of(drive: DriveRegression, other: DriveRegression, term: Term) -> FloatArray:
    """(w, 9, k) the responses of a term of another regression, at the windows of a drive; zero where the
    other has none."""
    own = other.own_design(term.design)
    used = np.flatnonzero(np.any(own != 0.0, axis=1))
    columns = np.nan_to_num(other.columns.take(used) @ own[used])
    _, here, there = np.intersect1d(
        drive.reader.windows.index, other.reader.windows.index, return_indices=True
    )
    out = np.zeros((len(drive.reader.windows), *columns.shape[1:]))
    out[here] = columns[there]
    return out
