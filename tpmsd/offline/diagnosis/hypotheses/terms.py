"""The hypotheses: terms that may be added to the rolling model, each a few combinations of columns.

In: terms and the calibration. Out: `Hypotheses`, which hold the terms of the catalogue and the smooth ones,
take further terms off the grid, and scan the large families. `one_drive`, `joint_terms` and
`assessment.simulated` make them of one drive, of several, and of what a simulation lacks.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS, FAULT, NONPARAMETRIC
from tpmsd.car.physics.effect import Effect, Kind
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.hypotheses.group_gain import gain_of_rows
from tpmsd.offline.diagnosis.hypotheses.penalties import grid_penalty, ramp_penalty, spline_penalty
from tpmsd.offline.diagnosis.hypotheses.response import SINGLE_PATTERNS
from tpmsd.offline.diagnosis.settings import SETTINGS

PATTERNS: dict[str, tuple[str, ...]] = {
    **{pattern: (pattern,) for pattern in SINGLE_PATTERNS},
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
    """Return the numbers of wheels by name, with blanks between."""
    return tuple(WHEELS.index(wheel) for wheel in wheels.split())


def wheels_of(pattern: str) -> tuple[int, ...]:
    """Return the numbers of the wheels of a wheel pattern."""
    return tuple(WHEELS.index(wheel) for wheel in PATTERNS[pattern])


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
    """Wheels; of a change of radius also several, with blanks between."""
    span_s: tuple[float, float] = (0.0, 0.0)
    """Times of a ramp: onset and end; of a pulse, from when to when."""
    at: float | None = None
    """Value of the parameter that enters nonlinearly."""
    second: float | None = None
    """Value of a second such parameter; None where there is none, or it is typical."""
    course: str = ""
    """Course of a ramp; empty: the plainest."""
    pattern: str = ""
    covariate: str = ""
    knots: tuple[float, ...] = ()
    """Knots of a smooth term with finer knots than its covariate's usual ones."""
    drive: int | None = None
    """Number of the one drive in which it acts; None where it acts in all."""

    @cached_property
    def nonzero_rows(self) -> tuple[np.ndarray, FloatArray]:
        """Return the positions (m,) of the columns that the design combines, the data not counted, and their
        weights (m, k)."""
        rows = np.flatnonzero(np.any(self.design[1:] != 0.0, axis=1))
        return rows, self.design[1 + rows]

    def gain(self, gram: FloatArray, b: FloatArray) -> tuple[float, float]:
        """Return the log-likelihood gain (nats) of the term and its first fitted value, as `group_gain`."""
        return gain_of_rows(*self.nonzero_rows, gram, b)

    def total_penalty(self, first: float) -> float:
        """Return the penalty (nats) including that of rare values, given the term's first value."""
        return self.penalty + self.kind_of.penalty(first)

    @property
    def kind_of(self) -> type[Effect]:
        """Return the effect's class in the catalogue."""
        return EFFECTS[self.effect]

    @property
    def nonparametric(self) -> bool:
        """True if this is a description without a formula."""
        return self.kind_of.kind is Kind.NONPARAMETRIC

    @property
    def ramp(self) -> bool:
        """True if this is a radius that steps or ramps once."""
        return self.kind_of.nonlinear.ramp

    @property
    def on_radii(self) -> bool:
        """True if the values are changes of single wheels' radii in metres."""
        return (
            self.nonparametric and self.pattern not in ("gnss_speed", "gnss_course", "yaw_rate")
        ) or self.ramp

    @property
    def calibrates(self) -> bool:
        """True if this is a nuisance of instruments and so never a finding."""
        return self.kind_of.kind is Kind.NUISANCE

    @property
    def pulse(self) -> bool:
        """True if this acts from one time to another, in `span_s`."""
        return self.span_s[1] > self.span_s[0] and not self.ramp

    @property
    def key(self) -> tuple[str, ...]:
        """Return what may act only once in a model: effect, wheel, pattern, covariate and drive; terms of
        equal key are alternatives."""
        drive = "" if self.drive is None else str(self.drive)
        return (self.effect, self.wheel, self.pattern, self.covariate, drive)

    @property
    def typical(self) -> bool:
        """True if the parameter that enters nonlinearly, if there is one, has its middle value."""
        grid = self.kind_of.nonlinear.grid
        return grid is None or self.at == grid.middle


