"""A diagnosis of vehicle dynamics as one picture: PNG, SVG or PDF by the file's suffix.

In: `DynamicsDiagnosis`. Out: the matplotlib figure (`draw_dynamics`), or the picture's bytes
(`plot_dynamics`): each output over the drive, recorded and predicted before and after, and how its error
shrinks with each effect. matplotlib is the optional extra `tpmsd[plot]`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tpmsd.foundation.palette import STYLES, line_style
from tpmsd.offline.dynamics.result import DynamicsDiagnosis
from tpmsd.offline.dynamics.summary import OUTPUT_NAMES, summary_sentences
from tpmsd.offline.report.dynamics_page import output_chart
from tpmsd.offline.report.replay_plot import picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL_IN = (8.0, 2.2)
POINTS = 1600


def plot_dynamics(diagnosis: DynamicsDiagnosis, name: str, suffix: str) -> bytes:
    """Return the diagnosis as a picture of the form `suffix`."""
    return picture(draw_dynamics(diagnosis, name), suffix)


def draw_dynamics(diagnosis: DynamicsDiagnosis, name: str) -> Figure:
    """Return the figure; one panel says why where nothing can be concluded."""
    from matplotlib.figure import Figure

    outputs = list(diagnosis.curves)
    steps = len(diagnosis.steps) > 1
    panels = max(len(outputs) + steps, 1)
    figure = Figure(figsize=(PANEL_IN[0], PANEL_IN[1] * panels + 0.5), layout="constrained")
    figure.suptitle(f"{name} against {diagnosis.baseline}: {diagnosis.verdict}")
    if not outputs:
        axes = figure.add_subplot()
        text = summary_sentences(diagnosis)[0]
        axes.text(0.5, 0.5, text, ha="center", va="center", wrap=True, transform=axes.transAxes)
        axes.set(xticks=[], yticks=[])
        return figure
    for k, output in enumerate(outputs):
        _draw_output(figure.add_subplot(panels, 1, k + 1), diagnosis, output, k == 0)
    if steps:
        _draw_steps(figure.add_subplot(panels, 1, panels), diagnosis)
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_output(axes: Axes, diagnosis: DynamicsDiagnosis, name: str, first: bool) -> None:
    chart = output_chart(diagnosis, name, POINTS)
    assert chart is not None
    for curve in chart.curves:
        axes.plot(chart.x, curve.y, lw=0.8, label=curve.name, **line_style(curve.style))
    axes.set(ylabel=chart.y_label, xlabel="time since the start (s)")
    if first:
        axes.legend(frameon=False, fontsize=8, ncols=3, loc="lower right", bbox_to_anchor=(1.0, 0.98))


def _draw_steps(axes: Axes, diagnosis: DynamicsDiagnosis) -> None:
    """Draw the error of each output over that of the baseline, after each step."""
    roles = ("fl", "fr", "rl", "rr", "plain", "soft")
    for role, name in zip(roles, diagnosis.outputs, strict=False):
        first = diagnosis.steps[0].rms[name]
        shares = [step.rms[name] / first if first > 0.0 else 1.0 for step in diagnosis.steps]
        axes.plot(shares, marker="o", ms=4, label=OUTPUT_NAMES[name], **line_style(role))
    labels = [diagnosis.baseline]
    for before, after in zip(diagnosis.steps, diagnosis.steps[1:], strict=False):
        new = [effect for effect in after.effects if effect not in before.effects]
        gone = [effect for effect in before.effects if effect not in after.effects]
        labels.append(
            "\n".join([*(f"+ {one}" for one in new), *(f"- {one}" for one in gone)]) or "fitted again"
        )
    axes.set_xticks(range(len(labels)), labels, fontsize=7)
    axes.axhline(1.0, color=STYLES["line"].colour, lw=1)
    axes.set(ylim=(0.0, None), ylabel="error over\nthe baseline's")
    axes.legend(frameon=False, fontsize=8)
