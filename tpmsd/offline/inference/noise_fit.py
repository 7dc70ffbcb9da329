"""The noise model of a drive, estimated from the drive by restricted maximum likelihood.

In: `Linearised`, residuals, the columns of the model so far. Out: the `Noise` of greatest restricted
likelihood (Patterson and Thompson, Biometrika 58, 1971: the values of the columns are integrated out, so that
what they take up is not counted as calm), and how much single readings must be inflated because they are
outliers. Estimated after the best model, not before: a missing effect must not pass for noise.

The likelihood is maximised in the logarithms of the parameters by L-BFGS-B (Byrd, Lu, Nocedal and Zhu, SIAM
Journal on Scientific Computing 16, 1995) with its exact gradient, which the filter's adjoint gives.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
import scipy.linalg
from scipy.optimize import OptimizeResult, minimize

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.noise import LIMITS, PRIORS, Noise
from tpmsd.offline.inference.scores import Derivatives
from tpmsd.offline.inference.state_space import Diagonals, Geometry, changed_diagonals, diagonals, geometry
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import CHANNELS, COURSE, EAST, GYRO, SPEED, Linearised

SLOW = ("slow_m", "slow_tau_s")
RADIUS_DRIFT = ("radius_drift", "radius_drift_tau_s")
POSITION = (*SLOW, "white_m", "clock_s")
VELOCITY = ("speed_white_mps", "speed_mps", "speed_memory")
SLOWLY_VARYING = (*SLOW, *RADIUS_DRIFT, "gyro_drift_radps", "speed_memory", "clock_s", "clock_tau_s")
"""Parameters that could pass for a missing effect: not estimated before effects were looked for."""
FIT_WINDOWS, SLOW_WINDOWS = 300, 600
"""Linearised that stand for a long drive, where all parameters and where slow ones are estimated."""
OUTLIER = 3.5
ROUGH_STRETCH = 1.6
"""Variance of a stretch over the typical one, from which it is taken as noisier."""
NEAR_NATS, FIRST_NEAR_NATS = 0.05, 0.2
"""Gain of a step of the maximisation below which it ends; the first stage's noise is where the second
starts."""
MAX_STEPS = 40
_RIDGE = 1e-7
_PROBE = 1e-5
"""Step in the logarithm of a parameter by which the closed forms of `Diagonals` are differentiated."""


class SearchStage(Enum):
    """Stage of the search for effects, and so the part of the noise that may be estimated."""

    FIRST = 0
    """Nothing was looked for: not what drifts."""
    SECOND = 1
    LAST = 2
    """The rest is known: only what drifts, once more."""


@dataclass(frozen=True)
class Data:
    """Data that a noise is estimated from."""

    space: Geometry
    columns: FloatArray
    """(w, 9, 1 + k) residual and columns whose values are integrated out; zero where not measured."""
    inflate: FloatArray
    """(w, 9)"""
    prior_std: FloatArray | None = None
    """(k,) of the columns' values; None where nothing is known of them."""
    priors: Mapping[str, tuple[float, float]] = field(default_factory=lambda: PRIORS)
    """Priors of the noise: median and logarithmic spread by parameter."""

    def estimable(self, names: Iterable[str] = LIMITS) -> list[str]:
        """Return those of `names` that a state of the drive depends on and a measured channel shows."""
        seen = np.atleast_1d(self.space.here.any(axis=0))
        return [
            name
            for name in names
            if name in self.space.layout.parameters and seen[_channel_of_parameter(name)]
        ]


def fit_noise(
    windows: Linearised,
    columns: FloatArray,
    start: Noise,
    stage: SearchStage,
    inflate: FloatArray | None = None,
) -> Noise:
    """Return the noise that maximises the restricted likelihood over the parameters of a stage.

    `columns` (w, 9, 1 + k): the residual and the columns of the model, whose values are fitted along.
    A long drive is represented by two stretches of it.
    """
    whole = _data_of(windows, columns, inflate)
    names = whole.estimable()
    if stage is SearchStage.FIRST:
        part = _with_radii_by_stretch(representative(whole, FIT_WINDOWS))
        return maximised(part, start, [name for name in names if name not in SLOWLY_VARYING], FIRST_NEAR_NATS)
    if stage is SearchStage.LAST:
        slow = representative(whole, SLOW_WINDOWS)
        return maximised(slow, start, [name for name in names if name in SLOWLY_VARYING])
    return maximised(representative(whole, FIT_WINDOWS), start, names)


def refit_slow(windows: Linearised, columns: FloatArray, noise: Noise, inflate: FloatArray | None) -> Noise:
    """Return the noise with only the receiver's slow error fitted, on the whole drive."""
    return refit(windows, columns, noise, inflate, SLOW)


