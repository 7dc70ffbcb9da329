"""A certificate for each finding: how often a drive without it would show as much.

In: a `Regression`, its `Selection`, the `RollingDiagnosis` made of them. Out: the diagnosis with a `p_value`
for each finding, and the findings that are not sure enough as suspicions.

Parametric bootstrap through the whole analysis (Davison and Hinkley, Bootstrap Methods and their Application,
1997, section 4.2): replicates of the recordings are drawn from the fitted model with all findings in it,
smoothed, linearised and whitened as the recordings were. The null hypothesis of one finding holds all
others: its own response is taken out of the replicate again. The statistic is the penalised gain of a
finding; its null distribution is that of the largest penalised gain among all alternatives that were tried,
so that their number is accounted for (Westfall and Young, Resampling-Based Multiple Testing, 1993). What
residual and covariates share by the reference motion, a replicate shares as well.

A replicate holds all that the model says and no more, and a recording does: slow errors that no state holds,
bursts. So the recording's gains are studentised: divided by the block-wise (sandwich) variance ratio of the
term, which hardly depends on such noise (Hall and Wilson, Biometrics 47, 1991). A replicate is one block and
has a ratio of 1, which errs on the safe side. A finding's own gain is also divided by the dispersion that
the model leaves on held-out stretches, as in a quasi-likelihood (McCullagh and Nelder, Generalized Linear
Models, 1989, chapter 9), where that is larger.

Counters, rings and events at low speed have statistics of their own, and the same replicates: each replicate
is searched for them as the recording was. What replicates do not draw, a sensor's reading, keeps the
probability of its own test.

The model is linear about the effects of the catalogue, and not about spline terms: what a plain spline does
beyond its linear response is hundreds of nats, for any effect to take up. Where replicates that hold one
reach a term, the term is tested again in replicates without spline terms.

Drawing stops early (Besag and Clifford, Biometrika 78, 1991) once every finding was exceeded several times,
or is beyond doubt. `estimate_p_value` makes p-values of the replicates; `verdict` decides: findings are
those that stand at a false discovery rate of 1 % (Benjamini and Hochberg, Journal of the Royal Statistical
Society B 57, 1995) and gain more than the negative control. A suspicion stays one: a term whose
log-likelihood gain, divided by the block-wise (sandwich) variance ratio, falls below the penalty.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.catalogue import make_effect
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.lost_counts import (
    LOW_SPEED,
    RHYTHM,
    SINGLY,
    low_speed_losses_of_drives,
    single_losses_of,
)
from tpmsd.offline.diagnosis.assessment.result import FINDING, Finding, Remaining, RollingDiagnosis
from tpmsd.offline.diagnosis.assessment.teeth import RING
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.robustness.negative_control import negative_control
from tpmsd.offline.diagnosis.robustness.p_value import PValue, count_reaching, estimate_p_value, is_decided
from tpmsd.offline.diagnosis.robustness.verdict import with_decisions
from tpmsd.offline.diagnosis.selection.candidates import Candidates
from tpmsd.offline.diagnosis.selection.catalogue_effect import effect_of
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.selection.empirical import empirical_effect
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence
from tpmsd.offline.inference.replicate import replicate
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.rings.missed import missed_counts
from tpmsd.offline.rings.uneven_teeth import ripples


@dataclass(frozen=True)
class Statistic:
    """The test statistic of one finding."""

    value: float
    """Its penalised gain, nats."""
    largest: Callable[[Replicate], float]
    """Statistics of one replicate: the largest penalised gain of all alternatives."""
    own: float = 0.0
    """Probability by the test's own distribution; 0 without one."""


@dataclass(frozen=True)
class Replicate:
    """All drives, drawn again."""

    evidence: Evidence
    drives: tuple[DriveRegression, ...]


