"""The hypotheses: terms that may be added to the rolling model, each a few combinations of columns.

In: the names of the columns. Out: `Term`s of the catalogue with one or several shapes each, and scans
over the large families (radius ramps of any onset and length, smooth terms at any place over any
covariate).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from tpmsd.diagnosis.response import PLACES, RAMP_KNOTS, TIME_CONSTANTS_S
from tpmsd.physics.catalogue import EFFECTS, groups
from tpmsd.wheels import WHEELS, FloatArray

PER_VALUE = 3.5
"""Log-likelihood that a further free value must bring: half the logarithm of a thousand windows."""
POSITIVE = frozenset(name for name, effect in EFFECTS.items() if effect.one_sign)
"""Effects whose first value has but one sign in nature; a wrong configuration may show the other."""
ODD_SIGN = 4.0
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


def thermal_price(time_constant_s: float) -> float:
    """Penalty of a warm-up: tyres take ten minutes, give or take a factor of two."""
    return PER_VALUE + 1.5 + 0.5 * (math.log(time_constant_s / 500.0) / 0.7) ** 2


def shape_price(hats: int) -> float:
    """Penalty of a smooth term: its heights, and the choice of its place and covariate."""
    return PER_VALUE * hats + math.log(120.0)


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
    span_s: tuple[float, float] = (0.0, 0.0)
    """Of a radius change: onset and end of the ramp; of a pulse, from when to when."""
    time_constant_s: float = 0.0
    place: str = ""
    covariate: str = ""
    knots: tuple[float, ...] = ()
    """Of a smooth term with finer knots than its covariate's usual ones."""
    drive: int | None = None
    """Number of the one drive in which it acts; None where it acts in all."""

    def price(self, first: float) -> float:
        """The penalty, given the first value: what nature seldom shows must be paid for."""
        if self.calibrates:
            beyond = (abs(first) - USUAL_LAG_S) / (UNUSUAL_LAG_S - USUAL_LAG_S)
            unusual = min(max(beyond, 0.0), 1.0)
            own = 2.0 * unusual - 1.0 if self.effect == "doppler_lag" else 0.0
            return self.penalty + RECEIVERS_OWN * own
        odd = self.effect in POSITIVE and first < 0.0
        return self.penalty + (ODD_SIGN if odd else 0.0)

    @property
    def on_radii(self) -> bool:
        """Whether the values are changes of single wheels' radii in metres."""
        free = self.effect == "unknown" and self.place not in ("gnss_speed", "gnss_course", "yaw_rate")
        return free or self.effect == "radius_change"

    @property
    def calibrates(self) -> bool:
        """Whether this is a constant of the receiver rather than a finding."""
        return self.effect in CALIBRATION

    @property
    def pulse(self) -> bool:
        """Whether this is a change of a wheel's radius that goes back after a while, in `span_s`."""
        return self.effect == "unknown" and self.span_s[1] > self.span_s[0]

    @property
    def key(self) -> tuple[str, ...]:
        """What makes two terms rivals for one place in the model: an effect may act once (per wheel, per
        place).
        """
        drive = "" if self.drive is None else str(self.drive)
        if self.effect == "unknown":
            return ("unknown", self.place, self.covariate, drive)
        return (self.effect, self.wheel, drive)


MIDDLE_TIME_CONSTANT_S = 450.0
CALIBRATION = frozenset({"doppler_lag", "grade_share"})
"""Terms that are looked for as effects are, but tell of the receiver's own making: no findings.

Receivers give a speed that is some hundredths of a second older than their position (on every real
recording at hand). Who does not know of it takes it for an old fix. And their heights wander by metres: on
a flat road that looks like slopes, and slip or load transfer by the pull of these slopes would be missing.
"""
RECEIVERS_OWN = 6.0
"""Log-likelihood by which the lag that receivers usually have goes before an effect that explains as much,
and by which an unusual one stands behind it: where the positions do not tell, that has the catalogue's name.
"""
USUAL_LAG_S, UNUSUAL_LAG_S = 0.05, 0.08
"""Up to the one it is usual, from the other on it is not."""
GROUPS = (*groups(), ("doppler_lag", ("lag_s",)), ("grade_share", ("share",)))


