"""Standard deviations of parameters that enter nonlinearly.

In: the final selection. Out: per chosen term the standard deviations of its linear and nonlinear
parameters. Of an onset or a duration by Gauss-Newton: the response's derivative is one more column of the
fit. Of a time constant by the profile likelihood: on a drive that is short against it, all long ones do
alike, which no derivative shows.
"""

from __future__ import annotations

import numpy as np

from tpmsd.diagnosis.hypotheses.terms import numbers_of, wheels_of
from tpmsd.diagnosis.prepared.drive_study import DriveStudy, Refined, refined
from tpmsd.diagnosis.prepared.study import Study
from tpmsd.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.diagnosis.settings import SETTINGS
from tpmsd.inference.least_squares import fitted
from tpmsd.wheels import FloatArray


def nonlinear_stds(study: Study, selection: Selection) -> dict[int, dict[str, float]]:
    """By place in the selection: standard deviations of amplitude and nonlinear parameters."""
    tangents: list[dict[int, FloatArray]] = []
    owner: list[tuple[int, str]] = []
    for k, one in enumerate(selection.chosen):
        by_drive = {number: _tangents(study.drives[number], one) for number in study.acting(one.term)}
        for name in dict.fromkeys(name for found in by_drive.values() for name in found):
            tangents.append({number: found[name] for number, found in by_drive.items()})
            owner.append((k, name))
    out = {
        k: _of_grid(study, selection, k, tangents)
        for k, one in enumerate(selection.chosen)
        if one.term.at is not None
    }
    if not tangents:
        return out
    first = selection.fit.design.shape[1]
    gram = np.zeros((first + len(tangents), first + len(tangents)))
    for number, drive in enumerate(study.drives):
        rows = np.zeros((*drive.white.shape[:2], len(gram)))
        rows[:, :, :first] = drive.acting(selection.fit.design)
        mine = [j for j, tangent in enumerate(tangents) if number in tangent]
        if mine:
            trial = np.stack([tangents[j][number] for j in mine], axis=2)
            rows[:, :, [first + j for j in mine]] = drive.whitened(trial)
        flat = rows.reshape(-1, len(gram))
        gram += flat.T @ flat
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    A = gram / np.outer(scale, scale) + 1e-7 * np.eye(len(gram))
    std = np.sqrt(np.diag(np.linalg.inv(A))) / scale
    for j, (k, name) in enumerate(owner):
        out.setdefault(k, {})[name] = float(std[first + j])
    start = study.hypotheses.nuisance.shape[1]
    for k, one in enumerate(selection.chosen):
        if any(owned == k for owned, _ in owner):
            out[k][one.term.parameters[0]] = float(std[start])
        start += one.term.design.shape[1]
    return out


def _of_grid(
    study: Study, selection: Selection, which: int, tangents: list[dict[int, FloatArray]]
) -> dict[str, float]:
    """Standard deviations of an effect's linear parameters and of the nonlinear one; `tangents` by drive, of
    what is beside.

    The farthest end of the interval in which the likelihood, all linear values fitted, is within 1.92 of its
    maximum (Wilks, Annals of Mathematical Statistics 9, 1938) counts as 1.96 of them.
    """
    one, others = selection.chosen[which], [c.term for k, c in enumerate(selection.chosen) if k != which]
    grid, tau, own = one.term.kind_of.grid, one.term.at, len(one.values)
    assert grid is not None
    assert tau is not None
    trials = np.concatenate([[tau], np.geomspace(*grid.range, 19)])
    rest = np.concatenate([study.hypotheses.nuisance, *(term.design for term in others)], axis=1)
    linear_only = 1 + rest.shape[1]
    known = linear_only + len(tangents)
    gram = np.zeros((known + own * len(trials), known + own * len(trials)))
    acting = study.acting(one.term)
    for number, drive in enumerate(study.drives):
        rows = np.zeros((*drive.white.shape[:2], len(gram)))
        rows[:, :, 0] = drive.white[:, :, 0]
        rows[:, :, 1:linear_only] = drive.acting(rest)
        for j, tangent in enumerate(tangents):
            if number in tangent:
                rows[:, :, linear_only + j] = drive.whitened(tangent[number][:, :, None])[:, :, 0]
        if number in acting:
            parts = [part for x in trials for part in refined(one.term, x)]
            columns = [part.column(drive.reader, drive.base) for part in parts]
            rows[:, :, known:] = drive.whitened(np.stack(columns, axis=2))
        flat = rows.reshape(-1, len(gram))
        gram += flat.T @ flat
    gains, sizes = np.zeros(len(trials)), np.zeros((own, len(trials)))
    for k in range(len(trials)):
        at = np.concatenate([np.arange(known), known + own * k + np.arange(own)])
        values, gains[k] = fitted(gram[np.ix_(at, at)])
        sizes[:, k] = values[-own:]
    lowest = min(float(gains.max()) - SETTINGS.assessment.interval_nats, float(gains[0]))
    order = np.argsort(trials, kind="stable")
    inside = np.flatnonzero(gains[order] >= lowest)
    ends = [
        crossing(gains[order], lowest, int(inside[0]), -1),
        crossing(gains[order], lowest, int(inside[-1]), 1),
    ]
    places = np.arange(len(trials), dtype=np.float64)
    reach = float(np.abs(np.interp(ends, places, trials[order]) - tau).max())
    spread = [float(np.abs(np.interp(ends, places, size[order]) - size[0]).max()) for size in sizes]
    scale = float(np.min(one.stds / np.maximum(np.abs(one.values), 1e-12)))
    stds = np.hypot(one.stds, np.array(spread) / 1.96)
    return {
        grid.parameter: max(reach / 1.96, scale * tau),
        **dict(zip(one.term.parameters, stds.tolist(), strict=True)),
    }


def crossing(gains: FloatArray, level: float, inside: int, step: int) -> float:
    """Where, from a place that is inside outwards, the gains fall to the level; between places, linearly."""
    outside = inside + step
    if not 0 <= outside < len(gains):
        return float(inside)
    fall = float(gains[inside] - gains[outside])
    return inside + step * float(np.clip((gains[inside] - level) / max(fall, 1e-12), 0.0, 1.0))


def _tangents(drive: DriveStudy, one: Chosen) -> dict[str, FloatArray]:
    """Derivatives of a ramp's or an event's response by onset and duration."""
    term, size = one.term, float(one.values[0])
    event = term.pulse and not term.free
    if not term.ramp and not event:
        return {}
    onset, duration = term.span_s[0], term.span_s[1] - term.span_s[0]
    h = max(2.0, 0.05 * duration)

    def column(at: float, long: float) -> FloatArray:
        if event:
            what = Refined(wheels_of(term.place), at, at + max(long, 0.0), pulse=True)
            radius = float(drive.reader.reference.car.radius_m[what.wheels[0]])
            return -radius * what.column(drive.reader, drive.base)
        return Refined(numbers_of(term.wheel), at, max(long, 0.0)).column(drive.reader, drive.base)

    by_onset = (column(onset + h, duration) - column(onset - h, duration)) / (2 * h)
    out = {"onset_s": size * by_onset}
    if duration > 2 * h:
        by_duration = (column(onset, duration + h) - column(onset, duration - h)) / (2 * h)
        out["duration_s"] = size * by_duration
    return out
