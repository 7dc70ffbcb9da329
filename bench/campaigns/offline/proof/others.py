"""Two other methods on the same drive: sparse regression of the discrepancy, and symbolic regression.

In: a drive folder. Out: of each method the residual with the largest held-out share explained, the covariate
of its leading term, and its formula. PySINDy is used as for discrepancy modelling (Ebers, Steele and Kutz,
2024): sequentially thresholded least squares of the model's error on a polynomial library. gplearn evolves a
formula for the same error.

Both get windows of a second from `independent_look`, which shares only the reading of the files with the
diagnosis: four wheels against the receiver and the gyro against the course, each less its mean, with
speed, accelerations, yaw rate and time. Both are fitted on every other block of 60 s and judged on the
blocks left out; the threshold is chosen within the former. Neither has a catalogue: a covariate and a
formula is all that it can say.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.campaigns.offline import independent_look
from tpmsd.car.config.load import load_config

Array = NDArray[np.float64]
COVARIATES = ("speed", "accel_long", "accel_lat", "yaw_rate", "time")
RESIDUALS = ("fl", "fr", "rl", "rr", "gyro")
BLOCK_S = 60
THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.4)
"""Trial thresholds of the standardised coefficients, in standard deviations of the residual."""


@dataclass(frozen=True)
class Said:
    """The answer of a method."""

    residual: str = ""
    covariate: str = ""
    formula: str = ""
    explained: float = 0.0
    """Share of the held-out variance of that residual."""
    error: str = ""

    def locates(self, channels: list[str], wheels: list[str], covariates: list[str]) -> bool:
        """Return True where residual and covariate are among those in which the effect acts."""
        on_gyro = self.residual == "gyro"
        receiver = any(channel.startswith("gnss") for channel in channels)
        right = "yaw_rate" in channels if on_gyro else receiver or self.residual in wheels
        return right and self.covariate in covariates


@dataclass(frozen=True)
class Table:
    """Windows: standardised covariates (n, 5), residuals (n, 5), which of them are held out (n,)."""

    X: Array
    Y: Array
    out: NDArray[np.bool_]


def table(folder: Path) -> Table:
    """Read a drive folder into windows of a second, outliers of six robust deviations left out."""
    config = load_config(folder / "vehicle.toml")
    seen = independent_look.read(folder, config)
    radii = np.array(config.vehicle.wheel_radius_m)
    half = 0.5 * np.array([-1.0, 1.0, -1.0, 1.0])
    track = np.repeat([config.vehicle.track_front_m, config.vehicle.track_rear_m], 2)
    rolling = seen.speed[:, None] + seen.yaw[:, None] * half * track
    with np.errstate(divide="ignore", invalid="ignore"):
        wheels = rolling / (seen.angle * radii) - 1.0
    gyro = seen.gyro - np.gradient(seen.course)
    time_s = np.arange(len(seen.speed), dtype=np.float64)
    X = np.stack([seen.speed, seen.accel, seen.speed * seen.yaw, seen.yaw, time_s], axis=1)
    Y = np.column_stack([wheels, gyro])
    driving = np.isfinite(X).all(axis=1) & (seen.speed > independent_look.MIN_SPEED_MPS)
    X, Y, out = X[driving], Y[driving], (time_s[driving] // BLOCK_S % 2) == 1
    middle = np.nanmedian(Y, axis=0)
    spread = 1.4826 * np.nanmedian(np.abs(Y - middle), axis=0)
    Y = np.where(np.abs(Y - middle) < 6.0 * spread, Y, np.nan)
    return Table((X - X.mean(axis=0)) / X.std(axis=0), Y, out)


def _answer(of: Table, fit: Callable[[Array, Array], tuple[Callable[[Array], Array], str, str]]) -> Said:
    best = Said(error="nothing explained")
    for k, residual in enumerate(RESIDUALS):
        known = np.isfinite(of.Y[:, k])
        train, test = known & ~of.out, known & of.out
        if min(train.sum(), test.sum()) < BLOCK_S:
            continue
        y = of.Y[:, k]
        mean, std = float(y[train].mean()), float(y[train].std())
        if std == 0.0:
            continue
        predict, covariate, formula = fit(of.X[train], (y[train] - mean) / std)
        wanted = (y[test] - mean) / std
        explained = 1.0 - float(np.var(wanted - predict(of.X[test])) / np.var(wanted))
        if covariate and explained > best.explained:
            best = Said(residual, covariate, formula, explained)
    return best


def sparse(of: Table) -> Said:
    """Return the answer of PySINDy's sequentially thresholded least squares."""
    from pysindy import STLSQ, PolynomialLibrary

    def fit(X: Array, y: Array) -> tuple[Callable[[Array], Array], str, str]:
        library = PolynomialLibrary(degree=2)
        Z = np.asarray(library.fit_transform(X))
        first = np.arange(len(y)) < len(y) // 2
        losses = []
        for threshold in THRESHOLDS:
            part = STLSQ(threshold=threshold, alpha=1e-3).fit(Z[first], y[first, None])
            losses.append(float(np.var(y[~first] - Z[~first] @ np.ravel(part.coef_))))
        model = STLSQ(threshold=THRESHOLDS[int(np.argmin(losses))], alpha=1e-3).fit(Z, y[:, None])
        coefficients = np.ravel(model.coef_)
        names = library.get_feature_names(list(COVARIATES))
        order = [k for k in np.argsort(-np.abs(coefficients) * Z.std(axis=0)) if coefficients[k] != 0.0]
        terms = [k for k in order if names[k] != "1"]
        formula = " ".join(f"{coefficients[k]:+.2f} {names[k]}" for k in terms[:3])
        covariate = names[terms[0]].replace("^2", "").split(" ")[0] if terms else ""

        def predict(at: Array) -> Array:
            return np.asarray(np.asarray(library.transform(at)) @ coefficients)

        return predict, covariate, formula

    return _answer(of, fit)


