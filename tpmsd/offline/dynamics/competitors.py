"""Competitors of the terms of a selection, each fitted in the term's place.

In: a finished selection. Out: log odds of every competitor against the term. Columns tell them apart to first
order alone: an effect that takes the place of a large one must be fitted before their evidence is compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from tpmsd.offline.dynamics.look import Look
from tpmsd.offline.dynamics.search import Search
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.stages import marginal_parts
from tpmsd.offline.dynamics.terms import CandidateTerm

CompetitorNats = Mapping[str, Mapping[str, float]]
"""Log odds of competitors, by the key of the term and by the competitor's name."""


def fitted_competitors(search: Search, look: Look) -> CompetitorNats:
    """Return the log odds of the competitors of each named term, fitted on a part of the blocks."""
    few = search.part()
    whole = len(search.setup.drive.time_s) / len(few.setup.drive.time_s)
    own = few.copied()
    if whole > 1.0 and any(term.name != "unknown" for term in search.named):
        own.fit()
    own.error = own.prediction_error()
    out: dict[str, dict[str, float]] = {}
    for k, term in enumerate(search.terms):
        if term.nuisance or term.name == "unknown":
            continue
        close = _close(look, k)
        if close:
            likelihood, other = _parts(own, own, k)
            for competitor in close:
                fitted = _exchanged(own, k, competitor)
                if fitted is None:
                    continue
                gain, rest = _parts(fitted, own, k)
                nats = whole * (gain - likelihood) + rest - other
                out.setdefault(term.key, {})[competitor.name] = nats
    return out


def _close(look: Look, k: int) -> list[CandidateTerm]:
    """Return the competitors that explain most of what a term explains, and those that its effect names."""
    term, own = look.terms[k], look.evidence(k)
    competitors = look.competitors(k)
    best = {competitor.name: value for competitor, value in reversed(competitors)}
    first: dict[str, CandidateTerm] = {}
    for competitor, value in competitors:
        near = value > SETTINGS.competitor_share * own or competitor.name in term.effect.twins
        if near and best[competitor.name] == value:
            first.setdefault(competitor.name, competitor)
    return list(first.values())[: SETTINGS.tried]


def _exchanged(own: Search, k: int, competitor: CandidateTerm) -> Search | None:
    """Return the selection with a competitor in a term's place, fitted; None where it predicts worse."""
    out = own.copied()
    start = replace(competitor, jump=False)
    terms = [start if j == k else term for j, term in enumerate(out.terms)]
    if not out.attempt(terms):
        return None
    out.settle()
    return out


def _parts(search: Search, judge: Search, k: int) -> tuple[float, float]:
    """Return likelihood and the rest of the log posterior, the choice of a likeliest part with it."""
    likelihood, rest = marginal_parts(search, judge)
    if search.terms[k].separable:
        rest += search.look([]).part_nats(k)
    return likelihood, rest
