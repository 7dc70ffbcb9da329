"""Location of a mismatch: channel, wheels, covariate and range, spans of time.

In: a `Regression` and one of its chosen terms. Out: `Where`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.assessment.result import Where
from tpmsd.offline.diagnosis.hypotheses.terms import ANTISYMMETRIC, PATTERNS, Term
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.chosen import Chosen
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.windows import COURSE, SPEED

RECEIVER = ("gnss_speed", "gnss_course", "yaw_rate")
"""Places of smooth terms that are no wheels."""


def where_of(regression: Regression, one: Chosen) -> Where:
    """Return where a term acts, as its report has it."""
    term = one.term
    wheels, channel, covariate = location_of(regression, term)
    if term.ramp or (term.pulse and not term.nonparametric):
        spans = _time_spans(regression, one)
        return Where(wheels, channel, "time", (spans[0][0], spans[-1][1]), spans)
    if term.nonparametric and covariate == "time":
        return Where(wheels, channel, None, None, _time_spans(regression, one))
    values = covariate_values(regression, term, covariate)
    if values is None:
        return Where(wheels, channel, None, None)
    if term.kind_of.identification.everywhere:
        return whole_range(regression, term)
    weight = np.concatenate(
        [
            _information_by_window(regression, regression.drives[number], one)
            for number in regression.acting_drives(term)
        ]
    )
    return Where(wheels, channel, covariate, _weighted_quantiles(values, weight, 0.025, 0.975))


def whole_range(regression: Regression, term: Term) -> Where:
    """Return where a term acts that was not chosen: all values of its covariate."""
    wheels, channel, covariate = location_of(regression, term)
    values = covariate_values(regression, term, covariate)
    if values is None:
        return Where(wheels, channel, None, None)
    return Where(wheels, channel, covariate, (float(values.min()), float(values.max())))


def covariate_values(regression: Regression, term: Term, covariate: str | None) -> FloatArray | None:
    """Return the (w,) covariate in the drives in which the term acts, one after the other; None if it is
    unknown."""
    windows = [regression.drives[number].reader.windows for number in regression.acting_drives(term)]
    if covariate is None or any(covariate not in one.covariates for one in windows):
        return None
    return np.concatenate([one.covariates[covariate] for one in windows])


def location_of(regression: Regression, term: Term) -> tuple[tuple[str, ...], str, str | None]:
    """Return the wheels, channel and covariate of a term."""
    drives = [regression.drives[number] for number in regression.acting_drives(term)]
    read = [WHEELS[k] for k in sorted({k for drive in drives for k in drive.reader.recording.wheels})]
    if term.nonparametric:
        return *_location_of_spline(term, read), term.covariate
    channel, covariate = EFFECTS[term.effect].identification.shows_in
    if channel.startswith(("gnss", "yaw")):
        return (), *_channel_by_receiver(drives, channel, covariate)
    acts = _acting_wheels(term, drives[0])
    wheels = tuple(wheel for wheel in read if wheel in acts)
    # Without another wheel to be compared with, only the receiver shows it.
    alone = set(wheels) == set(read) or (term.ramp and len(read) < 4)
    if channel == "wheel_ratio" and alone and not term.kind_of.identification.contrast:
        channel = "wheel"
    return wheels, channel, covariate


def _location_of_spline(term: Term, read: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Return the wheels and channel of a spline term."""
    if term.pattern in RECEIVER:
        return (), term.pattern
    if term.pattern in ANTISYMMETRIC:
        return tuple(read), "wheel_ratio"
    wheels = PATTERNS[term.pattern]
    return wheels, "wheel" if set(wheels) == set(read) or len(read) < 4 else "wheel_ratio"


def _channel_by_receiver(drives: Sequence[DriveRegression], channel: str, covariate: str) -> tuple[str, str]:
    """Return channel and covariate of a receiver's effect: positions where the receiver gives no speed or
    course."""
    measured = np.concatenate([np.isfinite(drive.reader.windows.measured) for drive in drives])
    if channel == "gnss_speed" and measured[:, SPEED].sum() < SETTINGS.hypotheses.fewest_readings:
        return "gnss_position", "speed"
    if channel == "gnss_course" and measured[:, COURSE].sum() < SETTINGS.hypotheses.fewest_readings:
        return "gnss_position", covariate
    return channel, covariate


def _acting_wheels(term: Term, drive: DriveRegression) -> tuple[str, ...]:
    """Return the wheels on which an effect acts: those of its pattern, or those that it knows itself."""
    if term.wheel:
        return tuple(term.wheel.split())
    if term.pattern:
        return PATTERNS[term.pattern]
    return term.kind_of.acting_wheels(drive.reader.reference.car, term.parameters)


def _information_by_window(regression: Regression, drive: DriveRegression, one: Chosen) -> FloatArray:
    """Return the (w,) squared whitened response of the term in each window, less what calibration
    explains."""
    response = drive.response(one.term.design, one.values)
    flat = response.reshape(-1)
    nuisance = drive.own_design(regression.hypotheses.nuisance)
    nuisance = (drive.white @ nuisance[:, np.any(nuisance != 0.0, axis=0)]).reshape(flat.size, -1)
    left = flat - nuisance @ np.linalg.lstsq(nuisance, flat, rcond=None)[0]
    return np.asarray((left.reshape(response.shape) ** 2).sum(axis=1))


def _weighted_quantiles(
    values: FloatArray, weight: FloatArray, low: float, high: float
) -> tuple[float, float]:
    """Return the two quantiles `low` and `high` of values under weights."""
    order = np.argsort(values)
    share = np.cumsum(weight[order]) / max(float(weight.sum()), 1e-300)
    a, b = np.interp([low, high], share, values[order])
    return float(a), float(b)


def _time_spans(regression: Regression, one: Chosen) -> tuple[tuple[float, float], ...]:
    """Return the spans (s) in which a term acts: from a ramp's onset on; where a smooth term over time is
    beyond half its height. Times are from the start of the drive in which the term acts."""
    end = float(regression.drives[regression.acting_drives(one.term)[0]].reader.recording.edges_s[-1])
    if one.term.pulse:
        return ((max(one.term.span_s[0], 0.0), min(one.term.span_s[1], end)),)
    if one.term.ramp:
        return ((max(one.term.span_s[0], 0.0), end),)
    knots = regression.knots(one.term)
    level = np.concatenate([np.zeros(len(knots) - len(one.values)), one.values])
    level = level - np.median(level)
    grid = np.linspace(0.0, end, 400)
    on = np.abs(np.interp(grid, knots, level)) > 0.5 * np.abs(level).max()
    edge = np.diff(np.concatenate([[0], on.astype(int), [0]]))
    starts, ends = np.flatnonzero(edge == 1), np.flatnonzero(edge == -1) - 1
    return tuple((float(grid[a]), float(grid[b])) for a, b in zip(starts, ends, strict=True))
