"""The order of the diagnosis of vehicle dynamics: catalogue first, then places, until nothing helps any more.

In: a setup, effects that belong to the baseline. Out: the selection.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.offline.dynamics.located import located_terms, nameless, refined, slopes
from tpmsd.offline.dynamics.look import threshold_of
from tpmsd.offline.dynamics.noise import Noise
from tpmsd.offline.dynamics.path import Setup, path_cost, smoothed
from tpmsd.offline.dynamics.search import Search
from tpmsd.offline.dynamics.settings import SETTINGS

Say = Callable[[float], None]


def searched(setup: Setup, fixed: tuple[DynamicsEffect, ...], say: Say) -> Search:
    """Return the selection once no step helps any more."""
    search = Search(setup, fixed)
    threshold = threshold_of(len({term.name for term in search.offered()}))
    search.keep_stage()
    _grow(search, threshold, SETTINGS.most_effects, say)
    named = [term for term in search.named if term.name != "unknown"]
    if len(named) < 2:
        return search
    plain = Search(setup, fixed)
    plain.admit()
    other = _nameless_first(setup, fixed, threshold)
    if other is None:
        return search
    base, first, best = (total(one, search) for one in (plain, other, search))
    predicts = other.error <= search.error + SETTINGS.most_worse
    if first > best + SETTINGS.twin_nats and predicts:
        return other
    nameless_there = len(named) < len(search.named)
    search.stand_in = nameless_there and first - base > SETTINGS.stand_in_share * (best - base)
    return search


def _grow(search: Search, threshold: float, most: int, say: Say) -> None:
    """Take steps until none helps, or so many terms are there."""
    while len(search.named) < most:
        say(0.1 + 0.6 * len(search.named) / SETTINGS.most_effects)
        search.admit()
        if not (_sloped(search, threshold) or search.forward(threshold) or _locate(search, threshold)):
            break
        for _ in range(3):
            if not (len(search.terms) > 1 and search.tidy(threshold)):
                break
        search.keep_stage()
    if not search.terms:
        return
    search.settle()
    if [term.key for term in search.terms] == [term.key for term in search.stages[-1].terms]:
        search.stages.pop()
    search.keep_stage()


def _nameless_first(setup: Setup, fixed: tuple[DynamicsEffect, ...], threshold: float) -> Search | None:
    """Return the selection that begins with the best term without a name; None where there is no such term.

    Several effects of the catalogue may stand in for one that is not in it; one term that explains more than
    all of them is the better answer.
    """
    search = Search(setup, fixed)
    search.keep_stage()
    search.admit()
    for located in nameless(search)[: SETTINGS.tried]:
        if located.evidence > threshold and search.attempt([*search.terms, refined(search, located)]):
            search.keep_stage()
            _grow(search, threshold, 4, lambda share: None)
            return search
    return None


def total(search: Search, judge: Search) -> float:
    """Return the log-likelihood of a selection under another one's noise with the priors of its values, less
    half log n per free value."""
    effects, noise = search.theta, judge.noise
    states = len(search.setup.states(effects))
    white = np.concatenate([noise.white[:states], search.noise.white[len(noise.white) :]])
    noise = Noise(white, noise.disturbance, noise.outputs)
    at = smoothed(search.setup, effects, search.at.path, noise)
    free = sum(len(term.free) for term in search.terms)
    count = np.isfinite(at.reading_residual).sum()
    away = sum(float(term.prior()[0] ** 2 @ term.prior()[1]) for term in search.terms)
    return -0.5 * (path_cost(search.setup, at, noise) + away + free * math.log(float(count)))


def _sloped(search: Search, threshold: float) -> bool:
    """Add a slope of the road that beats the catalogue; False if none does.

    Were it asked last, delays of instruments would stand in for it: they let readings drift.
    """
    for located in slopes(search)[:1]:
        if located.evidence > threshold:
            rivals = search.ranked(search.offered(), located.evidence)
            return not rivals and search.attempt([*search.terms, refined(search, located)])
    return False


def _locate(search: Search, threshold: float) -> bool:
    """Add the best term at a place; False if there is none."""
    for located in located_terms(search)[: SETTINGS.tried]:
        # Where the catalogue explains more, and predicts worse, no lesser place is the right one.
        if not located.evidence > max([threshold, *search.rejected.values()]):
            break
        if search.attempt([*search.terms, refined(search, located)]):
            return True
    return False
