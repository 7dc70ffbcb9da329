"""Terms that may be added to a baseline: an effect with the numbers that a fit moves, and their priors.

In: a baseline. Out: `CandidateTerm`s, one per effect, or one per value of its grid where it enters
nonlinearly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tpmsd.car.physics.baselines.base import Baseline, Theta
from tpmsd.car.physics.dynamics_catalogue import DYNAMICS_EFFECTS
from tpmsd.car.physics.dynamics_effect import EVENT, NUISANCE, DynamicsEffect
from tpmsd.car.physics.parameters import Parameter
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.columns import Probe
from tpmsd.offline.dynamics.settings import SETTINGS

_KNOT_PROBE = 1e-3


@dataclass(frozen=True)
class CandidateTerm:
    """An effect at the values about which it is linear."""

    effect: DynamicsEffect
    free: tuple[str, ...]
    """Parameters that a fit moves; `heights[k]` for those of a spline."""
    prior_mean: tuple[float, ...]
    prior_std: tuple[float, ...]
    neutral: Mapping[str, float]
    jump: bool = False
    """True if it is looked for as a whole, at a value of its grid, by one column of size one."""
    alternatives: int = 1
    """Terms of this effect among which is chosen."""
    spread: Mapping[str, float] = field(default_factory=dict)
    """Standard deviations by doubt about the span of time, beside those of the fit, by parameter."""
    has_neutral: bool = True
    """True if its distance from values that do nothing can be measured."""

    @property
    def name(self) -> str:
        """Return the effect's name."""
        return self.effect.name

    @property
    def nuisance(self) -> bool:
        """Return True if every car has the effect: it is fitted beside the findings and is none."""
        return self.effect.kind == NUISANCE

    @property
    def key(self) -> str:
        """Return the name, with what parts terms of one name."""
        on = getattr(self.effect, "on", "")
        return f"{self.name}:{on}:{getattr(self.effect, 'over', '')}" if on else self.name

    @property
    def separable(self) -> bool:
        """Return True if each of several free parameters may have a value alone."""
        return self.effect.separable and not self.jump and len(self.free) > 1

    @property
    def strengths(self) -> tuple[str, ...]:
        """Return the free parameters whose neutral values make the effect do nothing."""
        return tuple(name for name in self.free if name not in self.effect.shaped_by)

    @property
    def swings(self) -> bool:
        """Return True if a part of the car's mass swings with it."""
        return self.effect.mass_share() < 1.0

    def at_rest(self) -> DynamicsEffect:
        """Return the effect with its strengths neutral: it does nothing and has its states."""
        return replace(self.effect, **{name: self.neutral[name] for name in self.strengths})

    def value(self, name: str) -> float:
        """Return the value of a free parameter."""
        if name.startswith("heights["):
            return float(self.effect.heights[int(name[8:-1])])  # type: ignore[attr-defined]
        return float(getattr(self.effect, name))

    def values(self) -> FloatArray:
        """Return the values of the free parameters."""
        return np.array([self.value(name) for name in self.free])

    def moved(self, by: FloatArray) -> CandidateTerm:
        """Return the term with its free parameters moved, within their limits."""
        heights = [k for k, name in enumerate(self.free) if name.startswith("heights[")]
        if heights:
            new = tuple(float(v) for v in self.values() + by)
            return replace(self, effect=replace(self.effect, heights=new))  # type: ignore[call-arg]
        limits = {p.name: p for p in self.effect.parameters if isinstance(p, Parameter)}
        changed: dict[str, float] = {}
        for name, step in zip(self.free, by, strict=True):
            low, high = limits[name].limits
            margin = 2.0 * limits[name].probe
            where = self.free.index(name)
            reach = SETTINGS.max_prior_stds * self.prior_std[where]
            low, high = max(low, self.prior_mean[where] - reach), min(high, self.prior_mean[where] + reach)
            changed[name] = float(np.clip(self.value(name) + step, low + margin, high - margin))
        return replace(self, effect=replace(self.effect, **changed))

    def probe_size(self, name: str) -> float:
        """Return the difference by which a free parameter is moved for its derivative."""
        if name.startswith("heights["):
            return _KNOT_PROBE
        return next(p.probe for p in self.effect.numbers() if p.name == name)

    def probes(self, theta: Theta, covariates: Mapping[str, FloatArray]) -> list[Probe]:
        """Return the probes of its free parameters, beside the other effects of a model.

        `covariates` are those of the path, (n,) each, for the basis functions of splines.
        """
        if self.jump:
            return [Probe((*theta, self.effect), 1.0)]
        if self.free[0].startswith("heights["):
            knots: tuple[float, ...] = self.effect.knots  # type: ignore[attr-defined]
            raised = tuple(h + _KNOT_PROBE for h in self.effect.heights)  # type: ignore[attr-defined]
            moved = (*theta, replace(self.effect, heights=raised))  # type: ignore[call-arg]
            along = covariates[getattr(self.effect, "over", "time")]
            return [Probe(moved, _KNOT_PROBE, weights) for weights in hat_functions(along, knots)]
        out = []
        for name in self.free:
            size = self.probe_size(name)
            effect = replace(self.effect, **{name: self.value(name) + size})
            out.append(Probe((*theta, effect), size))
        return out

    def prior(self) -> tuple[FloatArray, FloatArray]:
        """Return mean of the prior minus value, and one over its variance, for each column."""
        if self.jump:
            return np.array([0.0]), np.array([1.0])
        return np.array(self.prior_mean) - self.values(), 1.0 / np.array(self.prior_std) ** 2

    def free_in(self, channels: Sequence[str]) -> tuple[str, ...]:
        """Return the free parameters that can show in these outputs."""
        shows = self.effect.shows_in
        return tuple(name for name in self.free if shows.get(name) is None or shows[name] in channels)

    def only(self, free: tuple[str, ...]) -> CandidateTerm:
        """Return the term with some of its parameters free."""
        rows = [self.free.index(name) for name in free]
        means, stds = (tuple(values[k] for k in rows) for values in (self.prior_mean, self.prior_std))
        return replace(self, free=free, prior_mean=means, prior_std=stds)

    @property
    def unusual(self) -> bool:
        """Return True if a value is one that hardly any car has, by its prior."""
        if self.free[0].startswith("heights["):
            return False
        away = np.abs(self.values() - np.array(self.prior_mean)) / np.array(self.prior_std)
        return bool(np.any(away > SETTINGS.unusual_prior_stds))

    @property
    def proxy_nats(self) -> float:
        """Return the log odds, by the fitted values alone, that the term is a proxy of an effect without a
        name.

        Values of the effect have the density of its prior, those of what has no name Cauchy's of the same
        scale: the odds grow with exp(z^2 / 2) / (1 + z^2), z in standard deviations of the prior.
        """
        if self.free[0].startswith("heights["):
            return -math.inf
        away = (self.values() - np.array(self.prior_mean)) / np.array(self.prior_std)
        ratio = 0.5 * away**2 - np.log1p(away**2) - 0.5 * math.log(0.5 * math.pi)
        return float(np.sum(ratio)) - SETTINGS.nameless_nats

    @property
    def columns(self) -> int:
        """Return how many columns it has."""
        return 1 if self.jump else len(self.free)


