"""Standard deviations of parameters that enter nonlinearly.

In: the final selection. Out: per chosen term the standard deviations of its linear and nonlinear
parameters, by Gauss-Newton: the response's derivative by an onset, a duration or a time constant is one
more column of the fit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tpmsd.diagnosis.response import ramp_column, thermal_column
from tpmsd.diagnosis.selection import Chosen, Selection
from tpmsd.diagnosis.whitening import whiten
from tpmsd.wheels import WHEELS, FloatArray

if TYPE_CHECKING:
    from tpmsd.diagnosis.diagnose import Study


def nonlinear_stds(study: Study, selection: Selection) -> dict[int, dict[str, float]]:
    """By place in the selection: standard deviations of amplitude and nonlinear parameters."""
    tangents: list[FloatArray] = []
    owner: list[tuple[int, str]] = []
    for k, one in enumerate(selection.chosen):
        for name, column in _tangents(study, one):
            tangents.append(column)
            owner.append((k, name))
    if not tangents:
        return {}
    believed = study.believed(selection.fit.design)
    columns = np.concatenate([believed, np.stack(tangents, axis=2)], axis=2)
    white, _ = whiten(study.reader.windows, study.noise, columns, study.inflate)
    rows = white.reshape(-1, white.shape[2])[:, 1:]
    scale = np.sqrt(np.maximum((rows**2).sum(axis=0), 1e-300))
    A = (rows / scale).T @ (rows / scale) + 1e-7 * np.eye(rows.shape[1])
    std = np.sqrt(np.diag(np.linalg.inv(A))) / scale
    first = selection.fit.design.shape[1]
    out: dict[int, dict[str, float]] = {}
    for j, (k, name) in enumerate(owner):
        out.setdefault(k, {})[name] = float(std[first + j])
    start = study.hypotheses.nuisance.shape[1]
    for k, one in enumerate(selection.chosen):
        if k in out:
            out[k][one.term.parameters[0]] = float(std[start])
        start += one.term.design.shape[1]
    return out


def _tangents(study: Study, one: Chosen) -> list[tuple[str, FloatArray]]:
    term, size = one.term, float(one.values[0])
    if term.effect == "thermal_growth":
        h = 0.05 * term.time_constant_s
        up = thermal_column(study.reader, term.time_constant_s + h)
        down = thermal_column(study.reader, term.time_constant_s - h)
        return [("time_constant_s", size * (up - down) / (2 * h))]
    if term.effect != "radius_change":
        return []
    wheel = WHEELS.index(term.wheel)
    onset, duration = term.span_s[0], term.span_s[1] - term.span_s[0]
    h = max(2.0, 0.05 * duration)

    def column(at: float, long: float) -> FloatArray:
        return ramp_column(study.reader, wheel, at, max(long, 0.0))

    by_onset = (column(onset + h, duration) - column(onset - h, duration)) / (2 * h)
    out = [("onset_s", size * by_onset)]
    if duration > 2 * h:
        by_duration = (column(onset, duration + h) - column(onset, duration - h)) / (2 * h)
        out.append(("duration_s", size * by_duration))
    return out
