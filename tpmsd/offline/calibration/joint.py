"""The joint estimate: all drives at once, by generalised least squares about a motion that is itself unknown.

In: `Recording`s of one car, its `Vehicle`. Out: `JointFit`: the parameters with their covariance, the
rows of innovations they came from, and how the iteration went.

Gauss-Newton: linearise each drive about its nominal motion (`equations`), take motion and correlated noise
out and fit the noise of each drive (`tpmsd.offline.inference`), weigh outliers down, solve all drives' rows
together, move the car, repeat until it stands still.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.car.physics.effect import Parameter
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.calibration.equations import (
    CHANGES,
    COLUMNS,
    LOCAL,
    Equations,
    calibration_parameters,
    make_equations,
)
from tpmsd.offline.calibration.nominal import Vehicle, nominal_motion
from tpmsd.offline.inference.fit import gram, solved
from tpmsd.offline.inference.layouts import LEANING_CAR
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.noise_fit import (
    FIT_WINDOWS,
    SLOW_WINDOWS,
    Data,
    maximised,
    representative,
    single_outliers,
)
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.state_space import geometry
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import EAST

WIDE_PRIOR_STD = 0.2
"""Relative standard deviation of what a calibration is made for, radii and tracks: they are let free."""


def _confounding_priors() -> dict[str, tuple[float, float]]:
    """Return, by name, the prior mean and standard deviation of the terms that confound radii, relative to
    the neutral value.
    """
    out = {}
    for name, probe in calibration_parameters().items():
        for one in EFFECTS[probe.effect].parameters:
            if isinstance(one, Parameter) and one.name == probe.parameter and one.prior is not None:
                out[name] = (one.prior.mean - probe.neutral, one.prior.std)
    return out


PRIOR = {
    **_confounding_priors(),
    **dict.fromkeys(
        (*(f"radius_{wheel}" for wheel in WHEELS), "track_rear", "track_front"), (0.0, WIDE_PRIOR_STD)
    ),
    **dict.fromkeys(CHANGES, (0.0, 1e-2)),
}
"""Prior mean and standard deviation, by `equations.COLUMNS`. Radii, tracks and gyro
gain are relative and refer to the configuration."""
_NONE = 1e-9
"""Prior standard deviation of what is not let in."""
MAX_ITERATIONS = 12
NOISE_ITERATIONS = (2, 3, 5)
"""Iterations in which the noise of each drive is estimated: the last time with all outliers weighed down."""
LAST_OUTLIERS = 4
"""Last iteration that looks for outliers, on top of those before."""
STILL = 0.02
"""Converged when no parameter moves by more than this share of its standard deviation."""
CLUSTER_S = 20.0
SCALE_FLOOR = 1e-4
"""Relative standard deviation that all radii share whatever the data say: slopes too short to show in the
receiver's heights make the distance longer than it looks from above (1.4 % of slope: 1e-4)."""

SLANT = 0.01
"""Standard deviation of a road's lasting slant across."""


@dataclass(frozen=True)
class WhitenedEquations:
    """Equations of one drive, whitened: k blocks of nine for p parameters, with the noise they assume."""

    y: FloatArray
    """(k, 9)"""
    X: FloatArray
    """(k, 9, p)"""
    time_s: FloatArray
    equations: Equations
    noise: Noise
    inflate: FloatArray


