"""The hypotheses of one drive.

In: the names of its columns. Out: `DriveHypotheses`: `Term`s of the catalogue with one or several shapes
each, and scans over the large families (radius ramps of any onset and length, smooth terms of any wheel
pattern over any covariate).
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.car.physics.catalogue import ALWAYS, EFFECTS, EVENTS, FAULT, NONPARAMETRIC, probe_groups
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.hypotheses.penalties import RAMPED_PATTERNS, grid_penalty, ramp_penalty
from tpmsd.offline.diagnosis.hypotheses.terms import (
    ANY_CAR,
    PATTERNS,
    PULSED,
    RAMPED,
    CarLimits,
    Hypotheses,
    Name,
    Term,
    patterns,
    spline_term,
    wheels_of,
)
from tpmsd.offline.diagnosis.settings import SETTINGS


class DriveHypotheses(Hypotheses):
    """All terms that one drive's columns allow."""

    def __init__(
        self,
        names: list[Name],
        ramp_knots_s: FloatArray,
        unusable: frozenset[str],
        car: CarLimits = ANY_CAR,
    ) -> None:
        """`names` are those of the columns, the data's own first; `unusable` effects are left out."""
        self._column_of = {name: k for k, name in enumerate(names)}
        self._knots_s = ramp_knots_s
        self._wheels = [wheel for wheel in WHEELS if ("ramp", wheel, "0") in self._column_of]
        self._pairs = [
            (a, b)
            for a in range(SETTINGS.hypotheses.ramp_knots)
            for b in range(a + 1, SETTINGS.hypotheses.ramp_knots + 1)
        ]
        self._ramps = np.zeros((SETTINGS.hypotheses.ramp_knots, len(self._pairs)))
        for k, (a, b) in enumerate(self._pairs):
            self._ramps[a:b, k] = 1.0 / (b - a)
        super().__init__(
            nuisance=self._unit_design([name for name in names if name[0] in ALWAYS]),
            catalogue=[term for term in self._catalogue_terms() if term.effect not in unusable],
            splines=self._spline_terms(),
            car=car,
        )

    def _unit_design(self, names: list[Name]) -> FloatArray:
        """Return the design (1 + p, k) with one unit column for each name."""
        out = np.zeros((len(self._column_of), len(names)))
        for k, name in enumerate(names):
            out[self._column_of[name], k] = 1.0
        return out

    def _catalogue_terms(self) -> list[Term]:
        """Return a term for each group of the catalogue's parameters whose columns the drive has."""
        out = []
        for group in probe_groups():
            if any(probe.key not in self._column_of for probe in group):
                continue
            name, pattern, at = group[0].effect, group[0].wheel_pattern, group[0].at
            penalty = SETTINGS.hypotheses.per_value_nats * len(group) + grid_penalty(EFFECTS[name], at)
            penalty += math.log(max(len(EFFECTS[name].identification.wheel_patterns), 1))
            design = self._unit_design([probe.key for probe in group])
            parameters = tuple(probe.parameter for probe in group)
            out.append(Term(name, design, parameters, penalty, pattern=pattern, at=at))
        return out

    def pulse_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the best pulse of each wheel and axle, and the events that look so, with their gains.

        A pulse is a ramp up between two knots and one down between two others.
        """
        out = []
        middle = 0.5 * (self._knots_s[1:] + self._knots_s[:-1])
        columns = {wheel: self._ramp_columns(wheel) - 1 for wheel in self._wheels}
        for pattern in PULSED:
            wheels = PATTERNS[pattern]
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
            slip = -float(score[i, j] / max(size[i, j], floor)) / self.mean_radius_m(pattern)
            # Of an axle, events alone: a shape that both wheels share has a covariate of its own.
            free = (NONPARAMETRIC.name,) if len(wheels) == 1 else ()
            for effect in (*free, *self._matching_events(pattern, slip, span[1] - span[0])):
                out.append((float(gain[i, j]), self._pulse_term(effect, pattern, span, design)))
        return out

    def _matching_events(self, pattern: str, slip: float, duration_s: float) -> list[str]:
        """Return the names of events whose limits of slip and duration hold for these wheels."""
        wheels = list(wheels_of(pattern))
        driven, axle = bool(self.car.driven[wheels].all()), len(wheels) == 2
        return [name for name in EVENTS if EFFECTS[name].fits_span(slip, duration_s, driven, axle)]

    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the best ramp of each wheel, and of each pair that may change together, with its gain.

        All wheels that are read would show against the receiver alone, whose slow error looks alike.
        """
        out = []
        for wheels in (PATTERNS[pattern] for pattern in RAMPED_PATTERNS):
            if not set(wheels) <= set(self._wheels) or (len(wheels) > 1 and set(wheels) == set(self._wheels)):
                continue
            at = [self._ramp_columns(wheel) - 1 for wheel in wheels]
            score = self._ramps.T @ sum(b[a] for a in at)
            both = sum(gram[np.ix_(a, c)] for a in at for c in at)
            information = np.einsum("ik,ik->k", self._ramps, both @ self._ramps)
            floor = 1e-6 * float(np.max(information, initial=1e-30))
            gain = 0.5 * score**2 / np.maximum(information, floor)
            best = int(np.argmax(np.where(information > floor, gain, 0.0)))
            out.append((float(gain[best]), self.ramp_term(" ".join(wheels), best)))
        return out

    def ramp_term(self, wheels: str, pair: int) -> Term:
        """Return the radius change of a wheel, or of several alike, between a pair of knots."""
        a, b = self._pairs[pair]
        design = np.zeros((self.width, 1))
        for wheel in wheels.split():
            design[self._ramp_columns(wheel)[a:b], 0] = 1.0 / (b - a)
        span = (float(self._knots_s[a]), float(self._knots_s[b]))
        return Term(FAULT.name, design, (RAMPED,), ramp_penalty(), wheel=wheels, span_s=span)

    def _ramp_columns(self, wheel: str) -> np.ndarray:
        """(knots,) positions of a wheel's ramps in the common index."""
        return np.array(
            [self._column_of[("ramp", wheel, str(k))] for k in range(SETTINGS.hypotheses.ramp_knots)]
        )

    def _spline_terms(self) -> list[Term]:
        """Return a spline term for each wheel pattern and covariate of which the drive has the columns."""
        number: dict[tuple[str, str], int] = {}
        for name in self._column_of:
            if name[0] == "smooth":
                at = (name[1], name[2])
                number[at] = max(number.get(at, 0), int(name[3]) + 1)
        out = []
        for covariate in sorted({covariate for _, covariate in number}):
            for pattern, members in patterns():
                if any(("smooth", member, covariate, "0") not in self._column_of for member, _ in members):
                    continue
                hats = number[members[0][0], covariate]
                design = np.zeros((len(self._column_of), hats))
                for member, sign in members:
                    for k in range(hats):
                        design[self._column_of[("smooth", member, covariate, str(k))], k] = sign
                out.append(spline_term(pattern, covariate, design))
        return out
