"""A certificate for each finding: how often a drive without it would show as much.

In: a `Study`, its `Selection`, the `Diagnosis` made of them. Out: the diagnosis with a `p_value` for each
finding, and the findings that are not sure enough as suspicions.

Parametric bootstrap through the whole analysis (Davison and Hinkley, Bootstrap Methods and their Application,
1997, section 4.2): replicates of the recordings are drawn from the fitted model with all findings in it,
smoothed, linearised and whitened as the recordings were. The null hypothesis of one finding holds all
others: its own response is taken out of the replicate again. The statistic is the penalised gain of a
finding; its null distribution is that of the largest penalised gain among all alternatives that were tried,
so that their number is accounted for (Westfall and Young, Resampling-Based Multiple Testing, 1993). What
residual and covariates share by the reference motion, a replicate shares as well.

A replicate holds all that the model says and no more, and a recording does: slow errors that no state holds,
bursts. So gains are studentised, in recording and replicates alike: divided by the block-wise (sandwich)
variance ratio of the term, which hardly depends on such noise (Hall and Wilson, Biometrics 47, 1991). A
finding's own gain is also divided by the dispersion that the model leaves on held-out stretches, as in a
quasi-likelihood (McCullagh and Nelder, Generalized Linear Models, 1989, chapter 9), where that is larger.

Drawing stops early (Besag and Clifford, Biometrika 78, 1991) once every finding was exceeded several times,
or is beyond doubt. Where no replicate reaches a finding, its p-value is that of the Gumbel distribution of
the replicates' maxima (as Knijnenburg et al., Bioinformatics 25, 2009, extend the tail of permutations).
Findings are those that stand at a false discovery rate of 1 % (Benjamini and Hochberg, Journal of the Royal
Statistical Society B 57, 1995) and gain more than the negative control. A suspicion stays one: a term whose
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
from tpmsd.offline.diagnosis.assessment.result import (
    CONSISTENT,
    FINDING,
    MISMATCH,
    SUSPICION,
    Diagnosis,
    Finding,
    Remaining,
)
from tpmsd.offline.diagnosis.counters.tone_ring import ripples
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.study import Study
from tpmsd.offline.diagnosis.robustness.negative_control import negative_control
from tpmsd.offline.diagnosis.selection.candidates import Candidates
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.selection.described import effect_of
from tpmsd.offline.diagnosis.selection.empirical import empirical_effect
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.replicate import replicate
from tpmsd.offline.inference.trajectory import reference


@dataclass(frozen=True)
class Statistic:
    """The test statistic of one finding."""

    value: float
    """Its penalised gain, nats."""
    largest: Callable[[Replicate], float]
    """Of one replicate, the largest penalised gain of all alternatives."""


@dataclass(frozen=True)
class Replicate:
    """All drives, drawn again."""

    evidence: Evidence
    recordings: tuple[Recording, ...]


def certified(
    study: Study,
    selection: Selection,
    evidence: Evidence,
    diagnosis: Diagnosis,
    replicates: int,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda share: None,
) -> Diagnosis:
    """The diagnosis with p-values from at most so many replicates."""
    if replicates < 1 or study.simulation:
        return diagnosis
    dispersion = max(diagnosis.model_rms**2, 1.0)
    statistics = [_statistic(study, selection, evidence, one, dispersion) for one in diagnosis.findings]
    statistics.append(_of_the_rest(study, selection, evidence))
    models = [_model(study, selection, number) for number in range(len(study.drives))]
    drawn = _drawn(study, models, statistics, replicates, rng, progress)
    *p_values, of_the_rest = [
        p_value(one.value, values) for one, values in zip(statistics, drawn, strict=True)
    ]
    rest = statistics.pop()
    for k, finding in enumerate(diagnosis.findings):
        if p_values[k] > SETTINGS.robustness.false_discovery_rate and finding.status == FINDING:
            p_values[k] = _without_it(
                study, selection, evidence, finding, dispersion, replicates, rng, p_values[k]
            )
    p_values = [
        drawn_p if finding.p_value is None else finding.p_value
        for finding, drawn_p in zip(diagnosis.findings, p_values, strict=True)
    ]
    control = negative_control(study, selection)
    certain = discoveries(p_values, SETTINGS.robustness.false_discovery_rate)
    stand = [
        sure and one.value > control and finding.status == FINDING
        for sure, one, finding in zip(certain, statistics, diagnosis.findings, strict=True)
    ]
    findings = tuple(
        replace(finding, p_value=p, status=FINDING if stands else SUSPICION)
        for finding, p, stands in zip(diagnosis.findings, p_values, stand, strict=True)
    )
    return replace(
        diagnosis,
        findings=findings,
        verdict=MISMATCH if any(stand) else CONSISTENT,
        model=without(diagnosis.model, findings),
        replicates=len(drawn[0]),
        remaining=Remaining(rest.value, of_the_rest, beyond(rest.value, drawn[-1]), len(drawn[-1])),
        control=control if math.isfinite(control) else None,
    )


def _drawn(
    study: Study,
    models: Sequence[ExtendedModel],
    statistics: Sequence[Statistic],
    replicates: int,
    rng: np.random.Generator,
    progress: Callable[[float], None] = lambda share: None,
) -> list[list[float]]:
    """Of each statistic, its largest values in replicates, drawn until all is decided."""
    drawn: list[list[float]] = [[] for _ in statistics]
    for number in range(replicates):
        again = _again(study, models, rng)
        for values, one in zip(drawn, statistics, strict=True):
            values.append(one.largest(again))
        progress((number + 1) / replicates)
        if all(_decided(one.value, values) for one, values in zip(statistics, drawn, strict=True)):
            break
    return drawn


def _without_it(
    study: Study,
    selection: Selection,
    evidence: Evidence,
    finding: Finding,
    dispersion: float,
    replicates: int,
    rng: np.random.Generator,
    p_value_so_far: float,
) -> float:
    """The p-value of a spline term by replicates in which it does not act.

    The model is linear about the effects of the catalogue, and not about spline terms. So taking a spline's
    linear response out of a replicate leaves the rest of what it does, hundreds of nats of a plain one. What
    is left passes for chance; a drawing without the term has none of it.
    """
    which = _of(selection, finding)
    if which is None or not selection.chosen[which].term.free:
        return p_value_so_far
    one = _of_term(study, selection, evidence, which, dispersion, acts=False)
    models = [_model(study, selection, number, but=which) for number in range(len(study.drives))]
    (values,) = _drawn(study, models, [one], replicates, rng)
    return p_value(one.value, values)


def without(model: ExtendedModel, findings: Sequence[Finding]) -> ExtendedModel:
    """The model less the effects of which suspicions tell."""
    doubtful = [finding for finding in findings if finding.status != FINDING]
    stay = [
        k for k, effect in enumerate(model.effects) if not any(_tells_of(one, effect) for one in doubtful)
    ]
    return ExtendedModel(tuple(model.effects[k] for k in stay), tuple(model.stds[k] for k in stay))


def _tells_of(finding: Finding, effect: Effect) -> bool:
    """Whether a finding and an effect are of one name, with the same values (of a spline term, knots)."""
    if effect.name != finding.effect:
        return False
    if finding.shape:
        return tuple(at for at, _, _ in finding.shape) == tuple(getattr(effect, "knots", ()))
    for name, quantity in finding.parameters.items():
        value = getattr(effect, name)
        if isinstance(quantity.value, str) or isinstance(value, str):
            if str(value) != str(quantity.value):
                return False
        elif not math.isclose(float(value), quantity.value, rel_tol=1e-6, abs_tol=1e-12):
            return False
    return True


def _of(selection: Selection, finding: Finding) -> int | None:
    """Number of the chosen term of which a finding tells; None of one that comes from elsewhere."""
    for k, one in enumerate(selection.chosen):
        if one.term.effect == finding.effect and one.heldout_gain == finding.gain:
            return k
    return None


def p_value(value: float, maxima: Sequence[float]) -> float:
    """Probability that chance makes as much, from the maxima of replicates.

    By counting where some of them reach the value; else by the tail of their Gumbel distribution, whose scale
    is raised by the doubt of so few.
    """
    count = len(maxima)
    exceeded = beyond(value, maxima)
    if exceeded:
        return exceeded / count if exceeded >= SETTINGS.robustness.exceeded else (exceeded + 1) / (count + 1)
    spread = float(np.std(maxima, ddof=1)) if count > 1 else 0.0
    scale = max(math.sqrt(6.0) / math.pi * spread, SETTINGS.robustness.least_scale_nats) * (
        1.0 + 2.0 / math.sqrt(count)
    )
    middle = float(np.mean(maxima)) - np.euler_gamma * scale
    tail = -math.expm1(-math.exp(-(value - middle) / scale))
    return min(max(tail, SETTINGS.robustness.least_p), 1.0 / (count + 1))


def beyond(value: float, maxima: Sequence[float]) -> int:
    """How many of the maxima reach the value."""
    return sum(one >= value for one in maxima)


def discoveries(p_values: Sequence[float], rate: float) -> list[bool]:
    """Which hypotheses are rejected at a false discovery rate: all up to the largest p-value that is no more
    than its rank's share of the rate (Benjamini and Hochberg 1995)."""
    order = sorted(range(len(p_values)), key=lambda k: p_values[k])
    last = 0
    for rank, k in enumerate(order, 1):
        if p_values[k] <= rate * rank / len(p_values):
            last = rank
    kept = set(order[:last])
    return [k in kept for k in range(len(p_values))]


