"""Bootstrap replicates of a fixed design: a drive prepared once, its columns, the fit under a noise.

In: a `Recording`, the `Car`. Out: `Prepared`, whose arrays are read-only, the columns (`Design`) of models in
it, and fits and replicates of both. Pure functions: the same arguments give the same bits. The program itself
linearises again (`tpmsd.offline.inference.replicate`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from tpmsd.car.physics.forward import wheel_angles
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.inference.covariate_errors import covariate_errors, covariate_jacobians
from tpmsd.offline.inference.fit import Gram, ParameterFit, Prior, gram, read_only, solved
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import ReferenceTrajectory, reference
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import MAX_WINDOWS, Reader, Windows

RADIUS_STEP_M = 1e-4
"""By which radii are changed to see what the channels make of it: all are linear far beyond."""


@dataclass(frozen=True)
class Covariate:
    """What an effect may depend on, over w windows; SI units."""

    value: FloatArray
    """(w,)"""
    jacobian: FloatArray
    """(w, 3) derivative by the errors of the motion's speed, yaw rate and heading."""
    std: FloatArray
    """(w,) of its error, as the smoother of all channels leaves it under typical noise."""


@dataclass(frozen=True)
class Prepared:
    """A drive's w windows and n ticks."""

    recording: Recording
    """Of the given car."""
    reference: ReferenceTrajectory
    """Motion and calibrated radii about which all is linear."""
    windows: Windows
    """`design` (w, 9, 3) is what the channels see of the motion's errors."""
    y: FloatArray
    """(w, 9) or (w, 9, r) channels minus what the rolling model predicts; NaN where not measured."""
    mask: np.ndarray
    """(w, 9) what was measured."""
    tick_residual_rad: FloatArray
    """(n, 4) turn of each wheel in each tick minus what the rolling model predicts; NaN where not read."""
    covariates: Mapping[str, Covariate]

    @property
    def motion(self) -> Motion:
        """At the ticks' edges (n + 1,)."""
        return self.reference.motion


@dataclass(frozen=True)
class Design:
    """The columns of a model in one drive."""

    keys: tuple[str, ...]
    """(p,) what each column's value is; equal keys of two drives are one value."""
    columns: FloatArray
    """(w, 9, p) response of the channels to a unit of each."""


def prepare(drive: Recording, car: Car, limit: int = MAX_WINDOWS) -> Prepared:
    """Smooth a drive's motion and compare all its channels with it, in `limit` windows at most."""
    recording = replace(drive, car=car)
    about = reference(recording)
    reader = Reader(recording, about, limit)
    windows, rolling = reader.windows, ExtendedModel()
    y = windows.measured - reader.predict(rolling)
    stds = covariate_errors(windows, about, Noise.first(recording.quantum_rad, about.car.radius_m))
    jacobians = covariate_jacobians(windows, about)
    covariates = {
        name: Covariate(value, jacobians[name], stds[name]) for name, value in windows.covariates.items()
    }
    turned = np.diff(wheel_angles(about.motion, about.car, rolling), axis=0)
    out = Prepared(
        recording=recording,
        reference=about,
        windows=windows,
        y=y,
        mask=np.isfinite(y),
        tick_residual_rad=recording.rotation_rad - turned,
        covariates=MappingProxyType(covariates),
    )
    for made in (
        about.motion,
        about.car,
        about.valid,
        windows,
        y,
        out.mask,
        out.tick_residual_rad,
        covariates,
    ):
        _lock(made)
    return out


def design(drive: Prepared, models: Mapping[str, ExtendedModel] | None = None) -> Design:
    """Columns of the radii of all wheels that were read (`radius_fl`..., metres), and of models by name: the
    response to each as it is given, so that a value of 1 is that model."""
    reader = Reader(drive.recording, drive.reference, kept=drive.windows.index)
    rolling, radii_m = ExtendedModel(), drive.reference.car.radius_m
    plain = reader.predict(rolling)
    columns = {}
    for wheel in drive.recording.wheels:
        moved = radii_m + RADIUS_STEP_M * (np.arange(4) == wheel)
        columns[f"radius_{WHEELS[wheel]}"] = (reader.predict(rolling, moved) - plain) / RADIUS_STEP_M
    for name, model in (models or {}).items():
        columns[name] = reader.predict(model) - plain
    stacked = np.nan_to_num(np.stack(list(columns.values()), axis=2))
    return Design(tuple(columns), *read_only(stacked))


def _lock(value: Any) -> None:
    """Make all arrays of nested records read-only."""
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif isinstance(value, Mapping):
        for one in value.values():
            _lock(one)
    elif is_dataclass(value):
        for field in fields(value):
            _lock(getattr(value, field.name))


@dataclass(frozen=True)
class DriveNoise:
    """The noise of one drive."""

    noise: Noise
    inflation: FloatArray | None = None
    """(w, 9) factors on the variances of single readings."""


def fit(
    drives: Sequence[Prepared],
    model: Sequence[Design],
    noise: Sequence[DriveNoise],
    prior: Prior | None = None,
) -> ParameterFit:
    """Fit a model to drives under their noise. ValueError where the three do not go together, or where the
    drives do not determine a value."""
    grams = [gram_of(drive, design, one) for drive, design, one in zip(drives, model, noise, strict=True)]
    return solved(grams, prior or {})


def gram_of(drive: Prepared, design: Design, noise: DriveNoise) -> Gram:
    """A drive's Gram matrices under its noise."""
    made = Whitener.of(drive.windows, noise.noise, drive.mask, noise.inflation)
    y = drive.y if drive.y.ndim == 3 else drive.y[:, :, None]
    replicates = y.shape[2]
    white = made.apply(np.concatenate([y, design.columns], axis=2)).reshape(-1, y.shape[2] + len(design.keys))
    return gram(design.keys, white[:, :replicates], white[:, replicates:], made.logdet)


def redrawn(
    drive: Prepared,
    design: Design,
    values: FloatArray,
    noise: DriveNoise,
    rng: np.random.Generator,
    count: int,
) -> Prepared:
    """The drive with residuals (w, 9, count) drawn from the noise about a model's values (p,): replicates
    whose design is fixed (parametric bootstrap; Davison and Hinkley 1997, section 2.2)."""
    made = Whitener.of(drive.windows, noise.noise, drive.mask, noise.inflation)
    expected = (design.columns @ values)[:, :, None]
    y = np.where(drive.mask[:, :, None], made.simulate(rng, count) + expected, np.nan)
    return replace(drive, y=read_only(y)[0])
