"""Sentences where the user's own simulation takes the rolling model's place, or known effects extend it.

In: `RollingDiagnosis`, `Finding`. Out: words.
"""

from __future__ import annotations

from tpmsd.foundation.plain import with_unit
from tpmsd.offline.diagnosis.assessment.result import Finding, Quantity, RollingDiagnosis


def baseline_name(diagnosis: RollingDiagnosis) -> str:
    """Return the name of the baseline of the diagnosis."""
    if diagnosis.baseline == ("simulation",):
        return "your simulation"
    known = diagnosis.baseline[1:]
    if not known:
        return "the rolling model"
    return f"the rolling model with {', '.join(known[:-1])}{' and ' if known[:-1] else ''}{known[-1]}"


def agreement(diagnosis: RollingDiagnosis) -> str:
    """Return the sentence for a recording in which nothing was found."""
    if diagnosis.baseline == ("simulation",):
        return "They agree within the noise: the recording holds nothing that your simulation does not."
    if len(diagnosis.baseline) > 1:
        return "They agree within the noise: with this model nothing is left."
    return "They agree within the noise: no missing physics was found."


def difference_lines(finding: Finding) -> list[str]:
    """Return whether recording or simulation holds an effect, with the simulation's own values; empty without
    a simulation."""
    if finding.held_by == "recording":
        return ["the recording holds it, your simulation does not"]
    if finding.held_by == "simulation":
        return ["your simulation holds it, the recording does not: the values are recording less simulation"]
    if finding.held_by == "both":
        own = ", ".join(
            f"{name} = {_quantity_text(quantity)}"
            for name, quantity in finding.simulated.items()
            if quantity.std is not None
        )
        line = "both hold it, not alike: the values are recording less simulation"
        return [f"{line}; your simulation has {own}" if own else line]
    return []


def _quantity_text(quantity: Quantity) -> str:
    return with_unit(f"{quantity.value:.4g} +- {quantity.std:.1g}", quantity.unit)
