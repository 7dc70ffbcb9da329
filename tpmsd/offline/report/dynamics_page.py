"""A diagnosis of vehicle dynamics as one HTML page.

In: `DynamicsDiagnosis`, the drive's name, where it comes from. Out: HTML (template `dynamics.html`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.dynamics_catalogue import DYNAMICS_EFFECTS
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.result import INSUFFICIENT, DynamicsDiagnosis, DynamicsFinding
from tpmsd.offline.dynamics.summary import (
    OUTPUT_NAMES,
    certificate_sentence,
    dynamics_summary,
    finding_title,
    p_text,
    summary_sentences,
)
from tpmsd.offline.report.decimation import decimated
from tpmsd.offline.report.diagnosis_figures import before_after_chart, covariate_label
from tpmsd.offline.report.figures import Bars, Chart, Curve
from tpmsd.offline.report.page import Cell, HtmlTable, Origin, RenderedFigure, Tile, render, render_figure
from tpmsd.offline.report.replay_charts import TIME_LABEL
from tpmsd.offline.report.wording import covariate_name, parameter_name

POINTS = 900
"""Points of a curve over the whole drive: as many as a screen shows."""


@dataclass(frozen=True)
class DynamicsFindingView:
    """One finding as the page shows it."""

    title: str
    effect: str
    sentences: tuple[str, ...]
    values: HtmlTable
    figures: tuple[RenderedFigure, ...]


def dynamics_page(diagnosis: DynamicsDiagnosis, name: str, origin: Origin, standalone: bool = True) -> str:
    """Return the page; ConfigError where Jinja2 or matplotlib is missing."""
    sentences = summary_sentences(diagnosis)
    gains = gain_bars(diagnosis)
    return render(
        "dynamics.html",
        origin,
        standalone,
        drive=name,
        verdict=sentences[0],
        more=sentences[1:],
        head=_summary_tiles(diagnosis),
        notes=diagnosis.notes,
        known=diagnosis.verdict != INSUFFICIENT,
        overview=_findings_table(diagnosis),
        gains=None if gains is None else render_figure(gains, "gains"),
        findings=[_finding_view(one, number) for number, one in enumerate(diagnosis.findings, 1)],
        outputs=_outputs_table(diagnosis),
        steps=_step_table(diagnosis),
        curves=[
            render_figure(chart, f"output-{key}")
            for key in diagnosis.curves
            if (chart := output_chart(diagnosis, key)) is not None
        ],
        certificate=certificate_sentence(diagnosis),
        missed=_undetected_table(diagnosis),
        summary=dynamics_summary(diagnosis, None),
    )


def _summary_tiles(diagnosis: DynamicsDiagnosis) -> list[Tile]:
    verdict = "insufficient data" if diagnosis.verdict == INSUFFICIENT else diagnosis.verdict
    tiles = [Tile(verdict, "Verdict", "Mismatch: an effect beyond noise was found. Consistent: none was.")]
    if diagnosis.verdict == INSUFFICIENT:
        return tiles
    tiles.append(
        Tile(
            f"{diagnosis.driving_s / 60:.1f} min",
            "Driving compared",
            "Time in which the car moved fast enough for slip angles.",
        )
    )
    tiles.append(Tile(str(len(diagnosis.findings)), "Found", "Findings and suspicions."))
    for key, fit in diagnosis.outputs.items():
        tiles.append(
            Tile(
                f"{fit.rms_before:.3g} → {fit.rms_after:.3g} {fit.unit}",
                f"Prediction error, {OUTPUT_NAMES[key]}",
                "Root mean square, predicted from the inputs alone with parameters fitted on other parts.",
            )
        )
    return tiles


def _findings_table(diagnosis: DynamicsDiagnosis) -> HtmlTable:
    heads = ("effect", "status", "p-value", "confidence", "held-out gain (nats)", "shows in")
    rows = tuple(
        (
            Cell(finding_title(one), link=f"finding-{number}"),
            Cell(one.status),
            Cell(p_text(one), one.p_value, number=True),
            Cell(f"{one.confidence:.3f}", number=True),
            Cell(f"{one.loglik_gain:.1f}", one.loglik_gain, number=True),
            Cell(OUTPUT_NAMES[one.where.channel]),
        )
        for number, one in enumerate(diagnosis.findings, 1)
    )
    return HtmlTable(heads, rows)


def _finding_view(finding: DynamicsFinding, number: int) -> DynamicsFindingView:
    charts = [chart for chart in (shape_chart(finding), residual_chart(finding)) if chart is not None]
    rows = tuple(
        (
            Cell(parameter_name(name)),
            Cell(f"{one.value:.4g} ± {one.std:.2g} {one.unit if one.unit != '1' else ''}"),
        )
        for name, one in finding.parameters.items()
    )
    return DynamicsFindingView(
        finding_title(finding),
        finding.effect,
        _finding_sentences(finding),
        HtmlTable(("parameter", "value ± one standard deviation"), rows),
        tuple(render_figure(chart, f"finding-{number}-{k}") for k, chart in enumerate(charts)),
    )


def _finding_sentences(finding: DynamicsFinding) -> tuple[str, ...]:
    effect = DYNAMICS_EFFECTS[finding.effect]
    where = OUTPUT_NAMES[finding.where.channel]
    over = finding.where.covariate
    location = f"It shows most in the {where}" + (f", over {covariate_name(over)}" if over else "")
    if finding.where.range is not None:
        location += f" from {finding.where.range[0]:.3g} to {finding.where.range[1]:.3g}"
    out = [f"{effect.wording.formula}." if effect.wording.formula else "", f"{location}."]
    for start, end in finding.where.time_spans:
        out.append(f"It acts from {start:.0f} to {end:.0f} s.")
    if finding.may_be_proxy:
        out.append("It may be a proxy of something that no effect of the catalogue describes.")
    if finding.indistinguishable_from:
        out.append(f"Confounded on this drive with: {', '.join(finding.indistinguishable_from)}.")
        if finding.distinguished_by:
            out.append(f"To part them, {finding.distinguished_by}.")
    return tuple(sentence for sentence in out if sentence)


def _outputs_table(diagnosis: DynamicsDiagnosis) -> HtmlTable:
    heads = ("output", "unit", "error before", "after", "rating before", "after")
    rows = tuple(
        (
            Cell(OUTPUT_NAMES[name]),
            Cell(fit.unit),
            *(
                Cell(f"{value:.3g}", value, number=True)
                for value in (fit.rms_before, fit.rms_after, fit.rating_before, fit.rating_after)
            ),
        )
        for name, fit in diagnosis.outputs.items()
    )
    return HtmlTable(heads, rows)


def _step_table(diagnosis: DynamicsDiagnosis) -> HtmlTable:
    """Return the error of each output after each step, the baseline first."""
    names = list(diagnosis.outputs)
    heads = ("model", *(f"{OUTPUT_NAMES[name]} ({diagnosis.outputs[name].unit})" for name in names))
    rows = []
    for step in diagnosis.steps:
        model = ", ".join(step.effects) if step.effects else f"{diagnosis.baseline} alone"
        errors = (Cell(f"{step.rms[name]:.3g}", step.rms[name], number=True) for name in names)
        rows.append((Cell(model), *errors))
    return HtmlTable(heads, tuple(rows))


def _undetected_table(diagnosis: DynamicsDiagnosis) -> HtmlTable:
    rows = []
    for one in diagnosis.not_detectable:
        sizes = [
            f"{parameter_name(name)} {size:.3g} {unit if unit != '1' else ''}".strip()
            for name, (size, unit) in one.smallest.items()
            if size is not None
        ]
        rows.append((Cell(one.effect), Cell(", ".join(sizes) if sizes else "none would")))
    return HtmlTable(("effect", "smallest size that would have shown"), tuple(rows))


def gain_bars(diagnosis: DynamicsDiagnosis) -> Bars | None:
    """Return the held-out gain of each finding; None without findings."""
    rows = tuple((finding_title(one), one.loglik_gain, True) for one in diagnosis.findings)
    return Bars("Log-likelihood gain of each finding", "held-out gain (nats)", rows) if rows else None


def output_chart(diagnosis: DynamicsDiagnosis, name: str, points: int = POINTS) -> Chart | None:
    """Return an output over the drive: recorded, and predicted before and after; None where it is not
    known."""
    curves = diagnosis.curves.get(name)
    if curves is None or diagnosis.time_s is None:
        return None
    kinds = {"recorded": curves.recorded, "the baseline": curves.before, "with the findings": curves.after}
    if not diagnosis.findings:
        kinds.pop("with the findings")
    time, thin = decimated(np.asarray(diagnosis.time_s), kinds, points)
    styles = {"recorded": "plain", "the baseline": "before", "with the findings": "after"}
    unit = diagnosis.outputs[name].unit
    return Chart(
        f"{OUTPUT_NAMES[name].capitalize()}: recorded and predicted",
        TIME_LABEL,
        f"{OUTPUT_NAMES[name]} ({unit})",
        time,
        tuple(Curve(kind, values, styles[kind]) for kind, values in thin.items()),
        group="outputs",
        time=True,
    )


def residual_chart(finding: DynamicsFinding) -> Chart | None:
    """Return mean residuals over the finding's covariate, without it and with it; None where there are
    none."""
    one = finding.residuals
    if one is None:
        return None
    title = f"Residual of the {OUTPUT_NAMES[finding.where.channel]} over {covariate_name(one.covariate)}"
    return before_after_chart(title, "mean residual (standard deviations)", one)


def shape_chart(finding: DynamicsFinding) -> Chart | None:
    """Return the fitted curve of a spline with one standard deviation; None where the finding has none."""
    if not finding.shape:
        return None
    table: FloatArray = np.array(finding.shape, dtype=np.float64)
    at, value, std = table.T
    name = finding.where.covariate or "time"
    unit = next((one.unit for one in finding.parameters.values()), "")
    curve = Curve("fitted term ± one standard deviation", value, "after", value - std, value + std, True)
    return Chart(
        f"Fitted term over {covariate_name(name)}", covariate_label(name), f"added ({unit})", at, (curve,)
    )