def term_of(
    effect: DynamicsEffect, baseline: Baseline, jump: bool = False, alternatives: int = 1
) -> CandidateTerm:
    """Return the term of an effect at its values."""
    numbers = effect.numbers()
    neutral = effect.neutral_values(baseline.car, baseline.nonlinear)
    means, stds = [], []
    for p in numbers:
        assert p.prior is not None
        means.append(neutral[p.name] if p.prior.mean == p.neutral and not effect.grid else p.prior.mean)
        stds.append(p.prior.std)
    names, reachable = tuple(p.name for p in numbers), effect.has_neutral(baseline.nonlinear)
    return CandidateTerm(
        effect, names, tuple(means), tuple(stds), neutral, jump, alternatives, has_neutral=reachable
    )


def spline_term(effect: DynamicsEffect, std: float) -> CandidateTerm:
    """Return the term of a spline effect, each height with this prior about 0."""
    count = len(effect.heights)  # type: ignore[attr-defined]
    return CandidateTerm(
        effect, tuple(f"heights[{k}]" for k in range(count)), (0.0,) * count, (std,) * count, {}
    )


def candidates(
    baseline: Baseline, channels: Sequence[str], taken: Theta = (), simulated: Theta = ()
) -> list[CandidateTerm]:
    """Return a term for every effect with numbers that is not in the model, grids included.

    Parameters that show only in an output that is not among `channels` stay at neutral. Of the effects in
    `simulated`, which a user's simulation has, the recording may have another one.
    """
    there = {effect.name for effect in taken}
    there |= {effect.name for effect in simulated if effect.kind == NUISANCE or not effect.composes}
    out: list[CandidateTerm] = []
    for name, cls in DYNAMICS_EFFECTS.items():
        if name in there or not cls.numbers() or cls.kind == EVENT:
            continue
        if not (cls.applies(baseline.nonlinear, baseline.forces) and acts_jointly(cls, taken)):
            continue
        neutral = cls.neutral_values(baseline.car, baseline.nonlinear)
        if not cls.grid or cls.near_neutral(baseline.nonlinear):
            variants = cls.variants(baseline.nonlinear)
            for fixed in variants:
                effect = cls(**{p.name: neutral[p.name] for p in cls.numbers()}, **fixed)
                term = term_of(effect, baseline, alternatives=len(variants))
                if term.free_in(channels):
                    out.append(term.only(term.free_in(channels)))
        for values in cls.grid:
            if not _all_equal(values, neutral):
                term = term_of(cls(**values), baseline, jump=True, alternatives=len(cls.grid))
                out.append(term.only(term.free_in(channels)))
    return out


