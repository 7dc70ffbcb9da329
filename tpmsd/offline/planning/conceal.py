"""Draws effects to be concealed in a recording: those that it can show, at twice their limit or more.

In: a `Recording`, how many, a Generator. Out: effects of the catalogue. The limit is the size that the
diagnosis of the untouched recording states as the smallest that it would have found in 19 of 20 drives
(`not_detectable`): by that recording's noise and radius drift, its gain divided by the overdispersion of its
blocks, beside what the diagnosis finds there. An effect is concealed at its typical value, or at twice the
limit where that is more, and never where another effect or another wheel looks the same, or where the
recording holds the effect already. Nobody asks whether the diagnosis finds the effect. Pure: the same
arguments give the same effects.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS, FAULT, FittedParameter, make_effect, probes
from tpmsd.car.physics.effect import Effect, Kind, Parameter
from tpmsd.car.physics.reading_change import acts_by_road_slope
from tpmsd.foundation.english import counted
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.assessment.identifiability import (
    EffectIdentifiability,
    identifiability,
    prior_scale,
)
from tpmsd.offline.diagnosis.assessment.simulated import widened_design
from tpmsd.offline.diagnosis.hypotheses.terms import numbers_of, wheels_of
from tpmsd.offline.diagnosis.prepared.admission import admitted_readers
from tpmsd.offline.diagnosis.prepared.drive_regression import Refined
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.reporting.detectable import smallest_size, smallest_sizes
from tpmsd.offline.diagnosis.selection.catalogue_effect import effect_of
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.stages import examine
from tpmsd.offline.inference.recording import Recording

SIZES = (0.7, 1.5)
"""Least and greatest share of the usual size that is drawn: sizes of ordinary cars."""
LIMITS = (2.0, 2.5)
"""Least and greatest multiple of the limit that is drawn where the usual size is below."""
MOST = 3.0
"""Usual sizes beyond which an effect is not plausible: three standard deviations of what cars have."""
MAX_SIMILAR = 0.95
"""Cosine of the angle to another effect's sensitivity from which a name is a matter of luck."""
LOSS_M = 1.4e-3
"""Loss of radius (m) at 20 % less pressure, of which UN R64 requires a warning."""
TRIES = 20
"""Draws of place and time of a change of radius, until one is large enough."""


class RecordingInformation:
    """Information that a recording can give."""

    def __init__(self, recording: Recording, progress: Callable[[float], None]) -> None:
        """InputError where the recording cannot be examined."""
        readers, notes = admitted_readers([recording])
        if not readers:
            raise InputError(recording.name, "; ".join(notes))
        self.found = found = examine(Regression(readers), progress)
        self._regression = found.regression
        self._selector = Selector(found.evidence, found.regression.hypotheses)
        self._terms = [one.term for one in found.selection.chosen]
        self._recording = readers[0].recording
        self.identifiable: tuple[EffectIdentifiability, ...] = identifiability(found.regression)

    @property
    def name(self) -> str:
        """Name of the recording in reports."""
        return self._recording.name

    @property
    def duration_s(self) -> float:
        """Duration of the drive, s."""
        return float(self._recording.edges_s[-1])

    @property
    def wheels(self) -> list[int]:
        """Wheels that are read."""
        return self._recording.wheels

    @property
    def present_effects(self) -> set[str]:
        """Names of the effects that the recording holds already."""
        return {term.effect for term in self._terms}

    @property
    def latency_s(self) -> float:
        """GNSS latency found in the recording itself, s; 0 where none is found."""
        found = [effect_of(one.term, one.values) for one in self.found.selection.chosen]
        return sum(one[0].fix_age_s() for one in found if one is not None)

    def smallest_detectable_size(self, name: str, parameter: str) -> float:
        """Return the smallest detectable size of an effect's parameter; infinite if none is."""
        terms = [
            t
            for t in self._regression.hypotheses.catalogue
            if t.effect == name and t.drive is None and t.typical
        ]
        gram, _ = self._selector.evidence.projected(self._selector.design(self._terms))
        sizes, _ = smallest_sizes(self._regression, self._selector, self._terms, gram, terms)
        value, _ = sizes.get(parameter, (None, ""))
        return math.inf if value is None else value

    def smallest_detectable_loss(self, wheel: str, onset_s: float, duration_s: float) -> float:
        """Return the smallest detectable change (m) of a wheel's radius with this course; infinite if none
        is, or where the same course on another wheel is confounded with it.
        """
        regression, drive = self._regression.copied(), self._regression.drives[0]
        wheels = [wheel, *(WHEELS[k] for k in self.wheels if WHEELS[k] != wheel)]
        courses = [Refined(numbers_of(one), onset_s, duration_s) for one in wheels]
        columns = regression.append([(one, {0: one.column(drive.reader, drive.base)}) for one in courses])
        for one, column in zip(wheels, columns, strict=True):
            regression.hypotheses.add_ramp(one, (onset_s, onset_s + duration_s), column)
        ramps = regression.hypotheses.catalogue[-len(wheels) :]
        terms = [
            replace(one, design=widened_design(one.design, regression.hypotheses.width))
            for one in self._terms
        ]
        selector = Selector(regression.evidence(), regression.hypotheses)
        gram, _ = selector.evidence.projected(selector.design(terms))
        if _cosine_to_others(gram, [column - 1 for column in columns]) > MAX_SIMILAR:
            return math.inf
        return smallest_size(regression, selector, terms, gram, ramps[0])


