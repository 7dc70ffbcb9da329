"""Names what the noise model took for a gyro that drifts, where it drifts far and smoothly.

In: `FoundTerms`. Out: the same, with a spline term of the yaw rate over time instead of a constant
bias, if there is one to tell, and the noise fitted jointly.

A gyro's bias walks at random, and how fast is estimated from the drive. A bias that fades as the sensor warms
raises that estimate, and beside so fast a walk its shape is not sure: what was left of it got the name of a
constant. So the shape is asked for under the walk that gyros usually have, and must be larger than that
makes.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.noise import PRIORS
from tpmsd.offline.inference.noise_fit import refit
from tpmsd.offline.inference.windows import GYRO

TYPICAL = PRIORS["gyro_drift_radps"][0]
DRIFTS = SETTINGS.robustness.gyro_walks_from * TYPICAL
"""Estimated walk (rad/s per square root of a second) that is more than usual."""
GYRO_NOISE = ["gyro_radps", "gyro_drift_radps"]
READING = "yaw_rate"


def add_gyro_drift(found: FoundTerms) -> FoundTerms:
    """Return the findings with the gyro's bias as a spline over time instead of a constant, where
    significant; single drives only."""
    regression, selection = found.regression, found.selection
    drive = regression.drives[0]
    measured = bool(np.isfinite(drive.reader.windows.measured[:, GYRO]).any())
    if len(regression.drives) > 1 or not measured or drive.noise.gyro_drift_radps < DRIFTS:
        return found
    terms = [one.term for one in selection.chosen]
    others = [term for term in terms if term.kind_of.confounding.drifts_into != READING]
    typical = drive.with_noise(replace(drive.noise, gyro_drift_radps=TYPICAL))
    selector = Selector(regression.with_drives([typical]).evidence(), regression.hypotheses, last=True)
    shape = _best_shape(selector, others)
    if shape is not None:
        # What drifts was in the gyro's white noise as well.
        design = drive.data_and_design(selector.design([*others, shape]))
        refitted = refit(drive.reader.windows, design, typical.noise, typical.inflate, GYRO_NOISE)
        tried = regression.with_noise({0: refitted})
        calm = tried.evidence()
        selector = Selector(calm, regression.hypotheses, last=True)
        margin = selector.heldout([*others, shape]) - selector.heldout(terms) - shape.penalty
        if (
            margin > SETTINGS.selection.admit_nats
            and _peak_to_peak(selector, others, shape) > SETTINGS.robustness.gyro_far_radps
        ):
            judged = selector.selection_of([*others, shape])
            if any(one.term is shape for one in judged.chosen):
                return FoundTerms(tried, _with_spline_confidence(judged, shape, margin), calm)
    return found


def _best_shape(selector: Selector, others: list[Term]) -> Term | None:
    """Return the shape of the yaw rate over time or distance that brings most beside the other terms."""
    gram, b = selector.evidence.projected(selector.design(others))
    found = [
        (gain - term.penalty, term)
        for gain, term in selector.hypotheses.smooth_gains(gram, b)
        if term.pattern == READING and term.covariate in ("time", "distance")
    ]
    return max(found, key=lambda entry: entry[0])[1] if found else None


def _peak_to_peak(selector: Selector, others: list[Term], shape: Term) -> float:
    """Return the greatest less the least value at the spline's knots, rad/s."""
    heights = selector.evidence.fit(selector.design([*others, shape])).values[-shape.design.shape[1] :]
    return float(np.ptp(heights))


def _with_spline_confidence(selection: Selection, shape: Term, margin: float) -> Selection:
    """Return the selection with the confidence of its spline term computed from `margin`, nats.

    Knots leave some of the bend between them, so the scatter from block to block is the term's own and says
    nothing about its confidence.
    """
    confidence = 1.0 / (1.0 + math.exp(-min(margin, 50.0)))
    chosen = tuple(
        replace(one, admitted_by=margin, confidence=confidence) if one.term is shape else one
        for one in selection.chosen
    )
    return replace(selection, chosen=chosen)
