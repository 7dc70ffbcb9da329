"""The diagnosis of vehicle dynamics in sentences and small tables: the answer first.

In: `DynamicsDiagnosis`. Out: text.
"""

from __future__ import annotations

from collections.abc import Mapping

from tpmsd.car.physics.dynamics_catalogue import DYNAMICS_EFFECTS
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.foundation.english import listed
from tpmsd.offline.dynamics.result import (
    CONSISTENT,
    INSUFFICIENT,
    SUSPICION,
    DynamicsDiagnosis,
    DynamicsFinding,
    FittedNumber,
    OutputFit,
)
from tpmsd.offline.dynamics.settings import SETTINGS

OUTPUT_NAMES = {
    "yaw_rate": "yaw rate",
    "accel_lat": "lateral acceleration",
    "accel_long": "longitudinal acceleration",
    "velocity_lat": "lateral speed",
    "side_slip": "side slip",
    "speed": "speed",
    "roll": "roll",
}
"""Outputs in words."""


def summary_sentences(diagnosis: DynamicsDiagnosis) -> list[str]:
    """Return the answer in sentences."""
    if diagnosis.verdict == INSUFFICIENT:
        return [f"Nothing can be concluded: {diagnosis.reason}."]
    named = [one for one in diagnosis.findings if one.status != SUSPICION]
    base, out = f"the {diagnosis.baseline} model", list[str]()
    if diagnosis.simulated:
        effects = listed([_with_values(effect) for effect in diagnosis.simulated])
        out.append(f"Your simulation moves like {base} with {effects}.")
    if diagnosis.simulated is not None:
        base = "your simulation"
    if diagnosis.given:
        base += f" with {listed(list(diagnosis.given))}"
    if diagnosis.verdict == CONSISTENT:
        out.append(f"The drive agrees with {base}: nothing beyond noise was found.")
    else:
        clauses = [clause(one) for one in named]
        more = "this" if len(clauses) == 1 else f"{len(clauses)} things"
        out.append(f"{base[:1].upper()}{base[1:]} leaves out {more}: {'; '.join(clauses)}.")
        out += [_fit(diagnosis)] if diagnosis.outputs else []
    out += _doubts(named)
    for one in diagnosis.findings:
        if one.status == SUSPICION:
            out.append(f"Suspected, not sure: {clause(one)}.")
    for nuisance in diagnosis.nuisances:
        sentence = DYNAMICS_EFFECTS[nuisance.effect].wording.sentence
        out.append(
            f"Fitted as what every car has, not as a finding: {sentence}"
            f" ({nuisance.effect}: {_numbers(nuisance.parameters)})."
        )
    return out


def _doubts(named: list[DynamicsFinding]) -> list[str]:
    """Return what the findings may be confounded with, or be proxies of."""
    out = []
    for one in named:
        if one.indistinguishable_from:
            confounded_with = listed(list(one.indistinguishable_from), "or")
            advice = f"; to part them, {one.distinguished_by}" if one.distinguished_by else ""
            out.append(f"This drive cannot tell {one.effect} from {confounded_with}{advice}.")
    if large := [one.effect for one in named if one.unusual]:
        are, they = ("is", "it") if len(large) == 1 else ("are", "they")
        out.append(f"{listed(large)} {are} larger than cars have: {they} may be proxies of something else.")
    if doubtful := [one.effect for one in named if one.may_be_proxy and not one.unusual]:
        are, proxies = ("is", "a proxy") if len(doubtful) == 1 else ("are", "proxies")
        out.append(
            f"An effect outside the catalogue may act instead: {listed(doubtful)} {are} {proxies} then."
        )
    return out


def clause(finding: DynamicsFinding) -> str:
    """Return what was found, as a clause with its numbers."""
    if finding.effect == "unknown":
        where = finding.where
        over = f"over {(where.covariate or 'time').replace('_', ' ')}"
        if where.range is not None:
            over += f" from {where.range[0]:.3g} to {where.range[1]:.3g}"
        return f"something without a name in the {_equation(finding.acts_on)} {over}"
    sentence = DYNAMICS_EFFECTS[finding.effect].wording.sentence
    return f"{sentence} ({finding.effect}: {_numbers(finding.parameters)})"


def _with_values(effect: DynamicsEffect) -> str:
    """Return an effect with its numbers; a spline by its name alone."""
    if effect.name == "unknown":
        return "something without a name"
    values = ", ".join(f"{p.name} {getattr(effect, p.name):.3g}" for p in effect.numbers())
    return f"{effect.name} ({values})" if values else effect.name


def _numbers(parameters: Mapping[str, FittedNumber]) -> str:
    """Return parameters with their standard deviations and units."""
    return ", ".join(
        f"{name} {one.value:.4g} +- {one.std:.2g}{' ' + one.unit if one.unit and one.unit != '1' else ''}"
        for name, one in parameters.items()
    )


