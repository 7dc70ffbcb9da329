"""The page and the picture of a diagnosis of vehicle dynamics."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import pytest

from tests.offline.dynamics.drives import folder, hidden, loaded
from tpmsd.offline.dynamics.diagnose import diagnose_dynamics
from tpmsd.offline.dynamics.result import DynamicsDiagnosis
from tpmsd.offline.dynamics.summary import dynamics_summary, summary_sentences
from tpmsd.offline.report.dynamics_page import dynamics_page, gain_bars, output_chart, residual_chart
from tpmsd.offline.report.dynamics_plot import draw_dynamics, plot_dynamics
from tpmsd.offline.report.page import Origin

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")


class Words(HTMLParser):
    """Text of a page without styles and scripts."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []
        self.inside: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        """Note the element."""
        if tag in ("script", "style"):
            self.inside.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """Leave it."""
        if self.inside and tag == self.inside[-1]:
            self.inside.pop()

    def handle_data(self, data: str) -> None:
        """Keep the text."""
        if not self.inside:
            self.words += data.split()


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory: pytest.TempPathFactory) -> DynamicsDiagnosis:
    """A car that is slower to turn than configured."""
    where = tmp_path_factory.mktemp("page") / "d"
    folder(where, hidden(yaw_inertia_error={"relative": 0.25}), duration_s=40.0)
    return diagnose_dynamics(*loaded(where, "single-track"))


def test_the_page_says_the_answer_first(diagnosis: DynamicsDiagnosis) -> None:
    """The same first sentence as the text, then every number of it, and nothing from outside."""
    page = dynamics_page(diagnosis, "monday", Origin.now({}))
    parser = Words()
    parser.feed(page)
    text = " ".join(parser.words)

    assert summary_sentences(diagnosis)[0] in text
    assert text.index("leaves out") < text.index("Findings")
    for fit in diagnosis.outputs.values():
        assert f"{fit.rms_before:.3g} → {fit.rms_after:.3g}" in text
    assert " ".join(dynamics_summary(diagnosis, None).split()) in text
    assert "src=" not in page
    assert 'href="http' not in page


def test_charts_show_recorded_and_predicted(diagnosis: DynamicsDiagnosis) -> None:
    """Three curves where something was found; the residual shrinks over the finding's covariate."""
    chart = output_chart(diagnosis, "yaw_rate")
    bars = gain_bars(diagnosis)
    residuals = residual_chart(diagnosis.findings[0])

    assert chart is not None
    assert [curve.name for curve in chart.curves] == ["recorded", "the baseline", "with the findings"]
    assert bars is not None
    assert bars.rows[0][1] == diagnosis.findings[0].loglik_gain
    assert residuals is not None
    before, after = residuals.curves
    assert float(abs(before.y).max()) > 2.0 * float(abs(after.y).max())


def test_the_picture_has_a_panel_for_each_output(diagnosis: DynamicsDiagnosis, tmp_path: Path) -> None:
    """And one for the steps."""
    figure = draw_dynamics(diagnosis, "monday")

    assert len(figure.axes) == len(diagnosis.outputs) + 1
    assert plot_dynamics(diagnosis, "monday", ".png").startswith(b"\x89PNG")


def test_insufficient_data_is_a_page_too() -> None:
    """The reason stands in the head, in the picture as well."""
    none = DynamicsDiagnosis("insufficient_data", "2 s of driving", "single-track", False, (), 2.0)

    assert "2 s of driving" in dynamics_page(none, "monday", Origin.now({}))
    assert len(draw_dynamics(none, "monday").axes) == 1
