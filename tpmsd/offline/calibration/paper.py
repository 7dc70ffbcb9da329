"""The method of [KF-WLS]: a Kalman filter and weighted least squares in turn, for the rear wheels.

In: `Recording`s, `Vehicle`, `PaperSettings`. Out: `PaperFit`. Each iteration filters the pose of the
two-wheel model with the present circumferences (eqs 3-7), solves for the circumferences that carry
each filtered pose to the next reference pose (8, 9), takes a share alpha of the step (11), shrinks the
covariances (10a, 10b) and judges what it has by the pose error of the un-fused odometry. The best iteration
is the result; three worse ones in a row end the search.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from tpmsd.foundation.wheels import RL, RR, FloatArray
from tpmsd.offline.calibration.nominal import Vehicle
from tpmsd.offline.calibration.reference import ReferencePose, reference_pose
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import fill

WEIGHTS = np.array([1.0, 1.0, 10.0])
"""W of eq. (9), diagonal."""
BLOCK_S = 20.0
PIECE_M = 2200.0
"""The paper's course. Over longer ways the first errors of heading rule the pose error."""
GROWN = 3
_FLOOR = 1e-3


@dataclass(frozen=True, slots=True)
class PaperSettings:
    """Settings that the paper leaves open."""

    iterations: int = 9
    alpha: float = 0.3
    q_m: float = 1.25
    q_p: float = 0.5
    varying: bool = True
    """False: the covariances stay at their first values."""
    side_slip: bool = True
    scale_m: float = 1.0
    """Factors on the first covariances, for the study of their effect."""
    scale_p: float = 1.0


@dataclass(frozen=True)
class PaperFit:
    """Radii of the published iteration (m), their jackknife deviations, and why it stopped."""

    vehicle: Vehicle
    std_m: FloatArray
    """(2,) jackknife standard deviation of the radii of rl, rr."""
    difference_std_m: float
    iterations: int
    stopped_because: str
    history: list[FloatArray]
    """Radii (4,) after every iteration."""
    pose_errors_m: list[float]
    """Before the first iteration and after each."""


@dataclass(frozen=True)
class _DriveInPieces:
    revolutions: FloatArray
    """(n, 2) turned by rl and rr in each tick."""
    reference: ReferencePose
    block: np.ndarray
    pieces: list[slice]
    """Pieces of the ticks: as long as the paper's course each."""


def fit_paper(recordings: list[Recording], start: Vehicle, settings: PaperSettings | None = None) -> PaperFit:
    """Estimate the circumferences of the rear wheels by the published iteration."""
    s = settings or PaperSettings()
    drives = [_prepared_drive(recording, start, s) for recording in recordings]
    track = start.geometry.track_rear_m
    c = 2 * math.pi * start.radius_m[[RL, RR]]
    errors = [_mean_pose_error(drives, c, track)]
    circumferences = [c]
    history: list[FloatArray] = []
    spread = np.zeros((2, 2))
    reason = f"{s.iterations} iterations are the most that are made"
    spreads = [spread]
    for i in range(1, s.iterations + 1):
        P, M = covariances(i if s.varying else 0, s)
        blocks = [_normal_equations(drive, c, track, P, M) for drive in drives]
        A, b = np.concatenate([x for x, _ in blocks]), np.concatenate([x for _, x in blocks])
        optimum = np.linalg.solve(A.sum(axis=0), b.sum(axis=0))
        c = c + s.alpha * (optimum - c)
        spreads.append(_jackknife_covariance(A, b))
        circumferences.append(c)
        history.append(_with_circumferences(start, c).radius_m)
        errors.append(_mean_pose_error(drives, c, track))
        if i > GROWN and errors[-GROWN - 1 :] == sorted(errors[-GROWN - 1 :]):
            reason = f"the pose error of the un-fused odometry has grown {GROWN} times running"
            break
    best = int(np.argmin(errors))
    radii = spreads[max(best, 1)] / (2 * math.pi) ** 2
    return PaperFit(
        vehicle=_with_circumferences(start, circumferences[best]),
        std_m=np.sqrt(np.diag(radii)),
        difference_std_m=math.sqrt(max(radii[0, 0] + radii[1, 1] - 2 * radii[0, 1], 0.0)),
        iterations=len(errors) - 1,
        stopped_because=f"{reason}; iteration {best} is the best",
        history=history,
        pose_errors_m=errors,
    )


def covariances(i: int, s: PaperSettings) -> tuple[FloatArray, FloatArray]:
    """Return (3,) diagonals of P (10b) and M (10a) in iteration i, kept positive.

    As printed, the heading's entry 0.1 - qP*i of (10b) is negative from the first iteration on. Here all
    three entries of P shrink alike, each from its own first value.
    """
    shrink = max(1.0 - s.q_p * i / 10.0, _FLOOR)
    first = np.array([10.0, 10.0, 0.1])
    return s.scale_p * first * shrink, s.scale_m * first / s.q_m**i


def un_fused_path(
    revolutions: FloatArray, reference: ReferencePose, c: FloatArray, track_m: float, piece: slice
) -> FloatArray:
    """Return the (k + 1, 2) path of the two-wheel model over k ticks from the reference pose before them, eqs
    (1), (2).
    """
    distance, turn = _distance_and_turn(revolutions[piece], c, track_m)
    at = piece.start
    heading = reference.heading_rad[at] + np.concatenate([[0.0], np.cumsum(turn)])
    course = heading[:-1] + turn / 2 + reference.side_slip_rad[piece.start + 1 : piece.stop + 1]
    out = np.empty((len(distance) + 1, 2))
    out[0] = reference.east_m[at], reference.north_m[at]
    out[1:, 0] = out[0, 0] + np.cumsum(distance * np.cos(course))
    out[1:, 1] = out[0, 1] + np.cumsum(distance * np.sin(course))
    return out


