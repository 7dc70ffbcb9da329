"""From chosen terms to findings that a reader understands.

In: a `Regression` and its `Selection`. Out: `RollingDiagnosis`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tpmsd.car.physics.catalogue import FAULT, make_effect, parameters_of
from tpmsd.car.physics.effect import Effect, Parameter, Std
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.diagnosis.assessment.explanatory import slip_gains
from tpmsd.offline.diagnosis.assessment.identifiability import separating_manoeuvre
from tpmsd.offline.diagnosis.assessment.lost_counts import (
    low_speed_loss_findings,
    missed_count_findings,
    single_count_findings,
)
from tpmsd.offline.diagnosis.assessment.reach import WhitenedColumns, assess_reach
from tpmsd.offline.diagnosis.assessment.result import (
    Finding,
    PictureData,
    Quantity,
    RadiusDrift,
    RollingDiagnosis,
    Where,
)
from tpmsd.offline.diagnosis.assessment.simulated import (
    EffectDifference,
    effect_differences,
    recorded_terms,
    simulated_effects,
)
from tpmsd.offline.diagnosis.assessment.tangent import nonlinear_stds
from tpmsd.offline.diagnosis.assessment.teeth import ordinary_ring_note, tooth_findings
from tpmsd.offline.diagnosis.hypotheses.group_gain import group_gain
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.reporting.detectable import not_detectable
from tpmsd.offline.diagnosis.reporting.down_weighted import down_weighted
from tpmsd.offline.diagnosis.reporting.information import speed_ranges
from tpmsd.offline.diagnosis.reporting.location import where_of, whole_range
from tpmsd.offline.diagnosis.reporting.traces import drive_map, traces
from tpmsd.offline.diagnosis.robustness.verdict import status_of, verdict_of, without_suspicions
from tpmsd.offline.diagnosis.selection.catalogue_effect import (
    neutral_of,
    nonlinear_parameters_of,
    text_parameters_of,
    tolerance_note,
)
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.diagnosis.selection.empirical import empirical_effect, shape_of
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.sensors.unusual import unusual
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence
from tpmsd.offline.inference.trajectory import WINDOW_S
from tpmsd.offline.inference.windows import CHANNEL_NAMES


def report(
    regression: Regression, selection: Selection, evidence: Evidence, notes: tuple[str, ...] = ()
) -> RollingDiagnosis:
    """Return the diagnosis of a selection; `notes` are what the reader must know of what was left out."""
    seconds = regression.driving_s
    rows = sum(int(np.isfinite(drive.reader.windows.measured).sum()) for drive in regression.examined)
    blocks = slice(0, sum(part.blocks for part in evidence.parts[: len(regression.examined)]))
    terms = [one.term for one in selection.chosen]
    selector = Selector(evidence, regression.hypotheses)
    whole = float(selection.heldout[blocks].sum())
    written = _ReportParts(
        list(notes), nonlinear_stds(regression, selection), effect_differences(regression, selection)
    )
    for k, one in enumerate(selection.chosen):
        if note := tolerance_note(one, regression.has_wheel_speeds_only):
            written.notes.append(note)
        elif status := status_of(one, selection):
            rest = terms[:k] + terms[k + 1 :]
            left_out = float(evidence.heldout(selector.design(rest))[blocks].sum())
            written.add_term(
                regression,
                selection,
                k,
                status,
                (_rms_of_log_likelihood(left_out, rows), _rms_of_log_likelihood(whole, rows)),
            )
    for one in recorded_terms(regression, selection):
        written.add_to_model(regression, one, _parameter_quantities(one, {}))
    # Beside the events: chains on an axle for half of a drive look like a tooth less on the other.
    rings = evidence.fit(selector.design([term for term in terms if term.pulse]))
    for finding in [
        *_separate_findings(regression, selection, written.findings),
        *tooth_findings(regression, rings, seconds),
    ]:
        if note := ordinary_ring_note(finding, regression.has_wheel_speeds_only):
            written.notes.append(note)
        else:
            written.add_separate_finding(finding)
    findings = written.findings
    baseline = float(selection.baseline_heldout[blocks].sum())
    log_determinant = sum(drive.log_determinant for drive in regression.examined)
    constant = -0.5 * log_determinant - 0.5 * rows * math.log(2 * math.pi)
    return RollingDiagnosis(
        verdict=verdict_of(findings),
        reason="",
        findings=tuple(sorted(findings, key=lambda finding: -finding.gain)),
        driving_s=seconds,
        baseline_rms=_rms_of_log_likelihood(baseline, rows),
        baseline_loglik_per_s=(baseline + constant) / seconds,
        model_rms=_rms_of_log_likelihood(whole, rows),
        unexplained=_unexplained_structure(regression, selector, terms),
        drift=_unusual_radius_drift(regression),
        model=without_suspicions(ExtendedModel(tuple(written.effects), tuple(written.stds)), findings),
        evidence=_gains_alone(regression, selector),
        baseline=("simulation",) if regression.simulation else ("rolling",),
        simulation=simulated_effects(regression, selection),
        notes=tuple(written.notes),
        down_weighted=down_weighted(regression.examined),
        information=speed_ranges(regression.examined),
        explanatory=slip_gains(regression, terms, evidence),
        not_detectable=not_detectable(regression, selection, selector),
        reach=assess_reach(
            [
                WhitenedColumns(
                    drive.white,
                    np.isfinite(drive.reader.windows.measured),
                    drive.blocks,
                    drive.names,
                    drive.own_design(regression.hypotheses.nuisance),
                    drive.own_design(selection.fit.design),
                )
                for drive in regression.drives
            ]
        ),
        inner=PictureData(
            _rms_by_channel(regression, selection, evidence),
            tuple(traces(regression, selection, evidence)),
            drive_map(regression, selection, evidence),
        ),
    )


@dataclass
class _ReportParts:
    """The parts of the report that are written so far."""

    notes: list[str]
    nonlinear: dict[int, dict[str, float]]
    """Standard deviations by term of what enters nonlinearly."""
    versus: list[EffectDifference]
    """Each term against the user's simulation; empty without one."""
    findings: list[Finding] = field(default_factory=list)
    effects: list[Effect] = field(default_factory=list)
    stds: list[Mapping[str, Std]] = field(default_factory=list)

    def add_term(
        self, regression: Regression, selection: Selection, which: int, status: str, rms: tuple[float, float]
    ) -> None:
        """Add a chosen term as a finding, with the held-out residual without it and with it."""
        one, seconds = selection.chosen[which], regression.driving_s
        quantities = _parameter_quantities(
            _with_full_values(regression, selection, which), self.nonlinear.get(which, {})
        )
        versus = self.versus
        self.findings.append(
            Finding(
                effect=one.term.effect,
                confidence=one.confidence,
                parameters=_with_plural_wheel_key(quantities),
                where=where_of(regression, one),
                rms_before=rms[0],
                rms_after=rms[1],
                loglik_gain_per_s=one.heldout_gain / seconds,
                gain=one.heldout_gain,
                indistinguishable_from=one.confounded_with,
                advice=separating_manoeuvre(one.term.effect, one.confounded_with),
                shape=shape_of(one, regression.knots(one.term)) if one.term.nonparametric else (),
                drives=_drive_names(regression, [each.term for each in selection.chosen], one.term),
                held_by=versus[which].by if versus else "",
                simulated=_parameter_quantities(versus[which].simulated, {}) if versus else {},
                status=status,
            )
        )
        if one.term.drive is None:  # the model is the car's, not that of one day
            self.add_to_model(regression, one, quantities)

    def add_to_model(self, regression: Regression, one: Chosen, quantities: dict[str, Quantity]) -> None:
        """Add a term to the effects of the model file."""
        effect, stds = (
            empirical_effect(one, regression.knots(one.term))
            if one.term.nonparametric
            else _bounded_effect(one, quantities)
        )
        self.effects.append(effect)
        self.stds.append(stds)

    def add_separate_finding(self, finding: Finding) -> None:
        """Add a finding that was searched for separately from the terms."""
        self.findings.append(finding)
        if finding.drives:  # the model is the car's
            return
        values = {name: quantity.value for name, quantity in finding.parameters.items()}
        self.effects.append(make_effect(finding.effect, **values))
        self.stds.append(
            {name: q.std for name, q in finding.parameters.items() if q.std is not None and q.std > 0.0}
        )


