"""The receiver's view of the drive: speed and yaw rate over cells of equal length.

In: fixes. Out: `ReceiverMotion` on a grid of the host's clock. Where the receiver gives no speed or course,
they come from
positions. The stamps of the fixes are smoothed: UTC plus the slowly varying offset of their arrival.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.settings import SETTINGS, Settings
from tpmsd.onboard.sources.events import GnssFix

_EARTH_M = 6_371_008.8


@dataclass(frozen=True, slots=True)
class ReceiverMotion:
    """Motion by the receiver, cell by cell."""

    edge_s: FloatArray
    """(n + 1,) host time of the cells' edges."""
    speed_mps: FloatArray
    """(n,) mean over the cell; NaN where the receiver had none."""
    yaw_radps: FloatArray
    """(n,) positive in a left turn; NaN where the course is unknown (standstill)."""
    accel_mps2: FloatArray
    """(n,)"""
    fix_s: FloatArray
    """(m,) smoothed stamps of the fixes."""
    fix_speed_mps: FloatArray
    fix_course_rad: FloatArray
    """(m,) unwrapped, mathematical sense (positive to the left); NaN at standstill."""
    by_position: bool
    """True if speeds come from positions."""

    @property
    def moving(self) -> NDArray[np.bool_]:
        """(n,) True for cells in which speed and yaw rate are known and the speed is above 2 m/s."""
        return np.isfinite(self.speed_mps) & np.isfinite(self.yaw_radps) & (self.speed_mps > 2.0)

    @property
    def duration_s(self) -> float:
        """Total time of the moving cells, s."""
        return float(self.moving.sum() * (self.edge_s[1] - self.edge_s[0])) if len(self.edge_s) > 1 else 0.0


def make_reference(fixes: Sequence[GnssFix], settings: Settings = SETTINGS) -> ReceiverMotion:
    """Return the reference of a drive; empty arrays where there is no usable fix."""
    time_s = _fix_times_on_host_clock(fixes)
    good = np.isfinite(time_s)
    order = np.flatnonzero(good)[np.argsort(time_s[good], kind="stable")]
    order = order[np.concatenate([[True], np.diff(time_s[order]) > 1e-3])] if len(order) else order
    time_s = time_s[order]
    speed, course = _motion([fixes[k] for k in order], time_s)
    by_position = sum(math.isfinite(fix.speed_mps) for fix in fixes) < 0.5 * len(fixes)
    if len(time_s) < 10:
        empty = np.zeros(0)
        return ReceiverMotion(np.zeros(1), empty, empty, empty, time_s, speed, course, by_position)
    cell = settings.cell_s
    edges = np.arange(math.ceil(time_s[0] / cell) * cell, time_s[-1], cell)
    mean_speed = bin_means(time_s, speed, edges)
    yaw = _mean_yaw_rate(time_s, course, edges)
    accel = np.full(len(mean_speed), np.nan)
    accel[1:-1] = (mean_speed[2:] - mean_speed[:-2]) / (2 * cell)
    return ReceiverMotion(edges, mean_speed, yaw, accel, time_s, speed, course, by_position)


