"""Joint linear regression of the drives of a diagnosis: own noise for each, columns that they share.

In: one `Reader` per drive. Out: `Regression`, which gives the evidence of all drives together under the
present noise. Whitening is done drive by drive; what the drives have in common is only the numbers that a fit
of their Gram matrices shares: an effect's value is one number for all drives (and, as a hypothesis apart, one
drive's own), a calibration constant is each drive's own.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.joint_terms import JointHypotheses, OwnNames, is_copied, is_own
from tpmsd.offline.diagnosis.hypotheses.one_drive import DriveHypotheses
from tpmsd.offline.diagnosis.hypotheses.plausible import limits_of
from tpmsd.offline.diagnosis.hypotheses.response import (
    available_readings,
    ramp_knots,
    smooth_knots,
)
from tpmsd.offline.diagnosis.hypotheses.terms import CarLimits, Hypotheses, Name, Term
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression, Refined, initial_noise
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.covariate_errors import covariate_stds
from tpmsd.offline.inference.least_squares import Evidence
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.windows import Reader
from tpmsd.offline.rings.missed import plausible_loss_rates


class Regression:
    """Whitened linear regression of several drives, and the columns that they share."""

    def __init__(self, readers: Sequence[Reader], simulation: bool = False) -> None:
        """At least one reader; with `simulation` the second of two is what the first is compared with."""
        self.simulation = simulation
        windows = sum(len(reader.windows) for reader in readers)
        block_s = max(SETTINGS.preparation.block_s, windows / SETTINGS.preparation.max_blocks)
        apart = () if simulation else ("time", "distance")
        stds = [covariate_stds(reader, initial_noise(reader)) for reader in readers]
        common = _common_knots(readers, stds, apart) if len(readers) > 1 else {}
        drives = []
        for reader, own in zip(readers, stds, strict=True):
            knots = smooth_knots(reader.windows.covariates, own)
            if len(readers) > 1:
                knots = {c: at for c, at in knots.items() if c in apart} | common
            drives.append(DriveRegression(reader, knots, own, block_s))
        self.drives = tuple(drives)
        nats = SETTINGS.hypotheses.impossible_nats
        rates = [plausible_loss_rates(one.recording, one.reference, nats) for one in readers]
        car = limits_of(readers[0].reference.car, rates)
        self.hypotheses: Hypotheses = (
            self._single_drive_hypotheses(car) if len(readers) == 1 else self._joint_hypotheses(car)
        )
        self.grid = self.hypotheses.width
        """Places in the common index from here on are of exact columns."""
        self.width = self.grid

    @property
    def examined(self) -> tuple[DriveRegression, ...]:
        """The drives whose physics is asked for: all but a simulation."""
        return self.drives[:1] if self.simulation else self.drives

    @property
    def has_wheel_speeds_only(self) -> bool:
        """True if the bus has wheel speeds and no counts."""
        return all(bool((drive.reader.recording.quantum_rad == 0.0).all()) for drive in self.examined)

    @property
    def driving_s(self) -> float:
        """Duration of the windows that are compared, s: there is one per second."""
        return float(sum(len(drive.reader.windows) for drive in self.examined))

    def with_drives(self, drives: Sequence[DriveRegression]) -> Regression:
        """Return the same hypotheses over other regressions of the drives; this regression stays what it
        is."""
        out = copy.copy(self)
        out.drives = tuple(drives)
        return out

    def with_noise(self, noises: Mapping[int, Noise]) -> Regression:
        """Return the regression with other noises for some drives, by their numbers."""
        return self.with_drives(
            [drive.with_noise(noises.get(number)) for number, drive in enumerate(self.drives)]
        )

    def copied(self) -> Regression:
        """Return a copy whose columns and hypotheses may be extended without a change of this one."""
        out = self.with_noise({})
        out.hypotheses = copy.copy(self.hypotheses)
        out.hypotheses.catalogue = list(self.hypotheses.catalogue)
        return out

    def evidence(self) -> Evidence:
        """Return the normal equations summed over drives, under the present noise."""
        return Evidence([drive.drive_grams() for drive in self.drives], self.width)

    def acting_drives(self, term: Term) -> list[int]:
        """Return the numbers of the drives in which a term acts."""
        return list(range(len(self.drives))) if term.drive is None else [term.drive]

    def knots(self, term: Term) -> FloatArray:
        """Return the knots (k,) of a smooth term."""
        if term.knots:
            return np.array(term.knots)
        return self.drives[self.acting_drives(term)[0]].knots[term.covariate]

    def append(self, columns: Sequence[tuple[Refined, Mapping[int, FloatArray]]]) -> list[int]:
        """Append columns, each (w, 9) by drive number; return their positions in the common index."""
        for number, drive in enumerate(self.drives):
            mine = [(k, column[number]) for k, (_, column) in enumerate(columns) if number in column]
            drive.refined += [what for what, column in columns if number in column]
            if mine:
                start = drive.columns.shape[2]
                drive.here = np.concatenate([drive.here, [self.width + k for k, _ in mine]])
                drive.local = np.concatenate([drive.local, start + np.arange(len(mine))])
                drive.append(np.stack([column for _, column in mine], axis=2))
        indices = list(range(self.width, self.width + len(columns)))
        self.width += len(columns)
        self.hypotheses.widen(self.width)
        return indices

    def _single_drive_hypotheses(self, car: CarLimits) -> DriveHypotheses:
        drive = self.drives[0]
        return DriveHypotheses(drive.names, ramp_knots(drive.reader), unusable_effects(drive.reader), car)

    def _joint_hypotheses(self, car: CarLimits) -> JointHypotheses:
        lost = [unusable_effects(drive.reader) for drive in self.drives]
        shared: list[Name] = [("data",)]
        for drive in self.drives:
            shared += [
                name for name in drive.names[1:] if not is_own(name, self.simulation) and name not in shared
            ]
        at = {name: k for k, name in enumerate(shared)}
        width = len(shared)
        own = []
        for drive, unused in zip(self.drives, lost, strict=True):
            names = [
                name
                for name in drive.names[1:]
                if is_own(name, self.simulation) or is_copied(name, self.simulation)
            ]
            own.append(OwnNames([("data",), *names], width, ramp_knots(drive.reader), unused))
            index_of = {name: k for k, name in enumerate(drive.names)}
            both = [name for name in drive.names if name in at and name[0] not in unused]
            here = [at[name] for name in both] + list(range(width, width + len(names)))
            drive.here = np.array(here)
            drive.local = np.array([index_of[name] for name in both] + [index_of[name] for name in names])
            width += len(names)
        return JointHypotheses(shared, frozenset.intersection(*lost), own, width, self.simulation, car)


def _common_knots(
    readers: Sequence[Reader], stds: Sequence[Mapping[str, float]], apart: Sequence[str]
) -> dict[str, FloatArray]:
    """Return knots over all drives' values of the covariates that all have, except those in `apart`."""
    names = [
        name
        for name in readers[0].windows.covariates
        if name not in apart and all(name in one.windows.covariates for one in readers)
    ]
    return smooth_knots(
        {name: np.concatenate([one.windows.covariates[name] for one in readers]) for name in names},
        {name: max(own[name] for own in stds) for name in names},
    )


def unusable_effects(reader: Reader) -> frozenset[str]:
    """Return the effects that cannot show in this drive: readings are missing, or its motion does not excite
    them."""
    here, motion, car = available_readings(reader), reader.reference.motion, reader.reference.car
    return frozenset(
        name
        for name, effect in EFFECTS.items()
        if not here >= set(effect.identification.needs) or not effect.observable(motion, car)
    )