def _separate_findings(
    regression: Regression, selection: Selection, findings: Sequence[Finding]
) -> list[Finding]:
    """Return findings on lost counts and sensors, looked for apart from the terms; not of a simulation.

    Counts that are lost one by one are not asked for where something else of that name was found.
    """
    if regression.simulation:
        return []
    seconds, readers = regression.driving_s, [drive.reader for drive in regression.examined]
    out = (
        low_speed_loss_findings(regression, seconds)
        + missed_count_findings(regression, seconds)
        + unusual(readers, seconds, regression.has_wheel_speeds_only)
    )
    met = {one.effect for one in [*findings, *out]}
    return out + [
        one for one in single_count_findings(regression, selection.fit, seconds) if one.effect not in met
    ]


def _drive_names(regression: Regression, terms: list[Term], term: Term) -> tuple[str, ...]:
    """Return the names of the drives in which a term acts; empty where it acts in all."""
    if regression.simulation:
        return ()
    names = [drive.reader.recording.name for drive in regression.drives]
    if term.drive is not None:
        return (names[term.drive],)
    apart = {
        other.drive for other in terms if other.effect == term.effect and _may_be_common_to_drives(other)
    } - {None}
    return tuple(name for k, name in enumerate(names) if k not in apart) if apart else ()


def _may_be_common_to_drives(term: Term) -> bool:
    """Return whether a term is an effect of the catalogue whose value may be common to all drives."""
    return not (term.nonparametric or term.kind_of.own_per_drive)


