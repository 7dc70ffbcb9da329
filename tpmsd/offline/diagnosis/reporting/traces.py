"""Numbers that the pictures of a diagnosis show.

In: a `Regression` and its `Selection`. Out: `Trace`s (a finding's mismatch over its covariate, before and
after) and `DriveMap` (the drive's map with the mismatch at every place).
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.result import DriveMap, Trace
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.reporting.location import covariate_values, where_of
from tpmsd.offline.diagnosis.selection.catalogue_effect import tolerance_note
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence
from tpmsd.offline.inference.smoothing import running_mean
from tpmsd.offline.inference.windows import EAST, NORTH


def traces(regression: Regression, selection: Selection, evidence: Evidence) -> list[Trace]:
    """Return one trace per finding that has a covariate, over all drives in which it acts."""
    out = []
    terms = [one.term for one in selection.chosen]
    selector = Selector(evidence, regression.hypotheses)
    for k, one in enumerate(selection.chosen):
        if tolerance_note(one, regression.has_wheel_speeds_only):
            continue
        covariate = where_of(regression, one).covariate
        values = covariate_values(regression, one.term, covariate)
        if covariate is None or values is None:
            continue
        without = evidence.fit(selector.design(terms[:k] + terms[k + 1 :]))
        drives = [regression.drives[number] for number in regression.acting_drives(one.term)]
        response = np.concatenate([drive.response(one.term.design, one.values) for drive in drives])
        before, after = (
            (np.concatenate([drive.residual(fit.design, fit.values) for drive in drives]) * response).sum(1)
            for fit in (without, selection.fit)
        )
        edges = _bin_edges(values)
        if len(edges) < 4:
            continue
        at = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        count = len(edges) - 1
        size = np.sqrt(np.maximum(np.bincount(at, (response**2).sum(axis=1), count), 1e-12))
        number = np.maximum(np.bincount(at, minlength=count), 1)
        out.append(
            Trace(
                effect=one.term.effect,
                covariate=covariate,
                middle=np.bincount(at, values, count) / number,
                before=np.bincount(at, before, count) / size,
                after=np.bincount(at, after, count) / size,
            )
        )
    return out


def _bin_edges(values: FloatArray) -> FloatArray:
    """Return the edges of bins with alike many windows, none narrower than a fortieth of the usual range."""
    quantiles = np.quantile(values, np.linspace(0.0, 1.0, SETTINGS.report.bins + 1))
    least = (quantiles[-2] - quantiles[1]) / 40.0
    edges = [quantiles[0]]
    for edge in quantiles[1:]:
        if edge - edges[-1] > max(least, 1e-12):
            edges.append(edge)
    edges[-1] = quantiles[-1]
    return np.array(edges)


def drive_map(regression: Regression, selection: Selection, evidence: Evidence) -> DriveMap | None:
    """Return the map of mismatch along the drives, side by side; None without positions."""
    rolling = evidence.fit(regression.hypotheses.nuisance)
    parts: list[FloatArray] = []
    right = 0.0
    for drive in regression.examined:
        measured = drive.reader.windows.measured
        known = np.isfinite(measured[:, EAST])
        if known.sum() < 10:
            continue
        before = (drive.residual(rolling.design, rolling.values) ** 2).sum(axis=1)
        after = (drive.residual(selection.fit.design, selection.fit.values) ** 2).sum(axis=1)
        mismatch = running_mean(0.5 * (before - after), 9)
        east, north = measured[known, EAST], measured[known, NORTH]
        if parts:
            # Each drive has an origin of its own.
            east = east - east.min() + right + 0.1 * float(np.ptp(east))
        right = float(east.max())
        parts.append(np.stack([east, north, mismatch[known]]))
    if not parts:
        return None
    east, north, mismatch = np.concatenate(parts, axis=1)
    return DriveMap(east, north, mismatch)