def refit_radius_drift(
    windows: Linearised, columns: FloatArray, noise: Noise, inflate: FloatArray | None
) -> Noise:
    """Return the noise with only the radius drift fitted, on the whole drive."""
    return refit(windows, columns, noise, inflate, RADIUS_DRIFT)


def refit(
    windows: Linearised, columns: FloatArray, noise: Noise, inflate: FloatArray | None, names: Sequence[str]
) -> Noise:
    """Return the noise with these parameters alone fitted, on the whole drive."""
    return maximised(_data_of(windows, columns, inflate), noise, names)


def log_posterior(
    windows: Linearised, columns: FloatArray, noise: Noise, inflate: FloatArray | None
) -> float:
    """Return the log-likelihood with the columns' values at their best, plus the log prior of the noise."""
    data = _data_of(windows, columns, inflate)
    made = Whitener(data.space, diagonals(data.space, noise, data.inflate))
    y, X, _ = _whitened_orthonormal(data, made)
    left = y - X @ (X.T @ y)
    return -0.5 * (float(left @ y) + made.logdet) + log_prior(noise)


def maximised(data: Data, start: Noise, names: Sequence[str], near_nats: float = NEAR_NATS) -> Noise:
    """Return the noise of greatest restricted posterior in these parameters, from a start; the search ends
    with a step that gains less than `near_nats`."""
    if not names:
        return start
    free = np.array([_free_coordinate(name, float(getattr(start, name))) for name in names])
    bounds = [
        (_free_coordinate(name, LIMITS[name][0]), _free_coordinate(name, LIMITS[name][1])) for name in names
    ]
    free = np.clip(free, *np.array(bounds).T)

    def negative(values: FloatArray) -> tuple[float, FloatArray]:
        value, slope = restricted_posterior(data, _noise_at(start, names, values), names)
        return -value, -slope

    found = minimize(
        negative,
        free,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"ftol": 0.0, "maxiter": MAX_STEPS, "maxfun": 2 * MAX_STEPS},
        callback=_Convergence(near_nats),
    )
    return _noise_at(start, names, found.x)


class _Convergence:
    """Ends a maximisation when a step gains next to nothing."""

    def __init__(self, least: float) -> None:
        self.least, self.before = least, math.inf

    def __call__(self, intermediate_result: OptimizeResult) -> None:
        now = float(intermediate_result.fun)
        if self.before - now < self.least:
            raise StopIteration
        self.before = now


def restricted_posterior(data: Data, noise: Noise, names: Sequence[str]) -> tuple[float, FloatArray]:
    """Return the restricted log-likelihood plus the log prior of a noise, and its gradient by the free
    coordinates (the logarithm; of a correlation the logit) of the named parameters."""
    diagonal = diagonals(data.space, noise, data.inflate)
    made = Whitener(data.space, diagonal, for_derivatives=True)
    y, X, log_information = _whitened_orthonormal(data, made)
    left = y - X @ (X.T @ y)
    value = -0.5 * (float(left @ y) + made.logdet + log_information) + log_prior(noise, data.priors)
    measured = slice(0, data.inflate.size)  # what is known beforehand depends on no noise
    rows = np.concatenate([left[measured, None], X[measured]], axis=1).reshape(data.columns.shape)
    by = made.derivatives(rows)
    slope = np.array([_slope_by_parameter(data, noise, diagonal, name, by) for name in names])
    return value, slope


def log_prior(noise: Noise, priors: Mapping[str, tuple[float, float]] = PRIORS) -> float:
    """Return the log prior of a noise: a drive holds too few swings of the receiver's slow error to fit it
    alone."""
    return -0.5 * sum(
        (math.log(getattr(noise, name) / middle) / spread) ** 2 for name, (middle, spread) in priors.items()
    )


def single_outliers(white: FloatArray) -> FloatArray:
    """Return (w, 9) factors on the variances that bring readings beyond 3.5 standard deviations back to 2."""
    size = np.abs(white)
    return np.where(size > OUTLIER, np.square(size / 2.0), 1.0)


def outliers(white: FloatArray, blocks: np.ndarray, inflate: FloatArray | None) -> FloatArray:
    """Return (w, 9) factors on the variances, from the whitened residual of the best model so far.

    Readings beyond 3.5 standard deviations are made to weigh less, and so are stretches in which a
    channel scatters more than in the rest of the drive (a receiver under bridges): noise is not the same
    all along a road.
    """
    before = np.ones(white.shape[:2]) if inflate is None else inflate
    size = np.abs(white)
    factor = single_outliers(white)
    calm = np.minimum(size, OUTLIER) ** 2
    for channels in (
        slice(0, GYRO),
        slice(GYRO, SPEED),
        slice(SPEED, COURSE),
        slice(COURSE, EAST),
        slice(EAST, CHANNELS),
    ):
        live = size[:, channels] > 0.0
        if channels.start == 0:
            live[:, :2] = False  # these rows tell the motion, not the noise
        total = np.bincount(blocks, (calm[:, channels] * live).sum(axis=1))
        number = np.bincount(blocks, live.sum(axis=1))
        scatter = total / np.maximum(number, 1.0)
        rough = np.where((scatter > ROUGH_STRETCH) & (number > 10), scatter, 1.0)
        factor[:, channels] *= rough[blocks][:, None]
    return np.asarray(before * factor)


