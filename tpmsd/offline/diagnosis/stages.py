"""The order of the diagnosis: the only place where it stands.

In: a `Regression`. Out: `FoundTerms`. Each stage takes a `State` and gives the next one; states are
frozen. The regression holds the columns and each drive's noise: a stage that gives other ones gives another
regression, and the one that it was given stays what it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.simulated import floored_noise, widened_design
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.beyond_linear import prune_by_exact_responses
from tpmsd.offline.diagnosis.refinement.refine import most_significant_shape, refine
from tpmsd.offline.diagnosis.refinement.relinearise import relinearised
from tpmsd.offline.diagnosis.robustness.change_or_drift import add_radius_change, add_velocity_error
from tpmsd.offline.diagnosis.robustness.common_drift import add_common_shape
from tpmsd.offline.diagnosis.robustness.confirm import remove_terms_of_slow_noise
from tpmsd.offline.diagnosis.robustness.found_terms import FoundTerms
from tpmsd.offline.diagnosis.robustness.gyro_drift import add_gyro_drift
from tpmsd.offline.diagnosis.robustness.receiver_outliers import remove_receiver_events
from tpmsd.offline.diagnosis.robustness.with_drift import fit_ramps_with_drift
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence
from tpmsd.offline.inference.noise_fit import SearchStage, fit_noise, outliers


@dataclass(frozen=True)
class State:
    """State that one stage leaves to the next."""

    regression: Regression
    design: FloatArray
    """(1 + p, k) of the model so far, beside which the noise is estimated."""
    evidence: Evidence | None = None
    selection: Selection | None = None
    tried: tuple[tuple[Term, ...], ...] = ()
    """Sets of terms that stages chose, the first ones first: each beside the noise of its time."""

    @property
    def chosen(self) -> Selection:
        """Return what was chosen; ValueError before anything was."""
        if self.selection is None:
            raise ValueError("nothing was chosen yet")
        return self.selection

    @property
    def found(self) -> FoundTerms:
        """Return the findings with the regression and the evidence of which it was chosen; ValueError without
        them.
        """
        if self.evidence is None:
            raise ValueError("there is no evidence")
        return FoundTerms(self.regression, self.chosen, self.evidence)


def first_noise(state: State) -> State:
    """Estimate each drive's noise beside everything that is linear."""
    return _estimate_noise(state, SearchStage.FIRST)


def second_noise(state: State) -> State:
    """Estimate each drive's noise jointly with the chosen terms."""
    return _estimate_noise(state, SearchStage.SECOND)


def last_noise(state: State) -> State:
    """Estimate the drift parameters of the noise once more."""
    return _estimate_noise(state, SearchStage.LAST)


def plain_shapes(state: State) -> State:
    """Estimate the first noise once more with the spline terms in the model that the drive shows plainly.

    What no effect of the catalogue holds would pass for noise, and noise of that size would hide its shape.
    """
    regression, design, evidence = state.regression.copied(), state.design, _current_evidence(state)
    for _ in range(SETTINGS.refinement.plain_splines):
        term = most_significant_shape(regression, evidence, design)
        if term is None:
            break
        design = np.concatenate([widened_design(design, regression.hypotheses.width), term.design], axis=1)
        regression = with_estimated_noise(regression, design, SearchStage.FIRST)
        evidence = regression.evidence()
    return replace(state, regression=regression, evidence=evidence)


def choose(state: State) -> State:
    """Choose terms and make those exact that enter nonlinearly.

    What is clearest comes first and exactly: a pulse half a minute off leaves more than a faint effect.
    """
    regression, evidence = state.regression.copied(), _current_evidence(state)
    for most in (1, SETTINGS.selection.max_terms):
        selection = Selector(evidence, regression.hypotheses).select(most)
        if refine(regression, selection, evidence, again=most == 1):
            evidence = regression.evidence()
            selection = Selector(evidence, regression.hypotheses).select(most)
    if not regression.simulation:
        selection = prune_by_exact_responses(regression, selection, evidence)
    tried = (*state.tried, tuple(one.term for one in selection.chosen))
    return State(regression, selection.fit.design, evidence, selection, tried)


