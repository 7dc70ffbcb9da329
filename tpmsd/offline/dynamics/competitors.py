"""Competitors of the terms of a selection, each fitted in the term's place.

In: a finished selection. Out: log odds of every competitor against the term, and the selection with those in
place that are plainly likelier. Columns tell them apart to first order alone: an effect that takes the place
of a large one must be fitted before their evidence is compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import permutations

from tpmsd.offline.dynamics.model_statistics import ModelStatistics
from tpmsd.offline.dynamics.search import CompetingSelection, Search
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.stages import log_posterior, log_posterior_parts
from tpmsd.offline.dynamics.terms import CandidateTerm, are_confounded

CompetitorNats = Mapping[str, Mapping[str, float]]
"""Log odds of competitors, by the key of the term and by the competitor's name."""
CompetitorFits = Mapping[tuple[str, str], Search]
"""Selections with a competitor in its term's place, by the same."""


CompetitorKeys = Mapping[tuple[str, str], frozenset[str]]
"""Keys of the named terms of these selections, by the same: other terms may have become needless in them."""


@dataclass(frozen=True)
class Compared:
    """A selection, its statistics, and the competitors of its terms."""

    search: Search
    look: ModelStatistics
    competitors: CompetitorNats
    keys: CompetitorKeys

    def selections_without(self) -> dict[str, tuple[CompetingSelection, ...]]:
        """Return for each term the other selections without it, from exchanges of other terms.

        A name is as likely as all the selections that hold it together.
        """
        out: dict[str, tuple[CompetingSelection, ...]] = {}
        for term in self.search.named:
            best: dict[frozenset[str], float] = {}
            own = {keys for (key, _), keys in self.keys.items() if key == term.key}
            for (key, name), keys in self.keys.items():
                if key != term.key and term.key not in keys and keys not in own:
                    nats = self.competitors[key][name]
                    best[keys] = max(best.get(keys, nats), nats)
            out[term.key] = tuple(CompetingSelection(nats, keys) for keys, nats in best.items())
        return out


def exchange_for_likelier(search: Search) -> Compared:
    """Exchange terms for likelier competitors until none is likelier by the odds of confounded effects."""
    seen: set[frozenset[str]] = set()
    search = choose_best_variants(search)
    while True:
        look = search.look([term for term in search.offered() if term.name not in search.rejected])
        nats, fits, keys = fit_competitors(search, look)
        seen.add(frozenset(term.name for term in search.terms))
        other = _likelier_selection(search, look, nats, fits, seen)
        if other is None:
            other = merge_confounded_terms(search)
        if other is search:
            return Compared(search, look, nats, keys)
        search = other


def choose_best_variants(search: Search) -> Search:
    """Return the selection with each effect in its likeliest variant.

    The first step took the variant that was likelier while other effects were missing.
    """
    for name in {term.name: None for term in search.terms}:
        search = _in_best_variant(search, name)
    return search


def _in_best_variant(search: Search, name: str) -> Search:
    """Return the selection with the effect of this name in its likeliest variant; as it is if absent."""
    here = next((term for term in search.terms if term.name == name), None)
    if here is None or len(variants := type(here.effect).variants(search.setup.baseline.nonlinear)) < 2:
        return search
    best, own = search, log_posterior(search, search)
    for fixed in variants:
        effect = replace(here.effect, **fixed)
        if effect == here.effect:
            continue
        other = _exchange_and_fit(search, search.terms.index(here), replace(here, effect=effect))
        if other is not None and (nats := log_posterior(other, search)) > own:
            best, own = other, nats
    if best is not search:
        best.record_stage()
    return best


def merge_confounded_terms(search: Search) -> Search:
    """Return the likeliest selection in which one name does all that it and one confounded with it did.

    Beside the other name, and with nuisances fitted for both, it may stand in a variant or at values from
    which no step leads to those it has alone: nuisances are admitted again.
    """
    if not any(are_confounded(*pair) for pair in permutations(search.named, 2)):
        return search
    few = search.part().duplicate()
    if few.setup is not search.setup:
        few.fit()
        few.error = few.prediction_error()
    best, own = None, log_posterior(few, few)
    for kept, other in permutations(few.named, 2):
        if not are_confounded(kept, other):
            continue
        rest = [term for term in few.named if term is not kept and term is not other]
        for fixed in type(kept.effect).variants(search.setup.baseline.nonlinear):
            terms = [*rest, replace(kept, effect=replace(kept.effect, **fixed))]
            one = _fit_with_nuisances(few, terms)
            if one is not None and (nats := log_posterior(one, few)) > own:
                best, own = terms, nats
    merged = _fit_with_nuisances(search, best) if best is not None else None
    if merged is None or log_posterior(merged, search) <= log_posterior(search, search):
        return search
    merged.record_stage()
    return merged


