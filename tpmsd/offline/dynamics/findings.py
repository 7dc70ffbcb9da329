"""From the terms of a selection to findings: where they act, what they are confounded with, how sure they
are.

In: a finished selection. Out: `DynamicsFinding`s, the strongest first, and what the drive could not have
shown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.baselines.base import UNITS, Theta
from tpmsd.car.physics.dynamics_effect import EVENT, DynamicsEffect
from tpmsd.car.physics.dynamics_effects.time_spline import EQUATIONS, DynamicsUnknown
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.competitors import CompetitorNats
from tpmsd.offline.dynamics.model_statistics import ModelStatistics, Slot
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.predict import predicted
from tpmsd.offline.dynamics.result import (
    FINDING,
    SUSPICION,
    DynamicsFinding,
    FittedNuisance,
    FittedNumber,
    Location,
    Residuals,
    UndetectableEffect,
)
from tpmsd.offline.dynamics.search import CompetingSelection, Search
from tpmsd.offline.dynamics.settings import SETTINGS
from tpmsd.offline.dynamics.terms import typical_values

BINS = 12
"""Bins of a covariate in which residuals are shown."""


def findings_of(
    search: Search,
    look: ModelStatistics,
    fitted: CompetitorNats | None = None,
    elsewhere: Mapping[str, Sequence[CompetingSelection]] | None = None,
) -> tuple[DynamicsFinding, ...]:
    """Return findings and suspicions, the strongest on held-out blocks first.

    What has odds of more than twenty against it is no suspicion. `fitted` are log odds of competing names
    that were fitted in a term's place; those of others are of first order. `elsewhere` are selections that
    lack a term, by its key, though another one is exchanged in them.
    """
    slots = [_with_fitted_competitors(look.slot(k), fitted or {}) for k in range(len(search.terms))]
    if not slots:
        return ()
    few = search.part(with_events=True)
    with_all = predicted(few.setup, few.theta, few.at.path)
    alternatives = len({term.name for term in look.offered}) + len(slots)
    found = []
    for k, slot in enumerate(slots):
        if slot.term.nuisance:
            continue
        without = _prediction_without(few, few.without(k))
        refitted = without
        if len(slots) > 1:
            refitted = _prediction_without(
                few, (*few.base, *(term.effect for term in look.refitted_others(k)))
            )
        without_it = (elsewhere or {}).get(slot.term.key, ())
        one = _finding(search, few, slot, Guesses(with_all, without, refitted), alternatives, without_it)
        found.append(replace(one, term=k))
    return drop_unlikely_suspicions(
        promote_strongest_suspicion(sorted(found, key=lambda one: -one.loglik_gain))
    )


def _with_fitted_competitors(slot: Slot, fitted: CompetitorNats) -> Slot:
    """Return a slot in which fitted competitors have their fitted evidence, best first."""
    known = fitted.get(slot.term.key, {})
    competitors = [
        (one, slot.evidence + known[one.name] if one.name in known else value)
        for one, value in slot.competitors
    ]
    return replace(slot, competitors=tuple(sorted(competitors, key=lambda pair: -pair[1])))


def drop_unlikely_suspicions(found: Sequence[DynamicsFinding]) -> tuple[DynamicsFinding, ...]:
    """Return the findings, and the suspicions whose odds are at least those of confounded effects."""
    least = 1.0 / (1.0 + math.exp(SETTINGS.confounded_nats))
    return tuple(one for one in found if one.status == FINDING or one.confidence >= least)


def promote_strongest_suspicion(found: Sequence[DynamicsFinding]) -> tuple[DynamicsFinding, ...]:
    """Return the findings; if there is none, the strongest suspicion becomes the finding `unknown`.

    The strongest of the suspicions that makes the prediction better says where it shows; its name and the
    effects confounded with it are listed as what it may be.
    """
    if any(one.status == FINDING for one in found):
        return tuple(found)
    for k, one in enumerate(found):
        better = one.loglik_gain > 0.0 and one.rms_after < SETTINGS.min_fall * one.rms_before
        if one.p_value <= SETTINGS.max_p_value and better:
            cause = one if one.effect == "unknown" else _as_unknown(one)
            return (*found[:k], replace(cause, status=FINDING), *found[k + 1 :])
    return tuple(found)


def _as_unknown(one: DynamicsFinding) -> DynamicsFinding:
    """Return a finding with the name `unknown` at the same place, its own name among those it may be."""
    return replace(
        one,
        effect="unknown",
        confidence=1.0 - one.confidence,
        parameters={},
        indistinguishable_from=tuple(dict.fromkeys((one.effect, *one.indistinguishable_from))),
        acts_on=one.where.channel,
        may_be_proxy=False,
        unusual=False,
    )


def nuisances_of(search: Search, look: ModelStatistics) -> tuple[FittedNuisance, ...]:
    """Return the nuisances of the model with their values."""
    return tuple(
        FittedNuisance(term.name, _quantities(look.slot(k)))
        for k, term in enumerate(search.terms)
        if term.nuisance
    )


@dataclass(frozen=True)
class Guesses:
    """Predictions from the inputs alone, (n, m) each."""

    with_all: FloatArray
    without: FloatArray
    """Without a finding, the others as they are."""
    refitted: FloatArray
    """Without it, the others fitted again."""


def _prediction_without(few: Search, theta: Theta) -> FloatArray:
    """Return the (n, m) prediction by these effects, some of those of the model."""
    setup = few.setup
    names, fewer = setup.states(few.theta), setup.states(theta)
    rows = [names.index(name) for name in fewer]
    rest = range(len(names), few.at.path.shape[1])
    return predicted(setup, theta, few.at.path[:, [*rows, *rest]])


def _finding(
    search: Search,
    few: Search,
    slot: Slot,
    guesses: Guesses,
    alternatives: int,
    elsewhere: Sequence[CompetingSelection],
) -> DynamicsFinding:
    """Return the finding or suspicion for a term of the model."""
    setup, term = search.setup, slot.term
    with_all, without = guesses.with_all, guesses.without
    change = with_all - without
    readings = few.setup.readings()
    known = np.isfinite(readings)
    change = np.where(known, change, 0.0)
    strength = np.sqrt((change**2).mean(axis=0)) / search.noise.outputs
    output = int(np.argmax(strength))
    channel = setup.channels[output]
    before, after = (
        math.sqrt(float(np.nanmean((readings[:, output] - guess[:, output]) ** 2)))
        for guess in (without, with_all)
    )
    duration = max(float(setup.drive.time_s[-1] - setup.drive.time_s[0]), 1.0)
    p_value = 1.0 - (1.0 - min(slot.p_value, 1.0)) ** alternatives
    p_value = max(p_value, min(alternatives * slot.p_value, 1.0) if slot.p_value < 1e-9 else p_value)
    competitors = [(competitor.name, value) for competitor, value in slot.competitors]
    odds = [value - slot.evidence for _, value in competitors] + [one.nats for one in elsewhere]
    confounded_with = _confounded_with(search, competitors, slot.evidence, elsewhere)
    against = sum(math.exp(min(nats, 50.0)) for nats in odds)
    against += odds_of_neutral_values(slot.evidence, slot.distance)
    with_nameless_term = search.may_be_proxy and search.has_unnamed_term and term.name != "unknown"
    against += math.exp(min(term.proxy_nats, 50.0))
    if search.competitor is not None and term.key not in search.competitor.keys:
        against += math.exp(min(search.competitor.nats, 50.0))
    if term.name != "unknown":
        time_s = few.setup.drive.time_s
        stays = unexplained_ratio(readings, guesses.refitted, with_all, search.noise.outputs, time_s)
        blocks = len(setup.drive.starts)
        against += math.hypot(stays, relative_block_spread(slot.overdispersion, slot.distance, blocks))
    confidence = 1.0 / (1.0 + against)
    doubtful = is_improbable(against, odds)
    return DynamicsFinding(
        effect=term.name,
        status=SUSPICION if p_value > SETTINGS.max_p_value or doubtful else FINDING,
        confidence=0.5 * confidence if with_nameless_term else confidence,
        p_value=p_value,
        parameters=_quantities(slot),
        where=_location(few.setup, few, slot, channel, change[:, output]),
        rms_before=before,
        rms_after=after,
        loglik_gain=slot.heldout_gain,
        loglik_gain_per_s=slot.heldout_gain / duration,
        evidence=slot.evidence,
        indistinguishable_from=confounded_with,
        distinguished_by=term.effect.wording.distinguished_by,
        shape=_shape(slot),
        acts_on=getattr(term.effect, "on", ""),
        may_be_proxy=with_nameless_term or term.unusual,
        unusual=term.unusual,
        residuals=_residuals(few, slot, readings[:, output], without[:, output], with_all[:, output]),
    )


def _confounded_with(
    search: Search,
    competitors: Sequence[tuple[str, float]],
    evidence: float,
    elsewhere: Sequence[CompetingSelection],
) -> tuple[str, ...]:
    """Return the names about as likely in a term's place, and those of other selections without it."""
    least = -SETTINGS.confounded_nats
    names = [name for name, value in competitors if value - evidence > least]
    own = {term.key for term in search.terms}
    for one in elsewhere:
        names += [key.split(":")[0] for key in sorted(one.keys - own) if one.nats > least]
    return tuple(dict.fromkeys(names))


