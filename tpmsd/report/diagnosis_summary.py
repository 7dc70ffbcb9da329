"""The diagnosis in plain sentences.

In: `Diagnosis`. Out: text for a terminal.
"""

from __future__ import annotations

from tpmsd.diagnosis.result import CONSISTENT, INSUFFICIENT, Diagnosis, Finding, Quantity, Where

SENTENCES: dict[str, str] = {
    "radius_change": "the radius of a tyre changed during the drive: the fault itself",
    "centrifugal_growth": "the tyres grow with speed",
    "thermal_growth": "the tyres grow as they warm up",
    "load_transfer_longitudinal": "driving and braking shift load between the axles and change the radii",
    "load_transfer_lateral": "bends shift load between the sides and change the radii",
    "longitudinal_slip": "driven wheels slip under drive force",
    "lateral_slip": "the rear axle drifts outwards in bends",
    "road_grade": "wheels roll along slopes, the receiver reports the horizontal",
    "gnss_latency": "the receiver's fixes are older than they seem",
    "antenna_lever_arm": "the antenna is not where the configuration says",
    "track_width_error": "the track differs from the configured one",
    "tone_ring_error": "a wheel's teeth are unevenly spaced or their number is wrong",
    "yaw_rate_bias": "the gyro reads a rate on the straight",
    "yaw_rate_scale": "the gyro's scale is off",
    "unknown": "something that no effect of the catalogue explains",
}
UNITS = {
    "speed": "m/s",
    "accel_long": "m/s2",
    "accel_lat": "m/s2",
    "yaw_rate": "rad/s",
    "steering": "rad",
    "steering_rate": "rad/s",
    "grade": "rad",
    "time": "s",
    "distance": "m",
    "wheel_angle": "rad",
    "temperature": "K",
    "torque": "Nm",
}


def diagnosis_summary(diagnosis: Diagnosis, model_file: str | None) -> str:
    """What was found, one paragraph per finding."""
    if diagnosis.verdict == INSUFFICIENT:
        return f"Not enough to go by: {diagnosis.reason}."
    head = f"{diagnosis.driving_s:.0f} s of driving compared with the rolling model. "
    if diagnosis.verdict == CONSISTENT:
        text = head + "They agree within the noise: no missing physics was found."
        return text + _rest(diagnosis)
    count = len(diagnosis.findings)
    text = head + f"They differ: {count} finding{'s' if count > 1 else ''}.\n"
    for number, finding in enumerate(diagnosis.findings, 1):
        text += "\n" + "\n".join(_paragraph(number, finding)) + "\n"
    text += (
        f"\nOn held-out stretches the residual is {diagnosis.baseline_rms:.3f} of its expected size before"
        f" and {diagnosis.model_rms:.3f} after."
    )
    text += _rest(diagnosis)
    if model_file is not None:
        text += f"\nThe extended model is in {model_file}."
    return text


def _rest(diagnosis: Diagnosis) -> str:
    if diagnosis.unexplained is None:
        return ""
    return f"\nWhat is left still has structure: {place(diagnosis.unexplained)}."


def _paragraph(number: int, finding: Finding) -> list[str]:
    lines = [
        f"{number}. {finding.effect} (confidence {finding.confidence:.2f}): {SENTENCES[finding.effect]}."
    ]
    if finding.parameters:
        lines.append(
            "   " + ", ".join(f"{name} = {quantity_text(q)}" for name, q in finding.parameters.items())
        )
    lines.append(f"   seen in {place(finding.where)}; held-out gain {finding.gain:.0f} nats")
    if finding.indistinguishable_from:
        lines.append(f"   this drive cannot tell it from: {', '.join(finding.indistinguishable_from)}")
        lines.append(f"   {finding.advice}")
    return lines


def quantity_text(quantity: Quantity) -> str:
    """A value with its standard deviation and unit."""
    if isinstance(quantity.value, str):
        return quantity.value
    std = "" if quantity.std is None else f" +- {quantity.std:.1g}"
    return f"{quantity.value:.4g}{std} {quantity.unit}".strip()


def place(where: Where) -> str:
    """Where a mismatch is, in words."""
    channel = {
        "wheel": "wheels against receiver",
        "wheel_ratio": "wheel against wheel",
        "gnss_speed": "the receiver's speed",
        "gnss_course": "the receiver's course",
        "gnss_position": "the receiver's position",
        "yaw_rate": "the yaw rate",
    }[where.channel]
    text = channel + (f" ({' '.join(where.wheels)})" if where.wheels else "")
    if where.covariate is not None:
        text += f", over {where.covariate}"
        if where.range is not None:
            low, high = where.range
            text += f" from {low:.3g} to {high:.3g} {UNITS.get(where.covariate, '')}".rstrip()
    elif where.time_spans:
        text += ", " + ", ".join(f"{a:.0f} to {b:.0f} s" for a, b in where.time_spans)
    return text