def _with_full_values(regression: Regression, selection: Selection, which: int) -> Chosen:
    """Return a term that is one drive's difference from the others with its full values in that drive."""
    one = selection.chosen[which]
    if one.term.drive is None or regression.simulation or not _may_be_common_to_drives(one.term):
        return one
    widths = [regression.hypotheses.nuisance.shape[1]] + [c.term.design.shape[1] for c in selection.chosen]
    starts = np.cumsum(widths)
    values, stds = one.values.copy(), one.stds.copy()
    covariance = selection.fit.covariance
    for k, other in enumerate(selection.chosen):
        if other.term.effect != one.term.effect or other.term.drive is not None:
            continue
        for i, name in enumerate(one.term.parameters):
            if name in other.term.parameters:
                a, b = int(starts[which]) + i, int(starts[k]) + other.term.parameters.index(name)
                ratio = stds[i] ** 2 / covariance[a, a]
                values[i] += selection.fit.values[b]
                stds[i] = math.sqrt(ratio * (covariance[a, a] + covariance[b, b] + 2 * covariance[a, b]))
    return replace(one, values=values, stds=stds)


def _rms_of_log_likelihood(score: float, rows: int) -> float:
    """Return the root mean square of a whitened residual of `rows` values with this log-likelihood."""
    return math.sqrt(max(-2.0 * score, 0.0) / max(rows, 1))


def _with_plural_wheel_key(quantities: dict[str, Quantity]) -> dict[str, Quantity]:
    """Return the quantities with the key `wheels` where `wheel` names several."""
    wheel = quantities.get("wheel")
    if wheel is None or " " not in str(wheel.value):
        return quantities
    return {"wheels" if name == "wheel" else name: quantity for name, quantity in quantities.items()}


def _parameter_quantities(one: Chosen, nonlinear: dict[str, float]) -> dict[str, Quantity]:
    """Return the parameters of a chosen term with values, standard deviations and units; empty for a
    spline."""
    term = one.term
    if term.nonparametric:
        return {}
    known = parameters_of(term.effect)
    out: dict[str, Quantity] = {}
    for name, word in text_parameters_of(term).items():
        out[name] = Quantity(word, None, "")
    for name, value, std in zip(term.parameters, one.values, one.stds, strict=True):
        if name:
            wider = max(float(std), nonlinear.get(name, 0.0))
            out[name] = Quantity(float(value) + neutral_of(term.effect, name), wider, known[name].unit)
    for name, value in nonlinear_parameters_of(term).items():
        if term.at is not None:
            std = nonlinear.get(name, term.at)
        else:
            std = math.hypot(nonlinear.get(name, SETTINGS.selection.step_s), WINDOW_S)
        out[name] = Quantity(value, std, known[name].unit)
    return out


