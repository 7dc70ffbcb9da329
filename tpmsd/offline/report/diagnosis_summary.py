"""The terminal text of a diagnosis: a paragraph per finding, what is left and what the drive would not show.

In: `RollingDiagnosis`. Out: text for a terminal. The short answer in front of it, which text, JSON and page
share, is that of `diagnosis_sentences`.
"""

from __future__ import annotations

from collections.abc import Sequence

from tpmsd.car.physics.catalogue import sentence_of
from tpmsd.car.physics.covariates import COVARIATES
from tpmsd.foundation.english import counted
from tpmsd.foundation.plain import with_unit
from tpmsd.offline.diagnosis.assessment.reach import Reach
from tpmsd.offline.diagnosis.assessment.result import (
    CONSISTENT,
    FINDING,
    INSUFFICIENT,
    Explanatory,
    Finding,
    Quantity,
    RollingDiagnosis,
    Where,
)
from tpmsd.offline.report.alarms_compared import AlarmsCompared, alarms_summary
from tpmsd.offline.report.diagnosis_sentences import summary_sentences
from tpmsd.offline.report.simulation_text import agreement, baseline_name, difference_lines
from tpmsd.offline.report.wording import covariate_name

CHANNELS: dict[str, str] = {
    "wheel": "wheels against receiver",
    "wheel_ratio": "differences between wheels",
    "gnss_speed": "the receiver's speed",
    "gnss_course": "the receiver's course",
    "gnss_position": "the receiver's position",
    "yaw_rate": "the yaw rate",
    "accel_long": "the acceleration forward",
    "accel_lat": "the acceleration to the left",
    "steering": "the steering wheel",
    "clock": "the host's clock against UTC",
}
UNITS = {**COVARIATES, "wheel_angle": "rad"}
SLIPS: dict[str, str] = {"wheel_slip": "Wheel slip", "side_slip": "Side slip"}
REPORTED_FROM_NATS = 10.0
"""Nats, in sample, from which it is reported what a slip would explain beyond the findings."""


def diagnosis_summary(
    diagnosis: RollingDiagnosis, model_file: str | None, alarms: Sequence[AlarmsCompared] = ()
) -> str:
    """Return what was found, one paragraph per finding, and its meaning for the tyres if asked."""
    parts = [_findings_text(diagnosis, model_file), *(alarms_summary(compared) for compared in alarms)]
    return "\n\n".join(parts)


def _findings_text(diagnosis: RollingDiagnosis, model_file: str | None) -> str:
    if diagnosis.verdict == INSUFFICIENT:
        return f"Insufficient data: {diagnosis.reason}."
    answer = " ".join(summary_sentences(diagnosis))
    head = f"{answer}\n\n{diagnosis.driving_s:.0f} s of driving compared with {baseline_name(diagnosis)}. "
    if diagnosis.verdict == CONSISTENT:
        text = head + agreement(diagnosis)
        if diagnosis.findings:
            text += "\nWhat looks like an effect, but is not sure enough:\n"
            for number, finding in enumerate(diagnosis.findings, 1):
                text += "\n" + "\n".join(_finding_paragraph(number, finding)) + "\n"
        return text + _text_after_findings(diagnosis)
    count = sum(finding.status == FINDING for finding in diagnosis.findings)
    more = len(diagnosis.findings) - count
    doubtful = f" and {counted(more, 'suspicion')}" if more else ""
    text = head + f"They differ: {counted(count, 'finding')}{doubtful}.\n"
    for number, finding in enumerate(diagnosis.findings, 1):
        text += "\n" + "\n".join(_finding_paragraph(number, finding)) + "\n"
    text += (
        f"\nOn held-out stretches the residual is {diagnosis.baseline_rms:.3f} of its expected size before"
        f" and {diagnosis.model_rms:.3f} after."
    )
    text += _text_after_findings(diagnosis)
    if model_file is not None:
        text += f"\nThe extended model is in {model_file}."
    return text


def _text_after_findings(diagnosis: RollingDiagnosis) -> str:
    text = _undetected_text(diagnosis)
    text += "".join(f"\n{sentence}" for sentence in remainder_sentences(diagnosis))
    if diagnosis.proposals:
        text += "\nClosed forms for what has no name, with their held-out gains in its place:"
    for one in diagnosis.proposals:
        text += f"\n  {one.coefficient:.3g} * {one.formula} on {one.on}: {one.heldout_gain:.1f} nats"
    return text


def _undetected_text(diagnosis: RollingDiagnosis) -> str:
    """Return a line per effect with the size below which the drive would not show it, then those without
    any."""
    lines, hidden = [], []
    for one in diagnosis.not_detectable:
        sizes = [
            f"{name} {value:.2g} {unit if unit != '1' else ''}".rstrip()
            for name, (value, unit) in one.smallest.items()
            if value is not None
        ]
        if sizes:
            lines.append(f"\n  {one.effect:28}{', '.join(sizes)}")
        else:
            hidden.append(one.effect)
    what = "differences from your simulation" if diagnosis.baseline == ("simulation",) else "effects"
    text = f"\nThis drive would not show {what} below these sizes:" if lines else ""
    text += "".join(lines)
    return text + (f"\nNothing of these shows on such a drive: {', '.join(hidden)}." if hidden else "")