def draw_effects(showing: RecordingInformation, count: int, rng: np.random.Generator) -> tuple[Effect, ...]:
    """Return `count` different effects that are not confounded; ConfigError where the drive cannot show as
    many.
    """
    similar = {
        one.effect: {other for other, cosine in one.confounded_with if other != one.effect}
        for one in showing.identifiable
    }
    names = [one.effect for one in showing.identifiable if not _is_ambiguous(one)]
    candidates = sorted({*filter(_may_be_concealed, names), FAULT.name} - showing.present_effects)
    drawn: list[Effect] = []
    for index in rng.permutation(len(candidates)):
        name = candidates[int(index)]
        if any(name in similar.get(one.name, ()) or one.name in similar.get(name, ()) for one in drawn):
            continue
        effect = _draw_detectable(showing, name, rng)
        if effect is not None:
            drawn.append(effect)
            if len(drawn) == count:
                return tuple(drawn)
    raise ConfigError(
        f"{showing.name}: shows {counted(len(drawn), 'effect')} of a plausible size side by side,"
        f" {count} are wanted (tpmsd effects --drive says which)"
    )


def _is_ambiguous(one: EffectIdentifiability) -> bool:
    """Return whether another effect is confounded with it, other than the one that it tends to for small
    values.
    """
    return any(
        cosine > MAX_SIMILAR and EFFECTS[other].confounding.limit != one.effect
        for other, cosine in one.confounded_with
    )


def _may_be_concealed(name: str) -> bool:
    """Return whether an effect acts by itself and is not in every recording already."""
    effect = EFFECTS[name]
    if (
        effect.kind in (Kind.NONPARAMETRIC, Kind.NUISANCE)
        or effect.identification.always_fitted
        or effect.shortens
        or effect.confounding.mirror_of
    ):
        return False
    return any(not acts_by_road_slope(probe.probing_effect()) for probe in _fitted_parameters(name))


def _fitted_parameters(name: str) -> list[FittedParameter]:
    """Return an effect's fitted parameters, for each wheel pattern and at the middle of its grid."""
    grid = EFFECTS[name].nonlinear.grid
    return [
        probe
        for probe in probes()
        if probe.effect == name and (grid is None or probe.at is None or probe.at == grid.middle)
    ]


def _draw_detectable(showing: RecordingInformation, name: str, rng: np.random.Generator) -> Effect | None:
    """Return a random effect of this name that the drive can show; None where no plausible size is large
    enough.
    """
    if name != FAULT.name:
        return _draw_effect(showing, name, rng)
    for _ in range(TRIES):
        effect = _draw_loss(showing, rng)
        if effect is not None:
            return effect
    return None


def _draw_loss(showing: RecordingInformation, rng: np.random.Generator) -> Effect | None:
    """Return a random loss of air, at once or within minutes, in the middle half of the drive; None where it
    cannot be shown.
    """
    wheel, long_s = WHEELS[int(rng.choice(showing.wheels))], float(rng.choice([0.0, 30.0, 120.0]))
    onset_s = _three_digits(float(rng.uniform(0.3, 0.6)) * showing.duration_s)
    size = _draw_size(rng, LOSS_M, showing.smallest_detectable_loss(wheel, onset_s, long_s))
    if size is None:
        return None
    return make_effect(
        FAULT.name, wheel=wheel, deviation_m=_three_digits(-size), onset_s=onset_s, duration_s=long_s
    )


def _draw_effect(showing: RecordingInformation, name: str, rng: np.random.Generator) -> Effect | None:
    """Return an effect with a random detectable value of its first parameter, on wheels that are read; None
    where there is none.
    """
    known = _fitted_parameters(name)
    first = known[0].parameter if known else ""
    usable = [
        probe
        for probe in known
        if probe.parameter == first and _wheels_are_read(probe.wheel_pattern, showing.wheels)
    ]
    if not usable:
        return None
    probe, cls = usable[int(rng.integers(len(usable)))], EFFECTS[name]
    if not first:
        return (
            probe.probing_effect()
            if LIMITS[0] * showing.smallest_detectable_size(name, first) <= prior_scale(cls, first)
            else None
        )
    size = _draw_size(rng, prior_scale(cls, first), showing.smallest_detectable_size(name, first))
    if size is None:
        return None
    sign = 1.0 if cls.one_sign else float(rng.choice([-1.0, 1.0]))
    parameter = next(p for p in cls.parameters if p.name == first)
    assert isinstance(parameter, Parameter)
    value = _three_digits(parameter.neutral + sign * size)
    low, high = parameter.limits
    return replace(probe, value=value).probing_effect() if low <= value <= high else None


def _draw_size(rng: np.random.Generator, usual: float, limit: float) -> float | None:
    """Return a random size of the usual order, or about twice the limit where that is more; None where that
    is not plausible.
    """
    size = max(float(rng.uniform(*SIZES)) * usual, float(rng.uniform(*LIMITS)) * limit)
    return size if size <= MOST * usual else None


def _cosine_to_others(gram: FloatArray, at: Sequence[int]) -> float:
    """Return the greatest absolute cosine of the first of some columns to the others."""
    inner = gram[np.ix_(at, at)]
    size = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    return float(np.max(np.abs(inner[0, 1:]) / (size[0] * size[1:]), initial=0.0))


def _wheels_are_read(pattern: str, wheels: Sequence[int]) -> bool:
    """Return whether all wheels of a pattern are read; True for an effect without a pattern."""
    return not pattern or set(wheels_of(pattern)) <= set(wheels)


def _three_digits(value: float) -> float:
    """Return the value rounded to three digits, the precision of a stated truth."""
    if value == 0.0:
        return 0.0
    digits = 2 - math.floor(math.log10(abs(value)))
    return round(value, digits)
