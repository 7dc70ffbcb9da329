"""A diagnosis as one picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tpmsd.car.physics.model import ExtendedModel
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.diagnosis.assessment.result import (
    CONSISTENT,
    MISMATCH,
    SUSPICION,
    Finding,
    PictureData,
    Quantity,
    RollingDiagnosis,
    Trace,
    Where,
)
from tpmsd.offline.report.diagnosis_plot import draw_diagnosis, plot_diagnosis

SPEEDS = np.array([5.0, 15.0, 25.0, 35.0])


def finding(effect: str, gain: float, status: str = "finding") -> Finding:
    """One over speed."""
    values = {"coefficient": Quantity(2e-6, 1e-7, "s2/m")}
    where = Where(("fl",), "wheel", "speed", (5.0, 35.0))
    return Finding(effect, 1.0, values, where, 1.0, 0.9, 0.1, gain, (), status=status)


def diagnosis(*findings: Finding, baseline: tuple[str, ...] = ("rolling",)) -> RollingDiagnosis:
    """With a residual that grows before and is flat after, for each finding."""
    traces = tuple(Trace(one.effect, "speed", SPEEDS, 0.1 * SPEEDS, 0.0 * SPEEDS) for one in findings)
    verdict = MISMATCH if findings else CONSISTENT
    return RollingDiagnosis(
        verdict,
        "",
        findings,
        300.0,
        1.0,
        -1.0,
        0.9,
        None,
        ExtendedModel(),
        baseline=baseline,
        inner=PictureData({}, traces, None),
    )


def test_each_finding_has_its_residual_before_and_after_under_its_name_and_value() -> None:
    """The strongest four; a suspicion says so; the last panel holds the gain of all."""
    names = [f"effect_{k}" for k in range(5)]
    found = [finding(name, 500.0 - 90.0 * k) for k, name in enumerate(names)]
    found[1] = finding("effect_1", 400.0, SUSPICION)
    figure = draw_diagnosis(diagnosis(*found), ["monday"])

    *traces, gains = figure.axes
    assert 4 == len(traces)
    assert "effect_0: coefficient = 2e-06 ± 1e-07 s2/m" == traces[0].get_title()
    assert traces[1].get_title().endswith("(suspicion)")
    for axes in traces:
        before, after = (line.get_ydata() for line in axes.get_lines())
        assert np.allclose(0.1 * SPEEDS, np.asarray(before))
        assert np.allclose(0.0, np.asarray(after))
        assert "speed (m/s)" == axes.get_xlabel()
    assert names[::-1] == [label.get_text() for label in gains.get_yticklabels()]
    assert [True, False] == [bool(bar.get_hatch()) for bar in gains.patches[::-1][1:3]]
    assert "monday against the rolling model: mismatch" == figure.get_suptitle()


@pytest.mark.parametrize(
    ("baseline", "said"),
    [
        (("rolling",), "no missing physics was found"),
        (("rolling", "wear"), "with this model nothing is left"),
    ],
)
def test_a_drive_in_which_nothing_was_found_says_so(baseline: tuple[str, ...], said: str) -> None:
    """One panel with the sentence of the summary, against the baseline that was asked."""
    figure = draw_diagnosis(diagnosis(baseline=baseline), ["monday"])

    (axes,) = figure.axes
    assert said in axes.texts[0].get_text()
    assert figure.get_suptitle().endswith("consistent")


@pytest.mark.parametrize(("suffix", "head"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_the_suffix_tells_the_form(suffix: str, head: bytes) -> None:
    """PNG, SVG and PDF."""
    assert plot_diagnosis(diagnosis(finding("wear", 50.0)), ["monday"], suffix).startswith(head)


def test_a_picture_that_nobody_can_draw_is_refused_before_the_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The drive need not even be there."""
    assert 2 == main(["diagnose", str(tmp_path / "none"), "--plot", str(tmp_path / "picture.docx")])
    assert "a plot ends in .png, .svg, .pdf, not in '.docx'" in capsys.readouterr().err