def bin_means(time_s: FloatArray, value: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the mean over each cell of a signal taken as linear between its samples; NaN over gaps."""
    known = np.isfinite(value)
    t, x = time_s[known], value[known]
    if len(t) < 2:
        return np.full(len(edges) - 1, np.nan)
    travel = np.concatenate([[0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t))])
    # Quadratic within a step: a receiver of 1 Hz has two cells between two fixes.
    before = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, len(t) - 2)
    since = edges - t[before]
    slope = np.diff(x)[before] / np.diff(t)[before]
    means = np.diff(travel[before] + since * (x[before] + 0.5 * slope * since)) / np.diff(edges)
    return np.where(_cells_without_gap(t, edges), means, np.nan)


def _cells_without_gap(
    time_s: FloatArray, edges: FloatArray, longest_s: float = SETTINGS.longest_gap_s
) -> NDArray[np.bool_]:
    """Return (n,) True for cells that no gap between two samples reaches into."""
    after = np.clip(np.searchsorted(time_s, edges, side="right"), 1, len(time_s) - 1)
    fine = time_s[after] - time_s[after - 1] <= longest_s
    inside = (edges >= time_s[0]) & (edges <= time_s[-1])
    edge_fine = fine & inside
    return np.asarray(edge_fine[1:] & edge_fine[:-1])


def _fix_times_on_host_clock(fixes: Sequence[GnssFix]) -> FloatArray:
    """Return the (m,) times of the fixes, s: their UTC shifted to the host's clock (NaN without UTC), or
    their arrival where hardly a fix has UTC.
    """
    arrival = np.array([fix.arrival_s for fix in fixes], dtype=np.float64)
    utc = np.array([fix.utc_s for fix in fixes], dtype=np.float64)
    known = np.isfinite(utc)
    if known.sum() < 10:
        return arrival
    stamps = np.full(len(fixes), np.nan)
    offset, at = arrival[known] - utc[known], utc[known]
    smooth = np.empty(len(at))
    start = 0
    # Piecewise medians: the host's clock may drift against UTC by tenths of a second in a drive.
    centres, medians = [], []
    while start < len(at):
        stop = int(np.searchsorted(at, at[start] + SETTINGS.offset_window_s))
        stop = max(stop, start + 1)
        centres.append(float(np.mean(at[start:stop])))
        medians.append(float(np.median(offset[start:stop])))
        start = stop
    smooth = np.interp(at, centres, medians)
    stamps[known] = at + smooth
    return stamps


def _motion(fixes: Sequence[GnssFix], time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the speed and unwrapped course (positive to the left) at the fixes."""
    speed = np.array([fix.speed_mps for fix in fixes], dtype=np.float64)
    course = np.array([-fix.course_rad for fix in fixes], dtype=np.float64)
    if np.isfinite(speed).sum() < 0.5 * len(fixes) or np.isfinite(course).sum() < 0.2 * len(fixes):
        speed_by_position, heading = _motion_by_positions(fixes, time_s)
        if np.isfinite(speed).sum() < 0.5 * len(fixes):
            speed = speed_by_position
        if np.isfinite(course).sum() < 0.2 * len(fixes):
            course = heading
    known = np.isfinite(course) & (speed > 1.0)
    out = np.full(len(course), np.nan)
    if known.any():
        out[known] = np.unwrap(course[known])
    return speed, out


def _motion_by_positions(fixes: Sequence[GnssFix], time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the (m,) speed and course at the fixes by differences of positions; NaN where they are too
    sparse.
    """
    latitude = np.radians([fix.latitude_deg for fix in fixes])
    longitude = np.radians([fix.longitude_deg for fix in fixes])
    speed, course = np.full(len(fixes), np.nan), np.full(len(fixes), np.nan)
    known = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
    if len(known) < 3:
        return speed, course
    t = time_s[known]
    north = _EARTH_M * (latitude[known] - latitude[known[0]])
    east = _EARTH_M * np.cos(latitude[known[0]]) * (longitude[known] - longitude[known[0]])
    before = np.clip(np.searchsorted(t, t - SETTINGS.position_base_s / 2, side="right") - 1, 0, None)
    after = np.clip(np.searchsorted(t, t + SETTINGS.position_base_s / 2), None, len(t) - 1)
    step = t[after] - t[before]
    fine = (step > 0.2) & (step < SETTINGS.longest_gap_s)
    centred = np.abs(0.5 * (t[after] + t[before]) - t) < 0.06 + 0.1 * step
    use = fine & centred
    with np.errstate(divide="ignore", invalid="ignore"):
        v_north, v_east = (north[after] - north[before]) / step, (east[after] - east[before]) / step
    speed[known[use]] = np.hypot(v_north, v_east)[use]
    moving = use & (np.hypot(v_north, v_east) > 1.0)
    course[known[moving]] = np.arctan2(v_north, v_east)[moving]
    return speed, course


def _mean_yaw_rate(time_s: FloatArray, course: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the mean yaw rate over each cell: the course's change from edge to edge."""
    known = np.isfinite(course)
    if known.sum() < 2:
        return np.full(len(edges) - 1, np.nan)
    t = time_s[known]
    at = np.interp(edges, t, course[known])
    return np.where(_cells_without_gap(t, edges), np.diff(at) / np.diff(edges), np.nan)