def _decided(value: float, maxima: Sequence[float]) -> bool:
    if beyond(value, maxima) >= SETTINGS.robustness.exceeded:
        return True
    return (
        len(maxima) >= SETTINGS.robustness.fewest_replicates
        and p_value(value, maxima) < SETTINGS.robustness.beyond_doubt
    )


def _again(study: Study, models: Sequence[ExtendedModel], rng: np.random.Generator) -> Replicate:
    recordings = [
        replicate(drive.reader, model, drive.noise, rng)
        for drive, model in zip(study.drives, models, strict=True)
    ]
    drives = [
        drive.repeated(one, model) for drive, one, model in zip(study.drives, recordings, models, strict=True)
    ]
    return Replicate(Evidence([drive.part() for drive in drives], study.width), tuple(recordings))


def _model(study: Study, selection: Selection, drive: int, but: int | None = None) -> ExtendedModel:
    """All that was chosen, as it acts in one drive; without number `but` of them."""
    effects: list[Effect] = []
    for number, one in enumerate(selection.chosen):
        if number == but or drive not in study.acting(one.term) or one.term.calibrates:
            continue
        if one.term.free:
            effects.append(empirical_effect(one, study.knots(one.term))[0])
        else:
            effects.append(_acting(one)[0])
    return ExtendedModel(tuple(effects))