def certified(
    regression: Regression,
    selection: Selection,
    evidence: Evidence,
    diagnosis: RollingDiagnosis,
    replicates: int,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda share: None,
) -> RollingDiagnosis:
    """Return the diagnosis with p-values from at most so many replicates."""
    if replicates < 1 or regression.simulation:
        return diagnosis
    dispersion = max(diagnosis.model_rms**2, 1.0)
    statistics = [
        _statistic_of(regression, selection, evidence, one, dispersion) for one in diagnosis.findings
    ]
    statistics.append(_statistic_of_rest(regression, selection, evidence))
    models = [_model_of_drive(regression, selection, number) for number in range(len(regression.drives))]
    drawn = _statistics_of_replicates(regression, models, statistics, replicates, rng, progress)
    *p_values, of_the_rest = [
        estimate_p_value(one.value, values, one.own) for one, values in zip(statistics, drawn, strict=True)
    ]
    rest = statistics.pop()
    again = _p_values_without_splines(
        regression, selection, evidence, diagnosis.findings, p_values, dispersion, replicates, rng
    )
    control = negative_control(regression, selection)
    return replace(
        with_decisions(
            diagnosis,
            [again.get(k, one) for k, one in enumerate(p_values)],
            [one.value > control for one in statistics],
        ),
        replicates=len(drawn[0]),
        remaining=Remaining(
            rest.value, of_the_rest.p_value, count_reaching(rest.value, drawn[-1]), len(drawn[-1])
        ),
        control=control if math.isfinite(control) else None,
    )


def _statistics_of_replicates(
    regression: Regression,
    models: Sequence[ExtendedModel],
    statistics: Sequence[Statistic],
    replicates: int,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda share: None,
) -> list[list[float]]:
    """Return, for each statistic, its largest values in replicates, drawn until every decision is settled."""
    drawn: list[list[float]] = [[] for _ in statistics]
    for number in range(replicates):
        again = _draw_replicate(regression, models, rng)
        for values, one in zip(drawn, statistics, strict=True):
            values.append(one.largest(again))
        progress((number + 1) / replicates)
        if all(is_decided(one.value, values) for one, values in zip(statistics, drawn, strict=True)):
            break
    return drawn


def _p_values_without_splines(
    regression: Regression,
    selection: Selection,
    evidence: Evidence,
    findings: Sequence[Finding],
    p_values: Sequence[PValue],
    dispersion: float,
    replicates: int,
    rng: np.random.Generator,
) -> dict[int, PValue]:
    """Return p-values without splines for findings whose p-value with them is not small, by their number.

    Replicates with spline terms exceed a true effect beside them: these are drawn without.
    """
    if not any(one.term.nonparametric for one in selection.chosen):
        return {}
    asked: list[tuple[int, int]] = []
    for k, (finding, one) in enumerate(zip(findings, p_values, strict=True)):
        which = _chosen_index(selection, finding)
        reached = one.tail > SETTINGS.robustness.false_discovery_rate and finding.status == FINDING
        if which is not None and reached:
            asked.append((k, which))
    if not asked:
        return {}
    statistics = [
        _statistic_of_term(
            regression,
            selection,
            evidence,
            which,
            dispersion,
            acts=not selection.chosen[which].term.nonparametric,
        )
        for _, which in asked
    ]
    models = [
        _model_of_drive(regression, selection, number, splines=False)
        for number in range(len(regression.drives))
    ]
    drawn = _statistics_of_replicates(regression, models, statistics, replicates, rng)
    return {
        k: estimate_p_value(one.value, values)
        for (k, _), one, values in zip(asked, statistics, drawn, strict=True)
    }


def _chosen_index(selection: Selection, finding: Finding) -> int | None:
    """Return the index of the chosen term that a finding reports; None for a finding from elsewhere."""
    for k, one in enumerate(selection.chosen):
        if one.term.effect == finding.effect and one.heldout_gain == finding.gain:
            return k
    return None


def _draw_replicate(
    regression: Regression, models: Sequence[ExtendedModel], rng: np.random.Generator
) -> Replicate:
    """Return a replicate of all drives, simulated with their models and noises."""
    recordings = [
        replicate(drive.reader, model, drive.noise, rng)
        for drive, model in zip(regression.drives, models, strict=True)
    ]
    drives = [
        drive.of_replicate(one, model)
        for drive, one, model in zip(regression.drives, recordings, models, strict=True)
    ]
    return Replicate(Evidence([drive.drive_grams() for drive in drives], regression.width), tuple(drives))


def _model_of_drive(
    regression: Regression, selection: Selection, drive: int, splines: bool = True
) -> ExtendedModel:
    """Return the chosen terms that act in one drive as a model; `splines`: with the spline terms."""
    effects: list[Effect] = []
    for one in selection.chosen:
        if (
            drive not in regression.acting_drives(one.term)
            or one.term.calibrates
            or (one.term.nonparametric and not splines)
        ):
            continue
        if one.term.nonparametric:
            effects.append(empirical_effect(one, regression.knots(one.term))[0])
        else:
            effects.append(_acting_effect(one)[0])
    return ExtendedModel(tuple(effects))


