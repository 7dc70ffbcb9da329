"""The hypotheses: terms that may be added to the rolling model, each a few combinations of columns.

In: the names of the columns. Out: `Term`s of the catalogue with one or several shapes each, and scans
over the large families (radius ramps of any onset and length, smooth terms at any place over any
covariate).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from tpmsd.car.physics.catalogue import ALWAYS, EFFECTS, EVENTS, FAULT, FREE, groups
from tpmsd.car.physics.effect import Effect, Kind
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.hypotheses.group_gain import gain_of_rows
from tpmsd.offline.diagnosis.hypotheses.prices import RAMPED_PLACES, grid_price, ramp_price, shape_price
from tpmsd.offline.diagnosis.hypotheses.response import PLACES
from tpmsd.offline.diagnosis.settings import SETTINGS

PATTERNS: dict[str, tuple[str, ...]] = {
    **{place: (place,) for place in PLACES},
    "front": ("fl", "fr"),
    "rear": ("rl", "rr"),
    "left": ("fl", "rl"),
    "right": ("fr", "rr"),
    "all": ("fl", "fr", "rl", "rr"),
}
ANTISYMMETRIC: dict[str, tuple[tuple[str, float], ...]] = {
    "front minus rear": (("fl", 1.0), ("fr", 1.0), ("rl", -1.0), ("rr", -1.0)),
    "left minus right": (("fl", 1.0), ("fr", -1.0), ("rl", 1.0), ("rr", -1.0)),
    "diagonal": (("fl", 1.0), ("fr", -1.0), ("rl", -1.0), ("rr", 1.0)),
}

Name = tuple[str, ...]
RAMPED, SLIPPING = "deviation_m", "slip"
"""Parameter that is linear, of a ramp of the radius and of an event."""

PULSED = ("fl", "fr", "rl", "rr", "front", "rear")
"""Wheels and axles that may act for a span of time."""


def numbers_of(wheels: str) -> tuple[int, ...]:
    """Numbers of wheels by name, with blanks between."""
    return tuple(WHEELS.index(wheel) for wheel in wheels.split())


def wheels_of(place: str) -> tuple[int, ...]:
    """Numbers of the wheels of a place."""
    return tuple(WHEELS.index(wheel) for wheel in PATTERNS[place])


@dataclass(frozen=True, eq=False)
class Term:
    """One hypothesis."""

    effect: str
    design: FloatArray
    """(1 + p, k)"""
    parameters: tuple[str, ...]
    """Names of the k values."""
    penalty: float
    """Nats that it must bring to pay for its freedom."""
    wheel: str = ""
    """Of a change of radius also several, with blanks between."""
    span_s: tuple[float, float] = (0.0, 0.0)
    """Of a ramp: onset and end; of a pulse, from when to when."""
    at: float | None = None
    """Value of the parameter that enters nonlinearly."""
    second: float | None = None
    """Of a second such parameter; None where there is none, or it is typical."""
    course: str = ""
    """Of a ramp; empty: the plainest."""
    place: str = ""
    covariate: str = ""
    knots: tuple[float, ...] = ()
    """Of a smooth term with finer knots than its covariate's usual ones."""
    drive: int | None = None
    """Number of the one drive in which it acts; None where it acts in all."""

    @cached_property
    def acting(self) -> tuple[np.ndarray, FloatArray]:
        """Numbers (m,) of the columns behind the data that it combines, and how (m, k)."""
        rows = np.flatnonzero(np.any(self.design[1:] != 0.0, axis=1))
        return rows, self.design[1 + rows]

    def gain(self, gram: FloatArray, b: FloatArray) -> tuple[float, float]:
        """Log-likelihood that it brings, and its first value, as `group_gain`."""
        return gain_of_rows(*self.acting, gram, b)

    def price(self, first: float) -> float:
        """The penalty, given the first value: rare values are penalised."""
        return self.penalty + self.kind_of.against(first)

    @property
    def kind_of(self) -> type[Effect]:
        """The effect itself."""
        return EFFECTS[self.effect]

    @property
    def free(self) -> bool:
        """Whether this is a description without a formula."""
        return self.kind_of.kind is Kind.FREE

    @property
    def ramp(self) -> bool:
        """Whether this is a radius that steps or ramps once."""
        return self.kind_of.ramp

    @property
    def on_radii(self) -> bool:
        """Whether the values are changes of single wheels' radii in metres."""
        return (self.free and self.place not in ("gnss_speed", "gnss_course", "yaw_rate")) or self.ramp

    @property
    def calibrates(self) -> bool:
        """Whether this is never a finding, but what instruments always do."""
        return self.kind_of.kind is Kind.NUISANCE

    @property
    def pulse(self) -> bool:
        """Whether this acts from one time to another, in `span_s`."""
        return self.span_s[1] > self.span_s[0] and not self.ramp

    @property
    def key(self) -> tuple[str, ...]:
        """What makes two terms rivals for one place in the model: an effect may act once (per wheel, per
        place).
        """
        drive = "" if self.drive is None else str(self.drive)
        return (self.effect, self.wheel, self.place, self.covariate, drive)

    @property
    def typical(self) -> bool:
        """Whether the parameter that enters nonlinearly, if there is one, has its middle value."""
        grid = self.kind_of.grid
        return grid is None or self.at == grid.middle


