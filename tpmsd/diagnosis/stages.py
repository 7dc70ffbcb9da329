"""The order of the diagnosis: the only place where it stands.

In: a `Study`. Out: its `Selection` and `Evidence`. Each stage takes a `State` and gives the next one; states
are frozen, and what a stage leaves to the next is in them. The study holds the columns and each drive's
noise; a stage that sets them says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.diagnosis.assessment.simulated import floored, widened
from tpmsd.diagnosis.prepared.study import Study
from tpmsd.diagnosis.refinement.beyond_linear import needed_exactly
from tpmsd.diagnosis.refinement.refine import plainest_shape, refine
from tpmsd.diagnosis.refinement.relinearise import relinearise
from tpmsd.diagnosis.robustness.accounts import changed
from tpmsd.diagnosis.robustness.confirm import confirmed
from tpmsd.diagnosis.robustness.drifting import drifting
from tpmsd.diagnosis.robustness.outlying import lasting
from tpmsd.diagnosis.robustness.together import together
from tpmsd.diagnosis.selection.chosen import Selection
from tpmsd.diagnosis.selection.selector import Selector
from tpmsd.diagnosis.settings import SETTINGS
from tpmsd.inference.least_squares import Evidence
from tpmsd.inference.noise_fit import Stage, fit_noise, outliers
from tpmsd.wheels import FloatArray


@dataclass(frozen=True)
class State:
    """What one stage leaves to the next."""

    study: Study
    design: FloatArray
    """(1 + p, k) of the model that is believed so far: the noise is estimated beside it."""
    evidence: Evidence | None = None
    selection: Selection | None = None

    @property
    def found(self) -> tuple[Selection, Evidence]:
        """What was chosen; ValueError before anything was."""
        if self.selection is None or self.evidence is None:
            raise ValueError("nothing was chosen yet")
        return self.selection, self.evidence


def first_noise(state: State) -> State:
    """Estimate the noise beside everything that is linear; sets each drive's noise."""
    return _estimated(state, Stage.FIRST)


def second_noise(state: State) -> State:
    """The same beside what was chosen; sets each drive's noise."""
    return _estimated(state, Stage.SECOND)


def last_noise(state: State) -> State:
    """What drifts alone, once more; sets each drive's noise."""
    return _estimated(state, Stage.LAST)


def plain_shapes(state: State) -> State:
    """Estimate the first noise once more with the spline terms in the model that the drive shows plainly.

    What no effect of the catalogue holds would pass for noise, and noise of that size would hide its shape.
    Adds columns and sets each drive's noise.
    """
    study, design, evidence = state.study, state.design, _present(state)
    for _ in range(SETTINGS.refinement.plain_splines):
        term = plainest_shape(study, evidence, design)
        if term is None:
            break
        design = np.concatenate([widened(design, study.hypotheses.width), term.design], axis=1)
        evidence = _present(_estimated(replace(state, design=design), Stage.FIRST))
    return replace(state, evidence=evidence)


def choose(state: State) -> State:
    """Choose terms and make those exact that enter nonlinearly; adds columns.

    What is clearest comes first and exactly: a pulse half a minute off leaves more than a faint effect.
    """
    study, evidence = state.study, _present(state)
    for most in (1, SETTINGS.selection.most_terms):
        selection = Selector(evidence, study.hypotheses).select(most)
        if refine(study, selection, evidence, again=most == 1):
            evidence = study.evidence()
            selection = Selector(evidence, study.hypotheses).select(most)
    if not study.simulation:
        selection = needed_exactly(study, selection, evidence)
    return replace(state, design=selection.fit.design, evidence=evidence, selection=selection)


def down_weight(state: State) -> State:
    """Let single readings weigh less that no chosen term explains; sets each drive's weights.

    Events have been looked for by now: what a hypothesis explains keeps its weight.
    """
    selection, _ = state.found
    for drive in state.study.drives:
        white = drive.residual(selection.fit.design, selection.fit.values)
        drive.inflate = outliers(white, drive.blocks, drive.inflate)
    return state


def move_origin(state: State) -> State:
    """Linearise about the best model so far; sets each drive's columns."""
    relinearise(state.study, state.found[0])
    return state


def verdict(state: State) -> State:
    """Choose for the last time, by the rules of a verdict."""
    evidence = _present(state)
    selection = Selector(evidence, state.study.hypotheses, last=True).select()
    if not state.study.simulation:
        selection = needed_exactly(state.study, selection, evidence, last=True)
    return replace(state, design=selection.fit.design, evidence=evidence, selection=selection)


def other_noise(state: State) -> State:
    """Ask what was found under each alternative noise in turn (`ALTERNATIVES`); may set a drive's noise."""
    before, _ = state.found
    found = state.found
    for alternative in ALTERNATIVES:
        found = alternative(state.study, *found, before)
    return replace(state, selection=found[0], evidence=found[1])


Alternative = Callable[[Study, Selection, Evidence, Selection], tuple[Selection, Evidence]]
"""Study, what is chosen, its evidence, and what was chosen before any alternative; the first two anew."""

ALTERNATIVES: tuple[Alternative, ...] = (
    # Outliers of the receiver, where it alone shows an event.
    lambda study, selection, evidence, before: lasting(study, selection, evidence),
    # Slow noise at its likeliest without the term: the receiver's for what all wheels share, radius drift.
    lambda study, selection, evidence, before: confirmed(study, selection, evidence),
    # Usual radius drift, where one group of wheels has nearly all of it to itself.
    lambda study, selection, evidence, before: together(study, selection, evidence, before),
    # Radius drift at its likeliest with and without a change of a radius.
    lambda study, selection, evidence, before: changed(study, selection, evidence),
    # Usual drift of the gyro's zero, where it drifts far and smoothly.
    lambda study, selection, evidence, before: drifting(study, selection, evidence),
)

STAGES: tuple[Callable[[State], State], ...] = (
    *(first_noise, plain_shapes, choose, down_weight, move_origin),
    *(second_noise, choose, down_weight, move_origin),
    *(last_noise, verdict, other_noise),
)


def examine(study: Study, progress: Callable[[float], None]) -> tuple[Selection, Evidence]:
    """Run all stages; `progress` is told the share that is done, from 0.2 to 0.9."""
    state = State(study, study.hypotheses.everything)
    for number, stage in enumerate(STAGES, start=1):
        state = stage(state)
        progress(0.2 + 0.7 * number / len(STAGES))
    return state.found


def estimate_noise(study: Study, design: FloatArray, stage: Stage) -> None:
    """Set each drive's noise, estimated beside a model."""
    for drive in study.drives:
        windows = drive.reader.windows
        drive.noise = fit_noise(windows, drive.believed(design), drive.noise, stage, drive.inflate)
    if study.simulation:
        recorded, simulated = study.drives
        simulated.noise = floored(simulated.noise, recorded.noise)


def _estimated(state: State, stage: Stage) -> State:
    estimate_noise(state.study, state.design, stage)
    return replace(state, evidence=state.study.evidence())


def _present(state: State) -> Evidence:
    return state.study.evidence() if state.evidence is None else state.evidence