def acts_jointly(effect: type[DynamicsEffect] | DynamicsEffect, others: Theta) -> bool:
    """Return True if an effect acts alone, or one that it acts with is there."""
    return not effect.acts_with or any(other.name in effect.acts_with for other in others)


def _all_equal(values: Mapping[str, float], neutral: Mapping[str, float]) -> bool:
    """Return True if all values are (nearly) the neutral ones."""
    return all(abs(value - neutral[name]) < 0.03 for name, value in values.items())


def are_confounded(one: CandidateTerm, other: CandidateTerm) -> bool:
    """Return True if either effect lists the other one as confounded with it."""
    return one.name in other.effect.confounded_with or other.name in one.effect.confounded_with


def typical_values(term: CandidateTerm) -> dict[str, float]:
    """Return the typical differences from neutral, by free parameter."""
    typical = {p.name: p.typical for p in term.effect.numbers()}
    return {name: abs(typical[name] - term.neutral.get(name, 0.0)) for name in term.free if name in typical}


def spaced_knots(first: float, last: float, step: float) -> tuple[float, ...]:
    """Return evenly spaced knots from first to last, about a step apart; at least two."""
    count = max(round((last - first) / step), 1) + 1
    return tuple(float(value) for value in np.linspace(first, last, count))


def drop_points_without_rows(points_s: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the points of time, without those whose neighbours on both sides enclose no row either."""
    rows = np.searchsorted(time_s, points_s)
    before, after = np.diff(rows, prepend=-1) > 0, np.diff(rows, append=len(time_s) + 1) > 0
    return np.asarray(points_s[before | after])


def hat_functions(along: FloatArray, knots: tuple[float, ...]) -> list[FloatArray]:
    """Return the basis functions of a spline that is linear between knots and constant beyond them, (n,)
    each."""
    eye = np.eye(len(knots))
    return [np.interp(along, knots, row) for row in eye]
