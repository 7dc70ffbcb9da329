"""What the pictures of a diagnosis show, as numbers.

In: a `Study` and its `Selection`. Out: `Trace`s (a finding's mismatch over its covariate, before and
after) and `Ground` (the drive's map with the mismatch at every place).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter1d

from tpmsd.diagnosis.channels import EAST, NORTH
from tpmsd.diagnosis.evidence import Evidence
from tpmsd.diagnosis.selection import Selection, Selector
from tpmsd.wheels import FloatArray

if TYPE_CHECKING:
    from tpmsd.diagnosis.diagnose import Study

BINS = 16


@dataclass(frozen=True)
class Trace:
    """Mismatch in standard deviations per bin of a covariate: residual along the finding's response."""

    effect: str
    covariate: str
    middle: FloatArray
    before: FloatArray
    after: FloatArray


@dataclass(frozen=True)
class Ground:
    """The drive's map."""

    east_m: FloatArray
    north_m: FloatArray
    mismatch: FloatArray
    """Log-likelihood per second that the rolling model loses there against the extended one, smoothed over 9
    s.
    """


def traces(
    study: Study, selection: Selection, evidence: Evidence, covariates: list[str | None]
) -> list[Trace]:
    """One trace per finding that has a covariate."""
    out = []
    terms = [one.term for one in selection.chosen]
    selector = Selector(evidence, study.hypotheses)
    whole = study.residual(selection.fit.design, selection.fit.values)
    for k, (one, covariate) in enumerate(zip(selection.chosen, covariates, strict=True)):
        if covariate is None or covariate not in study.reader.windows.covariates:
            continue
        without = evidence.fit(selector.design(terms[:k] + terms[k + 1 :]))
        before = study.residual(without.design, without.values)
        response = study.white @ (one.term.design @ one.values)
        values = study.reader.windows.covariates[covariate]
        edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)))
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
                before=np.bincount(at, (before * response).sum(axis=1), count) / size,
                after=np.bincount(at, (whole * response).sum(axis=1), count) / size,
            )
        )
    return out


def ground(study: Study, selection: Selection, evidence: Evidence) -> Ground | None:
    """The map; None without positions."""
    windows = study.reader.windows
    east, north = windows.measured[:, EAST], windows.measured[:, NORTH]
    known = np.isfinite(east)
    if known.sum() < 10:
        return None
    rolling = evidence.fit(study.hypotheses.nuisance)
    before = (study.residual(rolling.design, rolling.values) ** 2).sum(axis=1)
    after = (study.residual(selection.fit.design, selection.fit.values) ** 2).sum(axis=1)
    mismatch = uniform_filter1d(0.5 * (before - after), 9)
    return Ground(east[known], north[known], mismatch[known])
