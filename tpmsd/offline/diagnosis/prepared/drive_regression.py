"""Linear regression of one drive: its residual, its columns, its noise.

In: a `Reader`. Out: `DriveRegression`, whose whitened columns and Gram matrices are those of its present
noise. What was asked for under a noise before is kept, and only columns that were added since are whitened
again.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.response import (
    calibration_columns,
    grid_column,
    hat_functions,
    linear_columns,
    ramp_column,
    response_at,
)
from tpmsd.offline.diagnosis.hypotheses.terms import (
    ANTISYMMETRIC,
    PATTERNS,
    Name,
    Term,
    numbers_of,
    wheels_of,
)
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.covariate_errors import expected
from tpmsd.offline.inference.gram import Grams
from tpmsd.offline.inference.least_squares import DriveGrams
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.stack import ColumnStack
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import Reader


@dataclass(frozen=True)
class HatFunction:
    """One of the hat functions of a smooth term."""

    pattern: str
    covariate: str
    knots: tuple[float, ...]
    number: int
    std: float
    """Standard deviation of the covariate's error."""

    def column(self, reader: Reader) -> FloatArray:
        """(w, 9) the response to its height."""
        values = expected(reader.windows.covariates[self.covariate], self.std)
        weight = hat_functions(values, np.array(self.knots))
        signs = dict(ANTISYMMETRIC.get(self.pattern, ())) or dict.fromkeys(PATTERNS[self.pattern], 1.0)
        response = sum(sign * response_at(reader, pattern) for pattern, sign in signs.items())
        return np.asarray(response * weight[:, self.number : self.number + 1])


@dataclass(frozen=True)
class Refined:
    """A ramp or a pulse of wheels' radii, a nonlinear effect or a shape's hat off the grid."""

    wheels: tuple[int, ...] = ()
    """Numbers of the wheels that a ramp or a pulse acts on."""
    first: float = 0.0
    """Onset (s) of a ramp or a pulse, or value of the parameter that enters nonlinearly."""
    second: float = 0.0
    """Duration (s); of a pulse its end (s); of a nonlinear effect its second such parameter, 0 if there is
    none."""
    course: str = ""
    """Course of a ramp; empty: the plainest."""
    pulse: bool = False
    hat: HatFunction | None = None
    like: Term | None = None
    """The term of a nonlinear effect."""
    parameter: str = ""
    """Name of the parameter of that effect to which the column is the response."""

    def column(self, reader: Reader, base: ExtendedModel) -> FloatArray:
        """(w, 9) the response to a metre (to the unit of a hat or a parameter), at `base`."""
        if self.hat is not None:
            return self.hat.column(reader)
        if self.like is not None:
            wanted = (self.like.effect, self.parameter, self.like.pattern)
            return grid_column(reader, wanted, (self.first, self.second or None), base)
        out: FloatArray = np.zeros(0)
        for wheel in self.wheels:
            span = (self.first, 0.0 if self.pulse else self.second)
            one = ramp_column(reader, wheel, span, base, self.course)
            if self.pulse:
                one = one - ramp_column(reader, wheel, (self.second, 0.0), base)
            out = one if not out.size else out + one
        return out


def refined(term: Term, first: float, second: float = 0.0, course: str = "") -> tuple[Refined, ...]:
    """Return a term's columns, one per value: a ramp's by onset, duration and course, a pulse's by begin and
    end (s), those of others by the parameters that enter nonlinearly.
    """
    if term.ramp:
        return (Refined(numbers_of(term.wheel), first, second, course=course),)
    if term.pulse:
        return (Refined(wheels_of(term.pattern), first, second, pulse=True),)
    return tuple(Refined((), first, second, like=term, parameter=name) for name in term.parameters)


@dataclass(frozen=True)
class Whitened:
    """A drive's columns under one noise."""

    noise: Noise
    inflate: FloatArray | None
    whitener: Whitener
    grams: Grams
    """Gram matrices of the whitened columns (w, 9, n)."""

    @property
    def white(self) -> FloatArray:
        """Whitened columns of the windows, (w, 9, n)."""
        return self.grams.white


