"""The order of the diagnosis of vehicle dynamics: catalogue first, then places, until nothing helps any more.

In: a setup, effects that belong to the baseline. Out: the selection.
"""

from __future__ import annotations

from collections.abc import Callable

from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.offline.dynamics.located import places, refined
from tpmsd.offline.dynamics.look import threshold_of
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.search import Search
from tpmsd.offline.dynamics.settings import SETTINGS

Say = Callable[[float], None]


def searched(setup: Setup, fixed: tuple[DynamicsEffect, ...], say: Say) -> Search:
    """Return the selection once no step helps any more."""
    search = Search(setup, fixed)
    threshold = threshold_of(len({term.name for term in search.offered()}))
    search.keep_stage()
    while len(search.terms) < SETTINGS.most_effects:
        say(0.1 + 0.6 * len(search.terms) / SETTINGS.most_effects)
        if not (search.forward(threshold) or _locate(search, threshold)):
            break
        for _ in range(3):
            if not (len(search.terms) > 1 and search.tidy(threshold)):
                break
        search.keep_stage()
    return search


def _locate(search: Search, threshold: float) -> bool:
    """Add the best term at a place; False if there is none."""
    for place in places(search, nameless=True)[: SETTINGS.tried]:
        # Where the catalogue explains more, and predicts worse, no lesser place is the right one.
        if not place.evidence > max([threshold, *search.rejected.values()]):
            break
        if search.attempt([*search.terms, refined(search, place)]):
            return True
    return False
