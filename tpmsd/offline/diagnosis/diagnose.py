"""The diagnosis of drives, from recordings to findings.

In: `Recording`s of one car. Out: `RollingDiagnosis`. Pure: the same recordings give the same answer.

1. `prepared`: smooth each recording's own motion, predict all channels by the rolling model, and take the
   responses of all `hypotheses`.
2. `stages`: estimate the noise, choose terms, refine what enters nonlinearly, look again under other noise.
3. `reporting`: findings, and with a certificate their p-values.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.diagnosis.assessment.identifiability import EffectIdentifiability, identifiability
from tpmsd.offline.diagnosis.assessment.result import INSUFFICIENT, RollingDiagnosis
from tpmsd.offline.diagnosis.assessment.simulated import select_differences
from tpmsd.offline.diagnosis.prepared.admission import (
    admitted_readers,
    readers_against_simulation,
    unfit_reason,
)
from tpmsd.offline.diagnosis.prepared.drive_regression import initial_noise
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.proposal.search import proposals
from tpmsd.offline.diagnosis.reporting.findings import report
from tpmsd.offline.diagnosis.reporting.with_known import with_known
from tpmsd.offline.diagnosis.robustness.certify import certified
from tpmsd.offline.diagnosis.stages import examine, with_estimated_noise
from tpmsd.offline.inference.known_effects import without_effects
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.noise_fit import SearchStage
from tpmsd.offline.inference.recording import Recording

__all__ = ["diagnose", "diagnose_against", "initial_noise"]


@dataclass(frozen=True)
class Certification:
    """Options of the certificate."""

    replicates: int
    """At most."""
    rng: np.random.Generator


def diagnose(
    recordings: Sequence[Recording],
    progress: Callable[[float], None] = lambda share: None,
    certify: Certification | None = None,
    propose: bool = False,
    known: ExtendedModel | None = None,
) -> RollingDiagnosis:
    """Diagnose the drives of one car together; findings get p-values where a certificate is asked for.

    With `propose` the closed forms are looked for that suit what has no name. Effects that are `known` are
    part of the baseline model: what they explain is no finding, and the model of the answer holds them.

    ConfigError where the drives' configurations describe different cars.
    """
    if known is not None and len(known):
        rest = [one if unfit_reason(one) else without_effects(one, known) for one in recordings]
        return with_known(known, diagnose(rest, progress, certify, propose))
    readers, notes = admitted_readers(recordings)
    if not readers:
        return insufficient(notes)
    regression, selection, evidence = examine(Regression(readers), progress)
    diagnosis = report(regression, selection, evidence, notes)
    if certify is not None:
        diagnosis = certified(regression, selection, evidence, diagnosis, certify.replicates, certify.rng)
    if propose:
        diagnosis = replace(diagnosis, proposals=proposals(regression, selection))
    progress(1.0)
    return diagnosis


def diagnose_against(
    recording: Recording,
    simulation: Recording,
    progress: Callable[[float], None] = lambda share: None,
    propose: bool = False,
) -> RollingDiagnosis:
    """Return what a recording holds that the user's own simulation of the same drive does not.

    With `propose` the closed forms are looked for that suit what has no name.

    ConfigError where the two are of different cars or roads, or the simulation is of no use.
    """
    readers, notes = readers_against_simulation(recording, simulation)
    if not readers:
        return insufficient(notes)
    regression, selection, evidence = examine(Regression(readers, simulation=True), progress)
    selection, evidence = select_differences(regression, selection, evidence)
    diagnosis = report(regression, selection, evidence, notes)
    if propose:
        diagnosis = replace(diagnosis, proposals=proposals(regression, selection))
    progress(1.0)
    return diagnosis


def identifiability_on(recording: Recording) -> tuple[EffectIdentifiability, ...]:
    """Return the identifiability of each effect at its typical size on a drive; ConfigError where it cannot
    be examined."""
    readers, notes = admitted_readers([recording])
    if not readers:
        raise ConfigError("; ".join(notes))
    regression = Regression(readers)
    return identifiability(
        with_estimated_noise(regression, regression.hypotheses.fullest_design, SearchStage.FIRST)
    )


def noise_of(recording: Recording) -> Noise:
    """Return the noise of a drive's instruments and road; ConfigError where it cannot be examined."""
    readers, notes = admitted_readers([recording])
    if not readers:
        raise ConfigError("; ".join(notes))
    regression = Regression(readers)
    return (
        with_estimated_noise(regression, regression.hypotheses.fullest_design, SearchStage.FIRST)
        .drives[0]
        .noise
    )


def insufficient(notes: Sequence[str]) -> RollingDiagnosis:
    """Return the diagnosis of insufficient data; its reason is the notes."""
    return RollingDiagnosis(
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
