"""Standard deviations of parameters that enter nonlinearly.

In: the final selection. Out: per chosen term the standard deviations of its linear and nonlinear
parameters, by Gauss-Newton: the response's derivative by an onset, a duration or a time constant is one
more column of the fit.
"""

from __future__ import annotations

import numpy as np

from tpmsd.diagnosis.response import ramp_column, thermal_column
from tpmsd.diagnosis.selection import Chosen, Selection
from tpmsd.diagnosis.study import DriveStudy, Study
from tpmsd.wheels import WHEELS, FloatArray


def nonlinear_stds(study: Study, selection: Selection) -> dict[int, dict[str, float]]:
    """By place in the selection: standard deviations of amplitude and nonlinear parameters."""
    tangents: list[dict[int, FloatArray]] = []
    owner: list[tuple[int, str]] = []
    for k, one in enumerate(selection.chosen):
        by_drive = {number: _tangents(study.drives[number], one) for number in study.acting(one.term)}
        for name in dict.fromkeys(name for found in by_drive.values() for name in found):
            tangents.append({number: found[name] for number, found in by_drive.items()})
            owner.append((k, name))
    if not tangents:
        return {}
    first = selection.fit.design.shape[1]
    gram = np.zeros((first + len(tangents), first + len(tangents)))
    for number, drive in enumerate(study.drives):
        rows = np.zeros((*drive.white.shape[:2], len(gram)))
        rows[:, :, :first] = drive.white @ drive.own(selection.fit.design)
        mine = [j for j, tangent in enumerate(tangents) if number in tangent]
        if mine:
            trial = np.stack([tangents[j][number] for j in mine], axis=2)
            rows[:, :, [first + j for j in mine]] = drive.whitened(trial)
        flat = rows.reshape(-1, len(gram))
        gram += flat.T @ flat
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    A = gram / np.outer(scale, scale) + 1e-7 * np.eye(len(gram))
    std = np.sqrt(np.diag(np.linalg.inv(A))) / scale
    out: dict[int, dict[str, float]] = {}
    for j, (k, name) in enumerate(owner):
        out.setdefault(k, {})[name] = float(std[first + j])
    start = study.hypotheses.nuisance.shape[1]
    for k, one in enumerate(selection.chosen):
        if k in out:
            out[k][one.term.parameters[0]] = float(std[start])
        start += one.term.design.shape[1]
    return out


def _tangents(drive: DriveStudy, one: Chosen) -> dict[str, FloatArray]:
    term, size = one.term, float(one.values[0])
    if term.effect == "thermal_growth":
        h = 0.05 * term.time_constant_s
        up = thermal_column(drive.reader, term.time_constant_s + h, drive.base)
        down = thermal_column(drive.reader, term.time_constant_s - h, drive.base)
        return {"time_constant_s": size * (up - down) / (2 * h)}
    if term.effect != "radius_change":
        return {}
    wheel = WHEELS.index(term.wheel)
    onset, duration = term.span_s[0], term.span_s[1] - term.span_s[0]
    h = max(2.0, 0.05 * duration)

    def column(at: float, long: float) -> FloatArray:
        return ramp_column(drive.reader, wheel, at, max(long, 0.0), drive.base)

    by_onset = (column(onset + h, duration) - column(onset - h, duration)) / (2 * h)
    out = {"onset_s": size * by_onset}
    if duration > 2 * h:
        by_duration = (column(onset, duration + h) - column(onset, duration - h)) / (2 * h)
        out["duration_s"] = size * by_duration
    return out
