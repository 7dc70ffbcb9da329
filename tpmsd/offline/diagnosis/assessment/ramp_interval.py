"""Intervals of a change of a radius: onset, duration and size by their joint likelihood.

In: the final selection. Out: standard deviations of one linear ramp's onset, duration and size.

Onset and duration trade against each other, and both against radius drift, so no slope at the best point
tells how far they go. The likelihood is taken where a ramp begins and ends at any two of some nodes, all
linear values fitted, and divided by the block-wise variance ratio. The interval is all of it within 1.92 nats
of the maximum (Wilks, Annals of Mathematical Statistics 9, 1938), and its farther end counts as 1.96 standard
deviations. A ramp between two nodes is a weighted sum of the ramps between neighbours: only these are
whitened.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term, numbers_of
from tpmsd.offline.diagnosis.prepared.drive_regression import Refined
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.settings import SETTINGS


def is_linear_ramp(term: Term) -> bool:
    """Return whether a term is a change of a radius at a constant rate, or a step."""
    return term.ramp and not term.course


def ramp_stds(
    regression: Regression, selection: Selection, which: int, joint_slopes: Sequence[dict[int, FloatArray]]
) -> dict[str, float]:
    """Return standard deviations of a chosen ramp's size, onset and duration; `joint_slopes` are slopes of
    other terms by drive, fitted along.
    """
    one = selection.chosen[which]
    begin, end = one.term.span_s
    nodes = _trial_times(regression, one.term)
    pairs = _trial_ramps(nodes, begin, end)
    gains, sizes = _profile_likelihood(regression, selection, which, joint_slopes, nodes, pairs)
    return interval_stds(one, gains, sizes, pairs.begin_s, pairs.end_s - pairs.begin_s)


def interval_stds(
    one: Chosen, gains: FloatArray, sizes: FloatArray, onset_s: FloatArray, duration_s: FloatArray
) -> dict[str, float]:
    """Return standard deviations of a chosen change's size, onset and duration from the (t,) gains (nats) and
    sizes (m) at trials of the two times, the found ones first."""
    ratio = one.overdispersion
    inside = gains >= min(float(gains.max()) - SETTINGS.assessment.interval_nats * ratio, float(gains[0]))

    def reach(values: FloatArray) -> float:
        return float(np.abs(values[inside] - values[0]).max()) / 1.96

    # The fit's own standard deviation is that at the best onset and duration. A ramp that hardly acts within
    # the drive may have any size, so sizes are weighted by the likelihood.
    apart = np.abs(sizes[inside] - sizes[0])
    order = np.argsort(apart)
    weight = np.cumsum(np.exp((gains[inside][order] - gains.max()) / ratio))
    spread = float(apart[order][np.searchsorted(weight, 0.95 * weight[-1])]) / 1.96
    return {
        one.term.parameters[0]: math.hypot(float(one.stds[0]), spread),
        "onset_s": reach(onset_s),
        "duration_s": reach(duration_s),
    }


@dataclass(frozen=True)
class _Pairs:
    """Ramps that are tried; the first is the one that was found."""

    begin_s: FloatArray
    """(t,)"""
    end_s: FloatArray
    """(t,)"""
    weights: FloatArray
    """(t, p) of the pieces: steps at the nodes, then ramps between neighbours."""


def _trial_times(regression: Regression, term: Term) -> FloatArray:
    """Return the sorted times (m,), s, at which trial ramps begin and end: the found ones and some to either
    side, within the drive."""
    recording = regression.drives[regression.acting_drives(term)[0]].reader.recording
    steps = np.geomspace(*SETTINGS.assessment.ramp_reach_s, SETTINGS.assessment.ramp_nodes)
    offsets = np.concatenate([-steps[::-1], [0.0], steps])
    times = np.concatenate([offsets + float(at) for at in term.span_s])
    return np.unique(np.clip(times, min(0.0, *term.span_s), max(float(recording.edges_s[-1]), *term.span_s)))


def _trial_ramps(nodes: FloatArray, begin: float, end: float) -> _Pairs:
    """Return all ramps and steps between two of the trial times, the found one first."""
    count = len(nodes)
    i, j = np.triu_indices(count)
    first = int(np.searchsorted(nodes, begin)), int(np.searchsorted(nodes, end))
    i, j = np.concatenate([[first[0]], i]), np.concatenate([[first[1]], j])
    weights = np.zeros((len(i), 2 * count - 1))
    step = i == j
    weights[step, i[step]] = 1.0
    lengths = np.diff(nodes)
    within = (np.arange(count - 1) >= i[:, None]) & (np.arange(count - 1) < j[:, None])
    spans = np.maximum(nodes[j] - nodes[i], 1e-9)
    weights[:, count:] = within * lengths / spans[:, None]
    return _Pairs(nodes[i], nodes[j], weights)


def _profile_likelihood(
    regression: Regression,
    selection: Selection,
    which: int,
    joint_slopes: Sequence[dict[int, FloatArray]],
    nodes: FloatArray,
    pairs: _Pairs,
) -> tuple[FloatArray, FloatArray]:
    """Return the (t,) gains (nats) and (t,) sizes (m) of the trial ramps, each with everything linear fitted
    jointly."""
    term = selection.chosen[which].term
    others = [one.term.design for k, one in enumerate(selection.chosen) if k != which]
    rest = np.concatenate([regression.hypotheses.nuisance, *others], axis=1)
    known, pieces = 1 + rest.shape[1] + len(joint_slopes), 2 * len(nodes) - 1
    gram = np.zeros((known + pieces, known + pieces))
    spans = [(float(at), 0.0) for at in nodes] + list(zip(nodes[:-1], np.diff(nodes), strict=True))
    for number, drive in enumerate(regression.drives):
        rows = np.zeros((*drive.white.shape[:2], len(gram)))
        rows[:, :, 0] = drive.white[:, :, 0]
        rows[:, :, 1 : 1 + rest.shape[1]] = drive.whitened_design(rest)
        for k, slopes in enumerate(joint_slopes):
            if number in slopes:
                rows[:, :, 1 + rest.shape[1] + k] = drive.whitened(slopes[number][:, :, None])[:, :, 0]
        if number in regression.acting_drives(term):
            wheels = numbers_of(term.wheel)
            columns = [Refined(wheels, at, long).column(drive.reader, drive.base) for at, long in spans]
            rows[:, :, known:] = drive.whitened(np.stack(columns, axis=2))
        flat = rows.reshape(-1, len(gram))
        gram += flat.T @ flat
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram)[1:known], 1e-300))
    inner = gram[1:known, 1:known] * np.outer(scale, scale) + 1e-9 * np.eye(known - 1)
    cross = gram[1:known] * scale[:, None]
    solved = np.linalg.solve(inner, cross[:, known:])
    left = gram[known:, known:] - cross[:, known:].T @ solved
    score = pairs.weights @ (gram[known:, 0] - solved.T @ cross[:, 0])
    size = np.einsum("tp,pq,tq->t", pairs.weights, left, pairs.weights, optimize=True)
    # What the rest explains already, or what begins with the drive's end, tells nothing.
    whole = np.einsum("tp,pq,tq->t", pairs.weights, gram[known:, known:], pairs.weights, optimize=True)
    least = SETTINGS.sensors.min_share * max(float(whole.max()), 1e-300)
    acts = size > least
    size = np.where(acts, size, least)
    return np.where(acts, 0.5 * score**2 / size, 0.0), np.where(acts, score / size, 0.0)
