"""Steps of Gauss-Newton that are no longer than the exact likelihood allows.

In: a `Regression` and its `Selection`. Out: the values of the fit, or a step towards them. A low-pass and a
delay have one tangent: what tells them apart is curvature, and a linear fit that overdoes it takes a drive to
where its columns show nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.beyond_linear import ActingTerms
from tpmsd.offline.diagnosis.selection.catalogue_effect import effect_of
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import fitted
from tpmsd.offline.inference.whitening import Whitener


def damped_values(regression: Regression, selection: Selection) -> FloatArray | None:
    """Return the (k,) values of a selection's fit after a shortened step; None where the full step is the
    likeliest.
    The step is halved as long as the exact likelihood rises.
    """
    fit = selection.fit
    free = fit.design.shape[1] - sum(len(one.values) for one in selection.chosen)
    moving = [effect_of(one.term, one.values) is not None for one in selection.chosen]
    if not any(moving):
        return None
    sizes = [len(one.values) for one in selection.chosen]
    mine = np.concatenate([np.zeros(free, dtype=bool), np.repeat(moving, sizes)])
    effects = [one.term for one, moves in zip(selection.chosen, moving, strict=True) if moves]
    step = _Step(regression, fit.design, mine, effects)
    begin, end = np.concatenate([_values_at_origin(regression, term) for term in effects]), fit.values[mine]
    best, out = step.profile_likelihood(end)[0], None
    for halving in range(1, 1 + SETTINGS.refinement.step_halvings):
        gain, values = step.profile_likelihood(begin + 0.5**halving * (end - begin))
        if gain <= best:
            break
        best, out = gain, values
    return out


class _Step:
    """Exact responses of effects, with everything else fitted linearly."""

    def __init__(
        self, regression: Regression, design: FloatArray, mine: np.ndarray, effects: Sequence[Term]
    ) -> None:
        self._regression, self._effects = regression, effects
        self._mine, self._others = np.flatnonzero(mine), np.flatnonzero(np.logical_not(mine))
        self._made, self._white = [], []
        for drive in regression.drives:
            here = np.isfinite(drive.columns[0])
            made = Whitener.of(drive.reader.windows, drive.noise, here, drive.inflate)
            own = drive.own_design(design)
            used = np.flatnonzero(np.any(own != 0.0, axis=1))
            acting = drive.columns.take(used) @ own[used]
            self._made.append(made)
            self._white.append(made.apply(np.concatenate([drive.columns.take([0]), acting], axis=2)))

    def profile_likelihood(self, values: FloatArray) -> tuple[float, FloatArray]:
        """Return the log-likelihood (nats) of the effects' values with all others fitted, and all values (k,)
        of the design."""
        acting, size = ActingTerms(self._effects, values), 1 + len(self._others)
        gram = np.zeros((size, size))
        for number, (made, white) in enumerate(zip(self._made, self._white, strict=True)):
            error = made.apply(acting.unwhitened_error(self._regression, number)[:, :, None])
            left = white[:, :, :1] - error - (white[:, :, 1 + self._mine] @ values)[:, :, None]
            rows = np.concatenate([left, white[:, :, 1 + self._others]], axis=2).reshape(-1, size)
            gram += rows.T @ rows
        out = np.zeros(len(self._mine) + len(self._others))
        out[self._mine] = values
        out[self._others], gain = fitted(gram)
        return gain - 0.5 * float(gram[0, 0]), out


def _values_at_origin(regression: Regression, term: Term) -> FloatArray:
    """(k,) values of a term in the model about which everything is linear."""
    drive = regression.drives[regression.acting_drives(term)[0]]
    there = drive.own_design(term.design)[1 : 1 + len(drive.values)]
    return np.asarray(np.linalg.lstsq(there, drive.values, rcond=None)[0])