@dataclass(frozen=True)
class CarLimits:
    """Knowledge of the car for the hypotheses; by default a car of usual size, all wheels driven,
    no limits.
    """

    bounds: Mapping[tuple[str, ...], tuple[float, float]] = field(default_factory=dict)
    """Bounds of the values, by effect and parameter: what may be fitted on this car; of one wheel, by effect,
    parameter and wheel."""
    completions: Mapping[tuple[str, str], str] = field(default_factory=dict)
    """Parameters, by effect and parameter: the other effects' parameter that its bounds include."""
    radius_m: FloatArray = field(default_factory=lambda: np.full(4, 0.3))
    driven: np.ndarray = field(default_factory=lambda: np.ones(4, dtype=np.bool_))
    """(4,) each."""


ANY_CAR = CarLimits()


class Hypotheses(ABC):
    """Terms that may be added to the rolling model; complete once its constructor has run."""

    def __init__(
        self, nuisance: FloatArray, catalogue: Sequence[Term], splines: Sequence[Term], car: CarLimits
    ) -> None:
        """`nuisance` (1 + p, k) is the calibration, whose rows are those of all designs; `catalogue` may be
        added to, `splines` are the terms on the covariates' usual knots."""
        self.nuisance = nuisance
        self.width = len(nuisance)
        self.catalogue = list(catalogue)
        self.splines = list(splines)
        self.car = car

    @property
    def fullest_design(self) -> FloatArray:
        """Return the design (1 + p, k) of calibration and every effect of the catalogue that is linear and
        not rare.
        What it leaves is noise, whatever is missing: the noise is first estimated from it (Mallows,
        Technometrics 15, 1973).
        """
        return np.concatenate([self.nuisance, *single_value_designs(self.catalogue)], axis=1)

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
        self.splines = [replace(term, design=wider(term.design)) for term in self.splines]

    def add_ramp(self, wheel: str, span_s: tuple[float, float], column: int, course: str = "") -> None:
        """Add a ramp off the grid, whose response is that column."""
        design, penalty = self._column_design(column), ramp_penalty(course)
        term = Term(FAULT.name, design, (RAMPED,), penalty, wheel=wheel, span_s=span_s, course=course)
        self.catalogue.append(term)

    def add_off_grid(
        self, like: Term, at: float, columns: Sequence[int], second: float | None = None
    ) -> None:
        """Add a term whose nonlinear parameters lie off the grid, with the response to each of its values."""
        penalty = like.penalty - grid_penalty(like.kind_of, like.at, like.second)
        penalty += grid_penalty(like.kind_of, at, second)
        design = np.concatenate([self._column_design(column) for column in columns], axis=1)
        moved = replace(like, design=design, penalty=penalty, at=at, second=second, drive=None)
        self.catalogue.append(moved)

    def add_pulse(self, like: Term, span_s: tuple[float, float], column: int) -> None:
        """Add a pulse in a span of time that is not on the grid of knots, with an exact column."""
        self.catalogue.append(
            self._pulse_term(like.effect, like.pattern, span_s, self._column_design(column))
        )

    def add_shapes(
        self, like: Term, knots: tuple[float, ...], columns: dict[str, list[int]], drives: int
    ) -> None:
        """Add smooth terms over a term's covariate with finer knots, whose hats are these columns by wheel or
        reading."""
        for pattern, members in patterns():
            if all(member in columns for member, _ in members):
                design = np.zeros((self.width, len(columns[members[0][0]])))
                for member, sign in members:
                    design[columns[member], np.arange(design.shape[1])] = sign
                term = spline_term(pattern, like.covariate, design, knots)
                self.catalogue.append(term if like.drive is None else for_drive(term, like.drive, drives))

    def _column_design(self, column: int) -> FloatArray:
        """Return the design (1 + p, 1) that is one column of the common index."""
        design = np.zeros((self.width, 1))
        design[column, 0] = 1.0
        return design

    def _pulse_term(self, effect: str, pattern: str, span_s: tuple[float, float], design: FloatArray) -> Term:
        """Return the term of a pulse of the radii on some wheels, or of an event with that response, whose
        value is a slip."""
        penalty = SETTINGS.hypotheses.per_value_nats + math.log(
            len(PULSED) / 2 * SETTINGS.hypotheses.ramp_knots**2
        )
        if effect == NONPARAMETRIC.name:
            return Term(
                effect, design, ("height_m",), penalty, span_s=span_s, pattern=pattern, covariate="time"
            )
        slip = -design * self.mean_radius_m(pattern)
        return Term(effect, slip, (SLIPPING,), penalty, span_s=span_s, pattern=pattern)

    def mean_radius_m(self, pattern: str) -> float:
        """Return the mean radius of the wheels of a pattern."""
        return float(self.car.radius_m[list(wheels_of(pattern))].mean())

    @abstractmethod
    def pulse_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the best pulse of each wheel and axle, and the events that look so, with their gains."""

    @abstractmethod
    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the best ramp of each wheel, and of each pair that may change together, with its gain."""

    def shapes_over(self, like: Term) -> list[Term]:
        """Return all smooth terms over a term's covariate, of any pattern and knots."""
        pool = [term for term in self.catalogue if term.nonparametric and not term.pulse]
        both = (like.covariate, like.drive)
        return [term for term in (*pool, *self.splines) if (term.covariate, term.drive) == both]

    def smooth_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the log-likelihood gain, nats, of every smooth term, each on its own, with the term."""
        return [(term.gain(gram, b)[0], term) for term in self.splines]


def single_value_designs(terms: Sequence[Term]) -> list[FloatArray]:
    """Return the designs of terms with one value, at the typical nonlinear one, of effects that are not
    rare."""
    return [
        term.design
        for term in terms
        if term.design.shape[1] == 1
        and term.typical
        and not (term.kind_of.confounding.mirror_of or term.kind_of.confounding.rare)
    ]


def spline_term(pattern: str, covariate: str, design: FloatArray, knots: tuple[float, ...] = ()) -> Term:
    """Return a smooth term whose values (k,) are its heights at the knots."""
    values = tuple(f"at_{k + 1}" for k in range(design.shape[1]))
    penalty = spline_penalty(design.shape[1])
    return Term(
        NONPARAMETRIC.name, design, values, penalty, pattern=pattern, covariate=covariate, knots=knots
    )


def patterns() -> list[tuple[str, tuple[tuple[str, float], ...]]]:
    """Return the patterns of smooth terms: name, and the wheels or readings with their signs."""
    similar = [(name, tuple((member, 1.0) for member in members)) for name, members in PATTERNS.items()]
    return [*similar, *ANTISYMMETRIC.items()]


def wheels_acted_on(pattern: str) -> tuple[str, ...]:
    """Return the wheels on which a term of this pattern acts, of either sign; none of a reading, all without
    a pattern."""
    if not pattern:
        return WHEELS
    signed = ANTISYMMETRIC.get(pattern) or tuple((wheel, 1.0) for wheel in PATTERNS[pattern])
    return tuple(wheel for wheel, _ in signed if wheel in WHEELS)


def for_drive(term: Term, drive: int, drives: int) -> Term:
    """Return a term restricted to one of several drives, with the log of their number added to its
    penalty."""
    return replace(term, drive=drive, penalty=term.penalty + math.log(drives))