@dataclass(frozen=True)
class JointFit:
    """Parameters and covariance that the iteration over all drives ended with, and why it stopped."""

    vehicle: Vehicle
    names: tuple[str, ...]
    values: FloatArray
    """(q,) final parameters; the relative ones against the configuration."""
    covariance: FloatArray
    linearised: FloatArray
    """(q,) about which the last rows were made."""
    reference_speed_mps: float
    """The radii are those at this speed."""
    iterations: int
    stopped_because: str
    history: list[FloatArray]
    """Radii (4,) after every iteration."""
    rows: list[WhitenedEquations] = field(repr=False)

    def of_drive(self, drive: int) -> tuple[FloatArray, FloatArray]:
        """Return the (p,) final parameters of a drive less those of its last linearisation, and their (p, p)
        covariance.
        """
        columns = _column_indices(self.names, drive)
        return (self.values - self.linearised)[columns], self.covariance[np.ix_(columns, columns)]

    def std(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        at = self.names.index(name)
        return float(np.sqrt(self.covariance[at, at]))

    def value(self, name: str) -> float:
        """Return the value of a parameter."""
        return float(self.values[self.names.index(name)])


def fit(
    recordings: list[Recording], start: Vehicle, progress: Callable[[float], None] = lambda share: None
) -> JointFit:
    """Estimate the car's parameters from its drives; `progress` is called with the fraction of the
    work done.
    """
    names = parameter_names(len(recordings))
    reference_mps = reference_speed(recordings, start)
    mean, wide = _priors(names)
    steady = np.where([name.startswith("change") for name in names], _NONE, wide)
    about = np.array([name.startswith(("radius", "track", "latency")) for name in names])
    moved = np.zeros(len(names))  # what has been put into the vehicle so far
    values = mean.copy()
    car = start
    noises: list[Noise | None] = [None] * len(recordings)
    inflates: list[FloatArray | None] = [None] * len(recordings)
    history: list[FloatArray] = []
    linearised = moved
    reason = f"{MAX_ITERATIONS} iterations are the most that are made"
    iteration = 0
    for iteration in range(1, MAX_ITERATIONS + 1):
        rows = []
        for at, recorded in enumerate(recordings):
            # A course bends by 4 mrad within a latency of 0.16 s: too much for a column that is linear in it.
            late_s = moved[names.index(_name_in_drive("latency", at))]
            recording = replace(recorded, fix_time_s=recorded.fix_time_s - late_s)
            equations = make_equations(recording, nominal_motion(recording, car), car, reference_mps)
            noise, inflate = noises[at], inflates[at]
            if noise is None or inflate is None:
                noise, inflate = Noise.first(recording.quantum_rad, car.radius_m), equations.inflate
            if iteration in NOISE_ITERATIONS:
                local = np.array([wide[names.index(_name_in_drive(name, at))] for name in COLUMNS])
                last = iteration == NOISE_ITERATIONS[-1]
                noise = _fit_noise(equations, noise, inflate, local, SLOW_WINDOWS if last else FIT_WINDOWS)
            white = whiten_equations(equations, noise, inflate)
            drive = WhitenedEquations(
                white[:, :, 0], white[:, :, 1:], equations.time_s, equations, noise, inflate
            )
            noises[at], inflates[at] = noise, inflate
            rows.append(drive)
            progress(_fraction_done(iteration, (at + 1) / len(recordings)))
        linearised = moved
        new, covariance = solve(rows, names, mean, steady, moved)
        if iteration <= LAST_OUTLIERS:
            free, _ = solve(rows, names, mean, wide, moved)
            for at, drive in enumerate(rows):
                residual = drive.y - drive.X @ (free - moved)[_column_indices(names, at)]
                before = drive.equations.inflate if iteration < LAST_OUTLIERS else drive.inflate
                inflates[at] = before * outlier_factors(residual)
        std = np.sqrt(np.diag(covariance))
        change = np.abs(new - values) / std
        values = new
        moved = np.where(about, values, 0.0)
        car = start.corrected(
            values[[names.index(f"radius_{wheel}") for wheel in ("fl", "fr", "rl", "rr")]],
            values[names.index("track_rear")],
            values[names.index("track_front")],
            values[names.index("load_lateral")],
        )
        history.append(car.radius_m)
        if iteration > NOISE_ITERATIONS[-1] and float(change.max()) < STILL:
            reason = f"no parameter moved by more than {STILL:g} of its standard deviation"
            break
    covariance = _widened_covariance(rows, names, values, covariance, linearised, car.radius_m)
    return JointFit(
        car, names, values, covariance, linearised, reference_mps, iteration, reason, history, rows
    )


def _fraction_done(iteration: int, drives: float) -> float:
    """Return the fraction of the calibration's work that is done, for a progress bar; most iterations fit no
    noise and are short."""
    before = [0.0, 0.02, 0.42, 0.67, 0.69, 0.94]
    begin = before[min(iteration - 1, len(before) - 1)]
    end = before[iteration] if iteration < len(before) else 1.0
    return begin + (end - begin) * drives


def reference_speed(recordings: list[Recording], car: Vehicle) -> float:
    """Return the distance-weighted root mean square speed of all drives by the rear wheels, m/s."""
    speed = np.concatenate([r.rotation_rad[:, 2] * car.radius_m[2] / r.dt_s for r in recordings])
    speed = speed[np.isfinite(speed) & (speed > 1.0)]
    return float(np.sqrt(np.sum(speed**3) / np.sum(speed))) if speed.size else 0.0


def parameter_names(drives: int) -> tuple[str, ...]:
    """Return the names of all parameters of so many drives; those of a single drive end in `@` and its
    number.
    """
    shared = tuple(name for name in COLUMNS if name not in LOCAL)
    return shared + tuple(f"{name}@{drive}" for drive in range(drives) for name in LOCAL)


def _name_in_drive(name: str, drive: int) -> str:
    """Return the name of a parameter in a drive: with `@` and its number if it is the drive's own."""
    return f"{name}@{drive}" if name in LOCAL else name


def _column_indices(names: tuple[str, ...], drive: int) -> list[int]:
    """Return the indices of a drive's columns among all parameters."""
    return [names.index(_name_in_drive(name, drive)) for name in COLUMNS]


def _priors(names: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the (q,) prior means and standard deviations of the named parameters."""
    pairs = np.array([PRIOR[name.split("@")[0]] for name in names])
    return pairs[:, 0], pairs[:, 1]


def whiten_equations(equations: Equations, noise: Noise, inflate: FloatArray) -> FloatArray:
    """Return the (w, 9, 1 + p) residuals and columns of a drive, whitened by a Kalman filter."""
    return Whitener.of(equations, noise, equations.here, inflate, LEANING_CAR).apply(equations.data)


def _fit_noise(
    equations: Equations, start: Noise, inflate: FloatArray, prior_std: FloatArray, windows: int
) -> Noise:
    """Return the maximum-likelihood noise of a drive by so many windows, its parameters integrated out under
    these priors (p,).
    """
    space = geometry(equations, equations.here, LEANING_CAR)
    data = representative(Data(space, equations.data, inflate, prior_std, priors={}), windows)
    return maximised(data, start, data.estimable())


def outlier_factors(white: FloatArray) -> FloatArray:
    """Return (w, 9) factors on the variances for outliers; both axes of a position share the larger one."""
    factor = single_outliers(white)
    factor[:, EAST:] = factor[:, EAST:].max(axis=1, keepdims=True)
    return factor


def solve(
    rows: list[WhitenedEquations],
    names: tuple[str, ...],
    mean: FloatArray,
    prior_std: FloatArray,
    moved: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return values (q,) and covariance of all parameters; `moved` (q,) is what the rows were linearised
    about.

    The prior speaks of the values themselves, so it pulls them back by what was moved already.
    """
    grams = [
        gram(
            [_name_in_drive(name, at) for name in COLUMNS],
            drive.y.reshape(-1, 1),
            drive.X.reshape(-1, len(COLUMNS)),
        )
        for at, drive in enumerate(rows)
    ]
    prior = dict(zip(names, zip(mean - moved, prior_std, strict=True), strict=True))
    found = solved(grams, prior)
    order = [found.keys.index(name) for name in names]
    return moved + found.values[order, 0], found.covariance[np.ix_(order, order)]


def _widened_covariance(
    rows: list[WhitenedEquations],
    names: tuple[str, ...],
    values: FloatArray,
    covariance: FloatArray,
    moved: FloatArray,
    radius_m: FloatArray,
) -> FloatArray:
    """Return the covariance, scaled up per parameter where the innovations are not as independent as the
    noise model says.

    Sandwich estimate with clusters of 20 s (Liang and Zeger, Biometrika 73, 1986).
    """
    meat = np.zeros_like(covariance)
    for at, drive in enumerate(rows):
        columns = _column_indices(names, at)
        residual = drive.y - drive.X @ (values - moved)[columns]
        score = np.einsum("kcp,kc->kp", drive.X, residual)
        cluster = (drive.time_s / CLUSTER_S).astype(int)
        sums = np.zeros((cluster.max() + 1, len(columns)))
        np.add.at(sums, cluster, score)
        meat[np.ix_(columns, columns)] += sums.T @ sums
    robust = covariance @ meat @ covariance
    scale = np.sqrt(np.maximum(np.diag(robust) / np.diag(covariance), 1.0))
    widened = covariance * np.outer(scale, scale)
    radii = np.array([name.startswith("radius") for name in names], dtype=np.float64)
    left = np.array([name in ("radius_fl", "radius_rl") for name in names], dtype=np.float64)
    sides = radii - 2.0 * left
    # A road that slants along all of the drive looks like radii that differ: as much as its slant is seen to
    # vary may last, and no less than what load transfer makes of a usual slant.
    at = names.index("load_lateral")
    load = float(np.hypot(values[at], np.sqrt(covariance[at, at])))
    usual = load * GRAVITY_MPS2 * SLANT / float(radius_m.mean())
    lean = sum(max(drive.noise.left_right_drift, usual) ** 2 for drive in rows) / len(rows) ** 2
    widened += SCALE_FLOOR**2 * np.outer(radii, radii) + lean * np.outer(sides, sides)
    return np.asarray(widened)