def _fit_with_nuisances(search: Search, terms: list[CandidateTerm]) -> Search | None:
    """Return a copy with these terms and the nuisances they need, fitted; None where it predicts worse."""
    out = search.duplicate()
    if not out._try_terms(terms, SETTINGS.plain_error_increase):
        return None
    out.admit_nuisances()
    out.fit_until_converged()
    return out if out.error <= search.error + SETTINGS.max_error_increase else None


def _likelier_selection(
    search: Search,
    look: ModelStatistics,
    nats: dict[str, dict[str, float]],
    fits: CompetitorFits,
    seen: set[frozenset[str]],
) -> Search | None:
    """Return the selection with the likeliest competitor in its term's place; None where none is plainly
    likelier, the prediction gets worse, or the selection was there before.

    Odds of a part of the blocks become those of the whole drive where that is asked.
    """
    odds = [
        (value, k, name)
        for k, term in enumerate(search.terms)
        for name, value in nats.get(term.key, {}).items()
        if value > SETTINGS.confounded_nats
    ]
    own = log_posterior(search, search) if odds else 0.0
    for _, k, name in sorted(odds, reverse=True):
        competitor = next(one for one in _close_competitors(look, k) if one.name == name)
        if frozenset(one.name for one in (*search.terms[:k], competitor, *search.terms[k + 1 :])) in seen:
            continue
        other = fits.get((search.terms[k].key, name)) or _exchange_and_fit(search, k, competitor)
        if other is None:
            continue
        nats[search.terms[k].key][name] = gain = log_posterior(other, search) - own
        if gain > 0.0:
            other.record_stage()
            return other
    return None


def fit_competitors(
    search: Search, look: ModelStatistics
) -> tuple[dict[str, dict[str, float]], CompetitorFits, CompetitorKeys]:
    """Return the log odds of the competitors of each named term, fitted on a part of the blocks, the fits
    where that part is the whole drive, and the keys of their terms."""
    few = search.part()
    whole = len(search.setup.drive.time_s) / len(few.setup.drive.time_s)
    own = few.duplicate()
    if whole > 1.0 and any(term.name != "unknown" for term in search.named):
        own.fit()
        own.error = own.prediction_error()
        if own.admit_nuisances():  # competitors have those that the part favours beside them
            own.fit_until_converged()
    own.error = own.prediction_error()
    out: dict[str, dict[str, float]] = {}
    fits: dict[tuple[str, str], Search] = {}
    keys: dict[tuple[str, str], frozenset[str]] = {}
    for k, term in enumerate(search.terms):
        if term.nuisance or term.name == "unknown":
            continue
        close = _close_competitors(look, k)
        if close:
            likelihood, other = _posterior_parts(own, own, k)
            for competitor in close:
                fitted = _exchange_and_fit(own, k, competitor)
                if fitted is None:
                    continue
                at = [one.key for one in fitted.terms].index(competitor.key)
                gain, rest = _posterior_parts(fitted, own, at)
                nats = whole * (gain - likelihood) + rest - other
                out.setdefault(term.key, {})[competitor.name] = nats
                keys[term.key, competitor.name] = frozenset(one.key for one in fitted.named)
                if few.setup is search.setup:
                    fits[term.key, competitor.name] = fitted
    return out, fits, keys


def _close_competitors(look: ModelStatistics, k: int) -> list[CandidateTerm]:
    """Return competitors with most of a term's evidence, and those that its effect names as confounded."""
    term, own = look.terms[k], look.evidence(k)
    competitors = look.competitors(k)
    best = {competitor.name: value for competitor, value in reversed(competitors)}
    first: dict[str, CandidateTerm] = {}
    for competitor, value in competitors:
        near = value > SETTINGS.competitor_share * own or competitor.name in term.effect.confounded_with
        if near and best[competitor.name] == value:
            first.setdefault(competitor.name, competitor)
    return list(first.values())[: SETTINGS.tried]


def _exchange_and_fit(own: Search, k: int, competitor: CandidateTerm) -> Search | None:
    """Return a copy with a competitor in place of term k, fitted; None where it predicts worse."""
    out = own.duplicate()
    start = replace(competitor, jump=False)
    terms = [start if j == k else term for j, term in enumerate(out.terms)]
    if not out.try_terms(terms):
        return None
    out.fit_until_converged()
    if out.admit_nuisances():
        out.fit_until_converged()
    while _remove_needless_term(out, competitor):
        out.fit_until_converged()
    return out


def _remove_needless_term(search: Search, kept: CandidateTerm) -> bool:
    """Remove a term whose evidence is negative, other than `kept`; False if none was removed."""
    look = search.look([])
    for k, term in enumerate(search.terms):
        if term.key != kept.key and look.evidence(k) < 0.0:
            return search.try_terms([one for j, one in enumerate(search.terms) if j != k])
    return False


def _posterior_parts(search: Search, judge: Search, k: int) -> tuple[float, float]:
    """Return log-likelihood and the rest of the log posterior, for the likeliest part of term k."""
    likelihood, rest = log_posterior_parts(search, judge)
    if search.terms[k].separable:
        rest += search.look([]).best_part_nats(k)
    return likelihood, rest