def _acting(one: Chosen) -> tuple[Effect, FloatArray]:
    """An effect as it acts in replicates, and the values (k,) by which its columns say the same.

    One without parameters acts in full, whatever share of it fits best.
    """
    made = effect_of(one.term, one.values)
    return made if made is not None else (make_effect(one.term.effect), np.ones(1))


def _statistic(
    study: Study, selection: Selection, evidence: Evidence, finding: Finding, dispersion: float
) -> Statistic:
    if finding.p_value is not None:  # what it was found in is not drawn again
        return Statistic(finding.gain, lambda again: 0.0)
    which = _of(selection, finding)
    if which is None:
        return Statistic(finding.gain, _largest_ripple)
    return _of_term(study, selection, evidence, which, dispersion)


def _of_the_rest(study: Study, selection: Selection, evidence: Evidence) -> Statistic:
    """Of all alternatives to adding nothing to what was chosen."""
    terms = [one.term for one in selection.chosen]

    def largest(of: Evidence) -> float:
        return _largest_gain(Candidates(of, study.hypotheses), terms)

    return Statistic(largest(evidence), lambda again: largest(again.evidence))


def _largest_ripple(again: Replicate) -> float:
    """Of uneven teeth, whose evidence is not among the columns."""
    gains = [one.gain for drive in again.recordings for one in ripples(drive, reference(drive))]
    return max(gains, default=0.0)


def _of_term(
    study: Study,
    selection: Selection,
    evidence: Evidence,
    which: int,
    dispersion: float,
    acts: bool = True,
) -> Statistic:
    """Of a chosen term; `acts`: whether replicates hold it, so that it has to be taken out of them."""
    terms = [one.term for one in selection.chosen]
    rest = terms[:which] + terms[which + 1 :]
    one = selection.chosen[which]
    search = Candidates(evidence, study.hypotheses)
    net = search.net(one.term, one.gain, float(one.values[0]))
    value = min(
        search.studentised(rest, one.term, net), (net + one.term.penalty) / dispersion - one.term.penalty
    )
    response = (
        acts * one.term.design @ (one.values if one.term.free or one.term.calibrates else _acting(one)[1])
    )

    def largest(again: Replicate) -> float:
        return _largest_gain(Candidates(again.evidence.less(response), study.hypotheses), rest)

    return Statistic(value, largest)


def _largest_gain(search: Candidates, rest: list[Term]) -> float:
    """Studentised, of what could be a finding: no calibration, and nothing whose small values every
    instrument has."""
    largest = -math.inf
    for net, (term, *_) in search.candidates(rest):
        if net <= largest:  # no ratio is below one
            break
        if not term.calibrates and term.kind_of.against(0.0) >= 0.0:
            largest = max(largest, search.studentised(rest, term, net))
    return largest
