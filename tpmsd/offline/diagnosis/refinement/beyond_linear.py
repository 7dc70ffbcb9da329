"""Removes terms that only explain the linearisation error of the others.

In: a `Study` and its `Selection`. Out: what is significant beside the exact response of the others.

A lag of 0.3 s is a shift, its linear response the slope: the error is the curvature, and a faint low-pass has
the same. So each term is tested again with the linearisation error of the other terms subtracted from the
data: a score test at the exact null (Gauss-Newton steps with a constant Jacobian).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.drive_study import DriveStudy
from tpmsd.offline.diagnosis.prepared.study import Study
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.described import effect_of
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence, fitted, gain_of


def needed_exactly(study: Study, selection: Selection, evidence: Evidence, last: bool = False) -> Selection:
    """What was chosen, without terms that do not pay their penalty beside the exact response of the others.

    The weakest is tested first, the strongest never. `last` as of `Selector`.
    """
    selector = Selector(evidence, study.hypotheses, last)
    for one in sorted(selection.chosen, key=lambda chosen: chosen.gain)[:-1]:
        others = [other.term for other in selection.chosen if other is not one]
        ratio = selector.ratio([*others, one.term], len(others))
        if exact_gain(study, selector, others, one.term) / ratio < one.term.penalty:
            return needed_exactly(study, selector.judged(others), evidence, last)
    return selection


def exact_gain(study: Study, selector: Selector, others: Sequence[Term], term: Term) -> float:
    """Log-likelihood that a term brings beside others which act by the forward model (nats)."""
    before = selector.design(others)
    design = np.concatenate([before, term.design], axis=1)
    acting = [drive.acting(design) for drive in study.drives]
    values = selector.evidence.fit(before).values
    gram = np.zeros((0, 0))
    for _ in range(SETTINGS.refinement.exact_rounds):
        null = _Null(others, values[len(values) - sum(one.design.shape[1] for one in others) :])
        gram = np.zeros((1 + design.shape[1],) * 2)
        for number, drive in enumerate(study.drives):
            data = drive.white[:, :, :1] - null.error(study, number)
            rows = np.concatenate([data, acting[number]], axis=2).reshape(-1, len(gram))
            gram += rows.T @ rows
        values, without = fitted(gram[: 1 + before.shape[1], : 1 + before.shape[1]])
    return gain_of(gram) - without


@dataclass(frozen=True)
class _Null:
    """The other terms and their values."""

    terms: Sequence[Term]
    values: FloatArray
    """(k,)"""

    def error(self, study: Study, number: int) -> FloatArray:
        """(w, 9, 1) the linearisation error of one drive, whitened."""
        drive, at = study.drives[number], 0
        effects: list[Effect] = []
        linear = np.zeros(study.width)
        for term in self.terms:
            values = self.values[at : at + term.design.shape[1]]
            at += len(values)
            made = effect_of(term, values) if number in study.acting(term) else None
            if made is not None:
                effects.append(made[0])
                linear += term.design @ made[1]
        return drive.whitened(_linearisation_error(drive, ExtendedModel(tuple(effects)), linear)[:, :, None])


def _linearisation_error(drive: DriveStudy, model: ExtendedModel, linear: FloatArray) -> FloatArray:
    """(w, 9) prediction of a model less the sum of its columns, whose values (1 + p,) are `linear`."""
    more = drive.own(linear[:, None])[1:, 0]
    more[: len(drive.values)] -= drive.values
    used = np.flatnonzero(more)
    change = drive.reader.predict(model) - drive.reader.predicted(drive.base)
    return np.nan_to_num(change - drive.columns.take(1 + used) @ more[used])
