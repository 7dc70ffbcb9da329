"""Names what the noise model took for radius drift, where wheels drift together.

In: `FoundTerms`, and what was chosen before slow noise was asked. Out: the same, with a spline term
over time if there is one to tell, or the change of a wheel's radius, and the noise fitted jointly.

Every wheel's radius drifts for itself, and how much is estimated from the drive. What
warms one axle, or ages one wheel, raises that estimate as well, and beside so much noise no shape is sure.
But then one group of wheels holds nearly all of the drift, and with wheels that drift independently none
does: there the best one has little more than half of what four separate wheels bring, and an axle that brakes
warm has all of it. So the shape is asked for under the usual noise.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.diagnosis.hypotheses.group_gain import group_gain
from tpmsd.offline.diagnosis.hypotheses.terms import ANTISYMMETRIC, PATTERNS, Term
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.noise import with_usual_drift


def add_common_shape(found: FoundTerms, before: Selection) -> FoundTerms:
    """Return the findings with the shape over time that a group of wheels has in common, where it is
    significant.
    Asked of single drives that read all four wheels: of two wheels alone, only their difference shows. Of one
    wheel it may be a loss of air that was chosen `before`, and was not significant against radius drift.
    """
    regression, selection = found.regression, found.selection
    drive = regression.drives[0]
    if len(regression.drives) > 1 or len(drive.reader.recording.wheels) < len(WHEELS):
        return found
    if drive.noise.radius_drift < SETTINGS.robustness.drifts_from:
        return found
    tried = regression.with_noise({0: with_usual_drift(drive.noise)})
    calm = tried.evidence()
    selector = Selector(calm, regression.hypotheses, last=True)
    terms = [one.term for one in selection.chosen]
    shape = _common_shape(selector, terms)
    if shape is not None:
        shape = _changed_radius(selector, terms, shape, [one.term for one in before.chosen]) or shape
        judged = selector.selection_of([*terms, shape])
        if any(one.term is shape for one in judged.chosen):
            return FoundTerms(tried, judged, calm)
    return found


def _changed_radius(selector: Selector, terms: list[Term], shape: Term, before: list[Term]) -> Term | None:
    """Return the change of the wheel's radius, chosen before, that brings nearly what its spline
    term does.
    """
    gram, b = selector.evidence.projected(selector.design(terms))
    free, _ = group_gain(shape.design[1:], gram, b)
    for term in before:
        if term.ramp and term.wheel == " ".join(PATTERNS.get(shape.pattern, ())) and term not in terms:
            gain, _ = group_gain(term.design[1:], gram, b)
            if gain - term.penalty > (1.0 - SETTINGS.selection.spline_gain_margin) * free - shape.penalty:
                return term
    return None


def _common_shape(selector: Selector, terms: list[Term]) -> Term | None:
    """Return the best shape over time or distance beside the terms, if one group of wheels has it
    to itself.
    """
    gram, b = selector.evidence.projected(selector.design(terms))
    best: tuple[float, Term] | None = None
    for over in ("time", "distance"):
        shapes = {
            term.pattern: term
            for _, term in selector.hypotheses.smooth_gains(gram, b)
            if term.covariate == over and term.pattern in (*PATTERNS, *ANTISYMMETRIC)
        }
        if not set(WHEELS) <= set(shapes):
            continue
        separate = np.concatenate([shapes[wheel].design[1:] for wheel in WHEELS], axis=1)
        whole, _ = group_gain(separate, gram, b)
        for pattern, term in shapes.items():
            # What all wheels have in common may be the receiver's; a reading is no wheel.
            if not term.on_radii or pattern == "all":
                continue
            gain, _ = group_gain(term.design[1:], gram, b)
            if gain > SETTINGS.robustness.together_share * whole and (
                best is None or gain - term.penalty > best[0]
            ):
                best = (gain - term.penalty, term)
    if best is None:
        return None
    term = best[1]
    # Its few knots leave much of it, so the scatter from block to block is its own; what it predicts counts.
    more = selector.heldout([*terms, term]) - selector.heldout(terms)
    return term if more > term.penalty + SETTINGS.selection.admit_nats else None