def is_improbable(odds_against: float, competitors_nats: Sequence[float]) -> bool:
    """Return True if a name, together with competitors of about its evidence, is less likely than the rest.

    `odds_against` are the odds against the name, in which the competing names, of log odds
    `competitors_nats`, are summed.
    """
    similar = sum(math.exp(nats) for nats in competitors_nats if abs(nats) <= SETTINGS.confounded_nats)
    return odds_against - similar > 1.0 + similar


def odds_of_neutral_values(evidence: float, distance: float) -> float:
    """Return the odds that a term's values are the neutral ones, by its log evidence (nats).

    A Bayes factor is at most exp(d^2 / 2) ([Edwards 1963]), with `distance` d^2 in squared standard
    deviations: a value whose interval holds the default is hardly better than none, whatever the fit gains.
    """
    return math.exp(min(-min(evidence, 0.5 * distance), 50.0))


def unexplained_ratio(
    readings: FloatArray, without: FloatArray, with_all: FloatArray, noise: FloatArray, time_s: FloatArray
) -> float:
    """Return the prediction error left with a term over the error that the term removes.

    Both are root mean squares beyond the noise of a reading, in its standard deviations, over all outputs:
    the tangent of the angle between what is missing and the name's part of it. Under a random direction in
    their plane an angle has a probability that is proportional to it. Where more stays unexplained than a
    name explains, the name is as likely to be a part of what is missing.
    """
    before, after = ((readings - guess) / noise for guess in (without, with_all))
    taken = float(np.sum(np.nanmean(before**2, axis=0) - np.nanmean(after**2, axis=0)))
    return math.sqrt(max(correlated_mean_square(after, time_s), 0.0) / max(taken, 1e-9))


