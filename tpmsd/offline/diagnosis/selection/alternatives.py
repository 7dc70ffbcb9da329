"""Alternatives to a chosen term, and the confidence that they leave it.

In: what each alternative would bring instead of the term. Out: a probability, and the effects that would do
as well. Pure: the alternatives are gathered by `selector`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tpmsd.offline.diagnosis.hypotheses.terms import Term


@dataclass(frozen=True)
class Alternative:
    """An alternative to a chosen term, given the other chosen ones."""

    name: str
    effect: str
    weight: float
    """Likelihood ratio (0 to 1) of the alternative instead of the term over the term."""
    part_weight: float = 0.0
    """Gain where the alternative replaces one of the term's two values; 0 where it does not."""
    replaces_by: float | None = None
    """Log-likelihood gain by which it would do as well instead of the term; None where it would not."""


def confidence(effect: str, penalised_gain: float, alternatives: Sequence[Alternative]) -> float:
    """Return the probability of an effect among its alternatives and nothing at all, 1 / (sum of likelihood
    ratios).

    Of several alternatives of one name the first, the best, counts, or a later one that replaces a part and
    weighs more. `penalised_gain` (nats) is that of the effect over nothing.
    """
    weights = {effect: 1.0, "": math.exp(-min(max(penalised_gain, -50.0), 50.0))}
    for one in alternatives:
        weights.setdefault(one.name, one.weight)
        if one.part_weight:
            weights[one.name] = max(weights[one.name], one.part_weight)
    return 1.0 / sum(weights.values())


def confounded_effects(alternatives: Sequence[Alternative]) -> tuple[str, ...]:
    """Return the names of the effects that would do as well, the best first."""
    gains: dict[str, float] = {}
    for one in alternatives:
        if one.replaces_by is not None:
            gains.setdefault(one.effect, one.replaces_by)
    return tuple(sorted(gains, key=lambda name: -gains[name]))


def is_same_statement(alternative: Term, term: Term, first: float) -> bool:
    """Return whether an alternative says the same as a term: it is of one effect on the same wheels, an event
    in its place, an effect that differs by sign alone, or one whose simpler limit the term is. `first` is the
    term's first value.
    """
    if alternative.kind_of.confounding.limit == term.effect and term.kind_of.goes_before(first):
        return True
    if (alternative.wheel, alternative.pattern) != (term.wheel, term.pattern):
        return False
    if alternative.effect == term.effect or (alternative.pulse and term.pulse):
        return True
    return (alternative.kind_of.confounding.mirror_of or alternative.effect) == (
        term.kind_of.confounding.mirror_of or term.effect
    )
