"""The hypotheses where several drives are examined together.

In: the names of the columns that all drives share and of those that each drive has for itself. Out:
`JointHypotheses`: effects of one value for all drives, effects whose value is one drive's own (a gyro's bias
changes from day to day), radius ramps and terms over time and distance of each drive, and calibration
constants of each drive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.diagnosis.terms import Hypotheses, Name, Term
from tpmsd.wheels import FloatArray

BEST = 10
"""Terms over time and distance of one drive that a scan returns."""


@dataclass(frozen=True)
class OwnNames:
    """What one drive has for itself."""

    names: list[Name]
    """The data's own first."""
    first: int
    """Place of the second name in the common index; the others follow."""
    ramp_knots_s: FloatArray
    unusable: frozenset[str]


def is_own(name: Name) -> bool:
    """Whether a column is one drive's alone."""
    over_time = name[0] == "smooth" and name[2] in ("time", "distance")
    return name[0] in ("radius", "gyro_delay", "ramp") or over_time


def is_copied(name: Name) -> bool:
    """Whether a column stands both for all drives and for each alone: the catalogue's."""
    return not is_own(name) and name[0] not in ("smooth", "data")


def for_drive(term: Term, drive: int, drives: int) -> Term:
    """A term as that of one of so many drives: the choice must be paid for."""
    return replace(term, drive=drive, penalty=term.penalty + math.log(drives))


class JointHypotheses(Hypotheses):
    """All terms that several drives allow."""

    def __init__(
        self, shared: list[Name], unusable: frozenset[str], drives: list[OwnNames], width: int
    ) -> None:
        """`unusable` effects are left out of what is shared; `width` is that of the common index."""
        common = Hypotheses(shared, drives[0].ramp_knots_s, unusable)
        self.width = width
        self._drives = [
            Hypotheses(one.names, one.ramp_knots_s, one.unusable | {"road_grade"}) for one in drives
        ]
        self._at = [
            np.concatenate([[0], one.first + np.arange(len(one.names) - 1)]).astype(int) for one in drives
        ]
        self.catalogue = [replace(term, design=self._wide(term.design)) for term in common.catalogue]
        for number, one in enumerate(self._drives):
            self.catalogue += [self._of(number, term) for term in one.catalogue]
        self._smooth = [replace(term, design=self._wide(term.design)) for term in common._smooth]
        self.nuisance = np.concatenate(
            [self._place(number, one.nuisance) for number, one in enumerate(self._drives)], axis=1
        )

    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """For each drive and wheel the best ramp and its gain."""
        out = []
        for number, one in enumerate(self._drives):
            at = self._at[number][1:] - 1
            for gain, term in one.ramp_gains(gram[np.ix_(at, at)], b[at]):
                out.append((gain, self._of(number, term)))
        return out

    def pulse_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """For each drive and wheel the best pulse and its gain."""
        out = []
        for number, one in enumerate(self._drives):
            at = self._at[number][1:] - 1
            for gain, term in one.pulse_gains(gram[np.ix_(at, at)], b[at]):
                out.append((gain, self._of(number, term)))
        return out

    def smooth_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """Gain of every common smooth term, and of the best of each drive."""
        out = super().smooth_gains(gram, b)
        for number, one in enumerate(self._drives):
            at = self._at[number][1:] - 1
            gains = one.smooth_gains(gram[np.ix_(at, at)], b[at])
            best = sorted(gains, key=lambda entry: entry[1].penalty - entry[0])[:BEST]
            out += [(gain, self._of(number, term)) for gain, term in best]
        return out

    def _of(self, drive: int, term: Term) -> Term:
        return for_drive(replace(term, design=self._place(drive, term.design)), drive, len(self._drives))

    def _place(self, drive: int, design: FloatArray) -> FloatArray:
        out = np.zeros((self.width, design.shape[1]))
        out[self._at[drive]] = design
        return out

    def _wide(self, design: FloatArray) -> FloatArray:
        return np.concatenate([design, np.zeros((self.width - len(design), design.shape[1]))])