def _acting_effect(one: Chosen) -> tuple[Effect, FloatArray]:
    """Return an effect as it acts in replicates, and the values (k,) by which its columns say the same.

    One without parameters acts in full, whatever share of it fits best.
    """
    made = effect_of(one.term, one.values)
    return made if made is not None else (make_effect(one.term.effect), np.ones(1))


def _statistic_of(
    regression: Regression, selection: Selection, evidence: Evidence, finding: Finding, dispersion: float
) -> Statistic:
    """Return the test statistic of a finding."""
    own = finding.own_chance or 0.0
    largest = _largest_gain_by_search(selection).get(finding.found_by)
    if largest is not None:
        return Statistic(finding.gain, largest, own)
    which = _chosen_index(selection, finding)
    if which is None:  # a sensor's reading, which replicates do not draw
        return Statistic(finding.gain, lambda again: 0.0, own)
    return _statistic_of_term(regression, selection, evidence, which, dispersion)


def _largest_gain_by_search(selection: Selection) -> dict[str, Callable[[Replicate], float]]:
    """Return, by the name of a separate search, the function that gives its largest gain in a replicate; 0
    where it finds nothing."""

    def singly(again: Replicate) -> float:
        fit = again.evidence.fit(selection.fit.design)
        found = [single_losses_of(drive, fit) for drive in again.drives]
        return max((one.gain + one.unlike for one in found if one is not None), default=0.0)

    return {
        LOW_SPEED: lambda again: max(
            (one.gain for one in low_speed_losses_of_drives(again.drives)), default=0.0
        ),
        RHYTHM: lambda again: max(
            (
                one.gain
                for drive in again.drives
                for one in missed_counts(drive.reader.recording, drive.reader.reference)
            ),
            default=0.0,
        ),
        SINGLY: singly,
        RING: lambda again: max(
            (
                one.gain
                for drive in again.drives
                for one in ripples(drive.reader.recording, reference(drive.reader.recording))
            ),
            default=0.0,
        ),
    }


def _statistic_of_rest(regression: Regression, selection: Selection, evidence: Evidence) -> Statistic:
    """Return the largest penalised gain of any further term as a statistic."""
    terms = [one.term for one in selection.chosen]

    def largest(of: Evidence) -> float:
        return _largest_gain(Candidates(of, regression.hypotheses), terms)

    return Statistic(largest(evidence), lambda again: largest(again.evidence))


def _statistic_of_term(
    regression: Regression,
    selection: Selection,
    evidence: Evidence,
    which: int,
    dispersion: float,
    acts: bool = True,
) -> Statistic:
    """Return the gain of a chosen term; `acts`: whether replicates hold it, so that it has to be taken out of
    them.
    """
    terms = [one.term for one in selection.chosen]
    rest = terms[:which] + terms[which + 1 :]
    one = selection.chosen[which]
    search = Candidates(evidence, regression.hypotheses)
    penalised_gain = search.penalised_gain(one.term, one.gain, float(one.values[0]))
    value = min(
        search.studentised_gain(rest, one.term, penalised_gain),
        (penalised_gain + one.term.penalty) / dispersion - one.term.penalty,
    )
    response = (
        acts
        * one.term.design
        @ (one.values if one.term.nonparametric or one.term.calibrates else _acting_effect(one)[1])
    )

    def largest(again: Replicate) -> float:
        return _largest_gain(Candidates(again.evidence.less(response), regression.hypotheses), rest)

    return Statistic(value, largest)


def _largest_gain(search: Candidates, rest: list[Term]) -> float:
    """Return the largest penalised gain of a term that could be a finding, studentised by its blocks.

    Calibration is left out, and so are effects of which every instrument has small values.
    """
    largest = -math.inf
    for penalised_gain, (term, *_) in search.candidates(rest):
        if penalised_gain <= largest:  # no ratio is below one
            break
        if not term.calibrates and term.kind_of.penalty(0.0) >= 0.0:
            largest = max(largest, search.studentised_gain(rest, term, penalised_gain))
    return largest
