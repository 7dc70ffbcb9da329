"""The answer of a diagnosis that began with known effects.

In: the known effects, and the `RollingDiagnosis` of what they left. Out: the `RollingDiagnosis` with these
effects in its baseline and its model.
"""

from __future__ import annotations

from dataclasses import replace

from tpmsd.car.physics.catalogue import TEETH
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.diagnosis.assessment.result import CONSISTENT, FINDING, MISMATCH, Finding, RollingDiagnosis
from tpmsd.offline.diagnosis.settings import SETTINGS

RIPPLE = "amplitude_rad"


def with_known(known: ExtendedModel, rest: RollingDiagnosis) -> RollingDiagnosis:
    """Return the diagnosis of what known effects left, with these in its baseline and its model.

    The ripple of a ring stays in the readings, since its phase is each drive's own: one of the known size is
    no finding.
    """
    same = [one for one in rest.findings if _is_known_ripple(one, known)]
    findings = tuple(one for one in rest.findings if one not in same)
    found = rest.model
    if same:
        wheels = {one.parameters["wheel"].value for one in same if "wheel" in one.parameters}
        kept = [
            k
            for k, effect in enumerate(found)
            if effect.name != TEETH.name or effect.values().get("wheel") not in wheels
        ]
        found = ExtendedModel(tuple(found.effects[k] for k in kept), tuple(found.stds[k] for k in kept))
    verdict = rest.verdict
    if verdict == MISMATCH and not any(one.status == FINDING for one in findings):
        verdict = CONSISTENT
    names = dict.fromkeys(effect.name for effect in known)
    return replace(
        rest,
        verdict=verdict,
        findings=findings,
        baseline=(*rest.baseline, *names),
        model=ExtendedModel(known.effects + found.effects, known.stds + found.stds),
    )


def _is_known_ripple(finding: Finding, known: ExtendedModel) -> bool:
    """Return whether a finding is the ripple of a ring that the known effects hold, within three
    deviations.
    """
    amplitude = finding.parameters.get(RIPPLE)
    if finding.effect != TEETH.name or amplitude is None or not isinstance(amplitude.value, float):
        return False
    wheel = finding.parameters.get("wheel")
    for effect in known:
        values = effect.values()
        size = values.get(RIPPLE)
        if effect.name != TEETH.name or not isinstance(size, float):
            continue
        if wheel is None or values.get("wheel") in (None, wheel.value):
            off = abs(abs(amplitude.value) - abs(size))
            return off <= SETTINGS.report.known_ripple_stds * (amplitude.std or 0.0)
    return False
