"""A diagnosis as one HTML page.

In: `RollingDiagnosis`, the names of its drives, the replays of its drives where they were made, where it
comes from. Out: HTML (template `diagnosis.html`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tpmsd.car.physics.catalogue import sentence_of
from tpmsd.foundation.english import counted
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.diagnosis.assessment.result import (
    FINDING,
    INSUFFICIENT,
    MISMATCH,
    Finding,
    Quantity,
    RollingDiagnosis,
)
from tpmsd.offline.report.alarms_compared import AlarmsCompared
from tpmsd.offline.report.diagnosis_figures import (
    evidence_bars,
    finding_name,
    gain_bars,
    mismatch_track,
    radius_chart,
    spline_chart,
    trace_chart,
)
from tpmsd.offline.report.diagnosis_sentences import summary_sentences
from tpmsd.offline.report.diagnosis_summary import (
    CHANNELS,
    diagnosis_summary,
    location_text,
    p_text,
    quantity_text,
    remainder_sentences,
)
from tpmsd.offline.report.page import Cell, HtmlTable, Origin, RenderedFigure, Tile, render, render_figure
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.offline.report.simulation_text import agreement, baseline_name, difference_lines
from tpmsd.offline.report.wording import alarm_label, drive_time, parameter_name, plain_name, wheel_name


@dataclass(frozen=True)
class FindingView:
    """One finding as the page shows it."""

    title: str
    effect: str
    sentences: tuple[str, ...]
    values: HtmlTable
    figures: tuple[RenderedFigure, ...]


@dataclass(frozen=True)
class AlarmsView:
    """Effect of the findings on the alarms of one drive."""

    drive: str
    sentences: tuple[str, ...]
    alarms: HtmlTable
    radii: HtmlTable
    figures: tuple[RenderedFigure, ...]


def diagnosis_page(
    diagnosis: RollingDiagnosis,
    names: Sequence[str],
    origin: Origin,
    alarms: Sequence[AlarmsCompared] = (),
    standalone: bool = True,
) -> str:
    """Return the page; ConfigError where Jinja2 or matplotlib is missing."""
    known = diagnosis.verdict != INSUFFICIENT
    baseline = baseline_name(diagnosis)
    track = mismatch_track(diagnosis, baseline)
    gains, evidence = gain_bars(diagnosis), evidence_bars(diagnosis)
    return render(
        "diagnosis.html",
        origin,
        standalone,
        drives=", ".join(names),
        verdict=_verdict_sentence(diagnosis),
        answer=summary_sentences(diagnosis),
        head=_summary_tiles(diagnosis),
        known=known,
        baseline=baseline,
        overview=_findings_table(diagnosis),
        findings=_finding_views(diagnosis) if known else (),
        unseen=_undetected_table(diagnosis),
        gains=None if gains is None else render_figure(gains, "gains"),
        confounded=_confounded_table(diagnosis),
        alarms=[_alarms_view(one, number) for number, one in enumerate(alarms)],
        track=None if track is None else render_figure(track, "track"),
        reached=_reach_sentences(diagnosis),
        channels=_channel_table(diagnosis),
        evidence=None if evidence is None else render_figure(evidence, "evidence"),
        summary=diagnosis_summary(diagnosis, None),
    )


def _verdict_sentence(diagnosis: RollingDiagnosis) -> str:
    if diagnosis.verdict == INSUFFICIENT:
        return f"Insufficient data: {diagnosis.reason}."
    if diagnosis.verdict == MISMATCH:
        return f"The recording and {baseline_name(diagnosis)} differ: {_counts_text(diagnosis)}."
    return agreement(diagnosis)


def _counts_text(diagnosis: RollingDiagnosis) -> str:
    certain = sum(finding.status == FINDING for finding in diagnosis.findings)
    doubtful = len(diagnosis.findings) - certain
    parts = [counted(certain, "finding")]
    if doubtful:
        parts.append(counted(doubtful, "suspicion"))
    return " and ".join(parts)


def _summary_tiles(diagnosis: RollingDiagnosis) -> list[Tile]:
    verdicts = {INSUFFICIENT: "insufficient data"}
    tiles = [
        Tile(
            verdicts.get(diagnosis.verdict, diagnosis.verdict),
            "Verdict",
            "Mismatch: an effect beyond noise was found. Consistent: none was.",
        )
    ]
    if diagnosis.verdict == INSUFFICIENT:
        return tiles
    share = None if diagnosis.reach is None else diagnosis.reach.share
    tiles += [
        Tile(
            f"{diagnosis.driving_s / 60:.0f} min",
            "Driving compared",
            "Time in which the car moved and all was read.",
        ),
        Tile(_counts_text(diagnosis), "Found", "A suspicion may be noise and does not make a mismatch."),
        Tile(
            f"{diagnosis.baseline_rms:.2f} → {diagnosis.model_rms:.2f}",
            "Held-out residual",
            "Root mean square on stretches that were left out of the fit, before and after, in units of"
            " the noise; noise alone makes up to 1.",
        ),
        Tile(
            "nothing to gain" if share is None else f"{100 * share:.0f} %",
            "Share of the reachable gain",
            "Gain of the findings over that of a nonparametric model of everything.",
        ),
    ]
    if diagnosis.replicates:
        tiles.append(
            Tile(
                str(diagnosis.replicates),
                "Replicates",
                "Drives drawn without each effect and analysed alike; the p-values come from them.",
            )
        )
    return tiles


def _findings_table(diagnosis: RollingDiagnosis) -> HtmlTable:
    heads = ("effect", "status", "p-value", "confidence", "held-out gain (nats)", "held-out residual")
    rows = tuple(
        (
            Cell(finding_name(finding), link=f"finding-{number}"),
            Cell(finding.status),
            Cell(
                "–" if finding.p_value is None else p_text(finding.p_value, finding.p_value_is_bound),
                finding.p_value,
                number=True,
            ),
            Cell(f"{finding.confidence:.3f}", number=True),
            Cell(_grouped_digits(finding.gain), finding.gain, number=True),
            Cell(f"{finding.rms_before:.3f} → {finding.rms_after:.3f}", number=True),
        )
        for number, finding in enumerate(diagnosis.findings, 1)
    )
    return HtmlTable(heads, rows)


def _finding_views(diagnosis: RollingDiagnosis) -> tuple[FindingView, ...]:
    """Return the findings with charts of their residuals; a trace goes to the first finding of its
    covariate."""
    traces = [] if diagnosis.inner is None else list(diagnosis.inner.traces)
    views = []
    for number, finding in enumerate(diagnosis.findings, 1):
        charts = [spline_chart(finding)]
        covariate = finding.where.covariate or "time"
        for k, trace in enumerate(traces):
            if (trace.effect, trace.covariate) == (finding.effect, covariate):
                charts.append(trace_chart(traces.pop(k)))
                break
        figures = tuple(
            render_figure(chart, f"finding-{number}-{k}")
            for k, chart in enumerate(charts)
            if chart is not None
        )
        views.append(
            FindingView(
                finding_name(finding),
                finding.effect,
                _finding_sentences(finding),
                _parameter_table(finding),
                figures,
            )
        )
    return tuple(views)


def _finding_sentences(finding: Finding) -> tuple[str, ...]:
    certainty = "A finding" if finding.status == FINDING else "A suspicion, which noise may make as well"
    if finding.p_value is None:
        certainty += " (without a p-value: no certificate was asked for)"
    else:
        certainty += f" (p {p_text(finding.p_value, finding.p_value_is_bound)})"
    out = [
        f"{_capitalised(sentence_of(finding.effect))}.",
        f"{certainty}. Located in {location_text(finding.where)}.",
        *(f"{_capitalised(line)}." for line in difference_lines(finding)),
    ]
    if finding.drives:
        out.append(f"Only in {', '.join(finding.drives)}.")
    if finding.identified_by:
        out.append(f"{_capitalised(finding.identified_by)}.")
    if finding.indistinguishable_from:
        alternatives = ", ".join(plain_name(alternative) for alternative in finding.indistinguishable_from)
        out.append(f"Confounded on this drive with: {alternatives}.")
    if finding.advice:
        out.append(f"Which drive would tell: {finding.advice}.")
    return tuple(out)


def _parameter_table(finding: Finding) -> HtmlTable:
    rows = []
    for name, quantity in finding.parameters.items():
        shown = _short_length_in_mm(quantity)
        value = wheel_name(str(shown.value)) if name == "wheel" else quantity_text(shown).replace("+-", "±")
        rows.append((Cell(parameter_name(name)), Cell(value)))
    return HtmlTable(("parameter", "value ± one standard deviation"), tuple(rows))


def _short_length_in_mm(quantity: Quantity) -> Quantity:
    """Return lengths under 5 cm in millimetres, other quantities as they are."""
    if quantity.unit == "m" and isinstance(quantity.value, float) and abs(quantity.value) < 0.05:
        return Quantity(1e3 * quantity.value, None if quantity.std is None else 1e3 * quantity.std, "mm")
    return quantity


def _confounded_table(diagnosis: RollingDiagnosis) -> HtmlTable:
    rows = tuple(
        (Cell(finding_name(finding)), Cell(plain_name(alternative)), Cell(finding.advice))
        for finding in diagnosis.findings
        for alternative in finding.indistinguishable_from
    )
    return HtmlTable(("finding", "confounded with", "which drive would tell"), rows)


def _undetected_table(diagnosis: RollingDiagnosis) -> HtmlTable:
    """Return the effects that were not found, with the smallest size that the drive would show for sure."""
    rows = tuple(
        (
            Cell(plain_name(one.effect)),
            Cell(parameter_name(name)),
            Cell("nothing of it shows" if value is None else f"{value:.2g} {unit}".removesuffix(" 1"), value),
        )
        for one in diagnosis.not_detectable
        for name, (value, unit) in one.smallest.items()
    )
    return HtmlTable(("effect", "parameter", "seen for sure from"), rows)


def _reach_sentences(diagnosis: RollingDiagnosis) -> list[str]:
    out = [sentence.replace("+-", "±") for sentence in remainder_sentences(diagnosis)]
    removed = diagnosis.down_weighted
    if removed is not None and removed.share >= 0.005:
        spans = ", ".join(f"{drive_time(start)} to {drive_time(end)}" for start, end in removed.time_spans)
        where = f", most of it from {spans}" if spans else ""
        out.append(
            f"Robust weights took {100 * removed.share:.0f} % out of the data,"
            f" which no effect explains{where}."
        )
    return out


def _channel_table(diagnosis: RollingDiagnosis) -> HtmlTable:
    """Return residual, gain and remaining gain of a nonparametric model, a row per channel."""
    heads = ("channel", "residual before", "after", "gain (nats)", "left (nats)", "correlation after 1 s")
    rows = []
    for name, (before, after) in ({} if diagnosis.inner is None else diagnosis.inner.rms_by_channel).items():
        channel = None if diagnosis.reach is None else diagnosis.reach.channels.get(name)
        numbers = [f"{before:.3f}", f"{after:.3f}"]
        if channel is not None:
            numbers += [
                _grouped_digits(channel.found),
                _grouped_digits(channel.left),
                f"{channel.correlation:+.2f}",
            ]
        else:
            numbers += ["–"] * 3
        rows.append((Cell(CHANNELS[name]), *(Cell(text, number=True) for text in numbers)))
    return HtmlTable(heads, tuple(rows))


def _alarms_view(compared: AlarmsCompared, number: int) -> AlarmsView:
    """Return alarms and radii of one drive without and with the model."""
    sentences = [*compared.changes, *(f"{note}." for note in compared.notes)]
    if compared.after is compared.before:
        sentences.insert(0, "The model holds nothing to compensate: alarms and radii stay as they are.")
    alarms = tuple(
        (Cell(name), Cell("\n".join(_raised_texts(result)) or "none"))
        for name, result in (("without the model", compared.before), ("with the model", compared.after))
    )
    radii = tuple(
        (
            Cell(wheel_name(bias.wheel)),
            *(Cell(f"{1e3 * value:.2f}", number=True) for value in (bias.before_m, bias.after_m, bias.std_m)),
        )
        for bias in compared.wheels
    )
    charts = [radius_chart(compared, wheel) for wheel in range(len(WHEELS))]
    return AlarmsView(
        compared.drive,
        tuple(sentences),
        HtmlTable(("replay", "alarms raised"), alarms),
        HtmlTable(
            ("wheel", "without the model (mm)", "with it (mm)", "claimed std (mm)"),
            radii,
        ),
        tuple(
            render_figure(chart, f"radius-{number}-{k}")
            for k, chart in enumerate(charts)
            if chart is not None
        ),
    )


def _raised_texts(result: ReplayResult) -> list[str]:
    return [
        f"{alarm_label(alarm)} at {drive_time(alarm.time_s - result.start_s)}"
        for alarm in result.alarms
        if alarm.state == "raised"
    ]


def _grouped_digits(value: float) -> str:
    return f"{round(value) + 0:,}".replace(",", " ")


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]
