"""How much a drive identifies at best: least squares under the known noise, written apart from the diagnosis.

In: `Windows` and columns of differences (w, 9, p). Out: their Gram matrix (p, p) with the car's unknown
motion and all correlated noise taken out. Half a diagonal element is the log-likelihood that the difference
brings.

Unknowns of each window: reading errors of the four wheels at its end, error of speed and heading, position,
the receiver's slow position error, its Doppler errors along and across, the gyro's bias. They are solved for
together, as one banded system of normal equations (Rue and Held, Gaussian Markov Random Fields, 2005,
section 2.4).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import solveh_banded
from scipy.sparse import coo_matrix

from bench.campaigns.offline.diagnosis.signals import Windows
from bench.worlds.course import Array

Q, V, PSI, PE, PN, BE, BN, DS, DC, GB, STATES = 0, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13
_READING_FLOOR_M = 2e-4
_CHAIN_M = 1e-3
"""Of the way from window to window: only so that the matrix stays well conditioned."""


def reading_std_m(windows: Windows) -> Array:
    """(w,) error of a wheel's way at an instant: counts and time stamps."""
    spec = windows.spec
    if spec.wheel_signal == "speeds":
        step = spec.speed_step_kmh / 3.6 / math.sqrt(12)
        jitter = spec.edge_noise_rad * math.sqrt(2) / 0.02 * spec.radius_m
        # errors of single frames add up over a second
        counted = math.hypot(step, jitter) / math.sqrt(spec.wheel_hz) / math.sqrt(2)
    else:
        counted = 2 * math.pi / spec.teeth * spec.radius_m / math.sqrt(12)
    return np.asarray(np.hypot(counted, spec.frame_jitter_s * windows.speed) + _READING_FLOOR_M)


def gram(windows: Windows, columns: Array) -> Array:
    """(p, p) inner products of the columns under the inverse covariance of all noise."""
    H, weight, chain, chain_weight = _rows(windows)
    p = columns.shape[2]
    data = columns.reshape(-1, p) * windows.read.reshape(-1, 1)
    A = (H.T @ H.multiply(weight[:, None]) + chain.T @ chain.multiply(chain_weight[:, None])).tocoo()
    width = 2 * STATES
    banded = np.zeros((width, A.shape[0]))
    low = A.row >= A.col
    np.add.at(banded, (A.row[low] - A.col[low], A.col[low]), A.data[low])
    B = np.asarray(H.T @ (data * weight[:, None]))
    solved = solveh_banded(banded, B, lower=True)
    return np.asarray(data.T @ (data * weight[:, None]) - B.T @ solved)


