"""What the data hold at all: a Kalman filter and a fixed-interval smoother that know the noise.

In: a `Driven`. Out: errors of the causal estimate and of the off-line smoother, for the rear pair.

Both are given what no estimator has: the variances and memories of this very receiver and road, and the
true trajectory as the point to linearise about, so no error of linearisation is left. The radii are a random
walk of an intensity that suits the scenario (`WALK`), zero where they are constant. Reading errors are kept
as states, for they are bounded: each one is made good by the next.

State: east, north, heading; reading errors of rl and rr now and one tick ago; slow position error (2);
Doppler error (2); radius errors of rl and rr.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.worlds.paper_drive import QUANTUM_RAD, RADIUS_M, RL, ROUGHNESS_M, TICK_S, Driven
from bench.worlds.paper_route import TRACK_M

Array = NDArray[np.float64]
E, N, PSI, Q, QB, B, D, MU = 0, 1, 2, 3, 5, 7, 9, 11
SIZE = 13
PRIOR_RADIUS_M = 0.01 * RADIUS_M
WALK = {"balanced": 0.0, "unbalanced": 0.0, "puncture": 2e-5, "lively": 2e-5}
"""Random walk of each rear radius, m per sqrt(s): about what makes the smoother best in that scenario."""


@dataclass(frozen=True)
class Limit:
    """Estimates (n, 2) of the rear radii and their covariances (n, 2, 2)."""

    causal_m: Array
    causal_cov: Array
    smoothed_m: Array
    smoothed_cov: Array


def _transition(driven: Driven, k: int, walk: float) -> tuple[Array, Array, Array]:
    """Jacobian, noise covariance and the prediction's point for tick k, about the truth."""
    tick = driven.ticks[k]
    turned = tick.rotation_rad[RL:]
    radius = RADIUS_M + driven.offsets_m[k, RL:]
    distance = driven.distance_m[k]
    errors = driven.errors
    F = np.eye(SIZE)
    noise = np.zeros((SIZE, SIZE))
    point = _point(driven, k, k)
    F[QB : QB + 2, :] = 0.0
    F[QB, Q] = F[QB + 1, Q + 1] = 1.0
    keep_b = math.exp(-TICK_S / errors.slow_tau_s)
    keep_d = math.exp(-TICK_S / errors.doppler_tau_s) if errors.doppler_tau_s > 0.0 else 0.0
    for j in range(2):
        F[B + j, B + j], F[D + j, D + j] = keep_b, keep_d
        noise[B + j, B + j] = errors.slow_m**2 * (1.0 - keep_b**2)
        noise[D + j, D + j] = errors.doppler_mps**2 * (1.0 - keep_d**2)
        noise[MU + j, MU + j] = walk**2 * TICK_S
    if distance <= 1e-9:  # at a standstill the wheels do not move within their counts
        return F, noise, F @ point
    F[Q, Q] = F[Q + 1, Q + 1] = 0.0
    # A rolled way is (difference of the readings + error after - error before) times the radius.
    rolled = (turned - driven.reading_rad[k, RL:]) * radius
    gain = np.zeros((SIZE, 2))
    mid = driven.pose[k, 2] + (driven.pose[k + 1, 2] - driven.pose[k, 2]) / 2
    cos, sin = math.cos(mid), math.sin(mid)
    for j, sign in enumerate((-1.0, 1.0)):
        bend = sign / TRACK_M
        gain[E, j] = cos / 2 - distance * sin * bend / 2
        gain[N, j] = sin / 2 + distance * cos * bend / 2
        gain[PSI, j] = bend
        F[:, MU + j] += gain[:, j] * turned[j]
        F[:, Q + j] += gain[:, j] * -radius[j]
        column = gain[:, j].copy()
        # the new reading error moves the pose and stays as a state
        new = column * radius[j]
        new[Q + j] = 1.0
        noise += np.outer(new, new) * QUANTUM_RAD**2 / 12
        noise += np.outer(column, column) * ROUGHNESS_M**2 * distance
    F[E, PSI], F[N, PSI] = -distance * sin, distance * cos
    after = F @ point
    middle, turn = rolled.sum() / 2, (rolled[1] - rolled[0]) / TRACK_M
    heading = point[PSI] + turn / 2
    after[E] = point[E] + middle * math.cos(heading)
    after[N] = point[N] + middle * math.sin(heading)
    after[PSI] = point[PSI] + turn
    after[Q : Q + 2] = 0.0
    after[MU:] = point[MU:]
    return F, noise, after


