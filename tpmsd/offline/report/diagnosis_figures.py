"""The figures of a diagnosis' report.

In: `RollingDiagnosis`, `Finding`, replays without and with the model. Out: `Chart`s, `Bars`, `Track`.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.assessment.result import Finding, RollingDiagnosis, Trace
from tpmsd.offline.report.alarms_compared import AlarmsCompared
from tpmsd.offline.report.decimation import decimated
from tpmsd.offline.report.diagnosis_summary import UNITS
from tpmsd.offline.report.figures import Bars, Chart, Curve, MarkedInstant, Track
from tpmsd.offline.report.replay_charts import TIME_LABEL
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.offline.report.wording import alarm_label, covariate_name, plain_name, wheel_name

NOISE_STD = 2.0
"""Half width of the band in which noise stays, in standard deviations."""
EVIDENCE_ROWS = 14
POINTS = 800
_UNSURE = 3.0
"""Times the median standard deviation: what is less certain is not drawn."""
READINGS = {"gnss_speed": "m/s", "gnss_course": "rad", "yaw_rate": "rad/s"}
"""Channels whose nonparametric terms are a reading minus the truth; of the others they are a radius."""


class ResidualTrace(Protocol):
    """Means of residuals over a covariate, in standard deviations, of any baseline."""

    @property
    def covariate(self) -> str:
        """Return the name of the covariate."""
        ...

    @property
    def middle(self) -> FloatArray:
        """Return the (n,) middles of the bins, in the covariate's unit."""
        ...

    @property
    def before(self) -> FloatArray:
        """Return the (n,) means without the effect, in standard deviations."""
        ...

    @property
    def after(self) -> FloatArray:
        """Return the (n,) means with the effect, in standard deviations."""
        ...


def covariate_label(covariate: str) -> str:
    """Return the name of a covariate with its unit, for an axis."""
    return (
        f"{covariate_name(covariate)} ({UNITS[covariate]})"
        if covariate in UNITS
        else covariate_name(covariate)
    )


def spline_chart(finding: Finding) -> Chart | None:
    """Return the fitted curve of an `unknown` with one standard deviation; None without one."""
    if not finding.shape:
        return None
    at, value, std = np.array(finding.shape, dtype=np.float64).T
    unit = READINGS.get(finding.where.channel)
    scale, label = (1.0, f"reading minus truth ({unit})") if unit else (1e3, "change of radius (mm)")
    curve = Curve(
        "fitted term ± one standard deviation",
        scale * value,
        "after",
        scale * (value - std),
        scale * (value + std),
        True,
    )
    name = finding.where.covariate or "time"
    return Chart(f"Fitted term over {covariate_name(name)}", covariate_label(name), label, at, (curve,))


def trace_chart(trace: Trace) -> Chart:
    """Return the residual over the covariate at which a finding is located, without it and with it."""
    title = f"Residual over {covariate_name(trace.covariate)}, before and after"
    return before_after_chart(title, "residual (standard deviations)", trace)


def before_after_chart(title: str, label: str, trace: ResidualTrace) -> Chart:
    """Return the means of residuals over a covariate without an effect and with it, noise as a band."""
    return Chart(
        title,
        covariate_label(trace.covariate),
        label,
        trace.middle,
        (
            Curve("without this effect", trace.before, "before", dots=True),
            Curve("with it", trace.after, "after", dots=True),
        ),
        noise=(-NOISE_STD, NOISE_STD),
        noise_name=f"±{NOISE_STD:.0f} standard deviations of noise",
    )


def gain_bars(diagnosis: RollingDiagnosis) -> Bars | None:
    """Return the held-out log-likelihood gain of each finding fitted with the others; None without
    findings."""
    rows = tuple((finding_name(finding), finding.gain, True) for finding in diagnosis.findings)
    return Bars("Log-likelihood gain of each finding", "held-out gain (nats)", rows) if rows else None


