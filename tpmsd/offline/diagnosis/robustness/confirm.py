"""Confirms faint effects against slow noise that could make them.

In: `FoundTerms`. Out: the same without the terms that do not stand, under the noise without them.

Warm-up, growth with speed and slopes act on all wheels alike, so that only the receiver shows them, as a
slow drift. With such a term in the model the receiver's slow error is estimated smaller than it is, and
the term looks the surer for it. So the term is asked again under the noise that fits best without it. The
same holds of a single wheel's change and of terms over time against the radius drift.

Which positions weigh less as outliers was decided beside the term: those that contradict it. A reflection
swells over many seconds, and with a small weight it leaves a short memory to the rest. So what only the
receiver shows is asked once more with all positions at their full weight, under the noise that fits then.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tpmsd.car.physics.effect import NoiseResemblance
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import PATTERNS, Term
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence, gain_of
from tpmsd.offline.inference.noise import PRIORS
from tpmsd.offline.inference.noise_fit import (
    POSITION,
    SLOW,
    log_posterior,
    refit,
    refit_radius_drift,
    refit_slow,
)
from tpmsd.offline.inference.whitening import whiten
from tpmsd.offline.inference.windows import EAST


def remove_terms_of_slow_noise(found: FoundTerms) -> FoundTerms:
    """Return the findings without the terms that slow noise explains as well."""
    regression, selection, evidence = found
    for one in selection.chosen:
        looks = one.term.kind_of.confounding.resembles
        common = looks is NoiseResemblance.COMMON or acts_on_all_read_wheels(regression, one.term)
        wheel = looks is NoiseResemblance.WHEEL or one.term.covariate in ("time", "distance")
        clear = SETTINGS.robustness.clear_of_drift_nats if wheel else 0.0
        if one.gain > (SETTINGS.robustness.clear_of_receiver_nats if common else clear):
            continue
        terms = [other.term for other in selection.chosen if other is not one]
        selector = Selector(evidence, regression.hypotheses)
        without, with_it = selector.design(terms), selector.design([*terms, one.term])
        least = SETTINGS.selection.admit_nats + one.term.penalty
        null = {
            number: _under_null_noise(regression.drives[number], without, common)
            for number in regression.acting_drives(one.term)
        }
        asked = [null]
        if common:
            asked.append({number: _at_full_weight(drive, without) for number, drive in null.items()})
        if (
            min(gain_under_other_noise(regression, with_it, without.shape[1], other) for other in asked)
            < least
        ):
            slower = regression.with_noise({number: drive.noise for number, drive in null.items()})
            evidence = slower.evidence()
            return remove_terms_of_slow_noise(
                FoundTerms(slower, Selector(evidence, regression.hypotheses).selection_of(terms), evidence)
            )
    return FoundTerms(regression, _with_instrument_effects(regression, selection, evidence), evidence)


def acts_on_all_read_wheels(regression: Regression, term: Term) -> bool:
    """Return whether a term acts on all wheels that are read, so that only the receiver shows it."""
    read = {
        WHEELS[k]
        for number in regression.acting_drives(term)
        for k in regression.drives[number].reader.recording.wheels
    }
    return read <= set(PATTERNS.get(term.pattern, ()))


def _with_instrument_effects(regression: Regression, selection: Selection, evidence: Evidence) -> Selection:
    """Return the selection with its first uncertain term replaced by the instrument's effect.

    That is the effect which the term is tested with.
    """
    terms = [one.term for one in selection.chosen]
    for k, one in enumerate(selection.chosen):
        joint = one.term.kind_of.confounding.tested_jointly_with
        if not joint or one.confidence >= SETTINGS.robustness.confident_from:
            continue
        same = [t for t in regression.hypotheses.catalogue if t.effect in joint and t.drive == one.term.drive]
        if same and not any(term.effect in joint for term in terms):
            return Selector(evidence, regression.hypotheses).selection_of(
                [*terms[:k], *terms[k + 1 :], same[0]]
            )
    return selection


def _under_null_noise(drive: DriveRegression, design: FloatArray, common: bool) -> DriveRegression:
    """Return a drive under the noise that fits best with this design: `common`, the receiver's slow error,
    else radius drift."""
    windows, columns = drive.reader.windows, drive.data_and_design(design)
    if not common:
        start = replace(drive.noise, radius_drift=max(drive.noise.radius_drift, PRIORS["radius_drift"][0]))
        null = refit_radius_drift(windows, columns, start, drive.inflate)
        much = drive.noise.radius_drift >= SETTINGS.robustness.drifts_from
        unsure = SETTINGS.robustness.drift_unsure if much else 1.0
        return drive.with_noise(replace(null, radius_drift=unsure * null.radius_drift))
    middles: dict[str, Any] = {name: PRIORS[name][0] for name in SLOW}
    starts = (drive.noise, replace(drive.noise, **middles))
    found = [refit_slow(windows, columns, start, drive.inflate) for start in starts]
    return drive.with_noise(
        max(found, key=lambda noise: log_posterior(windows, columns, noise, drive.inflate))
    )


def _at_full_weight(drive: DriveRegression, design: FloatArray) -> DriveRegression:
    """Return a drive with robust weights of positions set to one, and the position noise fitted again."""
    if drive.inflate is None:
        return drive
    inflate = drive.inflate.copy()
    inflate[:, EAST:] = 1.0
    noise = refit(drive.reader.windows, drive.data_and_design(design), drive.noise, inflate, POSITION)
    return drive.with_noise(noise, inflate)


def gain_under_other_noise(
    regression: Regression, design: FloatArray, first: int, null: Mapping[int, DriveRegression]
) -> float:
    """Return the log-likelihood gain (nats) of a design's columns from `first` on, with some drives under
    another noise."""
    k = 1 + design.shape[1]
    gram = np.zeros((k, k))
    for number, drive in enumerate(regression.drives):
        rows = np.zeros((*drive.white.shape[:2], k))
        if number in null:
            other, acting = null[number], np.any(drive.own_design(design) != 0.0, axis=0)
            rows[:, :, np.concatenate([[True], acting])] = whiten(
                drive.reader.windows, other.noise, drive.data_and_design(design), other.inflate
            )[0]
        else:
            rows[:, :, 0] = drive.white[:, :, 0]
            rows[:, :, 1:] = drive.whitened_design(design)
        flat = rows.reshape(-1, k)
        gram += flat.T @ flat
    return gain_of(gram) - gain_of(gram[: 1 + first, : 1 + first])
