"""The diagnosis of drives, from recordings to findings.

In: `Recording`s of one car. Out: `Diagnosis`. Pure: the same recordings give the same answer.

1. Smooth each recording's own motion and predict all channels by the rolling model.
2. Whiten residuals and the responses of all hypotheses with the unknown motion eliminated.
3. Choose terms over all drives together; estimate each drive's noise from what they leave; repeat.
4. Refine the parameters that enter nonlinearly, and report.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.diagnosis.certify import certified
from tpmsd.diagnosis.chosen import Selection
from tpmsd.diagnosis.confirm import confirmed
from tpmsd.diagnosis.drifting import drifting
from tpmsd.diagnosis.drive_study import first_noise
from tpmsd.diagnosis.drives import admitted, against
from tpmsd.diagnosis.findings import report
from tpmsd.diagnosis.identifiability import Telling, tellings
from tpmsd.diagnosis.refine import plainest_shape, refine
from tpmsd.diagnosis.relinearise import relinearise
from tpmsd.diagnosis.result import INSUFFICIENT, Diagnosis
from tpmsd.diagnosis.selection import MAX_TERMS, Selector
from tpmsd.diagnosis.simulated import differences, floored, widened
from tpmsd.diagnosis.study import Study
from tpmsd.diagnosis.together import together
from tpmsd.errors import ConfigError
from tpmsd.inference.least_squares import Evidence
from tpmsd.inference.noise_fit import Stage, fit_noise, outliers
from tpmsd.inference.recording import Recording
from tpmsd.physics.model import ExtendedModel
from tpmsd.wheels import FloatArray

SHAPES = 3
"""Free shapes that are taken out before the noise is first estimated."""

__all__ = ["diagnose", "diagnose_against", "first_noise"]


@dataclass(frozen=True)
class Certification:
    """How findings are to be certified."""

    replicates: int
    """At most."""
    rng: np.random.Generator


def diagnose(
    recordings: Sequence[Recording],
    progress: Callable[[float], None] = lambda share: None,
    certify: Certification | None = None,
) -> Diagnosis:
    """Diagnose the drives of one car together; findings get p-values where a certificate is asked for.

    ConfigError where the drives' configurations describe different cars.
    """
    readers, notes = admitted(recordings)
    if not readers:
        return insufficient(notes)
    study = Study(readers)
    progress(0.2)
    selection, evidence = examine(study, progress)
    diagnosis = report(study, selection, evidence, notes)
    if certify is not None:
        diagnosis = certified(study, selection, evidence, diagnosis, certify.replicates, certify.rng)
    progress(1.0)
    return diagnosis


def diagnose_against(
    recording: Recording, simulation: Recording, progress: Callable[[float], None] = lambda share: None
) -> Diagnosis:
    """What a recording holds that the user's own simulation of the same drive does not.

    ConfigError where the two are of different cars or roads, or the simulation is of no use.
    """
    readers, notes = against(recording, simulation)
    if not readers:
        return insufficient(notes)
    study = Study(readers, simulation=True)
    progress(0.2)
    selection, evidence = examine(study, progress)
    selection, evidence = differences(study, selection, evidence)
    progress(1.0)
    return report(study, selection, evidence, notes)


def told_by(recording: Recording) -> tuple[Telling, ...]:
    """What a drive could tell of each effect at its usual size; ConfigError where it cannot be examined."""
    readers, notes = admitted([recording])
    if not readers:
        raise ConfigError("; ".join(notes))
    study = Study(readers)
    _estimate_noise(study, study.hypotheses.everything, Stage.FIRST)
    return tellings(study)


def examine(study: Study, progress: Callable[[float], None]) -> tuple[Selection, Evidence]:
    """Choose terms and estimate the noise in turn."""
    design = study.hypotheses.everything
    for stage in (Stage.FIRST, Stage.SECOND):
        _estimate_noise(study, design, stage)
        evidence = study.evidence()
        if stage is Stage.FIRST:
            evidence = _without_shapes(study, design, evidence)
        progress(0.35 + 0.25 * stage.value)
        # What is clearest first and exactly: a pulse half a minute off leaves more than a faint effect.
        for most in (1, MAX_TERMS):
            selection = Selector(evidence, study.hypotheses).select(most)
            if refine(study, selection, evidence, again=most == 1):
                evidence = study.evidence()
                selection = Selector(evidence, study.hypotheses).select(most)
        for drive in study.drives:
            white = drive.residual(selection.fit.design, selection.fit.values)
            drive.inflate = outliers(white, drive.blocks, drive.inflate)
        design = selection.fit.design
        relinearise(study, selection)
    _estimate_noise(study, design, Stage.LAST)
    evidence = study.evidence()
    chosen = Selector(evidence, study.hypotheses, last=True).select()
    found = together(study, *confirmed(study, chosen, evidence), chosen)
    return drifting(study, *found)


def _without_shapes(study: Study, design: FloatArray, evidence: Evidence) -> Evidence:
    """Estimate the first noise once more with the free shapes in the model that the drive shows plainly.

    What no effect of the catalogue holds would pass for noise, and noise of that size would hide its shape.
    """
    for _ in range(SHAPES):
        term = plainest_shape(study, evidence, design)
        if term is None:
            break
        design = np.concatenate([widened(design, study.hypotheses.width), term.design], axis=1)
        _estimate_noise(study, design, Stage.FIRST)
        evidence = study.evidence()
    return evidence


def _estimate_noise(study: Study, design: FloatArray, stage: Stage) -> None:
    for drive in study.drives:
        windows = drive.reader.windows
        drive.noise = fit_noise(windows, drive.believed(design), drive.noise, stage, drive.inflate)
    if study.simulation:
        recorded, simulated = study.drives
        simulated.noise = floored(simulated.noise, recorded.noise)


def insufficient(notes: Sequence[str]) -> Diagnosis:
    """The answer where there is nothing to go by."""
    return Diagnosis(
        verdict=INSUFFICIENT,
        reason="; ".join(notes) if notes else "no drive",
        findings=(),
        driving_s=0.0,
        baseline_rms=float("nan"),
        baseline_loglik_per_s=float("nan"),
        model_rms=float("nan"),
        unexplained=None,
        model=ExtendedModel(),
    )
