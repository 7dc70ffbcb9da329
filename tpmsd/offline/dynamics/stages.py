"""The order of the diagnosis of vehicle dynamics: catalogue first, then places, until nothing helps any more.

In: a setup, effects that belong to the baseline. Out: the selection.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import block_diag
from scipy.special import logsumexp

from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.columns import gram
from tpmsd.offline.dynamics.evidence import Statistics
from tpmsd.offline.dynamics.located import fit_located_term, located_terms, nameless, nameless_penalty, slopes
from tpmsd.offline.dynamics.model_statistics import threshold_of
from tpmsd.offline.dynamics.path import Setup, path_log_likelihood, smoothed
from tpmsd.offline.dynamics.search import CompetingSelection, Search
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.terms import CandidateTerm

Say = Callable[[float], None]


def select_model(
    setup: Setup,
    fixed: tuple[DynamicsEffect, ...],
    say: Say,
    simulated: tuple[DynamicsEffect, ...] = (),
) -> Search:
    """Return the likelier of two stepwise selections: one from the catalogue, one that begins with a term
    without a name."""
    search = Search(setup, fixed, simulated)
    threshold = threshold_of(len({term.name for term in search.offered()}))
    search.record_stage()
    search.admit_nuisances()
    plain = search.duplicate()
    _grow(search, threshold, SETTINGS.max_effects, say)
    named = [term for term in search.named if term.name != "unknown"]
    if not named:
        return search
    if (
        len(search.named) == 1
        and (nats := _unnamed_log_odds_in_part(plain, named[0].name)) < -SETTINGS.plain_odds_nats
    ):
        search.competitor = CompetingSelection(nats, frozenset())
        return search
    other = _grow_from_unnamed_term(plain, threshold)
    if other is None:
        return search
    base, first, best = (log_posterior(one, search) for one in (plain, other, search))
    for one, against, nats in ((search, other, first - best), (other, search, best - first)):
        one.competitor = CompetingSelection(nats, frozenset(term.key for term in against.terms))
    chosen = choose_selection(search, other, first - best)
    explained = max(first, best) - base
    chosen.may_be_proxy = first - base > SETTINGS.proxy_share * explained
    return chosen


def choose_selection(search: Search, other: Search, nats: float) -> Search:
    """Return the other selection if its log odds `nats` are positive and it predicts no worse, else this.

    One that is likelier and predicts worse explains how readings follow each other: it does not compete.
    """
    if nats <= 0.0:
        return search
    if other.error <= search.error + SETTINGS.max_error_increase:
        return other
    search.competitor = None
    return search


def _grow(search: Search, threshold: float, most: int, say: Say) -> None:
    """Take steps until none helps, there are `most` terms or a model recurs; then fit to convergence."""
    seen: set[tuple[str, ...]] = set()
    while len(search.named) < most:
        say(0.1 + 0.6 * len(search.named) / SETTINGS.max_effects)
        if not (
            _add_slope(search, threshold)
            or search.forward_step(threshold)
            or _add_located_term(search, threshold)
        ):
            break
        for _ in range(3):
            if not (len(search.terms) > 1 and search.backward_or_exchange_step(threshold)):
                break
        keys = tuple(sorted(term.key for term in search.terms))  # of a wind there may be several spans
        if keys in seen:
            break
        seen.add(keys)
        search.record_stage()
        search.admit_nuisances()
    if not search.terms:
        return
    search.fit_until_converged()
    if [term.key for term in search.terms] == [term.key for term in search.stages[-1].terms]:
        search.stages.pop()
    search.record_stage()


def _grow_from_unnamed_term(plain: Search, threshold: float) -> Search | None:
    """Return the selection that begins with the best term without a name; None where there is no such term.

    Several effects of the catalogue may be proxies of one that is not in it; one term that explains more than
    all of them is the better answer.
    """
    search = plain.duplicate()
    for located in nameless(search)[: SETTINGS.tried]:
        if located.evidence > threshold and search.try_terms(
            [*search.terms, fit_located_term(search, located)]
        ):
            search.kept = located.term.key
            search.record_stage()
            search.admit_nuisances()
            _grow(search, threshold, 4, lambda share: None)
            return search
    return None


def _unnamed_log_odds_in_part(plain: Search, name: str) -> float:
    """Return the log posterior odds of the best term without a name against the only effect that was found,
    in a part of the blocks and in the effect's place.

    Slopes and winds were found beside the terms without a name, and are likelier.
    """
    part = plain.part()
    offered = part.offered()
    own = [term for term in offered if term.name == name]
    nameless_terms = [located.term for located in nameless(part)]
    if not own or not nameless_terms:
        return -math.inf
    look = part.look([*own, *nameless_terms])
    named = max(look.score(k) for k in range(len(own)))
    additions = [look.addition(k) for k in range(len(own), len(look.offered))]
    free = [
        log_marginal_likelihood(
            [term], one.information / one.overdispersion, one.gradient / one.overdispersion
        )
        for term, one in zip(nameless_terms, additions, strict=True)
    ]
    return max(free) - nameless_penalty(part) - named + math.log(len({term.name for term in offered}))


def log_posterior(search: Search, judge: Search) -> float:
    """Return the log of a selection's posterior, up to what all selections share, under another one's noise.

    Values are integrated out over their priors by Laplace's method. Each effect of the catalogue counts as
    one of its alternatives, each term without a name as one of its own. The heights of such a term are a line
    with deviations from it whose scale is unknown.
    """
    return sum(log_posterior_parts(search, judge))


def log_posterior_parts(search: Search, judge: Search) -> tuple[float, float]:
    """Return log-likelihood, which grows with the drive, and the terms of priors and alternatives."""
    effects, noise = search.theta, judge.noise
    noise = noise.for_states(search.noise.states, search.noise)
    at = smoothed(search.setup, effects, search.at.path, noise)
    swings = any(term.swings for term in search.terms)
    rest = (*search.base, *(term.at_rest() if term.swings else term.effect for term in search.terms))
    likelihood = path_log_likelihood(search.setup, at, noise, rest if swings else None)
    if not search.terms:
        return likelihood, 0.0
    _, probes = search.own(0)
    statistics = Statistics(gram(search.setup, effects, at, noise, probes))
    alternatives = math.log(len(search.offered()) + len(search.named))
    penalty = sum(
        nameless_penalty(search) if term.name == "unknown" else alternatives for term in search.named
    )
    return likelihood, log_marginal_likelihood(
        search.terms, statistics.information, statistics.gradient
    ) - penalty


def log_marginal_likelihood(
    terms: Sequence[CandidateTerm], information: FloatArray, gradient: FloatArray
) -> float:
    """Return the log marginal likelihood relative to the present values, averaged over deviation scales."""
    logs = [_laplace_log_integral(terms, information, gradient, share) for share in SETTINGS.wiggle_shares]
    return float(logsumexp(logs)) - math.log(len(logs))


def _laplace_log_integral(
    terms: Sequence[CandidateTerm], information: FloatArray, gradient: FloatArray, wiggle: float
) -> float:
    """Return the log marginal likelihood relative to the present values, for one deviation scale."""
    precision = block_diag(*(prior_precision(term, wiggle) for term in terms))
    offset = np.concatenate([term.prior()[0] for term in terms])
    right = gradient + precision @ offset
    matrix = information + precision
    gain = 0.5 * float(right @ np.linalg.solve(matrix, right) - offset @ precision @ offset)
    return gain - 0.5 * float(np.linalg.slogdet(matrix)[1] - np.linalg.slogdet(precision)[1])


def prior_precision(term: CandidateTerm, wiggle: float) -> FloatArray:
    """Return the inverse covariance of a term's values: of a term without a name a constant, a slope and
    deviations from both with `wiggle` of the term's size."""
    if term.name != "unknown":
        return np.diag(term.prior()[1])
    position = np.linspace(-1.0, 1.0, len(term.free))
    shape = 1.0 + np.outer(position, position) + wiggle**2 * np.eye(len(position))
    return np.asarray(np.linalg.inv(term.prior_std[0] ** 2 * shape))


def _add_slope(search: Search, threshold: float) -> bool:
    """Add a slope of the road that beats the catalogue; False if none does.

    Were it asked last, delays of instruments would be its proxies: they let readings drift.
    """
    for located in slopes(search)[:1]:
        if located.evidence > threshold:
            competitors = search.ranked_terms(search.offered(), located.evidence)
            return not competitors and search.try_terms([*search.terms, fit_located_term(search, located)])
    return False


def _add_located_term(search: Search, threshold: float) -> bool:
    """Add the best term at a place; False if there is none."""
    for located in located_terms(search)[: SETTINGS.tried]:
        # Where the catalogue explains more, and predicts worse, no lesser place is the right one.
        if not located.evidence > max([threshold, *search.rejected.values()]):
            break
        if search.try_terms([*search.terms, fit_located_term(search, located)]):
            return True
    return False