def evidence_bars(diagnosis: RollingDiagnosis) -> Bars | None:
    """Return the log-likelihood gain of every effect alone, findings marked; None where no gain is
    positive."""
    found = {finding.effect for finding in diagnosis.findings}
    found |= {
        f"{finding.effect} {finding.parameters[name].value}"
        for finding in diagnosis.findings
        for name in ("wheel", "wheels")
        if name in finding.parameters
    }
    rows = tuple(
        (_evidence_name(name) + (" (found)" if name in found else ""), gain, name in found)
        for name, gain in diagnosis.evidence
        if gain > 0.0
    )
    return Bars("Evidence for each effect alone", "gain (nats)", rows[:EVIDENCE_ROWS]) if rows else None


def mismatch_track(diagnosis: RollingDiagnosis, baseline: str) -> Track | None:
    """Return the track coloured by the baseline's loss of log-likelihood against the extended model, nats/s;
    None without findings or positions."""
    ground = diagnosis.inner.ground if diagnosis.inner is not None else None
    if ground is None or not diagnosis.findings:
        return None
    return Track(
        f"Where {baseline} fails",
        "loss (nats per second)",
        ground.east_m,
        ground.north_m,
        ground.mismatch,
    )


def radius_chart(compared: AlarmsCompared, wheel: int) -> Chart | None:
    """Return one wheel's radius over the drive without and with the model; None where it was never
    estimated."""
    before, after = compared.before, compared.after
    time_s = before.time_s - before.start_s
    columns = {"before": 1e3 * _deviation_where_known(before, wheel)}
    if not np.isfinite(columns["before"]).any():
        return None
    moments = _raised_instants(before, wheel, "before")
    if after is not before:
        columns["after"] = 1e3 * np.interp(
            time_s, after.time_s - after.start_s, _deviation_where_known(after, wheel)
        )
        moments += _raised_instants(after, wheel, "after")
    fault_m = compared.fault_m(before, wheel)
    if np.any(fault_m != 0.0):
        quiet = after.deviation_m[:, wheel][: len(fault_m)][fault_m == 0.0]
        start_m = float(np.nanmedian(quiet)) if np.isfinite(quiet).any() else 0.0
        columns["fault"] = 1e3 * (fault_m + start_m)
    x, kept = decimated(time_s, columns, POINTS)
    names = {"before": "without the model", "after": "with the model", "fault": "change of radius as found"}
    styles = {"before": "before", "after": "after", "fault": "soft"}
    return Chart(
        f"Radius of the {wheel_name(WHEELS[wheel])} wheel",
        TIME_LABEL,
        "radius minus nominal (mm)",
        x,
        tuple(Curve(names[name], values, styles[name]) for name, values in kept.items()),
        moments=tuple(moments),
        group=compared.drive,
        time=True,
    )


def finding_name(finding: Finding) -> str:
    """Return a heading: the effect, and the wheel where it has one."""
    name = "Unexplained effect" if finding.effect == "unknown" else plain_name(finding.effect)
    if "wheel" in finding.parameters:
        return f"{name}, {wheel_name(str(finding.parameters['wheel'].value))}"
    return name


def _evidence_name(name: str) -> str:
    effect, _, wheel = name.partition(" ")
    plain = "Nonparametric term" if effect == "unknown" else plain_name(effect)
    return f"{plain}, {wheel_name(wheel)}" if wheel else plain


def _raised_instants(result: ReplayResult, wheel: int, style: str) -> list[MarkedInstant]:
    return [
        MarkedInstant(alarm.time_s - result.start_s, alarm_label(alarm), style)
        for alarm in result.alarms
        if alarm.wheel == WHEELS[wheel] and alarm.state == "raised"
    ]


def _deviation_where_known(result: ReplayResult, wheel: int) -> FloatArray:
    """Return the (n,) deviation in metres, NaN where its std is several times the median, as at the start."""
    std = result.std_m[:, wheel]
    known = std[np.isfinite(std)]
    most = _UNSURE * float(np.median(known)) if len(known) else 0.0
    return np.where(std < most, result.deviation_m[:, wheel], np.nan)