def _prepared_drive(recording: Recording, start: Vehicle, s: PaperSettings) -> _DriveInPieces:
    """Return the drive's wheel revolutions, reference pose, blocks and pieces."""
    turned = np.stack([fill(recording.rotation_rad[:, k]) for k in (RL, RR)], axis=1) / (2 * math.pi)
    block = (np.arange(len(turned)) * recording.dt_s / BLOCK_S).astype(int)
    distance = np.cumsum(turned.mean(axis=1)) * 2 * math.pi * start.radius_m[RL]
    count = max(round(float(distance[-1]) / PIECE_M), 1)
    bounds = np.searchsorted(distance, distance[-1] * np.arange(count + 1) / count)
    pieces = [slice(int(a), int(b)) for a, b in pairwise(bounds) if b > a]
    return _DriveInPieces(turned, reference_pose(recording, start, s.side_slip), block, pieces)


def _with_circumferences(start: Vehicle, c: FloatArray) -> Vehicle:
    """Return the vehicle with these circumferences (2,) of the rear wheels."""
    radii = start.radius_m.copy()
    radii[[RL, RR]] = c / (2 * math.pi)
    return replace(start, radius_m=radii)


def _distance_and_turn(
    revolutions: FloatArray, c: FloatArray, track_m: float
) -> tuple[FloatArray, FloatArray]:
    """Return the (k,) distance and turn of each tick by the revolutions (k, 2) of the rear wheels."""
    d = revolutions * c
    return d.mean(axis=1), (d[:, 1] - d[:, 0]) / track_m


def _mean_pose_error(drives: list[_DriveInPieces], c: FloatArray, track_m: float) -> float:
    """Return the mean distance (m) of un-fused odometry from the reference over all poses of all pieces."""
    distances = []
    for drive in drives:
        position = np.stack([drive.reference.east_m, drive.reference.north_m], axis=1)
        for piece in drive.pieces:
            path = un_fused_path(drive.revolutions, drive.reference, c, track_m, piece)
            distances.append(np.hypot(*(path - position[piece.start : piece.stop + 1]).T))
    return float(np.concatenate(distances).mean())


def _normal_equations(
    drive: _DriveInPieces, c: FloatArray, track_m: float, P: FloatArray, M: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return (b, 2, 2), (b, 2): Phi' W Phi and Phi' W Y of eq. (9), by blocks of the drive."""
    reference = drive.reference
    r = np.stack([reference.east_m, reference.north_m, reference.heading_rad], axis=1)
    filtered = _filtered_poses(drive, r, c, track_m, P, M)
    n = drive.revolutions
    _, turn = _distance_and_turn(n, c, track_m)
    course = filtered[:-1, 2] + turn / 2 + reference.side_slip_rad[1:]
    half = n / 2
    phi = np.stack(
        [half * np.cos(course)[:, None], half * np.sin(course)[:, None], n * [-1.0, 1.0] / track_m], axis=1
    )
    Y = r[1:] - filtered[:-1]
    blocks = int(drive.block[-1]) + 1
    A, b = np.zeros((blocks, 2, 2)), np.zeros((blocks, 2))
    np.add.at(A, drive.block, np.einsum("kri,r,krj->kij", phi, WEIGHTS, phi))
    np.add.at(b, drive.block, np.einsum("kri,r,kr->ki", phi, WEIGHTS, Y))
    return A, b


def _filtered_poses(
    drive: _DriveInPieces, r: FloatArray, c: FloatArray, track_m: float, P: FloatArray, M: FloatArray
) -> FloatArray:
    """Return (n + 1, 3) poses by the EKF of eqs (4)-(7)."""
    distance, turn = _distance_and_turn(drive.revolutions, c, track_m)
    slip = drive.reference.side_slip_rad
    out = np.empty_like(r)
    x, S = r[0].copy(), np.diag(M)
    out[0] = x
    F, Q, R = np.eye(3), np.diag(P), np.diag(M)
    for k in range(1, len(r)):
        course = x[2] + turn[k - 1] / 2 + slip[k]
        east, north = distance[k - 1] * math.cos(course), distance[k - 1] * math.sin(course)
        x = x + np.array([east, north, turn[k - 1]])
        F[0, 2], F[1, 2] = -north, east
        S = F @ S @ F.T + Q
        gain = np.linalg.solve(S + R, S).T
        x = x + gain @ (r[k] - x)
        S = S - gain @ S
        out[k] = x
    return out


def _jackknife_covariance(A: FloatArray, b: FloatArray) -> FloatArray:
    """Return the (2, 2) covariance of the least-squares circumferences by leaving out one block of the drives
    at a time.
    """
    count = len(A)
    if count < 3:
        return np.full((2, 2), math.nan)
    left_out = np.linalg.solve(A.sum(axis=0) - A, (b.sum(axis=0) - b)[:, :, None])[:, :, 0]
    off = left_out - left_out.mean(axis=0)
    return np.asarray((count - 1) / count * off.T @ off)
