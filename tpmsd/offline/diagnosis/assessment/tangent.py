"""Standard deviations of parameters that enter nonlinearly.

In: the final selection. Out: per chosen term the standard deviations of its linear and nonlinear
parameters. Of an onset or a duration by Gauss-Newton: the response's derivative is one more column of the
fit. Of a time constant by the profile likelihood: on a drive that is short against it, all long ones do
alike, which no derivative shows. Both are those of a quasi-likelihood: variances are multiplied, and
log-likelihoods divided, by the overdispersion of the term's blocks (McCullagh and Nelder, Generalized Linear
Models, 1989).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.ramp_interval import interval_stds, is_linear_ramp, ramp_stds
from tpmsd.offline.diagnosis.hypotheses.terms import numbers_of, wheels_of
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression, Refined, refined
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import fitted


def nonlinear_stds(regression: Regression, selection: Selection) -> dict[int, dict[str, float]]:
    """Return, by index in the selection, standard deviations of amplitude and nonlinear parameters."""
    tangents: list[dict[int, FloatArray]] = []
    owner: list[tuple[int, str, float]] = []
    for k, one in enumerate(selection.chosen):
        by_drive = {
            number: _tangents(regression.drives[number], one) for number in regression.acting_drives(one.term)
        }
        for name in dict.fromkeys(name for found in by_drive.values() for name in found):
            tangents.append({number: found[name].by for number, found in by_drive.items()})
            owner.append((k, name, min(found[name].reach_s for found in by_drive.values())))
    out = {
        k: _stds_of_grid_effect(regression, selection, k, tangents)
        for k, one in enumerate(selection.chosen)
        if one.term.at is not None
    }
    if not tangents:
        return out
    first = selection.fit.design.shape[1]
    std = _joint_stds(regression, selection, tangents)
    whole_s = max(d.reader.recording.ticks * d.reader.recording.dt_s for d in regression.drives) / math.sqrt(
        12.0
    )
    for j, (k, name, reach_s) in enumerate(owner):
        # A slope that lets an onset be outside the drive says nothing: there the likelihood alone does.
        by_slope = float(std[first + j]) * math.sqrt(selection.chosen[k].overdispersion)
        out.setdefault(k, {})[name] = max(reach_s / 1.96, by_slope if by_slope < whole_s else 0.0)
    owners, start = [owned for owned, *_ in owner], regression.hypotheses.nuisance.shape[1]
    for k, one in enumerate(selection.chosen):
        if k in owners:
            out[k][one.term.parameters[0]] = float(std[start]) * math.sqrt(one.overdispersion)
        start += one.term.design.shape[1]
    return out | _stds_of_ramps(regression, selection, tangents, owners)


def _stds_of_ramps(
    regression: Regression, selection: Selection, tangents: list[dict[int, FloatArray]], owners: list[int]
) -> dict[int, dict[str, float]]:
    """Return, by index in the selection, standard deviations of changes of radii, each fitted jointly with
    the tangents (by drive) of the others."""
    out = {}
    for k, one in enumerate(selection.chosen):
        if one.term.ramp:
            joint_slopes = [slope for slope, owned in zip(tangents, owners, strict=True) if owned != k]
            stds_of = ramp_stds if is_linear_ramp(one.term) else _stds_of_curved_ramp
            out[k] = stds_of(regression, selection, k, joint_slopes)
    return out


def _stds_of_curved_ramp(
    regression: Regression, selection: Selection, which: int, tangents: list[dict[int, FloatArray]]
) -> dict[str, float]:
    """Return standard deviations of size, onset and time constant of a change of a radius that is no linear
    ramp.
    On a drive that ends before the change does, size and time constant trade against each other without end:
    their joint likelihood is asked, as of a ramp.
    """
    one = selection.chosen[which]
    onset, tau = one.term.span_s[0], one.term.span_s[1] - one.term.span_s[0]
    steps = np.geomspace(*SETTINGS.assessment.ramp_reach_s, SETTINGS.assessment.second_values)
    onsets = onset + np.concatenate([[0.0], -steps, steps])
    factors = np.geomspace(1.0, SETTINGS.assessment.longest_share, SETTINGS.assessment.second_values)
    taus = tau * np.concatenate([factors, 1.0 / factors[1:]])
    trials = [(at, long, one.term.course) for at in onsets for long in taus]
    gains, sizes = _profile_likelihood(regression, selection, which, tangents, trials)
    first, second = (np.array([trial[k] for trial in trials], np.float64) for k in (0, 1))
    return interval_stds(one, gains, sizes[0], first, second)


def _joint_stds(
    regression: Regression, selection: Selection, tangents: list[dict[int, FloatArray]]
) -> FloatArray:
    """(f + t,) standard deviations of the f values of a fit and of t tangents (by drive), all fitted
    jointly."""
    first = selection.fit.design.shape[1]
    gram = np.zeros((first + len(tangents), first + len(tangents)))
    for number, drive in enumerate(regression.drives):
        rows = np.zeros((*drive.white.shape[:2], len(gram)))
        rows[:, :, :first] = drive.whitened_design(selection.fit.design)
        mine = [j for j, tangent in enumerate(tangents) if number in tangent]
        if mine:
            trial = np.stack([tangents[j][number] for j in mine], axis=2)
            rows[:, :, [first + j for j in mine]] = drive.whitened(trial)
        flat = rows.reshape(-1, len(gram))
        gram += flat.T @ flat
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    A = gram / np.outer(scale, scale) + 1e-7 * np.eye(len(gram))
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(A))) / scale)


def _stds_of_grid_effect(
    regression: Regression, selection: Selection, which: int, tangents: list[dict[int, FloatArray]]
) -> dict[str, float]:
    """Return standard deviations of an effect's linear and nonlinear parameters, with the tangents (by drive)
    of other terms fitted jointly.
    The farthest end of the interval in which the likelihood, all other values fitted and divided by the
    overdispersion, is within 1.92 of its maximum (Wilks, Annals of Mathematical Statistics 9, 1938) counts
    as 1.96 of them.
    """
    one = selection.chosen[which]
    grid, tau = one.term.kind_of.nonlinear.grid, one.term.at
    assert grid is not None
    assert tau is not None
    seconds = np.zeros(1)
    if grid.second is not None and one.term.second is not None:
        seconds = np.concatenate(
            [[one.term.second], np.geomspace(*grid.second.range, SETTINGS.assessment.second_values)]
        )
    firsts = np.concatenate([[tau], np.geomspace(*grid.range, SETTINGS.assessment.first_values)])
    gains, sizes = _profile_likelihood(
        regression, selection, which, tangents, [(a, b) for a in firsts for b in seconds]
    )
    gains = gains.reshape(len(firsts), len(seconds))
    if grid.second is not None and len(seconds) > 1:
        gains = gains - np.array([grid.second.penalty(value) for value in seconds])
    sizes = sizes.reshape(-1, len(firsts), len(seconds))
    # Along the first, the second fitted; then along the second, the first held: what is left of the variance.
    best = np.argmax(gains, axis=1)
    best[0] = 0 if gains[0, 0] >= gains[0, best[0]] - SETTINGS.preparation.moved_nats else best[0]
    along = np.arange(len(firsts))
    fall = SETTINGS.assessment.interval_nats * one.overdispersion
    reach, spread = _profile_interval(firsts, gains[along, best], sizes[:, along, best], fall)
    scale = float(np.min(one.stds / np.maximum(np.abs(one.values), 1e-12)))
    out = {grid.parameter: max(reach / 1.96, scale * tau)}
    stds = np.hypot(one.stds, spread / 1.96)
    if grid.second is not None and len(seconds) > 1:
        stds = np.hypot(stds, _profile_interval(seconds, gains[0], sizes[:, 0], fall)[1] / 1.96)
        out[grid.second.parameter] = (
            _profile_interval(seconds, gains.max(axis=0), sizes[:, 0], fall)[0] / 1.96
        )
    return {**out, **dict(zip(one.term.parameters, stds.tolist(), strict=True))}


def _profile_likelihood(
    regression: Regression,
    selection: Selection,
    which: int,
    tangents: list[dict[int, FloatArray]],
    trials: Sequence[tuple[float, float] | tuple[float, float, str]],
) -> tuple[FloatArray, FloatArray]:
    """Return (t,) gains and (k, t) linear values where a term's nonlinear parameters have the trials' values,
    all linear ones fitted."""
    one, others = selection.chosen[which], [c.term for k, c in enumerate(selection.chosen) if k != which]
    own = len(one.values)
    rest = np.concatenate([regression.hypotheses.nuisance, *(term.design for term in others)], axis=1)
    linear_only = 1 + rest.shape[1]
    known = linear_only + len(tangents)
    gram = np.zeros((known + own * len(trials), known + own * len(trials)))
    acting = regression.acting_drives(one.term)
    for number, drive in enumerate(regression.drives):
        rows = np.zeros((*drive.white.shape[:2], len(gram)))
        rows[:, :, 0] = drive.white[:, :, 0]
        rows[:, :, 1:linear_only] = drive.whitened_design(rest)
        for j, tangent in enumerate(tangents):
            if number in tangent:
                rows[:, :, linear_only + j] = drive.whitened(tangent[number][:, :, None])[:, :, 0]
        if number in acting:
            parts = [part for x in trials for part in refined(one.term, *x)]
            columns = [part.column(drive.reader, drive.base) for part in parts]
            rows[:, :, known:] = drive.whitened(np.stack(columns, axis=2))
        flat = rows.reshape(-1, len(gram))
        gram += flat.T @ flat
    gains, sizes = np.zeros(len(trials)), np.zeros((own, len(trials)))
    for k in range(len(trials)):
        at = np.concatenate([np.arange(known), known + own * k + np.arange(own)])
        values, gains[k] = fitted(gram[np.ix_(at, at)])
        sizes[:, k] = values[-own:]
    return gains, sizes


def _profile_interval(
    trials: FloatArray, gains: FloatArray, sizes: FloatArray, fall: float
) -> tuple[float, FloatArray]:
    """Return the half-width of a nonlinear parameter's profile-likelihood interval, and the changes of the
    other sizes (k, t) within it.

    The interval ends where the gains (nats) have fallen by `fall`; its half-width counts from the first
    trial.
    """
    lowest = min(float(gains.max()) - fall, float(gains[0]))
    order = np.argsort(trials, kind="stable")
    inside = np.flatnonzero(gains[order] >= lowest)
    ends = [
        level_crossing(gains[order], lowest, int(inside[0]), -1),
        level_crossing(gains[order], lowest, int(inside[-1]), 1),
    ]
    grid = np.arange(len(trials), dtype=np.float64)
    reach = float(np.abs(np.interp(ends, grid, trials[order]) - trials[0]).max())
    spread = [float(np.abs(np.interp(ends, grid, size[order]) - size[0]).max()) for size in sizes]
    return reach, np.array(spread)


def level_crossing(gains: FloatArray, level: float, inside: int, step: int) -> float:
    """Return the fractional index at which gains fall to a level, from an index inside outwards; the square
    root of the fall is linear between grid points."""
    outside = inside + step
    if not 0 <= outside < len(gains):
        return float(inside)
    near, far, wanted = (
        math.sqrt(max(float(np.max(gains)) - gain, 0.0)) for gain in (gains[inside], gains[outside], level)
    )
    return inside + step * float(np.clip((wanted - near) / max(far - near, 1e-12), 0.0, 1.0))


@dataclass(frozen=True)
class _Tangent:
    """Response as a function of an onset or a duration."""

    by: FloatArray
    """(w, 9) change per second."""
    reach_s: float
    """Change to one side, the farther one, by which the log-likelihood, divided by the overdispersion, falls
    by 1.92 nats (Wilks 1938)."""


def _tangents(drive: DriveRegression, one: Chosen) -> dict[str, _Tangent]:
    """Return the slopes (w, 9) of a ramp's or an event's response by onset and duration; empty for other
    terms.
    Where a car stands, a change of a radius shows later, and no slope says that its begin (at the same end)
    or its end may be anywhere in the stop: how far is asked of the likelihood.
    """
    term, size = one.term, float(one.values[0])
    event = term.pulse and not term.nonparametric
    if not term.ramp and not event:
        return {}
    onset, duration = term.span_s[0], term.span_s[1] - term.span_s[0]
    least = max(2.0, 0.05 * duration)
    whole_s = 0.5 * drive.reader.recording.ticks * drive.reader.recording.dt_s

    def column(at: float, long: float) -> FloatArray:
        if event:
            what = Refined(wheels_of(term.pattern), at, at + max(long, 0.0), pulse=True)
            radius = float(drive.reader.reference.car.radius_m[what.wheels[0]])
            return -radius * what.column(drive.reader, drive.base)
        what = Refined(numbers_of(term.wheel), at, max(long, 0.0), course=term.course)
        return what.column(drive.reader, drive.base)

    here = column(onset, duration)

    nats = SETTINGS.assessment.interval_nats * one.overdispersion

    def reach(at: float, long: float, most: float) -> float:
        if is_linear_ramp(term):  # `ramp_stds` takes both ends together
            return 0.0

        def fall(h: float) -> float:
            change = size * (column(onset + at * h, duration + long * h) - here)
            return 0.5 * float(np.sum(drive.whitened(change[:, :, None]) ** 2))

        inside, outside = 0.0, least
        while outside < most and fall(outside) < nats:
            inside, outside = outside, 2.0 * outside
        for _ in range(SETTINGS.assessment.halvings):
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if fall(middle) < nats else (inside, middle)
        return inside

    def slope(at: float, long: float) -> FloatArray:
        h = least
        while True:
            change = column(onset + at * h, duration + long * h) - column(onset - at * h, duration - long * h)
            if change.any() or h > whole_s:
                return np.asarray(size * change / (2.0 * h))
            h *= 2.0

    if duration <= 2 * least:
        return {
            "onset_s": _Tangent(slope(1.0, 0.0), max(reach(-1.0, 0.0, whole_s), reach(1.0, 0.0, whole_s)))
        }
    begin = max(reach(-1.0, 1.0, whole_s), reach(1.0, -1.0, duration))
    end = max(reach(0.0, -1.0, duration), reach(0.0, 1.0, whole_s))
    return {
        "onset_s": _Tangent(slope(1.0, 0.0), begin),
        "duration_s": _Tangent(slope(0.0, 1.0), math.hypot(begin, end)),
    }