class Hypotheses:
    """All terms that a drive's columns allow."""

    bounds: Mapping[tuple[str, str], tuple[float, float]] = MappingProxyType({})
    """Of the values, by effect and parameter: what may be fitted on this car."""
    completions: Mapping[tuple[str, str], str] = MappingProxyType({})
    """By effect and parameter, the other effects' parameter that its bounds include."""
    radius_m: FloatArray = np.full(4, 0.3)
    driven: np.ndarray = np.ones(4, dtype=np.bool_)
    """(4,) each, of the car."""

    def __init__(self, names: list[Name], ramp_knots_s: FloatArray, unusable: frozenset[str]) -> None:
        """`names` are those of the columns, the data's own first; `unusable` effects are left out."""
        self.place = {name: k for k, name in enumerate(names)}
        self.width = len(names)
        self.knots_s = ramp_knots_s
        self.nuisance = self._unit([name for name in names if name[0] in ALWAYS])
        self.catalogue = [term for term in self._catalogue() if term.effect not in unusable]
        self.wheels = [wheel for wheel in WHEELS if ("ramp", wheel, "0") in self.place]
        pairs = [
            (a, b)
            for a in range(SETTINGS.hypotheses.ramp_knots)
            for b in range(a + 1, SETTINGS.hypotheses.ramp_knots + 1)
        ]
        self._pairs = pairs
        self._ramps = np.zeros((SETTINGS.hypotheses.ramp_knots, len(pairs)))
        for k, (a, b) in enumerate(pairs):
            self._ramps[a:b, k] = 1.0 / (b - a)
        self._smooth = self._smooth_groups()

    @property
    def everything(self) -> FloatArray:
        """(1 + p, k) calibration and every effect of the catalogue that is linear: the fullest model.

        What it leaves is noise, whatever is missing: the noise is first estimated from it (Mallows,
        Technometrics 15, 1973).
        """
        singles = [
            term.design
            for term in self.catalogue
            if term.design.shape[1] == 1 and term.typical and not term.kind_of.mirror_of
        ]
        return np.concatenate([self.nuisance, *singles], axis=1)

    def widen(self, width: int) -> None:
        """Make room for columns that were added at the end."""
        more = width - self.width
        if more <= 0:
            return

        def wider(design: FloatArray) -> FloatArray:
            return np.concatenate([design, np.zeros((more, design.shape[1]))])

        self.width = width
        self.nuisance = wider(self.nuisance)
        self.catalogue = [replace(term, design=wider(term.design)) for term in self.catalogue]
        self._smooth = [replace(term, design=wider(term.design)) for term in self._smooth]

    def _unit(self, names: list[Name]) -> FloatArray:
        out = np.zeros((self.width, len(names)))
        for k, name in enumerate(names):
            out[self.place[name], k] = 1.0
        return out

    def _catalogue(self) -> list[Term]:
        out = []
        for group in groups():
            if any(probe.key not in self.place for probe in group):
                continue
            name, place, at = group[0].effect, group[0].place, group[0].at
            price = SETTINGS.hypotheses.per_value_nats * len(group) + grid_price(EFFECTS[name], at)
            price += math.log(max(len(EFFECTS[name].places), 1))
            design = self._unit([probe.key for probe in group])
            parameters = tuple(probe.parameter for probe in group)
            out.append(Term(name, design, parameters, price, place=place, at=at))
        return out

    def add_ramp(self, wheel: str, span_s: tuple[float, float], column: int, course: str = "") -> None:
        """A ramp off the grid, whose response is that column."""
        design, price = self._column(column), ramp_price(course)
        term = Term(FAULT.name, design, (RAMPED,), price, wheel=wheel, span_s=span_s, course=course)
        self.catalogue.append(term)

    def add_off_grid(
        self, like: Term, at: float, columns: Sequence[int], second: float | None = None
    ) -> None:
        """A term whose nonlinear parameters lie off the grid, with the response to each of its values."""
        price = like.penalty - grid_price(like.kind_of, like.at, like.second)
        price += grid_price(like.kind_of, at, second)
        design = np.concatenate([self._column(column) for column in columns], axis=1)
        moved = replace(like, design=design, penalty=price, at=at, second=second, drive=None)
        self.catalogue.append(moved)

    def add_pulse(self, like: Term, span_s: tuple[float, float], column: int) -> None:
        """A pulse off the grid."""
        self.catalogue.append(self._pulse(like.effect, like.place, span_s, self._column(column)))

    def add_shapes(
        self, like: Term, knots: tuple[float, ...], columns: dict[str, list[int]], drives: int
    ) -> None:
        """Smooth terms over a term's covariate with finer knots, whose hats are these columns by place."""
        for pattern, places in _patterns():
            if all(place in columns for place, _ in places):
                design = np.zeros((self.width, len(columns[places[0][0]])))
                for place, sign in places:
                    design[columns[place], np.arange(design.shape[1])] = sign
                term = self._shape(pattern, like.covariate, design, knots)
                self.catalogue.append(term if like.drive is None else for_drive(term, like.drive, drives))

    def _column(self, column: int) -> FloatArray:
        design = np.zeros((self.width, 1))
        design[column, 0] = 1.0
        return design

    def _pulse(self, effect: str, place: str, span_s: tuple[float, float], design: FloatArray) -> Term:
        """A pulse of the radii on some wheels, or the event that looks so: its value is then a slip."""
        price = SETTINGS.hypotheses.per_value_nats + math.log(
            len(PULSED) / 2 * SETTINGS.hypotheses.ramp_knots**2
        )
        if effect == FREE.name:
            return Term(effect, design, ("height_m",), price, span_s=span_s, place=place, covariate="time")
        slip = -design * self.mean_radius_m(place)
        return Term(effect, slip, (SLIPPING,), price, span_s=span_s, place=place)

    def mean_radius_m(self, place: str) -> float:
        """Of the wheels of a place."""
        return float(self.radius_m[list(wheels_of(place))].mean())

    def pulse_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """For each wheel and axle the best pulse (a ramp up between two knots, one down between two others),
        and the events that look so.
        """
        out = []
        middle = 0.5 * (self.knots_s[1:] + self.knots_s[:-1])
        columns = {wheel: self._ramp_columns(wheel) - 1 for wheel in self.wheels}
        for place in PULSED:
            wheels = PATTERNS[place]
            if any(wheel not in columns for wheel in wheels):
                continue
            at = [columns[wheel] for wheel in wheels]
            both = sum(gram[np.ix_(a, c)] for a in at for c in at)
            own = np.diag(both)
            size = own[:, None] + own[None, :] - both - both.T
            floor = 1e-6 * float(np.max(size, initial=1e-30))
            total = sum(b[a] for a in at)
            score = total[:, None] - total[None, :]
            gain = np.triu(np.where(size > floor, 0.5 * score**2 / np.maximum(size, floor), 0.0), 1)
            i, j = (int(k) for k in np.unravel_index(int(np.argmax(gain)), gain.shape))
            design = np.zeros((self.width, 1))
            for a in at:
                design[a[i] + 1, 0], design[a[j] + 1, 0] = 1.0, -1.0
            span = (float(middle[i]), float(middle[j]))
            slip = -float(score[i, j] / max(size[i, j], floor)) / self.mean_radius_m(place)
            # Of an axle, events alone: a shape over what both wheels share is told better by its covariate.
            free = (FREE.name,) if len(wheels) == 1 else ()
            for effect in (*free, *self._events(place, slip, span[1] - span[0])):
                out.append((float(gain[i, j]), self._pulse(effect, place, span, design)))
        return out

    def _events(self, place: str, slip: float, duration_s: float) -> list[str]:
        """Events that make these wheels slip so for so long."""
        wheels = list(wheels_of(place))
        driven, axle = bool(self.driven[wheels].all()), len(wheels) == 2
        return [name for name in EVENTS if EFFECTS[name].fits_span(slip, duration_s, driven, axle)]

    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """For each wheel, and each pair that may change alike, the best ramp and its gain.

        All wheels that are read would show against the receiver alone, whose slow error looks alike.
        """
        out = []
        for wheels in (PATTERNS[place] for place in RAMPED_PLACES):
            if not set(wheels) <= set(self.wheels) or (len(wheels) > 1 and set(wheels) == set(self.wheels)):
                continue
            at = [self._ramp_columns(wheel) - 1 for wheel in wheels]
            score = self._ramps.T @ sum(b[a] for a in at)
            both = sum(gram[np.ix_(a, c)] for a in at for c in at)
            information = np.einsum("ik,ik->k", self._ramps, both @ self._ramps)
            floor = 1e-6 * float(np.max(information, initial=1e-30))
            gain = 0.5 * score**2 / np.maximum(information, floor)
            best = int(np.argmax(np.where(information > floor, gain, 0.0)))
            out.append((float(gain[best]), self.ramp(" ".join(wheels), best)))
        return out

    def ramp(self, wheels: str, pair: int) -> Term:
        """The radius change of a wheel, or of several alike, between a pair of knots."""
        a, b = self._pairs[pair]
        design = np.zeros((self.width, 1))
        for wheel in wheels.split():
            design[self._ramp_columns(wheel)[a:b], 0] = 1.0 / (b - a)
        span = (float(self.knots_s[a]), float(self.knots_s[b]))
        return Term(FAULT.name, design, (RAMPED,), ramp_price(), wheel=wheels, span_s=span)

    def _ramp_columns(self, wheel: str) -> np.ndarray:
        """(knots,) places of a wheel's ramps in the common index."""
        return np.array([self.place[("ramp", wheel, str(k))] for k in range(SETTINGS.hypotheses.ramp_knots)])

    def _smooth_groups(self) -> list[Term]:
        number: dict[tuple[str, str], int] = {}
        for name in self.place:
            if name[0] == "smooth":
                at = (name[1], name[2])
                number[at] = max(number.get(at, 0), int(name[3]) + 1)
        out = []
        for covariate in sorted({covariate for _, covariate in number}):
            for pattern, places in _patterns():
                if any(("smooth", place, covariate, "0") not in self.place for place, _ in places):
                    continue
                hats = number[places[0][0], covariate]
                design = np.zeros((self.width, hats))
                for place, sign in places:
                    for k in range(hats):
                        design[self.place[("smooth", place, covariate, str(k))], k] = sign
                out.append(self._shape(pattern, covariate, design))
        return out

    @staticmethod
    def _shape(place: str, covariate: str, design: FloatArray, knots: tuple[float, ...] = ()) -> Term:
        values = tuple(f"at_{k + 1}" for k in range(design.shape[1]))
        penalty = shape_price(design.shape[1])
        return Term(FREE.name, design, values, penalty, place=place, covariate=covariate, knots=knots)

    def shapes_over(self, like: Term) -> list[Term]:
        """All smooth terms over a term's covariate, of any pattern and knots."""
        pool = [term for term in self.catalogue if term.free and not term.pulse]
        both = (like.covariate, like.drive)
        return [term for term in (*pool, *self._smooth) if (term.covariate, term.drive) == both]

    def smooth_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Gain of every smooth term."""
        return [(term.gain(gram, b)[0], term) for term in self._smooth]


def _patterns() -> list[tuple[str, tuple[tuple[str, float], ...]]]:
    """Where a smooth term may act: its name, and the places with their signs."""
    alike = [(name, tuple((place, 1.0) for place in places)) for name, places in PATTERNS.items()]
    return [*alike, *ANTISYMMETRIC.items()]


def for_drive(term: Term, drive: int, drives: int) -> Term:
    """A term as that of one of so many drives: the choice must be paid for."""
    return replace(term, drive=drive, penalty=term.penalty + math.log(drives))