def symbolic(of: Table, seed: int) -> Said:
    """Return the answer of gplearn's symbolic regression."""
    from gplearn.genetic import SymbolicRegressor

    def fit(X: Array, y: Array) -> tuple[Callable[[Array], Array], str, str]:
        model: Any = SymbolicRegressor(
            population_size=100,
            generations=5,
            tournament_size=10,
            parsimony_coefficient=0.005,
            function_set=("add", "sub", "mul", "div", "sqrt", "abs"),
            feature_names=list(COVARIATES),
            random_state=seed,
        )
        model.fit(X, y)
        formula = str(model._program)
        # the leading covariate is the one whose shuffling costs most
        rng, base = np.random.default_rng(seed), np.asarray(model.predict(X))
        costs = []
        for k in range(X.shape[1]):
            shuffled = X.copy()
            shuffled[:, k] = rng.permutation(X[:, k])
            costs.append(float(np.mean((np.asarray(model.predict(shuffled)) - base) ** 2)))
        covariate = COVARIATES[int(np.argmax(costs))] if max(costs) > 0.0 else ""
        return lambda at: np.asarray(model.predict(at)), covariate, formula

    return _answer(of, fit)


def others(folder: Path, seed: int) -> dict[str, Said]:
    """Return the answers of both; what is not installed, or fails on a drive, says so."""
    said: dict[str, Said] = {}
    methods = {"PySINDy": ("pysindy", sparse), "gplearn": ("gplearn", lambda of: symbolic(of, seed))}
    windows: Table | None = None
    for name, (module, method) in methods.items():
        if find_spec(module) is None:
            said[name] = Said(error="not installed")
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                windows = windows or table(folder)
                said[name] = method(windows)
            except (np.linalg.LinAlgError, ValueError) as error:
                said[name] = Said(error=f"failed: {error}")
    return said
