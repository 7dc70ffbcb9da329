"""The receiver's course on the wheels' heading: track, antenna ahead, side slip.

In: the rear wheels' speed and difference, the receiver's reference, its latency by the speed. Out:
`RegressionFit`.

    course = constant + S(difference) / track + tyres S(v) + x_a r / v - tau r - c v r - l S(v^2 r)

within each block, S the integral over time (rigid body to first order in r x / v). Load on the outer tyres
makes their radii smaller, R -+ c a_lat with a_lat = v r, so they turn faster in a bend: l = 2 c / (R track).
The heading is the integral of the wheels' difference, so that rounding of their counts does not add up, as
it would in rates. A course is as uncertain as the receiver's velocity across the car over the speed; rows
are weighted by the speed.

A lever arm, a latency and a side slip differ in their power of the speed alone, and so do a track and the
load of the outer tyres. So the latency comes from the speed's own regression, and track, side slip and load
have the prior of cars.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tpmsd.car.physics.priors import LATERAL_LOAD_S2
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.reference import ReceiverMotion, bin_means
from tpmsd.offline.discovery.regress import RegressionFit, fit, with_prior
from tpmsd.offline.discovery.result import Estimate
from tpmsd.offline.discovery.settings import SETTINGS, Settings

_YAW_COLUMNS = (2, 3, 4)
"""Columns of the design that are the wheels' yaw rate itself, not its integral."""


def course_fit(
    speed: FloatArray,
    difference: FloatArray,
    reference: ReceiverMotion,
    latency: Estimate | None,
    settings: Settings = SETTINGS,
) -> RegressionFit | None:
    """Regress the receiver's course on the rear wheels' heading: 1 / track, unequal tyres per metre,
    -latency, antenna ahead, -side slip, -load.

    `speed`, `difference` (n,) of the rear wheels over the cells, right minus left; None if unknown.
    """
    made = _course_fit_at_track(settings.track_m, speed, difference, reference, latency, settings)
    if made is None or made.value[0] <= 0.0:
        return made
    return _course_fit_at_track(1.0 / float(made.value[0]), speed, difference, reference, latency, settings)


def _course_fit_at_track(
    track_m: float,
    speed: FloatArray,
    difference: FloatArray,
    reference: ReceiverMotion,
    latency: Estimate | None,
    settings: Settings,
) -> RegressionFit | None:
    """Return the fit of `course_fit` with yaw rates by this track; None where too little is known."""
    yaw = difference / track_m
    with np.errstate(divide="ignore", invalid="ignore"):
        per_speed = yaw / speed
    course = bin_means(reference.fix_s, reference.fix_course_rad, reference.edge_s)
    design = np.column_stack(
        [
            _integral_to_cell_centres(difference, settings),
            _integral_to_cell_centres(speed, settings),
            yaw,
            per_speed,
            yaw * speed,
            _integral_to_cell_centres(yaw * speed**2, settings),
        ]
    )
    seen = np.where(np.isfinite(reference.yaw_radps), reference.yaw_radps, yaw)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_receiver = np.column_stack([seen, seen / speed, seen * speed])
    usable = (speed > settings.min_speed_mps) & (np.abs(yaw) < 0.5 * speed) & np.isfinite(course)
    block = np.floor(reference.edge_s[:-1] / settings.block_s)
    count = design.shape[1]
    table = np.column_stack([design, by_receiver, course])
    within = np.full(table.shape, np.nan)
    for cells in _gapless_runs(usable, block):
        weight = speed[cells]
        share = weight**2 / (weight @ weight)
        within[cells] = (table[cells] - share @ table[cells]) * weight[:, None]
    target = within[:, -1]
    rows = _instrumented_design(within[:, :count], within[:, count:-1], block)
    estimate = None if rows is None else fit(rows, target, block)
    if rows is None or estimate is None or not np.isfinite(estimate.cov).all():
        return None
    cov = estimate.cov.copy()
    cov[0, 0] += (estimate.value[0] * _unexplained_fraction(rows, target, estimate)) ** 2 / 3.0
    estimate = replace(estimate, cov=cov)
    mean, std = np.zeros(len(estimate.value)), np.full(len(estimate.value), np.inf)
    mean[0], std[0] = 1.0 / settings.track_m, settings.track_std_m / settings.track_m**2
    mean[4], std[4] = -settings.side_slip, settings.side_slip_std
    per_load = 2.0 / (settings.radius_m * settings.track_m)
    mean[5], std[5] = -per_load * LATERAL_LOAD_S2.mean, per_load * LATERAL_LOAD_S2.std
    if latency is not None:
        mean[2], std[2] = -latency.value, latency.std
    return with_prior(estimate, mean, std)


def _instrumented_design(rows: FloatArray, by_receiver: FloatArray, block: FloatArray) -> FloatArray | None:
    """Return the design with the yaw rate's columns regressed on the receiver's yaw rate.

    The receiver's yaw rate is the instrumental variable.

    On a motorway a count of one wheel is as large as a cell's yaw rate, which would draw the coefficients of
    latency, antenna and side slip to zero, each by its own share. The receiver's errors are others:
    instrumental variables in two stages (Theil 1953).
    """
    instruments = np.column_stack([rows[:, :2], by_receiver, rows[:, 5:]])
    instrumented = rows.copy()
    for column in _YAW_COLUMNS:
        made = fit(instruments, rows[:, column], block)
        if made is None:
            return None
        instrumented[:, column] = instruments @ made.value
    return instrumented


def _unexplained_fraction(rows: FloatArray, target: FloatArray, estimate: RegressionFit) -> float:
    """Return the fraction of the course's variance that the heading does not explain, the other columns
    regressed out of both.

    Noise of the heading makes the slope too small by at most this share: between the regression and the
    reverse one lies the truth (Frisch 1934).
    """
    error = target - rows @ estimate.value
    kept = np.abs(error) <= 4.0 * 1.4826 * np.nanmedian(np.abs(error))
    others = rows[kept, 1:]
    both = np.column_stack([rows[kept, 0], target[kept]])
    both = both - others @ np.linalg.lstsq(others, both, rcond=None)[0]
    return 1.0 - float(np.corrcoef(both.T)[0, 1]) ** 2


def _integral_to_cell_centres(value: FloatArray, settings: Settings) -> FloatArray:
    """Return the (n,) integral over time up to the middle of each cell; unknown values (NaN) count as 0."""
    known = np.where(np.isfinite(value), value, 0.0)
    return settings.cell_s * (np.cumsum(known) - 0.5 * known)


def _gapless_runs(usable: NDArray[np.bool_], block: FloatArray) -> list[NDArray[np.int64]]:
    """Return the cells of each run without a gap within a block; runs below `min_cells` are left out."""
    begins = np.concatenate([[True], ~usable[:-1] | (np.diff(block) != 0)])
    number = np.cumsum(begins)
    cells = np.flatnonzero(usable)
    if not len(cells):
        return []
    parts = np.split(cells, np.flatnonzero(np.diff(number[cells])) + 1)
    return [part for part in parts if len(part) >= SETTINGS.min_cells]
