"""Position error of the rear wheels alone: un-fused odometry against the receiver's positions.

In: `Recording`, `Vehicle`. Out: the mean distance in metres (`pose_error`), paths for a picture.
[KF-WLS], eqs (1), (2): the two-wheel model integrated without any fusion. A whole drive's error is ruled by
its first few headings, so the drive is cut into pieces of the paper's 2.2 km, each laid onto its positions
by the rigid motion that fits best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import RL, RR, FloatArray
from tpmsd.offline.calibration.nominal import Vehicle, shown_turn_ratio
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import fill

PIECE_M = 2200.0
_FEWEST = 8


@dataclass(frozen=True)
class OdometryStretch:
    """One stretch of un-fused odometry, laid onto the positions; arrays (f, 2) of east, north in metres."""

    odometry_m: FloatArray
    position_m: FloatArray

    @property
    def distances_m(self) -> FloatArray:
        """(f,) distances between odometry and positions."""
        return np.asarray(np.hypot(*(self.odometry_m - self.position_m).T), dtype=np.float64)


def odometry_stretches(recording: Recording, car: Vehicle) -> list[OdometryStretch]:
    """Return the stretches of un-fused odometry of the antenna, each aligned with the receiver's
    positions.
    """
    roll = np.stack([fill(recording.rotation_rad[:, k]) for k in (RL, RR)], axis=1) * car.radius_m[[RL, RR]]
    distance, turn = roll.mean(axis=1), (roll[:, 1] - roll[:, 0]) / car.geometry.track_rear_m
    turn = turn / shown_turn_ratio(car, distance / recording.dt_s)
    heading = np.concatenate([[0.0], np.cumsum(turn)])
    middle = heading[:-1] + turn / 2
    axle = np.zeros((len(distance) + 1, 2))
    np.cumsum(np.stack([distance * np.cos(middle), distance * np.sin(middle)], axis=1), axis=0, out=axle[1:])
    forward, left = recording.car.antenna_forward_m, recording.car.antenna_left_m
    cos, sin = np.cos(heading), np.sin(heading)
    antenna = axle + np.stack([forward * cos - left * sin, forward * sin + left * cos], axis=1)
    edges = recording.edges_s
    known = np.isfinite(recording.east_m)
    time_s = recording.fix_time_s[known]
    odometry = np.stack([np.interp(time_s, edges, antenna[:, axis]) for axis in (0, 1)], axis=1)
    position = np.stack([recording.east_m[known], recording.north_m[known]], axis=1)
    rolled = np.interp(time_s, edges, np.concatenate([[0.0], np.cumsum(np.abs(distance))]))
    if not rolled.size:
        return []
    number = np.floor(rolled / max(rolled[-1] / max(round(rolled[-1] / PIECE_M), 1), 1e-9)).astype(int)
    out = []
    for index in np.unique(number):
        at = number == index
        if at.sum() >= _FEWEST:
            out.append(OdometryStretch(_aligned_points(odometry[at], position[at]), position[at]))
    return out


def pose_error(recordings: list[Recording], car: Vehicle) -> float:
    """Return the mean distance of un-fused odometry from the positions of all drives, metres; NaN without
    positions."""
    distances = [piece.distances_m for r in recordings for piece in odometry_stretches(r, car)]
    return float(np.concatenate(distances).mean()) if distances else float("nan")


def _aligned_points(points: FloatArray, onto: FloatArray) -> FloatArray:
    """Return the points (f, 2) after the rotation and shift that bring them closest to the others (Kabsch, in
    the plane).
    """
    here, there = points - points.mean(axis=0), onto - onto.mean(axis=0)
    angle = np.arctan2(
        float(np.sum(here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0])), float(np.sum(here * there))
    )
    cos, sin = np.cos(angle), np.sin(angle)
    return np.asarray(here @ np.array([[cos, sin], [-sin, cos]]) + onto.mean(axis=0))