def _bounded_effect(one: Chosen, quantities: dict[str, Quantity]) -> tuple[Effect, dict[str, float]]:
    """Return the effect for the model file with its values limited to its bounds, and their standard
    deviations."""
    values: dict[str, float | str] = {}
    stds: dict[str, float] = {}
    for name, quantity in quantities.items():
        parameter = parameters_of(one.term.effect)[name]
        if isinstance(parameter, Parameter) and isinstance(quantity.value, float):
            values[name] = min(max(quantity.value, parameter.lower), parameter.upper)
            if quantity.std is not None and math.isfinite(quantity.std):
                stds[name] = quantity.std
        else:
            values[name] = quantity.value
    return make_effect(one.term.effect, **values), stds


def _unexplained_structure(regression: Regression, selector: Selector, terms: list[Term]) -> Where | None:
    """Return the location of structure that is still significant beyond the chosen terms; None without
    any."""
    options = [entry for entry in selector.candidates(terms) if not entry[1][0].calibrates]
    for penalised_gain, found in options[:3]:
        term = found[0]
        ratio = selector.variance_ratio([*terms, term], len(terms))
        gain = (penalised_gain + term.penalty) / ratio - term.penalty
        rest = heldout_gain_of_term(selector, terms, term)
        if gain > 2 * SETTINGS.selection.admit_nats and rest > SETTINGS.selection.admit_nats:
            return whole_range(regression, term)
    return None


def _unusual_radius_drift(regression: Regression) -> RadiusDrift | None:
    """Return the radius drift where it exceeds that of tyres and roads; None where it does not."""
    drive = max(regression.drives, key=lambda one: one.noise.radius_drift)
    if drive.noise.radius_drift < SETTINGS.report.drift_reported_from:
        return None
    recording = drive.reader.recording
    wheels = tuple(WHEELS[k] for k in recording.wheels)
    where = Where(wheels, "wheel_ratio", "time", (0.0, float(recording.edges_s[-1])))
    name = recording.name if len(regression.drives) > 1 else ""
    return RadiusDrift(drive.noise.radius_drift, drive.noise.radius_drift_tau_s, name, where)


def heldout_gain_of_term(selector: Selector, terms: list[Term], more: Term) -> float:
    """Return the held-out gain (nats) of one more term."""
    evidence = selector.evidence
    with_it = evidence.heldout(selector.design([*terms, more])).sum()
    return float(with_it - evidence.heldout(selector.design(terms)).sum())


def _gains_alone(regression: Regression, selector: Selector) -> tuple[tuple[str, float], ...]:
    """Return the gain (nats) of each effect alone over calibration, the largest first."""
    gram, b = selector.evidence.projected(selector.design([]))
    best: dict[str, float] = {}
    for term in regression.hypotheses.catalogue:
        if (term.drive is not None and not regression.simulation) or term.calibrates:
            continue
        gain, _ = group_gain(term.design[1:], gram, b)
        best[term.effect] = max(best.get(term.effect, 0.0), gain)
    for gain, term in regression.hypotheses.ramp_gains(gram, b):
        name = f"{FAULT.name} {term.wheel}"
        best[name] = max(best.get(name, 0.0), gain)
    return tuple(sorted(best.items(), key=lambda entry: -entry[1]))


def _rms_by_channel(
    regression: Regression, selection: Selection, evidence: Evidence
) -> dict[str, tuple[float, float]]:
    """Return the root mean square of the whitened residual by channel, before and after."""
    rolling = evidence.fit(regression.hypotheses.nuisance)
    fits = (rolling, selection.fit)
    left = [
        np.concatenate([drive.residual(fit.design, fit.values) for drive in regression.examined])
        for fit in fits
    ]
    here = np.concatenate([np.isfinite(drive.reader.windows.measured) for drive in regression.examined])
    out: dict[str, tuple[float, float]] = {}
    for name in dict.fromkeys(CHANNEL_NAMES):
        mask = here & np.array([channel == name for channel in CHANNEL_NAMES])[None, :]
        if mask.any():
            before, after = (float(np.sqrt((rows[mask] ** 2).mean())) for rows in left)
            out[name] = (before, after)
    return out