def _rows(windows: Windows) -> tuple[coo_matrix, Array, coo_matrix, Array]:
    """Measurement rows over the unknowns with their weights; and the rows that chain the windows."""
    spec, count = windows.spec, len(windows)
    k = np.arange(count)
    at = k * STATES
    v = np.maximum(windows.speed, 1.0)
    one = np.ones(count)
    entries: list[tuple[Array, Array, Array]] = []

    def put(row: Array, state: Array, value: Array, valid: Array | None = None) -> None:
        keep = slice(None) if valid is None else valid
        entries.append((row[keep], state[keep], value[keep]))

    later = k > 0
    before = at - STATES
    for wheel in range(4):
        row = 9 * k + wheel
        put(row, at + V, one)
        put(row, at + Q + wheel, one)
        put(row, before + Q + wheel, -one, later)
        put(row, at + PSI, windows.yaw_of_distance[:, wheel])
        put(row, before + PSI, -windows.yaw_of_distance[:, wheel], later)
    gyro, speed, course = 9 * k + 4, 9 * k + 5, 9 * k + 6
    put(gyro, at + PSI, one)
    put(gyro, before + PSI, -one, later)
    put(gyro, at + GB, one)
    left, ahead = spec.antenna_left_m, spec.antenna_forward_m
    put(speed, at + V, one)
    put(speed, at + PSI, -left * one)
    put(speed, before + PSI, left * one, later)
    put(speed, at + DS, one)
    put(course, at + PSI, 0.5 + ahead / v)
    put(course, before + PSI, 0.5 - ahead / v, later)
    put(course, at + DC, 1.0 / v)
    for axis, (place, slow) in enumerate(((PE, BE), (PN, BN))):
        row = 9 * k + 7 + axis
        put(row, at + place, one)
        put(row, at + slow, one)
        put(row, at + V, -0.5 * (windows.cos, windows.sin)[axis])
    H = _matrix(entries, 9 * count, count * STATES)
    number = np.maximum(windows.fixes, 1.0)
    variance = np.empty((count, 9))
    variance[:, :4] = (spec.rough**2 * v + 1e-8)[:, None]
    variance[:, 4] = (spec.gyro_std / math.sqrt(spec.inertial_hz)) ** 2 + (1e-4) ** 2 / 12
    fresh = spec.doppler_mps**2 * 0.02 + (0.514 * 10.0**-spec.speed_digits) ** 2 / 12
    variance[:, 5] = fresh / number
    grain = math.radians(10.0**-spec.course_digits) / math.sqrt(12)
    variance[:, 6] = (fresh / v**2 + grain**2) / number
    metres = 1852.0 * 10.0**-spec.place_digits / math.sqrt(12)
    variance[:, 7:] = ((spec.position_white_m**2 + metres**2) / number)[:, None]
    weight = (windows.read / variance).reshape(-1)

    links: list[tuple[Array, Array, Array]] = []
    weights: list[Array] = []
    rows = 0

    def link(pieces: list[tuple[Array, Array]], variances: Array) -> None:
        nonlocal rows
        row = rows + k
        for state, factor in pieces:
            keep = (state >= 0) & (state < count * STATES)
            links.append((row[keep], state[keep], factor[keep]))
        weights.append(1.0 / variances)
        rows += count

    def markov(state: int, std: float, tau_s: float) -> None:
        a = math.exp(-1.0 / tau_s)
        first = np.where(later, std**2 * (1 - a * a), std**2)
        link([(at + state, one), (before + state, -a * one)], first)

    reading = reading_std_m(windows) ** 2
    for wheel in range(4):
        link([(at + Q + wheel, one)], reading)
    link([(at + V, one)], 1.0 * one)
    link([(at + PSI, one), (before + PSI, -one)], np.where(later, 0.1**2, 0.5**2))
    for place, slope, turn in ((PE, windows.cos, -windows.sin), (PN, windows.sin, windows.cos)):
        link(
            [
                (at + place, one),
                (before + place, -one),
                (at + V, -slope),
                (at + PSI, -0.5 * v * turn),
                (before + PSI, -0.5 * v * turn),
            ],
            np.where(later, _CHAIN_M**2, 300.0**2),
        )
    markov(BE, spec.position_slow_m, spec.position_tau_s)
    markov(BN, spec.position_slow_m, spec.position_tau_s)
    markov(DS, spec.doppler_mps, spec.doppler_tau_s)
    markov(DC, spec.doppler_mps, spec.doppler_tau_s)
    link([(at + GB, one), (before + GB, -one)], np.where(later, spec.gyro_drift**2, 1e-10))
    return H, weight, _matrix(links, rows, count * STATES), np.concatenate(weights)


def _matrix(entries: list[tuple[Array, Array, Array]], rows: int, columns: int) -> coo_matrix:
    row, column, values = (np.concatenate([entry[k] for entry in entries]) for k in range(3))
    return coo_matrix((values, (row, column)), shape=(rows, columns)).tocsr()


def explained(G: Array, target: int, by: list[int]) -> float:
    """Half the energy of column `target` that columns `by` can take up."""
    if not by:
        return 0.0
    inner = G[np.ix_(by, by)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    solved = np.linalg.lstsq(inner / np.outer(scale, scale), G[by, target] / scale, rcond=1e-10)[0]
    return 0.5 * float((G[by, target] / scale) @ solved)


def without(G: Array, by: list[int]) -> Array:
    """(p, p) the Gram matrix with the span of columns `by` taken out."""
    if not by:
        return G
    inner = G[np.ix_(by, by)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    inverse = np.linalg.pinv(inner / np.outer(scale, scale), rcond=1e-10) / np.outer(scale, scale)
    return np.asarray(G - G[:, by] @ inverse @ G[by, :])