def _whitened_orthonormal(data: Data, made: Whitener) -> tuple[FloatArray, FloatArray, float]:
    """Return whitened data (n,), columns (n, k) that are orthonormal and span the others, and the log-
    determinant of these others' information, up to a constant that no noise changes. Priors of the columns'
    values stand in k rows at the end, as readings of zero."""
    white = made.apply(data.columns)
    rows = white.reshape(-1, white.shape[2])
    y, X = rows[:, 0], rows[:, 1:]
    if data.prior_std is not None:
        y = np.concatenate([y, np.zeros(len(data.prior_std))])
        X = np.concatenate([X, np.diag(1.0 / data.prior_std)])
    if not X.shape[1]:
        return y, X, 0.0
    gram = X.T @ X
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    gram = gram / np.outer(size, size)
    gram.flat[:: len(gram) + 1] += _RIDGE
    factor = np.linalg.cholesky(gram)
    basis = scipy.linalg.solve_triangular(factor, (X / size).T, lower=True).T
    return y, basis, 2.0 * float(np.log(np.diag(factor)).sum() + np.log(size).sum())


def _slope_by_parameter(data: Data, noise: Noise, diagonal: Diagonals, name: str, by: Derivatives) -> float:
    """Return the derivative of the restricted posterior by the free coordinate of one parameter."""
    here = _free_coordinate(name, float(getattr(noise, name)))
    moved = _noise_at(noise, [name], np.array([here + _PROBE]))
    parts = changed_diagonals(data.space, moved, name, data.inflate)
    out = sum(
        float(np.sum(getattr(by, part)[..., at] * (after - getattr(diagonal, part)[..., at]))) / _PROBE
        for part, at, after in parts
    )
    if name in data.priors:
        middle, spread = data.priors[name]
        out -= math.log(getattr(noise, name) / middle) / spread**2
    return out


def _free_coordinate(name: str, value: float) -> float:
    """Return the unbounded coordinate of a parameter: its logarithm, or the logit of a correlation."""
    return math.log(value / (1.0 - value)) if name == "speed_memory" else math.log(value)


def _noise_at(start: Noise, names: Sequence[str], free: FloatArray) -> Noise:
    """Return the noise with the named parameters at these free coordinates."""
    values = np.exp(free)
    changes = {
        name: float(value / (1.0 + value)) if name == "speed_memory" else float(value)
        for name, value in zip(names, values, strict=True)
    }
    return dataclasses.replace(start, **changes)  # type: ignore[arg-type]


def _channel_of_parameter(name: str) -> int:
    """Return the channel that has to be measured so that a parameter can be estimated."""
    if name.startswith("gyro"):
        return GYRO
    if name.startswith("speed"):
        return SPEED
    if name.startswith(("cross", "course")):
        return COURSE
    return EAST if name.startswith(("white", "slow", "clock", "age")) else 2


def _data_of(windows: Linearised, columns: FloatArray, inflate: FloatArray | None) -> Data:
    """Return the data of a noise fit; a channel is missing where column 0 is NaN."""
    here = np.isfinite(columns[:, :, 0])
    weight = np.ones((len(windows), CHANNELS)) if inflate is None else inflate
    return Data(geometry(windows, here), columns, weight)


def representative(data: Data, windows: int = FIT_WINDOWS) -> Data:
    """Return two contiguous stretches, of `windows` windows together, in place of a long drive."""
    count = len(data.columns)
    if count <= windows:
        return data
    half = windows // 2
    first = count // 4 - half // 2
    second = 3 * count // 4 - half // 2
    at = np.concatenate([np.arange(first, first + half), np.arange(second, second + half)])
    index = np.cumsum(data.space.gap)[at]
    gap = np.diff(index, prepend=index[:1] - 1)
    return dataclasses.replace(
        data, space=data.space.part(at, gap), columns=data.columns[at], inflate=data.inflate[at]
    )


def _with_radii_by_stretch(data: Data) -> Data:
    """Return the data with columns for radii of each stretch: a tyre that changed between them is no noise in
    them."""
    gap = data.space.gap
    if not np.any(gap > 1):
        return data
    cut = int(np.argmax(gap))
    wheels = np.flatnonzero(data.space.here[:, :GYRO].any(axis=0))
    own = np.zeros((*data.columns.shape[:2], len(wheels)))
    own[cut:, wheels, np.arange(len(wheels))] = data.space.speed_mps[cut:, None]
    return dataclasses.replace(data, columns=np.concatenate([data.columns, own], axis=2))
