"""The answer of a diagnosis in sentences, which comes first in text, JSON and page.

In: `RollingDiagnosis`. Out: sentences. The words for an effect are its own (`tpmsd.car.physics.in_words`).
"""

from __future__ import annotations

from collections.abc import Mapping

from tpmsd.car.physics import in_words
from tpmsd.car.physics.catalogue import NONPARAMETRIC
from tpmsd.foundation.english import listed
from tpmsd.offline.diagnosis.assessment.result import (
    CONSISTENT,
    FINDING,
    INSUFFICIENT,
    Finding,
    NotDetectable,
    Quantity,
    RollingDiagnosis,
)
from tpmsd.offline.report.simulation_text import baseline_name
from tpmsd.offline.report.wording import covariate_name, wheel_name

NEAREST = 3
"""Effects that are named with their sizes in a sentence; the table has all."""


def summary_sentences(diagnosis: RollingDiagnosis) -> list[str]:
    """Return what was found, what else was taken into account, and what the drive would not show."""
    if diagnosis.verdict == INSUFFICIENT:
        return [f"Nothing can be concluded: {diagnosis.reason}."]
    out = [_finding_sentence(one) for one in diagnosis.findings if one.status == FINDING]
    if diagnosis.verdict == CONSISTENT:
        out.append(f"The drive agrees with {baseline_name(diagnosis)} within the noise.")
    for one in diagnosis.findings:
        if one.status == FINDING and one.indistinguishable_from:
            confounded_with = listed(
                [in_words.noun(name.partition(":")[0]) for name in one.indistinguishable_from], "or"
            )
            out.append(f"This drive cannot tell {in_words.noun(one.effect)} from {confounded_with}.")
    out += [f"Suspected, not sure: {clause(one)}." for one in diagnosis.findings if one.status != FINDING]
    out += [_capitalised(note.rstrip(".")) + "." for note in diagnosis.notes]
    if diagnosis.verdict != CONSISTENT:
        out.append(f"No other deviation from {baseline_name(diagnosis)} was found.")
    undetected = [one for one in diagnosis.not_detectable if _has_known_size(one)][:NEAREST]
    if undetected:
        out.append(
            f"This drive would not show {listed([detection_limit_text(one) for one in undetected], 'or')}."
        )
    return out


def clause(finding: Finding) -> str:
    """Return a finding as a clause: the effect and its values."""
    if finding.effect == NONPARAMETRIC.name:
        over = covariate_name(finding.where.covariate or "time")
        on = _wheel_names(" ".join(finding.where.wheels)) or finding.where.channel.replace("_", " ")
        return f"something without a name acts on {on} over {over}"
    return in_words.clause(finding.effect, _values_in_words(finding.effect, finding.parameters))


def detection_limit_text(one: NotDetectable) -> str:
    """Return an effect with the sizes below which the drive would not show it, as part of a sentence."""
    sizes = [
        f"{in_words.rounded(value, 0.1 * value, with_std=False)} {unit if unit != '1' else ''}".rstrip()
        for value, unit in one.smallest.values()
        if value is not None
    ]
    return f"{in_words.noun(one.effect)} below {listed(sizes, 'or')}"


def _has_known_size(one: NotDetectable) -> bool:
    return any(value is not None for value, _ in one.smallest.values())


def _finding_sentence(finding: Finding) -> str:
    said = clause(finding)
    if finding.held_by == "recording":
        said = f"what your simulation lacks: {said}"
    elif finding.held_by == "simulation":
        said = f"what your simulation has and the recording has not (recording less simulation): {said}"
    elif finding.held_by == "both":
        said = f"what your simulation has at another size (recording less simulation): {said}"
    if finding.drives:
        said += f" (only in {listed(list(finding.drives))})"
    return f"{_capitalised(said)}."


def _values_in_words(effect: str, parameters: Mapping[str, Quantity]) -> dict[str, in_words.FoundValue | str]:
    out: dict[str, in_words.FoundValue | str] = {}
    for name, one in parameters.items():
        if isinstance(one.value, str):
            out[name] = _wheel_names(one.value)
        else:
            out[name] = in_words.found_value(effect, name, one.value, one.std, one.unit)
    return out


def _wheel_names(words: str) -> str:
    return listed([wheel_name(word) for word in words.split()]) if words else ""


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]