def relative_block_spread(overdispersion: float, distance: float, blocks: int) -> float:
    """Return the spread of a term's value between blocks, beyond the noise, over the value.

    It is the other part of what is missing: a constant of the car is the same in all blocks. `distance` is
    that from the values that do nothing, squared, in standard deviations with the overdispersion in them.
    """
    return math.sqrt(blocks * max(1.0 - 1.0 / overdispersion, 0.0) / max(distance, 1e-9))


def correlated_mean_square(errors: FloatArray, time_s: FloatArray) -> float:
    """Return the mean product of errors of neighbouring rows, summed over outputs; NaN are left out.

    Rows are no farther apart than a disturbance lasts. For white noise it is 0, whatever its size,
    and with many pairs it is known several times better than a mean square less that of the noise.
    """
    step = float(np.median(np.diff(time_s)))
    total, count = np.zeros(errors.shape[1]), np.zeros(errors.shape[1])
    for lag in range(1, max(round(SETTINGS.disturbance_time_s / step), 1) + 1):
        near = time_s[lag:] - time_s[:-lag] < (lag + 0.5) * step
        products = (errors[lag:] * errors[:-lag])[near]
        total += np.nansum(products, axis=0)
        count += np.isfinite(products).sum(axis=0)
    return float(np.sum(total / np.maximum(count, 1.0)))


