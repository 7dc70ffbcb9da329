"""The hypotheses where several drives are examined together.

In: the names of the columns that all drives share and of those that each drive has for itself. Out:
`JointHypotheses`: effects of one value for all drives, effects whose value is one drive's own (a gyro's bias
changes from day to day), radius ramps and terms over time and distance of each drive, and calibration
constants of each drive.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.catalogue import ALWAYS, EFFECTS
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.one_drive import DriveHypotheses
from tpmsd.offline.diagnosis.hypotheses.terms import (
    ANY_CAR,
    CarLimits,
    Hypotheses,
    Name,
    Term,
    for_drive,
    single_value_designs,
)
from tpmsd.offline.diagnosis.settings import SETTINGS

SHARED = frozenset(name for name, effect in EFFECTS.items() if effect.common_to_all_drives)
"""Effects of which no drive has a value of its own."""


@dataclass(frozen=True)
class OwnNames:
    """Values that one drive has for itself."""

    names: list[Name]
    """The data's own first."""
    first: int
    """Place of the second name in the common index; the others follow."""
    ramp_knots_s: FloatArray
    unusable: frozenset[str]


def is_own(name: Name, same_road: bool) -> bool:
    """Return whether a column is one drive's alone; on the same road at the same times, time is
    common too.
    """
    over_time = name[0] == "smooth" and name[2] in ("time", "distance")
    return name[0] in (*ALWAYS, "ramp") or (over_time and not same_road)


def is_copied(name: Name, same_road: bool) -> bool:
    """Return whether a column stands both for all drives and for each alone: the catalogue's, on one road
    all.
    """
    return not is_own(name, same_road) and name[0] != "data" and (same_road or name[0] != "smooth")


class JointHypotheses(Hypotheses):
    """All terms that several drives allow."""

    def __init__(
        self,
        shared: list[Name],
        unusable: frozenset[str],
        drives: list[OwnNames],
        width: int,
        same_road: bool,
        car: CarLimits = ANY_CAR,
    ) -> None:
        """`unusable` effects are left out of what is shared; `width` is that of the common index.

        A slope acts in every drive alike, but `same_road` compares a recording with a simulation, which may
        have left it out.
        """
        common = DriveHypotheses(shared, drives[0].ramp_knots_s, unusable, car)
        self._drives = [
            DriveHypotheses(
                one.names, one.ramp_knots_s, one.unusable if same_road else one.unusable | SHARED, car
            )
            for one in drives
        ]
        self._at = [
            np.concatenate([[0], one.first + np.arange(len(one.names) - 1)]).astype(int) for one in drives
        ]
        self._names = [
            {int(at): name for at, name in zip(indices[1:], one.names[1:], strict=True)}
            for indices, one in zip(self._at, drives, strict=True)
        ]
        self._own_splines: dict[tuple[int, str, int], list[Term]] = {}
        self._indices = [{name: at for at, name in names.items()} for names in self._names]
        calibration = [
            self._embedded_design(number, one.nuisance, width) for number, one in enumerate(self._drives)
        ]
        super().__init__(
            nuisance=np.concatenate(calibration, axis=1),
            catalogue=[replace(term, design=_padded_design(term.design, width)) for term in common.catalogue]
            + [
                self._term_of_drive(number, term, width)
                for number, one in enumerate(self._drives)
                for term in one.catalogue
            ],
            splines=[replace(term, design=_padded_design(term.design, width)) for term in common.splines],
            car=car,
        )

    @property
    def fullest_design(self) -> FloatArray:
        """Return the design of calibration and each drive's own effects, for the first estimate of the noise.

        As `Hypotheses.fullest_design`; values of each drive's own cover what all drives share.
        """
        own = [term for term in self.catalogue if term.drive is not None or term.effect in SHARED]
        return np.concatenate([self.nuisance, *single_value_designs(own)], axis=1)

    def design_in_other_drive(self, design: FloatArray, drive: int, other: int) -> FloatArray | None:
        """Return one drive's design (1 + p, k) in another drive's columns of the same names; None if it lacks
        them."""
        out = np.zeros_like(design)
        for row in np.flatnonzero(np.any(design != 0.0, axis=1)):
            name = self._names[drive].get(int(row))
            at = self._indices[other].get(name) if name is not None else None
            if at is None:
                return None
            out[at] = design[row]
        return out

    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the best ramp of each drive and wheel, with its gain."""
        out = []
        for number, one in enumerate(self._drives):
            at = self._at[number][1:] - 1
            for gain, term in one.ramp_gains(gram[np.ix_(at, at)], b[at]):
                out.append((gain, self._term_of_drive(number, term, self.width)))
        return out

    def pulse_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the best pulse of each drive and wheel, with its gain."""
        out = []
        for number, one in enumerate(self._drives):
            at = self._at[number][1:] - 1
            for gain, term in one.pulse_gains(gram[np.ix_(at, at)], b[at]):
                out.append((gain, self._term_of_drive(number, term, self.width)))
        return out

    def smooth_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Return the gain of every common smooth term, and of the best of each drive."""
        out = super().smooth_gains(gram, b)
        for number, one in enumerate(self._drives):
            at = self._at[number][1:] - 1
            gains = one.smooth_gains(gram[np.ix_(at, at)], b[at])
            best = sorted(gains, key=lambda entry: entry[1].penalty - entry[0])[
                : SETTINGS.hypotheses.best_per_drive
            ]
            out += [(gain, self._term_of_drive(number, term, self.width)) for gain, term in best]
        return out

    def shapes_over(self, like: Term) -> list[Term]:
        """Return what the base returns; of a term of one drive, those of that drive."""
        shapes = super().shapes_over(like)
        return shapes if like.drive is None else [*shapes, *self.splines_of(like.drive, like.covariate)]

    def splines_of(self, drive: int, covariate: str = "") -> list[Term]:
        """Return the smooth terms of one drive alone, over one covariate or over any."""
        which = (drive, covariate, self.width)
        if which not in self._own_splines:
            mine = [one for one in self._drives[drive].splines if covariate in ("", one.covariate)]
            self._own_splines[which] = [self._term_of_drive(drive, one, self.width) for one in mine]
        return self._own_splines[which]

    def _term_of_drive(self, drive: int, term: Term, width: int) -> Term:
        """Return a term of one drive's hypotheses as a term over the common columns."""
        embedded = replace(term, design=self._embedded_design(drive, term.design, width))
        return for_drive(embedded, drive, len(self._drives))

    def _embedded_design(self, drive: int, design: FloatArray, width: int) -> FloatArray:
        """Return a drive's own design as rows (width, k) of the common index."""
        out = np.zeros((width, design.shape[1]))
        out[self._at[drive]] = design
        return out


def _padded_design(design: FloatArray, width: int) -> FloatArray:
    """Return a design with zero rows up to `width`."""
    return np.concatenate([design, np.zeros((width - len(design), design.shape[1]))])
