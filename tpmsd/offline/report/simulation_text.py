"""What is said where the user's own simulation takes the rolling model's place.

In: `Diagnosis`, `Finding`. Out: words.
"""

from __future__ import annotations

from tpmsd.offline.diagnosis.assessment.result import Diagnosis, Finding, Quantity


def baseline_name(diagnosis: Diagnosis) -> str:
    """What the recording was compared with."""
    return "your simulation" if diagnosis.baseline == ("simulation",) else "the rolling model"


def agreement(diagnosis: Diagnosis) -> str:
    """The sentence for a recording in which nothing was found."""
    if diagnosis.baseline == ("simulation",):
        return "They agree within the noise: the recording holds nothing that your simulation does not."
    return "They agree within the noise: no missing physics was found."


def held_lines(finding: Finding) -> list[str]:
    """Who holds an effect, and what the simulation's own value is; nothing without a simulation."""
    if finding.held_by == "recording":
        return ["the recording holds it, your simulation does not"]
    if finding.held_by == "simulation":
        return ["your simulation holds it, the recording does not: the values are recording less simulation"]
    if finding.held_by == "both":
        own = ", ".join(
            f"{name} = {_text(quantity)}"
            for name, quantity in finding.simulated.items()
            if quantity.std is not None
        )
        line = "both hold it, not alike: the values are recording less simulation"
        return [f"{line}; your simulation has {own}" if own else line]
    return []


def _text(quantity: Quantity) -> str:
    return f"{quantity.value:.4g} +- {quantity.std:.1g} {quantity.unit}".strip()
