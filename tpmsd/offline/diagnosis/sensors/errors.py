"""Fits all errors of the sensors together.

In: a `Reader`. Out: `SensorError`s, one per parameter of an effect that shows in these sensors. Least squares
over all sensors at once, each scaled by its own scatter; standard deviations by blocks of time (White,
Econometrica 48, 1980), for slopes, gusts and drivers make residuals that last for seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.catalogue import FittedParameter, sensor_probes
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.sensors.readings import Rows, response, rows_of
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.windows import Reader


@dataclass(frozen=True)
class SensorError:
    """A fitted parameter."""

    probe: FittedParameter
    value: float
    """Difference from neutral."""
    std: float
    sensors: tuple[str, ...]
    """Those in which it shows, the plainest first."""
    rms_before: float
    """Sums of squares of the scaled residuals in them, without and with it."""
    rms_after: float


def fit_sensor_errors(reader: Reader) -> list[SensorError]:
    """Return estimate and standard deviation of each error of a sensor that the drive identifies.

    Least squares; of sound sensors too; empty on too short a drive.
    """
    rows = rows_of(reader)
    probes = [probe for probe, reads in sensor_probes() if set(reads) & set(rows)]
    if not rows or not probes:
        return []
    columns = {
        name: np.stack([response(reader, name, part, probe) for probe in probes], axis=1)
        for name, part in rows.items()
    }
    scale = {name: _scatter(part.residual, columns[name]) for name, part in rows.items()}
    y = np.concatenate([part.residual / scale[name] for name, part in rows.items()])
    X = np.concatenate([columns[name] / scale[name] for name in rows])
    blocks = _blocks(list(rows.values()))
    size = np.sqrt((X**2).sum(axis=0))
    estimated = _estimable(X, size)
    if not estimated or blocks.max() + 1 < SETTINGS.sensors.fewest_blocks:
        return []
    X, size = X[:, estimated] / size[estimated], size[estimated]
    inverse = np.linalg.inv(X.T @ X)
    values = inverse @ (X.T @ y)
    left = y - X @ values
    score = np.stack([np.bincount(blocks, left * column) for column in X.T], axis=1)
    stds = np.sqrt(np.diag(inverse @ (score.T @ score) @ inverse))
    starts = np.cumsum([0, *(len(part.time_s) for part in rows.values())])
    out = []
    for k, which in enumerate(estimated):
        share = np.add.reduceat(X[:, k] ** 2, starts[:-1])
        order = [list(rows)[i] for i in np.argsort(-share) if share[i] > SETTINGS.sensors.min_share]
        here = np.abs(X[:, k]) > 0.0
        without = left + X[:, k] * values[k]
        value, std = values[k] / size[k], stds[k] / size[k]
        out.append(
            SensorError(
                probe=probes[which],
                value=float(value),
                std=float(np.hypot(std, SETTINGS.sensors.model_error * value)),
                sensors=tuple(order),
                rms_before=float(np.sqrt(np.mean(without[here] ** 2))),
                rms_after=float(np.sqrt(np.mean(left[here] ** 2))),
            )
        )
    return out


def _scatter(residual: FloatArray, columns: FloatArray) -> float:
    """Return the standard deviation of what no error explains, by the median."""
    used = columns[:, np.any(columns != 0.0, axis=0)]
    left = residual - used @ np.linalg.lstsq(used, residual, rcond=None)[0] if used.size else residual
    return max(float(np.median(np.abs(left))) / 0.6745, 1e-9)


def _blocks(parts: list[Rows]) -> np.ndarray:
    """(rows,) number of each row's block; those of one time are one block whatever the sensor."""
    times = np.concatenate([part.time_s for part in parts])
    return np.unique(np.floor(times / SETTINGS.sensors.block_s), return_inverse=True)[1]


def _estimable(X: FloatArray, size: FloatArray) -> list[int]:
    """Return the indices of the columns that the ones before them do not explain."""
    kept: list[int] = []
    for k in range(X.shape[1]):
        if size[k] <= 0.0:
            continue
        column = X[:, k] / size[k]
        basis = X[:, kept] / size[kept]
        left = column - basis @ np.linalg.lstsq(basis, column, rcond=None)[0] if kept else column
        if float(left @ left) > SETTINGS.sensors.min_share:
            kept.append(k)
    return kept