def down_weight(state: State) -> State:
    """Reduce the weight of single readings that no chosen term explains.

    Events have been looked for by now: what a hypothesis explains keeps its weight. What was whitened so far
    is let go: it takes as much memory as the columns, and the next origin has others.
    """
    regression, selection, _ = state.found
    drives = []
    for drive in regression.drives:
        white = drive.residual(selection.fit.design, selection.fit.values)
        drives.append(drive.reweighted(outliers(white, drive.blocks, drive.inflate)))
    return replace(state, regression=regression.with_drives(drives), evidence=None)


def move_origin(state: State) -> State:
    """Linearise about the best model so far."""
    return replace(state, regression=relinearised(state.regression, state.chosen))


def ramps_and_drift(state: State) -> State:
    """Fit the chosen changes of radii jointly with the radius drift, unless a simulation is compared."""
    if state.regression.simulation:
        return state
    regression, terms = fit_ramps_with_drift(state.regression, [one.term for one in state.chosen.chosen])
    evidence = regression.evidence()
    design = Selector(evidence, regression.hypotheses).design(terms)
    return replace(state, regression=regression, design=design, evidence=evidence)


def choose_for_verdict(state: State) -> State:
    """Choose terms for the last time, by the rules that decide the verdict."""
    regression, evidence = state.regression.copied(), _current_evidence(state)
    selection = Selector(evidence, regression.hypotheses, last=True).select()
    if not regression.simulation:
        selection = prune_by_exact_responses(regression, selection, evidence, last=True)
    return State(regression, selection.fit.design, evidence, selection, state.tried)


def other_noise(state: State) -> State:
    """Test the found terms under each alternative noise in turn (`ALTERNATIVES`)."""
    found = state.found
    for alternative in ALTERNATIVES:
        found = alternative(found, state)
    return replace(state, regression=found.regression, selection=found.selection, evidence=found.evidence)


Alternative = Callable[[FoundTerms, State], FoundTerms]
"""Findings, and the state before any alternative; the first again."""

ALTERNATIVES: tuple[Alternative, ...] = (
    # Outliers of the receiver, where it alone shows an event.
    lambda found, before: remove_receiver_events(found),
    # Slow noise at its likeliest without the term: the receiver's for what all wheels share, radius drift.
    lambda found, before: remove_terms_of_slow_noise(found),
    # Usual radius drift, where one group of wheels has nearly all of it to itself.
    lambda found, before: add_common_shape(found, before.chosen),
    # Radius drift at its likeliest with and without a change of a radius.
    lambda found, before: add_radius_change(found, before.chosen, before.tried),
    # Slow noise of the receiver's speed at its likeliest with and without a constant error of its velocity.
    lambda found, before: add_velocity_error(found),
    # Usual drift of the gyro's zero, where it drifts far and smoothly.
    lambda found, before: add_gyro_drift(found),
)

STAGES: tuple[Callable[[State], State], ...] = (
    *(first_noise, plain_shapes, choose, down_weight, move_origin),
    *(second_noise, choose, down_weight, move_origin),
    *(last_noise, ramps_and_drift, choose_for_verdict, other_noise),
)


def examine(regression: Regression, progress: Callable[[float], None]) -> FoundTerms:
    """Run all stages and return the findings; `progress` gets the fraction done, from 0.2 to 0.9."""
    progress(0.2)
    state = State(regression, regression.hypotheses.fullest_design)
    del regression  # its columns are not needed for longer than the first stages'
    for number, stage in enumerate(STAGES, start=1):
        state = stage(state)
        progress(0.2 + 0.7 * number / len(STAGES))
    return state.found


def with_estimated_noise(regression: Regression, design: FloatArray, stage: SearchStage) -> Regression:
    """Return the regression with each drive's noise estimated jointly with a design."""
    noises = {
        number: fit_noise(
            drive.reader.windows, drive.data_and_design(design), drive.noise, stage, drive.inflate
        )
        for number, drive in enumerate(regression.drives)
    }
    if regression.simulation:
        noises[1] = floored_noise(noises[1], noises[0])
    return regression.with_noise(noises)


def _estimate_noise(state: State, stage: SearchStage) -> State:
    """Return the state with the noise estimated jointly with its design."""
    regression = with_estimated_noise(state.regression, state.design, stage)
    return replace(state, regression=regression, evidence=regression.evidence())


def _current_evidence(state: State) -> Evidence:
    """Return the state's evidence, computed again where a stage removed it."""
    return state.regression.evidence() if state.evidence is None else state.evidence
