"""Sizes that a drive could not have shown: the size from which each effect would have been chosen.

In: the final `Regression`, what was chosen and its evidence. Out: `NotDetectable`s of the effects whose usual
size is smaller than that. A value s of a parameter brings 0.5 * (s * sqrt(I) + z)^2 nats, where I is its
information with calibration and all chosen terms eliminated (their Gram matrix projected out of its column,
divided by the block-wise variance ratio) and z a standard normal number. It is chosen from the nats on that
the selection asks for: what admits a term, its penalty, and what is held against that value. The size is the
one that reaches them in 19 of 20 drives, z = -1.645.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.car.physics.effect import Effect, Kind, Parameter
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.identifiability import prior_scale
from tpmsd.offline.diagnosis.assessment.result import NotDetectable
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS


def not_detectable(
    regression: Regression, selection: Selection, selector: Selector
) -> tuple[NotDetectable, ...]:
    """Return the effects that would have had to be larger than typical to be found, the nearest to its
    typical value first.
    Of an effect without any trace in the drive (no such reading, no such motion) the size is None. Where a
    simulation takes the rolling model's place, sizes are those of a difference: recording less simulation.
    """
    acting_in = 0 if regression.simulation else None
    chosen = [one.term for one in selection.chosen]
    names = {term.effect for term in chosen}
    gram, _ = selector.evidence.projected(selector.design(chosen))
    out: list[tuple[float, NotDetectable]] = []
    for name, effect in EFFECTS.items():
        if name in names or not _has_detectable_size(effect):
            continue
        terms = [
            t
            for t in regression.hypotheses.catalogue
            if t.effect == name and t.drive == acting_in and t.typical
        ]
        smallest, share = smallest_sizes(regression, selector, chosen, gram, terms)
        for one in effect.parameters:
            if isinstance(one, Parameter) and one.probe > 0.0 and not terms:
                smallest[one.name] = (None, one.unit)
        if smallest and share > 1.0:
            out.append((share, NotDetectable(name, smallest)))
    return tuple(one for _, one in sorted(out, key=lambda entry: entry[0]))


def _has_detectable_size(effect: type[Effect]) -> bool:
    """Return whether the smallest detectable size of an effect can be computed from its columns."""
    if effect.kind in (Kind.NONPARAMETRIC, Kind.NUISANCE, Kind.EVENT):
        return False
    # These have searches of their own, and no column tells their sizes.
    how, change = effect.identification, effect.nonlinear
    searched_apart = (change.ramp, change.span, how.by_teeth, how.by_ripple, how.at_walking_pace, how.reads)
    return not (any(searched_apart) or effect.confounding.mirror_of)


def smallest_sizes(
    regression: Regression, selector: Selector, chosen: list[Term], gram: FloatArray, terms: list[Term]
) -> tuple[dict[str, tuple[float | None, str]], float]:
    """Return the smallest size of an effect's parameters that is found beside `chosen`, and the least of them
    in usual sizes.

    `terms` are those of the effect, `gram` (p, p) is the Gram matrix with `chosen` projected out. Each is
    the size of the wheel pattern that shows least, None where none shows; the share is infinite where
    nothing of the effect shows.
    """
    sizes: dict[str, float] = {}
    for name in dict.fromkeys(name for term in terms for name in term.parameters):
        alone = [t for t in terms if t.parameters == (name,)]
        for term in alone or [t for t in terms if name in t.parameters]:
            size = smallest_size(regression, selector, chosen, gram, term, term.parameters.index(name))
            sizes[name] = max(sizes.get(name, 0.0), size)
    if not sizes:
        return {}, math.inf
    kind = terms[0].kind_of
    share = min(size / prior_scale(kind, name) for name, size in sizes.items())
    units = {p.name: p.unit for p in kind.parameters}
    reported: Mapping[str, float] = {name: size for name, size in sizes.items() if name}
    return {
        name: (size if math.isfinite(size) else None, units.get(name, "")) for name, size in reported.items()
    }, share


def smallest_size(
    regression: Regression,
    selector: Selector,
    chosen: list[Term],
    gram: FloatArray,
    term: Term,
    which: int = 0,
) -> float:
    """Return the size of one of a term's values that would be chosen in 19 of 20 drives; infinite if none
    would.
    """
    column = term.design[1:, which]
    total = float(column @ np.asarray(selector.evidence.total)[1:, 1:] @ column)
    information = float(column @ gram @ column)
    if not information > SETTINGS.selection.min_own_share * total:
        return math.inf
    information /= selector.variance_ratio([*chosen, term], len(chosen))
    kind, std = term.kind_of, 1.0 / math.sqrt(information)
    size, least = 0.0, _min_gain(selector, chosen)
    for _ in range(SETTINGS.assessment.size_rounds):
        signs = (1.0,) if kind.one_sign else (1.0, -1.0)
        against = max(0.0, *(kind.penalty(sign * size) for sign in signs))
        nats = least + term.penalty + against
        size = std * (math.sqrt(2.0 * nats) + SETTINGS.assessment.power_stds)
    while size < SETTINGS.assessment.implausible_stds * std and kind.tolerance_note(
        size, std, regression.has_wheel_speeds_only
    ):
        size += std
    return size


def _min_gain(selector: Selector, chosen: list[Term]) -> float:
    """Return the nats beyond its penalty that the selection asks of a term beside those chosen."""
    rest = max(selector.gain(chosen) - selector.gain([]), 0.0)
    return SETTINGS.selection.admit_nats + SETTINGS.selection.share_of_rest * rest