def remainder_sentences(diagnosis: RollingDiagnosis) -> list[str]:
    """Return what the findings leave unexplained: remaining gain, a further term, radius drift, slips."""
    out = [] if diagnosis.reach is None else [reach_sentence(diagnosis.reach)]
    if diagnosis.unexplained is not None:
        but = (
            "One more term alone would"
            if out and not _has_structure_left(diagnosis)
            else "One more term would"
        )
        out.append(f"{but} still explain structure: {location_text(diagnosis.unexplained)}.")
    if (drift := diagnosis.drift) is not None:
        of = f" of {drift.drive}" if drift.drive else ""
        out.append(
            f"All of this is beside radii{of} that drift by {100 * drift.relative_std:.2g} % within"
            f" {drift.time_constant_s:.0f} s ({' '.join(drift.where.wheels)}), more than tyres and roads make"
            " them: this is taken as noise, and its cause is not known."
        )
    return out + [text for text in map(explanatory_sentence, diagnosis.explanatory) if text]


def _has_structure_left(diagnosis: RollingDiagnosis) -> bool:
    """Return whether a nonparametric model has a significant gain beyond the findings."""
    return diagnosis.reach is not None and diagnosis.reach.structured


def reach_sentence(reach: Reach) -> str:
    """Return which part of a nonparametric model's held-out gain the findings reached, and what is left."""
    left = f"{round(reach.left, 1):.4g} +- {max(reach.left_std, 0.1):.2g} nats"
    if reach.share is None:
        return f"A nonparametric model has no significant held-out gain either ({left})."
    share = f"Of the held-out gain of a nonparametric model, {100 * reach.share:.0f} % was reached"
    if not reach.structured:
        worse = (
            ": it fits noise, and predicts worse than the findings" if reach.left < -reach.left_std else ""
        )
        return f"{share}; beyond that it has no significant gain ({left}{worse})."
    most = max(reach.channels, key=lambda name: reach.channels[name].left)
    return f"{share}; {left} are left, most of them in {CHANNELS[most]}."


def _finding_paragraph(number: int, finding: Finding) -> list[str]:
    confidence = f"confidence {finding.confidence:.2f}"
    if finding.p_value is not None:
        confidence += f", p {p_text(finding.p_value, finding.p_value_is_bound)}"
    if finding.status != FINDING:
        confidence = f"a suspicion, {confidence}"
    lines = [f"{number}. {finding.effect} ({confidence}): {sentence_of(finding.effect)}."]
    if finding.parameters:
        lines.append(
            "   " + ", ".join(f"{name} = {quantity_text(q)}" for name, q in finding.parameters.items())
        )
    if finding.shape:
        lines.append(f"   {shape_text(finding)}")
    lines += [f"   {line}" for line in difference_lines(finding)]
    if finding.drives:
        lines.append(f"   only in {', '.join(finding.drives)}")
    lines.append(f"   seen in {location_text(finding.where)}; held-out gain {finding.gain:.0f} nats")
    if finding.identified_by:
        lines.append(f"   {finding.identified_by}")
    if finding.indistinguishable_from:
        lines.append(f"   this drive cannot tell it from: {', '.join(finding.indistinguishable_from)}")
        lines.append(f"   {finding.advice}")
    return lines


def explanatory_sentence(one: Explanatory) -> str:
    """Return the gain of a slip as a sentence; empty where it is small beyond the findings."""
    if one.beyond < REPORTED_FROM_NATS:
        return ""
    text = (
        f"{SLIPS[one.variable]} by the tyre model of a typical car, over {one.covariate}, would gain"
        f" {one.beyond:.0f} nats beyond this ({one.alone:.0f} alone, both in sample)"
    )
    if one.without:
        text += (
            f"; without {' and '.join(one.without)} on the bus it is estimated from the wheels' own motion"
        )
    return text + "."


def p_text(p_value: float, is_bound: bool) -> str:
    """Return a p-value in one digit; with `<=` if no replicate reached the statistic."""
    return f"<= {p_value:.1g}" if is_bound else f"{p_value:.1g}"


def quantity_text(quantity: Quantity) -> str:
    """Return a value with its standard deviation and unit."""
    if isinstance(quantity.value, str):
        return quantity.value
    std = "" if quantity.std is None else f" +- {quantity.std:.1g}"
    return with_unit(f"{quantity.value:.4g}{std}", quantity.unit)


def shape_text(finding: Finding) -> str:
    """Return the least and the greatest value of a nonparametric term, and the covariate's value at each."""
    reading = {"gnss_speed": "m/s", "gnss_course": "rad", "yaw_rate": "rad/s"}
    unit, scale = reading.get(finding.where.channel, "mm"), 1.0 if finding.where.channel in reading else 1e3
    heights = [(value, at, std) for at, value, std in finding.shape]
    (low, low_at, low_std), (high, high_at, high_std) = min(heights), max(heights)
    covariate = finding.where.covariate or "time"
    of = UNITS[covariate]

    def height(value: float, std: float, at: float) -> str:
        spread = f" +- {scale * std:.1g}" if std > 0.0 else ""
        return f"{scale * value:.3g}{spread} {unit} at {_three_digits(at)} {of}"

    return f"from {height(low, low_std, low_at)} to {height(high, high_std, high_at)}"


def _three_digits(value: float) -> str:
    """Return a number in three digits, without an exponent."""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def location_text(where: Where) -> str:
    """Return the channel, wheels, covariate range or time spans of a mismatch, in words."""
    text = CHANNELS[where.channel] + (f" ({' '.join(where.wheels)})" if where.wheels else "")
    if where.covariate is not None:
        text += f", over {covariate_name(where.covariate)}"
        if where.range is not None:
            low, high = where.range
            unit = UNITS.get(where.covariate, "")
            text += f" from {_three_digits(low)} to {_three_digits(high)} {unit}".rstrip()
    elif where.time_spans:
        text += ", " + ", ".join(f"{a:.0f} to {b:.0f} s" for a, b in where.time_spans)
    return text