class Hypotheses:
    """All terms that a drive's columns allow."""

    bounds: Mapping[tuple[str, str], tuple[float, float]] = MappingProxyType({})
    """Of the values, by effect and parameter, where the car has bounds of its own."""

    def __init__(self, names: list[Name], ramp_knots_s: FloatArray, unusable: frozenset[str]) -> None:
        """`names` are those of the columns, the data's own first; `unusable` effects are left out."""
        self.place = {name: k for k, name in enumerate(names)}
        self.width = len(names)
        self.knots_s = ramp_knots_s
        self.nuisance = self._unit([name for name in names if name[0] in ("radius", "gyro_delay")])
        self.catalogue = [term for term in self._catalogue() if term.effect not in unusable]
        self.wheels = [wheel for wheel in WHEELS if ("ramp", wheel, "0") in self.place]
        pairs = [(a, b) for a in range(RAMP_KNOTS) for b in range(a + 1, RAMP_KNOTS + 1)]
        self._pairs = pairs
        self._ramps = np.zeros((RAMP_KNOTS, len(pairs)))
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
            if term.design.shape[1] == 1 and term.time_constant_s in (0.0, MIDDLE_TIME_CONSTANT_S)
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
        for effect, parameters in GROUPS:
            if (effect, parameters[0]) not in self.place:
                continue
            design = self._unit([(effect, parameter) for parameter in parameters])
            out.append(Term(effect, design, parameters, PER_VALUE * len(parameters)))
        for tau in TIME_CONSTANTS_S:
            design = self._unit([("thermal_growth", f"{tau:g}")])
            out.append(
                Term("thermal_growth", design, ("amplitude_m",), thermal_price(tau), time_constant_s=tau)
            )
        return out

    def add_ramp(self, wheel: str, span_s: tuple[float, float], column: int) -> None:
        """A ramp off the grid, whose response is that column."""
        design = np.zeros((self.width, 1))
        design[column, 0] = 1.0
        price = PER_VALUE + math.log(4 * RAMP_KNOTS)
        self.catalogue.append(
            Term("radius_change", design, ("deviation_m",), price, wheel=wheel, span_s=span_s)
        )

    def add_thermal(self, time_constant_s: float, column: int) -> None:
        """A warm-up off the grid."""
        design = np.zeros((self.width, 1))
        design[column, 0] = 1.0
        price = thermal_price(time_constant_s)
        self.catalogue.append(
            Term("thermal_growth", design, ("amplitude_m",), price, time_constant_s=time_constant_s)
        )

    def add_pulse(self, wheel: str, span_s: tuple[float, float], column: int) -> None:
        """A pulse off the grid."""
        self.catalogue.append(self._pulse(wheel, span_s, self._column(column)))

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

    @staticmethod
    def _pulse(wheel: str, span_s: tuple[float, float], design: FloatArray) -> Term:
        price = PER_VALUE + math.log(2 * RAMP_KNOTS * RAMP_KNOTS)
        values = ("height_m",)
        return Term("unknown", design, values, price, span_s=span_s, place=wheel, covariate="time")

    def pulse_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """For each wheel the best pulse (a ramp up between two knots, one down between two others)."""
        out = []
        middle = 0.5 * (self.knots_s[1:] + self.knots_s[:-1])
        for wheel in self.wheels:
            at = np.array([self.place[("ramp", wheel, str(k))] for k in range(RAMP_KNOTS)]) - 1
            own = np.diag(gram)[at]
            size = own[:, None] + own[None, :] - 2.0 * gram[np.ix_(at, at)]
            floor = 1e-6 * float(np.max(size, initial=1e-30))
            score = b[at][:, None] - b[at][None, :]
            gain = np.triu(np.where(size > floor, 0.5 * score**2 / np.maximum(size, floor), 0.0), 2)
            i, j = (int(k) for k in np.unravel_index(int(np.argmax(gain)), gain.shape))
            design = np.zeros((self.width, 1))
            design[at[i] + 1, 0], design[at[j] + 1, 0] = 1.0, -1.0
            span = (float(middle[i]), float(middle[j]))
            out.append((float(gain[i, j]), self._pulse(wheel, span, design)))
        return out

    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """For each wheel the best ramp and its gain."""
        out = []
        for wheel in self.wheels:
            at = np.array([self.place[("ramp", wheel, str(k))] for k in range(RAMP_KNOTS)]) - 1
            score = self._ramps.T @ b[at]
            information = np.einsum("ik,ik->k", self._ramps, gram[np.ix_(at, at)] @ self._ramps)
            floor = 1e-6 * float(np.max(information, initial=1e-30))
            gain = 0.5 * score**2 / np.maximum(information, floor)
            best = int(np.argmax(np.where(information > floor, gain, 0.0)))
            out.append((float(gain[best]), self.ramp(wheel, best)))
        return out

    def ramp(self, wheel: str, pair: int) -> Term:
        """The radius change of a wheel between a pair of knots."""
        a, b = self._pairs[pair]
        design = np.zeros((self.width, 1))
        for k in range(a, b):
            design[self.place[("ramp", wheel, str(k))], 0] = 1.0 / (b - a)
        penalty = PER_VALUE + math.log(4 * RAMP_KNOTS)
        span = (float(self.knots_s[a]), float(self.knots_s[b]))
        return Term("radius_change", design, ("deviation_m",), penalty, wheel=wheel, span_s=span)

    def _smooth_groups(self) -> list[Term]:
        number: dict[tuple[str, str], int] = {}
        for name in self.place:
            if name[0] == "smooth":
                at = (name[1], name[2])
                number[at] = max(number.get(at, 0), int(name[3]) + 1)
        covariates = sorted({covariate for _, covariate in number})
        out = []
        for covariate in covariates:
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
        return Term("unknown", design, values, penalty, place=place, covariate=covariate, knots=knots)

    def shapes_over(self, like: Term) -> list[Term]:
        """All smooth terms over a term's covariate, of any pattern and knots."""
        pool = [term for term in self.catalogue if term.effect == "unknown" and not term.pulse]
        both = (like.covariate, like.drive)
        return [term for term in (*pool, *self._smooth) if (term.covariate, term.drive) == both]

    def smooth_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Gain of every smooth term."""
        return [(group_gain(term.design[1:], gram, b)[0], term) for term in self._smooth]


def _patterns() -> list[tuple[str, tuple[tuple[str, float], ...]]]:
    """Where a smooth term may act: its name, and the places with their signs."""
    alike = [(name, tuple((place, 1.0) for place in places)) for name, places in PATTERNS.items()]
    return [*alike, *ANTISYMMETRIC.items()]


def for_drive(term: Term, drive: int, drives: int) -> Term:
    """A term as that of one of so many drives: the choice must be paid for."""
    return replace(term, drive=drive, penalty=term.penalty + math.log(drives))


def group_gain(design: FloatArray, gram: FloatArray, b: FloatArray) -> tuple[float, float]:
    """Log-likelihood that a group of columns brings, and the value of its first, given Gram matrix and
    correlation.
    """
    rows = np.flatnonzero(np.any(design != 0.0, axis=1))
    part = design[rows]
    A = part.T @ gram[np.ix_(rows, rows)] @ part
    score = part.T @ b[rows]
    scale = np.sqrt(np.maximum(np.diag(A), 1e-300))
    A = A / np.outer(scale, scale) + 1e-6 * np.eye(len(score))
    score = score / scale
    # A column that the others already explain has next to nothing left: it cannot bring anything.
    values = np.linalg.solve(A, score)
    return 0.5 * float(score @ values), float(values[0] / scale[0])