def _rows(driven: Driven, k: int) -> tuple[Array, Array, Array]:
    """Rows, residuals at the truth and variances of the fix at the end of tick k."""
    fix = driven.ticks[k].fixes[0]
    speed, heading = driven.speed_mps[k + 1], driven.pose[k + 1, 2]
    truth = driven.pose[k + 1]
    H = np.zeros((4, SIZE))
    H[0, E] = H[0, B] = H[1, N] = H[1, B + 1] = 1.0
    z = np.array([fix.east_m - truth[0], fix.north_m - truth[1], math.nan, math.nan])
    if math.isfinite(fix.heading_rad) and driven.distance_m[k] > 0.0:
        cos, sin = math.cos(heading), math.sin(heading)
        z[2] = fix.speed_mps * math.cos(fix.heading_rad) - speed * cos
        z[3] = fix.speed_mps * math.sin(fix.heading_rad) - speed * sin
        for row, along, across in ((2, cos, -sin), (3, sin, cos)):
            H[row, D + row - 2] = 1.0
            H[row, PSI] = speed * across
            for j in range(2):
                share = along / 2 / driven.distance_m[k] * speed
                turned = driven.ticks[k].rotation_rad[RL + j]
                H[row, MU + j] = share * turned
                H[row, Q + j] = share * RADIUS_M
                H[row, QB + j] = -share * RADIUS_M
    white = driven.errors.white_m**2
    doppler = 1e-6 if driven.errors.doppler_tau_s > 0.0 else driven.errors.doppler_mps**2
    return H, z, np.array([white, white, doppler, doppler])


def limit(driven: Driven, walk: float | None = None) -> Limit:
    """Filter forwards, smooth backwards (Rauch, Tung and Striebel)."""
    walk = WALK[driven.scenario.name] if walk is None else walk
    count = len(driven.ticks)
    mean = np.zeros(SIZE)
    mean[:3] = driven.pose[0]
    P = np.diag([100.0, 100.0, 0.1, 1e-3, 1e-3, 1e-3, 1e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    P[Q, Q] = P[Q + 1, Q + 1] = QUANTUM_RAD**2 / 12
    P[QB, QB] = P[QB + 1, QB + 1] = QUANTUM_RAD**2 / 12
    for j in range(2):
        P[B + j, B + j] = driven.errors.slow_m**2
        P[D + j, D + j] = driven.errors.doppler_mps**2
        P[MU + j, MU + j] = PRIOR_RADIUS_M**2
    means, covs = np.empty((count, SIZE)), np.empty((count, SIZE, SIZE))
    ahead_means, ahead_covs = np.empty_like(means), np.empty_like(covs)
    steps = np.empty_like(covs)
    for k in range(count):
        F, noise, after = _transition(driven, k, walk)
        mean = after + F @ (mean - _point(driven, k, k))
        P = F @ P @ F.T + noise
        ahead_means[k], ahead_covs[k], steps[k] = mean, P, F
        if driven.ticks[k].fixes:
            mean, P = _update(driven, k, mean, P)
        means[k], covs[k] = mean, P
    smooth, smooth_cov = means.copy(), covs.copy()
    scale = np.array([1, 1, 1e-2, 0.03, 0.03, 0.03, 0.03, 1, 1, 0.1, 0.1, 1e-4, 1e-4])
    for k in range(count - 2, -1, -1):
        ahead = ahead_covs[k + 1] / np.outer(scale, scale)
        cross = (covs[k] @ steps[k + 1].T) / scale
        gain = np.linalg.pinv(ahead, rcond=1e-13, hermitian=True)
        gain = cross @ gain / scale
        smooth[k] += gain @ (smooth[k + 1] - ahead_means[k + 1])
        smooth_cov[k] += gain @ (smooth_cov[k + 1] - ahead_covs[k + 1]) @ gain.T
    pair = slice(MU, MU + 2)
    return Limit(means[:, pair], covs[:, pair, pair], smooth[:, pair], smooth_cov[:, pair, pair])


def _point(driven: Driven, instant: int, tick: int) -> Array:
    """The true state at an instant, seen from the tick that begins or ends there."""
    out = np.zeros(SIZE)
    out[:3] = driven.pose[instant]
    out[Q : Q + 2] = driven.reading_rad[instant, RL:]
    out[QB : QB + 2] = driven.reading_rad[tick, RL:]
    out[MU:] = driven.offsets_m[tick, RL:]
    return out


def _update(driven: Driven, k: int, mean: Array, P: Array) -> tuple[Array, Array]:
    """All readings of a fix, one after the other; residuals are taken about the truth."""
    H, z, variances = _rows(driven, k)
    about = _point(driven, k + 1, k)
    for h, seen, variance in zip(H, z, variances, strict=True):
        if math.isnan(seen):
            continue
        column = P @ h
        gain = column / (h @ column + variance)
        mean = mean + gain * (seen - h @ (mean - about))
        P = P - np.outer(gain, column)
    return mean, (P + P.T) / 2
