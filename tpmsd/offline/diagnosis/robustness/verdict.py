"""The verdict: which candidates are findings, which are suspicions, and which are neither.

In: chosen terms, and of a certificate the p-value of each finding. Out: a status for each, the verdict of the
drive and the model less the effects of suspicions. It decides, and writes nothing down; `reporting` writes
down, and decides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from tpmsd.car.physics.effect import Effect, Kind
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.diagnosis.assessment.result import (
    CONSISTENT,
    FINDING,
    MISMATCH,
    SUSPICION,
    Finding,
    RollingDiagnosis,
)
from tpmsd.offline.diagnosis.hypotheses.terms import Term, wheels_acted_on
from tpmsd.offline.diagnosis.robustness.p_value import PValue, discoveries
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.settings import SETTINGS


def status_of(one: Chosen, selection: Selection) -> str:
    """Return the status of a chosen term before any certificate; empty of one that is not reported.

    With the variance from block to block a suspicion does not pay for what was tried.
    """
    if one.admitted_by > 0.0:
        return SUSPICION if is_outweighed(one, selection) else FINDING
    return SUSPICION if one.confidence >= SETTINGS.report.suspected_from else ""


def verdict_of(findings: Sequence[Finding]) -> str:
    """Return the verdict: a mismatch where any finding has the status of a finding, else consistent."""
    return MISMATCH if any(one.status == FINDING for one in findings) else CONSISTENT


def with_decisions(
    diagnosis: RollingDiagnosis, p_values: Sequence[PValue], above_control: Sequence[bool]
) -> RollingDiagnosis:
    """Return the diagnosis with the p-value of each finding, and its status by it.
    A finding stands at the false discovery rate, above the negative control; a suspicion stays one.
    """
    certain = discoveries([one.tail for one in p_values], SETTINGS.robustness.false_discovery_rate)
    findings = tuple(
        replace(
            finding,
            p_value=one.p_value,
            p_value_is_bound=one.is_bound,
            status=FINDING if is_certain and above and finding.status == FINDING else SUSPICION,
        )
        for finding, one, is_certain, above in zip(
            diagnosis.findings, p_values, certain, above_control, strict=True
        )
    )
    return replace(
        diagnosis,
        findings=findings,
        verdict=verdict_of(findings),
        model=without_suspicions(diagnosis.model, findings),
    )


def without_suspicions(model: ExtendedModel, findings: Sequence[Finding]) -> ExtendedModel:
    """Return the model without the effects of findings that are suspicions."""
    doubtful = [finding for finding in findings if finding.status != FINDING]
    stay = [
        k
        for k, effect in enumerate(model.effects)
        if not any(_is_same_effect(one, effect) for one in doubtful)
    ]
    return ExtendedModel(tuple(model.effects[k] for k in stay), tuple(model.stds[k] for k in stay))


def _is_same_effect(finding: Finding, effect: Effect) -> bool:
    """Return whether finding and effect are of one name, with the same values (of a spline term, knots)."""
    if effect.name != finding.effect:
        return False
    if finding.shape:
        return tuple(at for at, _, _ in finding.shape) == tuple(getattr(effect, "knots", ()))
    for name, quantity in finding.parameters.items():
        value = getattr(effect, name)
        if isinstance(quantity.value, str) or isinstance(value, str):
            if str(value) != str(quantity.value):
                return False
        elif not math.isclose(float(value), quantity.value, rel_tol=1e-6, abs_tol=1e-12):
            return False
    return True


def is_outweighed(one: Chosen, selection: Selection) -> bool:
    """Return whether an instrument's effect on wheel differences gains less than a spline on these wheels.

    No formula holds there what is stronger than it; of what the spline's form leaves, an effect over another
    covariate may take up a part without acting itself.
    """
    effect = one.term.kind_of
    if effect.kind is not Kind.INSTRUMENT or effect.identification.shows_in[0] != "wheel_ratio":
        return False
    shapes = (
        each
        for each in selection.chosen
        if each.term.nonparametric and each.term.on_radii and not each.term.pulse
    )
    wheels = _wheels_of(one.term)
    return any(each.heldout_gain > one.heldout_gain and wheels & _wheels_of(each.term) for each in shapes)


def _wheels_of(term: Term) -> set[str]:
    """Return the wheels on which a term acts; all where it does not say."""
    return set(term.wheel.split()) if term.wheel else set(wheels_acted_on(term.pattern))