class DriveRegression:
    """Whitened linear regression of one drive: residual, columns and noise."""

    def __init__(
        self,
        reader: Reader,
        knots: dict[str, FloatArray],
        stds: Mapping[str, float],
        block_s: float = SETTINGS.preparation.block_s,
    ) -> None:
        """`knots` of the smooth terms by covariate, and `stds` of the covariates' errors."""
        self.reader = reader
        self.knots = knots
        self.stds = stds
        windows = reader.windows
        self.base = ExtendedModel()
        """About which everything is linear."""
        self.refined: list[Refined] = []
        """Keys of the columns beyond the named ones."""
        residual = windows.measured - reader.predict(self.base)
        columns = linear_columns(reader, knots, stds)
        self.names: list[Name] = [("data",), *columns.names]
        self.columns = ColumnStack(residual) + columns.stack
        self.noise = initial_noise(reader)
        self.inflate: FloatArray | None = None
        count = max(SETTINGS.preparation.fewest_blocks, round(len(windows) / block_s))
        self.blocks = np.arange(len(windows)) * count // len(windows)
        self.here = np.arange(len(self.names))
        """Indices of columns in the common index, and the columns by index."""
        self.local = np.arange(len(self.names))
        self.values = np.zeros(len(self.names) - 1)
        """(n - 1,) of the columns, at `base`."""
        self._kept: list[Whitened] = []
        """Under the noises asked for last, the present one at the end."""

    def relinearised(
        self, base: ExtendedModel, radii_m: FloatArray, values: FloatArray, fitted: FloatArray
    ) -> DriveRegression:
        """Return the same drive with a model, radii (4,) and the motion that goes with them as the new
        origin.

        `values` (n - 1,) are the base's in the columns, `fitted` (n - 1,) those of the whole fit.

        The values of all columns stay what they were: the change of an effect's value from zero, of a
        radius from the former origin.
        """
        used = np.flatnonzero(fitted)
        left = self.columns[0] - self.columns.take(1 + used) @ fitted[used]
        made = Whitener.of(self.reader.windows, self.noise, np.isfinite(left), self.inflate)
        out = self.with_noise()
        out.reader = copy.copy(self.reader)
        out._move_origin(base, radii_m, left, made)
        out._linearise(base, values)
        return out

    def _move_origin(
        self, model: ExtendedModel, radii_m: FloatArray, left: FloatArray, made: Whitener
    ) -> None:
        """Set the radii (4,), and move the motion by its errors smoothed from the residual `left` (w, 9),
        with a model acting."""
        errors = made.smooth(made.apply(left[:, :, None])[:, :, 0])
        self.reader.recalibrate(radii_m, model, errors)

    def _linearise(self, base: ExtendedModel, values: FloatArray) -> None:
        """Compute all columns again, about the present motion."""
        self.base, self.values = base, values
        columns = linear_columns(self.reader, self.knots, self.stds, base)
        for one in self.refined:
            columns.add(("refined",), one.column(self.reader, base))
        residual = self.reader.windows.measured - self.reader.predict(base)
        for k in np.flatnonzero(values):
            residual += values[k] * columns.stack[int(k)]
        self.columns = ColumnStack(residual) + columns.stack
        self._kept = []

    def of_replicate(self, recording: Recording, model: ExtendedModel) -> DriveRegression:
        """Return the regression of a replicate of this drive's recording, made by a model, with the same
        columns and noise.
        Its reference motion is made again from the replicate, and moved by its own smoothed errors: what it
        shares with the residual it shares here as well. All is one block: gains are not divided by an
        overdispersion.
        """
        out = copy.copy(self)
        out.reader = Reader(recording, reference(recording), kept=self.reader.windows.index)
        out.blocks = np.zeros(len(out.reader.windows), dtype=int)
        out.inflate = None
        out._calibrate_repeatedly(model)
        out._linearise(self.base, self.values)
        return out

    def _calibrate_repeatedly(self, model: ExtendedModel) -> None:
        """Calibrate radii and motion with a model acting, by Gauss-Newton steps until the gain is small."""
        before = math.inf
        for _ in range(SETTINGS.preparation.max_moves):
            left = self._calibrate_once(model)
            if before - left < SETTINGS.preparation.moved_nats:
                break
            before = left

    def _calibrate_once(self, model: ExtendedModel) -> float:
        """Calibrate the radii and move the motion once; return half the sum of squares (nats) left before."""
        windows = self.reader.windows
        residual = windows.measured - self.reader.predict(model)
        both = (ColumnStack(residual) + calibration_columns(self.reader).stack).whole()
        made = Whitener.of(windows, self.noise, np.isfinite(residual))
        white = made.apply(both).reshape(-1, both.shape[2])
        fitted = np.linalg.lstsq(white[:, 1:], white[:, 0], rcond=None)[0]
        left = residual - both[:, :, 1:] @ fitted
        radii = self.reader.reference.car.radius_m.copy()
        wheels = self.reader.recording.wheels
        radii[wheels] += fitted[: len(wheels)]
        self._move_origin(model, radii, left, made)
        return 0.5 * float(np.sum((white[:, 0] - white[:, 1:] @ fitted) ** 2))

    def with_noise(self, noise: Noise | None = None, inflate: FloatArray | None = None) -> DriveRegression:
        """Return the regression under another noise, or with other factors on the variances; this drive stays
        what it is, also where columns are added to the other."""
        out = copy.copy(self)
        out._kept, out.refined = list(self._kept), list(self.refined)
        out.noise = self.noise if noise is None else noise
        out.inflate = self.inflate if inflate is None else inflate
        return out

    def reweighted(self, inflate: FloatArray) -> DriveRegression:
        """Return the same with other factors (w, 9) on the variances, and without what was whitened
        so far.
        """
        out = self.with_noise(inflate=inflate)
        out._kept = []
        return out

    def append(self, columns: FloatArray) -> None:
        """Append further columns (w, 9, k)."""
        self.columns += ColumnStack(*np.moveaxis(columns, 2, 0))

    def own_design(self, design: FloatArray) -> FloatArray:
        """Return a design over the common columns as (n, k) over this drive's columns."""
        out = np.zeros((self.columns.shape[2], design.shape[1]))
        np.add.at(out, self.local, design[self.here])
        return out

    def whitened_design(self, design: FloatArray) -> FloatArray:
        """Return the whitened columns (w, 9, k) of a design over the common columns."""
        own = self.own_design(design)
        used = np.flatnonzero(np.any(own != 0.0, axis=1))
        return np.asarray(self.white[:, :, used] @ own[used])

    def data_and_design(self, design: FloatArray) -> FloatArray:
        """Return the data and those columns of a design that act in this drive, (w, 9, 1 + j), not
        whitened."""
        own = self.own_design(design)
        acting = own[:, np.any(own != 0.0, axis=0)]
        used = np.flatnonzero(np.any(acting != 0.0, axis=1))
        return np.concatenate([self.columns.take([0]), self.columns.take(used) @ acting[used]], axis=2)

    @property
    def white(self) -> FloatArray:
        """(w, 9, n) all columns, whitened by the present noise."""
        return self.present.white

    @property
    def log_determinant(self) -> float:
        """Log determinant of the innovations' covariances under the present noise."""
        return self.present.whitener.logdet

    def drive_grams(self) -> DriveGrams:
        """Return the Gram matrices of the whitened columns under the present noise."""
        return DriveGrams(self.present.grams, self.here, self.local)

    def residual(self, design: FloatArray, values: FloatArray) -> FloatArray:
        """(w, 9) whitened residual of a fit."""
        return np.asarray(self.white[:, :, 0] - self.response(design, values))

    def response(self, design: FloatArray, values: FloatArray) -> FloatArray:
        """(w, 9) whitened response of combinations with these values."""
        weights = self.own_design(design) @ values
        used = np.flatnonzero(weights)
        return np.asarray(self.white[:, :, used] @ weights[used])

    def unwhitened_residual(self, design: FloatArray, values: FloatArray) -> FloatArray:
        """Return the (w, 9) residual of a fit in the channels' units."""
        weights = self.own_design(design) @ values
        used = np.flatnonzero(weights)
        return np.asarray(self.columns[0] - self.columns.take(used) @ weights[used])

    def whitened(self, columns: FloatArray) -> FloatArray:
        """(w, 9, t) further columns (w, 9, t), whitened as the others are."""
        return self.present.whitener.apply(columns)

    @property
    def present(self) -> Whitened:
        """Return the columns whitened by the present noise, from a cache of the noises used last."""
        found = None
        for k, one in enumerate(self._kept):
            if one.noise == self.noise and one.inflate is self.inflate:
                found = self._kept.pop(k)
                break
        width = self.columns.shape[2]
        if found is None:
            here = np.isfinite(self.columns[0])
            whitener = Whitener.of(self.reader.windows, self.noise, here, self.inflate)
            grams = Grams(whitener.apply_all(self.columns), self.blocks)
            found = Whitened(self.noise, self.inflate, whitener, grams)
        elif found.white.shape[2] < width:
            more = found.whitener.apply_all(self.columns, found.white.shape[2])
            found = replace(found, grams=found.grams.extended(more))
        self._kept = [*self._kept[-(SETTINGS.preparation.noises_kept - 1) :], found]
        return found


def initial_noise(reader: Reader) -> Noise:
    """Return the noise with which its estimation starts."""
    return Noise.first(reader.recording.quantum_rad, reader.reference.car.radius_m)