def _residuals(
    few: Search, slot: Slot, reading: FloatArray, without: FloatArray, with_all: FloatArray
) -> Residuals | None:
    """Return mean residuals of an output over the finding's covariate; None where there are too few rows."""
    covariate = _covariate(slot.term.effect)
    along = few.covariates[covariate]
    known = np.isfinite(reading)
    if known.sum() < 20 * BINS:
        return None
    edges = np.quantile(along[known], np.linspace(0.0, 1.0, BINS + 1)[1:-1])
    which = np.searchsorted(edges, along[known])
    count = np.maximum(np.bincount(which, minlength=BINS), 1)

    def mean(values: FloatArray) -> FloatArray:
        """Return the (BINS,) means of values by bin."""
        return np.asarray(np.bincount(which, values, minlength=BINS) / count)

    after = reading[known] - with_all[known]
    size = float(np.std(after)) / np.sqrt(count)
    before = mean(reading[known] - without[known]) / size
    return Residuals(covariate, mean(along[known]), before, mean(after) / size)


def _covariate(effect: DynamicsEffect) -> str:
    """Return the covariate that an effect depends on; time where it has none."""
    return getattr(effect, "over", effect.covariate) or "time"


def _quantities(slot: Slot) -> dict[str, FittedNumber]:
    """Return the term's fitted numbers by name: a spline's amplitude, else its parameters."""
    term = slot.term
    if term.free and term.free[0].startswith("heights["):
        size = float(np.std(term.values()))
        return {
            "amplitude": FittedNumber(
                size, float(np.mean(slot.std)) / math.sqrt(len(slot.std)), unit_of(term.effect)
            )
        }
    out = {
        name: FittedNumber(term.value(name), float(std), term.effect.unit_of(name))
        for name, std in zip(term.free, slot.std, strict=True)
    }
    for name, value in term.effect.values().items():
        if name not in out and name in ("onset_s", "duration_s") and isinstance(value, float):
            std = term.spread.get(name, SETTINGS.wind_box_s / math.sqrt(12.0))
            out[name] = FittedNumber(value, std, "s")
    return out


def unit_of(effect: DynamicsEffect) -> str:
    """Return the unit of a spline's values."""
    if isinstance(effect, DynamicsUnknown):
        return EQUATIONS.get(effect.on) or UNITS[effect.on]
    return effect.unit_of("heights")


def _shape(slot: Slot) -> tuple[tuple[float, float, float], ...]:
    """Return (knot, height, standard deviation) of a spline; empty for other effects."""
    effect = slot.term.effect
    knots: Sequence[float] = getattr(effect, "knots", ())
    return tuple(
        (float(at), float(value), float(std))
        for at, value, std in zip(knots, slot.term.values(), slot.std, strict=False)
    )


def _location(setup: Setup, few: Search, slot: Slot, channel: str, change: FloatArray) -> Location:
    """Return covariate and range of the rows that hold nine tenths of the change, or the time spans."""
    effect = slot.term.effect
    if effect.kind == EVENT:
        onset, duration = (float(getattr(effect, name)) for name in ("onset_s", "duration_s"))
        return Location(channel, None, None, ((onset, onset + duration),))
    covariate = _covariate(effect)
    along = few.covariates[covariate]
    order = np.argsort(along)
    mass = np.cumsum(change[order] ** 2)
    if not mass[-1] > 0.0:
        return Location(channel, covariate, None)
    low, high = (float(along[order][np.searchsorted(mass, part * mass[-1])]) for part in (0.05, 0.95))
    return Location(channel, covariate, (low, high))


def not_detectable(search: Search, look: ModelStatistics, threshold: float) -> tuple[UndetectableEffect, ...]:
    """Return the effects that this drive shows only if larger than typical, with the sizes needed."""
    out = []
    done: set[str] = set()
    for k, term in enumerate(look.offered):
        if term.jump or term.name in done:
            continue
        done.add(term.name)
        addition = look.addition(k)
        if not addition.visible:
            units = {name: (None, term.effect.unit_of(name)) for name in term.free}
            out.append(UndetectableEffect(term.name, units))
            continue
        sizes = dict(zip(term.free, addition.sizes_at_evidence(threshold), strict=True))
        typical = typical_values(term)
        if all(sizes[name] > typical[name] for name in term.free):
            out.append(
                UndetectableEffect(
                    term.name, {n: (float(v), term.effect.unit_of(n)) for n, v in sizes.items()}
                )
            )
    return tuple(out)
