"""Tells events of wheels from errors of the receiver, where the receiver alone shows them.

In: `FoundTerms`. Out: the same without the events that a few readings make, which weigh less then.

An axle that slips is an event of its own while all others roll. Where the car has no other wheels, or all of
them slip alike, what is left to compare with is the receiver, and a receiver that errs for two seconds shows
as much as wheels that slip. The two differ in duration: so the event is fitted again with those readings
down-weighted that are outliers without it; each of them then contributes two standard deviations at most
(Huber, Annals of Mathematical Statistics 35, 1964). Ten seconds of slip remain significant; an error of the
receiver of two seconds does not. The wheels' own speed adds to the evidence: wheels that spin up depart from
the smooth speed of a car, and where the receiver errs they do not.

Where an event goes, everything is chosen again under the lighter weights: outliers at their full weight make
a scatter between blocks by which the gain of every other effect was divided.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpmsd.car.physics.catalogue import EVENTS
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.beyond_linear import prune_by_exact_responses
from tpmsd.offline.diagnosis.robustness.confirm import acts_on_all_read_wheels
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence
from tpmsd.offline.inference.noise_fit import single_outliers


def remove_receiver_events(found: FoundTerms) -> FoundTerms:
    """Return the findings without events of all wheels that follow from a few outliers of the receiver."""
    regression, selection, evidence = found
    selector = Selector(evidence, regression.hypotheses, last=True)
    for one in selection.chosen:
        if not (one.term.pulse and acts_on_all_read_wheels(regression, one.term)):
            continue
        terms = [other.term for other in selection.chosen if other is not one]
        lighter = _outliers_down_weighted(regression, selector.design(terms), one.term)
        calm = lighter.evidence()
        robust = Selector(calm, regression.hypotheses, last=True)
        gain = robust.gain([*terms, one.term]) - robust.gain(terms)
        gain += sum(
            jump_evidence(regression.drives[number], one) for number in regression.acting_drives(one.term)
        )
        if gain < one.term.penalty + SETTINGS.selection.admit_nats:
            return remove_receiver_events(
                FoundTerms(lighter, _selected_without_events(lighter, calm, one.term), calm)
            )
    return found


def _outliers_down_weighted(regression: Regression, design: FloatArray, event: Term) -> Regression:
    """Return the regression in which readings that are outliers without an event weigh less, in the drives in
    which it would act. Lighter readings make outliers of neighbours, so it repeats until none is left."""
    for _ in range(SETTINGS.robustness.down_weighting_rounds):
        evidence = regression.evidence()
        fit = evidence.fit(design)
        drives, changed = list(regression.drives), False
        for number in regression.acting_drives(event):
            drive = regression.drives[number]
            factor = single_outliers(drive.residual(fit.design, fit.values))
            changed = changed or bool(np.any(factor > 1.0))
            drives[number] = drive.with_noise(
                inflate=factor if drive.inflate is None else drive.inflate * factor
            )
        if not changed:
            break
        regression = regression.with_drives(drives)
    return regression


def _selected_without_events(regression: Regression, evidence: Evidence, event: Term) -> Selection:
    """Return the final selection where no event may act on the wheels of the removed one."""
    barred = frozenset(replace(event, effect=name).key for name in EVENTS)
    selection = Selector(evidence, regression.hypotheses, last=True, barred=barred).select()
    return (
        selection
        if regression.simulation
        else prune_by_exact_responses(regression, selection, evidence, last=True)
    )


def jump_evidence(drive: DriveRegression, one: Chosen) -> float:
    """Return the log-likelihood ratio (nats) of an event by second differences of speed: the car has that of
    the wheels less the event, or that of the wheels as it is."""
    wheels, index = drive.reader.recording.wheels, drive.reader.windows.index
    own = drive.own_design(one.term.design) @ one.values
    used = np.flatnonzero(own)
    event = (drive.columns.take(used)[:, wheels] @ own[used]).mean(axis=1)
    distance = drive.reader.windows.measured[:, wheels].mean(axis=1)
    together = (np.diff(index)[1:] == 1) & (np.diff(index)[:-1] == 1)
    plain, less = (np.diff(course, 2)[together] for course in (distance, distance - event))
    scale = SETTINGS.robustness.normal_median * float(np.median(np.abs(plain)))
    return float(np.sum(_student_log_density(less, scale) - _student_log_density(plain, scale)))


def _student_log_density(values: FloatArray, scale: float) -> FloatArray:
    """Return the log-density of Student's distribution, up to a constant: its tails hold braking (Lange,
    Little and Taylor, Journal of the American Statistical Association 84, 1989)."""
    free = SETTINGS.robustness.student_freedom
    return np.asarray(-0.5 * (free + 1.0) * np.log1p(np.square(values / scale) / free))