def _equation(on: str) -> str:
    """Return an equation or an output in words."""
    acts = {
        "force_x": "longitudinal force",
        "force_y": "lateral force",
        "moment": "yaw moment",
        "force_front": "side force of the front axle",
        "force_rear": "side force of the rear axle",
    }
    return acts.get(on) or OUTPUT_NAMES.get(on, on)


def finding_title(finding: DynamicsFinding) -> str:
    """Return what was found, in words and without numbers, for a heading."""
    sentence = DYNAMICS_EFFECTS[finding.effect].wording.sentence
    return f"{sentence[:1].upper()}{sentence[1:]}"


def p_text(finding: DynamicsFinding) -> str:
    """Return a p-value in one digit; as a bound where no replicate showed as much."""
    return f"<= {finding.p_value:.1g}" if finding.p_value_is_bound else f"{finding.p_value:.1g}"


def certificate_sentence(diagnosis: DynamicsDiagnosis) -> str:
    """Return how the p-values were counted, and what they say of what was not found; empty without any."""
    one = diagnosis.certificate
    if one is None:
        return ""
    counted = "Each p-value is counted" if diagnosis.findings else "Checked"
    without = "without the finding " if diagnosis.findings else ""
    return (
        f"{counted} in up to {one.replicates} replicates of the drive, drawn from the fitted model {without}"
        "and analysed alike. Of what was not found, the strongest has p"
        f" {one.remaining_p_value:.1g}: {one.remaining_exceeded} of {one.remaining_replicates} show"
        " as much."
    )


def _fit(diagnosis: DynamicsDiagnosis) -> str:
    """Return which outputs are predicted better with the findings, and which are not."""

    def errors(outputs: Mapping[str, OutputFit]) -> str:
        return listed(
            [
                f"of {OUTPUT_NAMES[name]} from {fit.rms_before:.3g} to {fit.rms_after:.3g} {fit.unit}"
                for name, fit in outputs.items()
            ]
        )

    better = {
        name: fit
        for name, fit in diagnosis.outputs.items()
        if fit.rms_after < SETTINGS.min_fall * fit.rms_before
    }
    other = {name: fit for name, fit in diagnosis.outputs.items() if name not in better}
    with_what = "it" if len(diagnosis.findings) == 1 else "them"
    if not better:
        return f"With {with_what} the held-out prediction error does not fall: it goes {errors(other)}."
    text = f"With {with_what} the held-out prediction error falls {errors(better)}"
    return f"{text}; it does not fall, {errors(other)}." if other else f"{text}."


def dynamics_summary(diagnosis: DynamicsDiagnosis, model_file: str | None) -> str:
    """Return the whole report for people."""
    lines = list(summary_sentences(diagnosis))
    lines += [f"Note: {note}." for note in diagnosis.notes]
    if diagnosis.verdict == INSUFFICIENT:
        return "\n".join(lines)
    if diagnosis.findings:
        lines += ["", f"{'finding':28}{'confidence':>10}{'p':>9}{'held-out gain':>15}   shows in"]
        for one in diagnosis.findings:
            over = f" over {one.where.covariate}" if one.where.covariate else ""
            lines.append(
                f"{one.effect:28}{one.confidence:10.3f}{p_text(one):>9}{one.loglik_gain:11.1f} nats"
                f"   {OUTPUT_NAMES[one.where.channel]}{over}"
            )
    if certificate := certificate_sentence(diagnosis):
        lines += ["", certificate]
    if diagnosis.outputs:
        lines += [
            "",
            f"{'output, held out':28}{'rms before':>12}{'after':>10}{'rating before':>15}{'after':>8}",
        ]
        for name, fit in diagnosis.outputs.items():
            lines.append(
                f"{OUTPUT_NAMES[name] + ', ' + fit.unit:28}{fit.rms_before:12.4g}{fit.rms_after:10.4g}"
                f"{fit.rating_before:15.3f}{fit.rating_after:8.3f}"
            )
        lines.append(
            "Predicted from the inputs alone, parameters fitted on other parts; ratings by ISO/TS 18571."
        )
    if diagnosis.not_detectable:
        names = listed([one.effect for one in diagnosis.not_detectable])
        lines += ["", f"This drive could not have shown at a usual size: {names}."]
    for form in diagnosis.proposals[:1]:
        lines += [
            "",
            f"What has no name is described by {form.formula} in the {_equation(form.on)}: coefficient"
            f" {form.coefficient:.4g} +- {form.std:.2g} {form.on_unit} per {form.unit},"
            f" {form.heldout_gain:.1f} nats on held-out blocks.",
        ]
    if model_file is not None:
        lines += ["", f"The extended model is in {model_file}."]
    return "\n".join(lines)
