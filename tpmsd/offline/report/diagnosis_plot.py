"""A diagnosis as one picture: PNG, SVG or PDF by the file's suffix.

In: `RollingDiagnosis`. Out: the matplotlib figure (`draw_diagnosis`), or the picture's bytes
(`plot_diagnosis`): for each of the strongest findings the residual over the covariate where it is located,
before and after, under its name and value; and the held-out gain of all findings. matplotlib is the optional
extra `tpmsd[plot]`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tpmsd.foundation.palette import STYLES
from tpmsd.offline.diagnosis.assessment.result import FINDING, Finding, RollingDiagnosis, Trace
from tpmsd.offline.report.diagnosis_figures import NOISE_STD, covariate_label
from tpmsd.offline.report.diagnosis_summary import quantity_text
from tpmsd.offline.report.replay_plot import check_plot_target, picture
from tpmsd.offline.report.simulation_text import agreement, baseline_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["check_plot_target", "draw_diagnosis", "plot_diagnosis"]

MAX_TRACES = 4
MAX_BARS = 10
PANEL_IN = (5.6, 3.1)
MAX_TITLE = 64
"""Letters that stand above a panel of this width."""


def plot_diagnosis(diagnosis: RollingDiagnosis, names: list[str], suffix: str) -> bytes:
    """Return the diagnosis as a picture of the form `suffix` (one of `SUFFIXES`)."""
    return picture(draw_diagnosis(diagnosis, names), suffix)


def draw_diagnosis(diagnosis: RollingDiagnosis, names: list[str]) -> Figure:
    """Return the figure; `names` of the drives stand above it. One panel says so where nothing was found."""
    from matplotlib.figure import Figure

    pairs = _findings_with_trace(diagnosis)[:MAX_TRACES]
    panels = len(pairs) + 1
    columns = 1 if panels == 1 else 2
    rows = -(-panels // columns)
    figure = Figure(figsize=(PANEL_IN[0] * columns, PANEL_IN[1] * rows + 0.5), layout="constrained")
    figure.suptitle(f"{', '.join(names)} against {baseline_name(diagnosis)}: {diagnosis.verdict}")
    grid = figure.add_gridspec(rows, columns)
    for k, (finding, trace) in enumerate(pairs):
        _draw_trace(figure.add_subplot(grid[k // columns, k % columns]), finding, trace)
    last = grid[-1, :] if panels % 2 else grid[-1, -1]
    _draw_gains(figure.add_subplot(last), diagnosis)
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _findings_with_trace(diagnosis: RollingDiagnosis) -> list[tuple[Finding, Trace]]:
    """Return the findings that have a residual trace, each with its trace, the strongest first."""
    traces = list(diagnosis.inner.traces) if diagnosis.inner is not None else []
    out = []
    for finding in diagnosis.findings:
        mine = [one for one in traces if one.effect == finding.effect]
        exact = [one for one in mine if one.covariate == finding.where.covariate]
        if mine:
            trace = (exact or mine)[0]
            traces = [one for one in traces if one is not trace]
            out.append((finding, trace))
    return out


def _draw_trace(axes: Axes, finding: Finding, trace: Trace) -> None:
    axes.axhspan(-NOISE_STD, NOISE_STD, color=STYLES["line"].colour, alpha=0.3, lw=0)
    for values, style, label in (
        (trace.before, "before", "without this effect"),
        (trace.after, "after", "with it"),
    ):
        axes.plot(trace.middle, values, "o-", ms=4, lw=1, color=STYLES[style].colour, label=label)
    axes.set(xlabel=covariate_label(trace.covariate), ylabel="residual (std. dev.)")
    axes.set_title(panel_title(finding), fontsize=9)
    axes.legend(frameon=False, fontsize=8)


def panel_title(finding: Finding) -> str:
    """Return effect and parameter values in one line, cut to `MAX_TITLE`; a suspicion is marked as one."""
    values = ", ".join(f"{name} = {quantity_text(one)}" for name, one in finding.parameters.items()).replace(
        "+-", "±"
    )
    text = f"{finding.effect}: {values}" if values else finding.effect
    if finding.status != FINDING:
        text += " (suspicion)"
    return text if len(text) <= MAX_TITLE else f"{text[: MAX_TITLE - 3]}..."


def _draw_gains(axes: Axes, diagnosis: RollingDiagnosis) -> None:
    found = diagnosis.findings[:MAX_BARS][::-1]
    if not found:
        text = diagnosis.reason if diagnosis.reason else agreement(diagnosis)
        axes.text(0.5, 0.5, text, ha="center", va="center", wrap=True, transform=axes.transAxes)
        axes.set(xticks=[], yticks=[])
        return
    gains = [finding.gain for finding in found]
    bars = axes.barh(range(len(found)), gains, color=STYLES["after"].colour)
    for bar, finding in zip(bars, found, strict=True):
        if finding.status != FINDING:
            bar.set(facecolor="none", edgecolor=STYLES["after"].colour, hatch="//")
    axes.bar_label(bars, [f"{gain:.0f}" if gain >= 100.0 else f"{gain:.3g}" for gain in gains], padding=3)
    axes.set_yticks(range(len(found)), [finding.effect for finding in found])
    axes.set_xscale("symlog")
    axes.set_xlim(min(0.0, *gains), 10.0 * max(1.0, *gains))
    axes.set_xlabel("held-out log-likelihood gain (nats)")
