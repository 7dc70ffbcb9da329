"""The page of a replayed drive."""

from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest

from tests.offline.report.drives import MONITOR, VEHICLE, Drive, puncture
from tests.offline.report.pages import ORIGIN, Page
from tpmsd.foundation.palette import STYLES
from tpmsd.offline.report.figures import Chart, Curve
from tpmsd.offline.report.mpl_style import place_labels
from tpmsd.offline.report.page import render, render_figure
from tpmsd.offline.report.replay_charts import replay_charts, replay_track
from tpmsd.offline.report.replay_page import replay_page
from tpmsd.offline.report.replay_recorder import ReplayRecorder
from tpmsd.onboard.monitor.records import WheelState

matplotlib = pytest.importorskip("matplotlib", reason="the report extra is not installed")

from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: E402  only once it is known to be there
from matplotlib.figure import Figure  # noqa: E402

CIRCLE = np.linspace(0.0, 2.0 * np.pi, 200)


@pytest.fixture(scope="module")
def html() -> str:
    """The page of the puncture with a track."""
    result = puncture().record().result(2.0)
    track = replay_track(result, 300.0 * np.cos(CIRCLE), 100.0 * np.sin(CIRCLE), CIRCLE, 100.0 * CIRCLE)
    return replay_page(result, ORIGIN, track, ["a frame was torn"])


def test_the_page_tells_the_drive(html: str) -> None:
    """Verdict, alarm with wheel and time, wheels, notes, and where it comes from."""
    page = Page(html)

    assert "Rear left tyre is losing air" in page.text
    assert "5:41|Deflation|rear left|raised|-1.11" in page.text
    assert "a frame was torn." in page.text
    assert "Made|2026-03-01 12:30 UTC|Program|tpmsd 9.9|" in page.text
    assert "Configuration hash|sha256:c|" in page.text


def test_the_page_stands_alone(html: str) -> None:
    """Nothing is loaded, identifiers are unique, and it is smaller than 3 MB."""
    page = Page(html)

    assert [] == page.loaded
    assert [] == re.findall(r"url\((?!#)|@import", html)
    assert {1} == set(page.ids.values())
    assert len(html) < 3_000_000


def test_every_figure_has_a_picture_and_data(html: str) -> None:
    """Readers without JavaScript see each figure; the script gets the same curves."""
    page = Page(html)

    assert page.tags["figure"] == page.tags["svg"] == len(page.data) >= 5
    change = page.data[0]
    assert ["front left", "front right", "rear left", "rear right"] == [
        one["name"] for one in change["curves"]
    ]
    assert -2.2 == pytest.approx(change["curves"][2]["y"][-1], abs=0.01)
    assert [("deflation RL", 341.2)] == [(one["name"], pytest.approx(one["at"])) for one in change["moments"]]
    assert page.data[-1]["kind"] == "track"


def test_the_ring_of_the_track_is_where_the_car_was(html: str) -> None:
    """Places of the track are in the coordinates of its picture: an ellipse of 3 to 1, start at the right."""
    data = Page(html).data[-1]
    x, y = np.array(data["x"]), np.array(data["y"])

    assert 3.0 == pytest.approx(np.ptp(x) / np.ptp(y), rel=0.02)
    assert 0 == int(np.argmax(x))
    assert y[len(y) // 4] < y[0] < y[3 * len(y) // 4]


def test_pictures_take_their_colours_from_the_page(html: str) -> None:
    """No colour of a role is left as a number, so that a dark theme reaches all of it; no inline style."""
    pictures = "".join(re.findall(r"<svg.*?</svg>", html, re.DOTALL))

    assert [] == [style.colour for style in STYLES.values() if style.colour in pictures]
    assert "var(--rl)" in pictures
    assert "style=" not in pictures


def test_names_that_would_end_a_script_do_not(html: str) -> None:
    """A name with a closing tag stays text, in the picture as in the data."""
    curve = Curve("</script><b>", np.array([0.0, 1.0]), "plain")
    other = Curve("more", np.array([1.0, 0.0]), "soft")
    one = render_figure(Chart("<i>", "x", "y", np.array([0.0, 1.0]), (curve, other)), "k")

    assert "</script" not in one.data
    assert "<b>" not in one.svg
    assert (
        "</script><b>"
        == Page(f'<script type="application/json">{one.data}</script>').data[0]["curves"][0]["name"]
    )


def test_a_page_of_the_server_links_its_assets() -> None:
    """Without inline styles and scripts, as the server's policy wants."""
    result = puncture().record().result(2.0)
    page = Page(replay_page(result, ORIGIN, standalone=False))

    assert "assets/report.js" in page.loaded
    assert 0 == page.tags["style"]


def test_an_empty_drive_has_a_page() -> None:
    """Not one tick: no figures, and the sentence that nothing was monitored."""
    page = Page(replay_page(ReplayRecorder("empty", VEHICLE, MONITOR).result(1.0), ORIGIN))

    assert 0 == page.tags["figure"]
    assert "no wheel was monitored" in page.text


def test_wheels_that_are_not_on_the_bus_are_left_out() -> None:
    """The rear pair alone: two curves, two rows."""
    drive = Drive(
        duration_s=30.0,
        state=lambda t, wheel: WheelState.LEARNING if wheel[0] == "r" else WheelState.UNAVAILABLE,
    )
    charts = {chart.title: chart for chart in replay_charts(drive.record().result(1.0))}

    assert ["rl", "rr"] == [curve.style for curve in charts["Radius minus nominal"].curves]
    assert "Radius minus learned baseline" not in charts


@pytest.mark.parametrize("width_in", [4.0, 12.0])
def test_names_of_alarms_never_cover_each_other(width_in: float) -> None:
    """Forty alarms, bunched and spread: no two names overlap, none leaves the plot, the rest is counted."""
    figure = Figure(figsize=(width_in, 2.7), dpi=72)
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.set(xlim=(0.0, 600.0), ylim=(-1.0, 1.0))
    times = [*np.linspace(100.0, 140.0, 20), *np.linspace(0.0, 600.0, 20)]
    moments = [(at, f"radius deviation {k}", "bad") for k, at in enumerate(sorted(times))]
    left_out = place_labels(axes, moments)
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts]

    assert 40 - left_out == len(boxes) >= 3
    assert [] == [(a, b) for k, a in enumerate(boxes) for b in boxes[:k] if a.overlaps(b)]
    assert all(-1.0 <= box.x0 - axes.bbox.x0 and box.x1 <= axes.bbox.x1 + 1.0 for box in boxes)
    assert 1.0 < axes.transData.inverted().transform((0.0, min(box.y0 for box in boxes)))[1]


def test_without_jinja2_one_line_says_how_to_install_it() -> None:
    """The missing extra is a ConfigError with the command that installs it, before any work."""
    program = (
        "import sys, importlib.util as u\n"
        "found = u.find_spec\n"
        "u.find_spec = lambda name, *rest: None if name == 'jinja2' else found(name, *rest)\n"
        "from tpmsd.foundation.errors import ConfigError\n"
        "from tpmsd.offline.report.page import check_report_packages\n"
        "try: check_report_packages()\n"
        "except ConfigError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert "HTML reports need jinja2, which is not installed: pip install 'tpmsd[report]'\n" == done.stdout


def test_a_template_that_lacks_a_value_fails() -> None:
    """A forgotten value is an error, not an empty place on a page."""
    from jinja2 import UndefinedError

    with pytest.raises(UndefinedError):
        render("replay.html", ORIGIN, True, drive="d")
