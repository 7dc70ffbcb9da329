"""The picture: every panel carries the drive's own numbers."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from tests.offline.report.drives import MONITOR, START_S, VEHICLE, Drive, alarm, puncture
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.report.replay_plot import check_plot_target, draw_replay, plot_replay
from tpmsd.offline.report.replay_recorder import ReplayRecorder
from tpmsd.onboard.monitor.records import WheelState

matplotlib = pytest.importorskip("matplotlib", reason="the plot extra is not installed")

from matplotlib.artist import Artist  # noqa: E402  only once it is known to be there
from matplotlib.figure import Figure  # noqa: E402
from matplotlib.lines import Line2D  # noqa: E402
from matplotlib.patches import Rectangle  # noqa: E402


def named(figure: Figure, gid: str) -> list[Artist]:
    """The artists of this name in all panels."""
    artists: Iterable[Artist] = (artist for axis in figure.axes for artist in axis.get_children())
    return [artist for artist in artists if artist.get_gid() == gid]


def line(figure: Figure, gid: str) -> tuple[np.ndarray, np.ndarray]:
    """The data of the one line of this name."""
    (artist,) = named(figure, gid)
    assert isinstance(artist, Line2D)
    return np.asarray(artist.get_xdata()), np.asarray(artist.get_ydata())


def spans(figure: Figure, gid: str) -> list[tuple[float, float]]:
    """From where to where the shaded spans of this name reach, in seconds of drive time."""
    found = [artist for artist in named(figure, gid) if isinstance(artist, Rectangle)]
    return [(span.get_x(), span.get_x() + span.get_width()) for span in found]


@pytest.fixture(scope="module")
def picture() -> Figure:
    """The picture of the puncture."""
    return draw_replay(puncture().record().result(2.0))


def test_deviations_are_drawn_in_millimetres_over_drive_time(picture: Figure) -> None:
    """Each wheel's curve is its series; the punctured one ends 2.2 mm below where it began."""
    times, values = line(picture, "deviation rl")

    assert 600.0 == pytest.approx(times[-1], abs=1e-5)
    assert 0.4 == pytest.approx(values[0])
    assert -1.8 == pytest.approx(values[-1])
    for wheel in ("fl", "fr", "rr"):
        assert len(times) == len(line(picture, f"deviation {wheel}")[1])


def test_bands_are_two_standard_deviations_wide(picture: Figure) -> None:
    """At the end the band reaches 0.2 mm either side of the curve."""
    (band,) = named(picture, "band deviation rl")
    vertices = band.get_paths()[0].vertices  # type: ignore[attr-defined]
    at_the_end = vertices[np.isclose(vertices[:, 0], 600.0, atol=1e-4), 1]

    assert -2.0 == pytest.approx(at_the_end.min(), abs=1e-6)
    assert -1.6 == pytest.approx(at_the_end.max(), abs=1e-6)


def test_the_alarm_is_marked_where_and_when_it_was_raised(picture: Figure) -> None:
    """A line in both upper panels, a mark on the curve, a label with the time, the verdict as the title."""
    lines = named(picture, "alarm deflation rl raised") + named(picture, "moment deflation RL 5:41")
    assert 2 == len(lines)
    for artist in lines:
        assert isinstance(artist, Line2D)
        assert 341.2 == pytest.approx(artist.get_xdata()[0], abs=1e-5)  # type: ignore[index]
    x, y = line(picture, "mark deflation rl raised")
    assert (341.2, -1.11) == pytest.approx((x[0], y[0]), abs=1e-5)
    assert "deflation RL 5:41" in [text.get_text() for text in picture.axes[0].texts]
    assert "evening-drive: rear left tyre is losing air, announced at 5:41" == picture.get_suptitle()


def test_the_thresholds_are_drawn(picture: Figure) -> None:
    """0.35 % and 0.8 % of 316 mm against the baseline, and none against nominal."""
    assert -1.106 == pytest.approx(line(picture, "limit -1.106")[1][0])
    assert -2.528 == pytest.approx(line(picture, "limit -2.528")[1][0])
    assert 2.528 == pytest.approx(line(picture, "limit +2.528")[1][0])
    assert [] == [one for one in picture.axes[1].get_children() if str(one.get_gid()).startswith("limit")]


def test_speed_is_drawn_with_outages_and_standstill_shaded(picture: Figure) -> None:
    """The stop is grey; the tunnel is shaded from the last fix to the next one."""
    _, kmh = line(picture, "speed")
    (idle,) = spans(picture, "not informative")
    tunnels = [span for span in spans(picture, "gnss gap") if span[0] > 10]

    assert 25.0 * 3.6 == pytest.approx(kmh.max(), abs=0.1)
    assert (100.0, 130.0) == pytest.approx(idle, abs=0.35)
    assert [(420.0, 450.0)] == [pytest.approx(span, abs=0.35) for span in tunnels]


def test_the_probability_strip_has_a_row_per_wheel(picture: Figure) -> None:
    """The punctured wheel's row ends at one, the others' at zero, and the learning time is unknown."""
    (image,) = named(picture, "probability")
    values = np.ma.filled(np.ma.asarray(image.get_array()), np.nan)  # type: ignore[attr-defined]

    assert 4 == values.shape[0]
    np.testing.assert_allclose([0.0, 0.0, 1.0, 0.0], values[:, -1], atol=1e-6)
    assert np.isnan(values[:, 0]).all()


def test_faults_have_a_panel_only_where_there_were_some(picture: Figure) -> None:
    """The counts so far of both inputs; a clean drive has one panel less."""
    _, can = line(picture, "faults CAN")
    _, gnss = line(picture, "faults GNSS")

    assert (21.0, 1.0) == (can[-1], gnss[-1])
    clean = draw_replay(Drive(duration_s=90.0).record().result(1.0))
    assert [] == named(clean, "faults CAN")
    assert len(picture.axes) - 1 == len(clean.axes)


def test_every_panel_is_labelled_with_its_unit(picture: Figure) -> None:
    """Millimetres, kilometres per hour, and minutes below."""
    labels = " ".join(axis.get_ylabel() + axis.get_xlabel() for axis in picture.axes)

    for unit in ("(mm)", "(km/h)", "(min:s)"):
        assert unit in labels
    assert "0:00 is 2024-07-01 08:00:00 UTC" in labels


def test_a_pause_of_the_recording_interrupts_the_curves() -> None:
    """No line is drawn over a time in which nothing was recorded."""
    figure = draw_replay(Drive(duration_s=120.0, pauses={600: 60.0}).record().result(1.0))
    times, values = line(figure, "deviation fl")
    (hole,) = np.flatnonzero(np.isnan(values))

    assert 60.0 == pytest.approx(times[hole - 1], abs=0.11)
    assert 120.1 == pytest.approx(times[hole + 1], abs=0.11)


def test_the_filters_first_ignorance_does_not_flatten_the_rest() -> None:
    """A band of metres in the first seconds leaves the axis at the millimetres that follow."""
    figure = draw_replay(Drive(std_m=lambda t: 1.0 if t < 5 else 1e-4).record().result(1.0))
    low, high = figure.axes[0].get_ylim()

    assert -5.0 < low < -0.8
    assert 1.9 < high < 5.0


def test_labels_that_would_cover_each_other_are_counted_instead() -> None:
    """Twenty alarms within a minute: three labels, and a note about the other seventeen."""
    events = {600 + 20 * k: (alarm(60.0 + 2 * k),) for k in range(20)}
    figure = draw_replay(Drive(events=events).record().result(1.0))

    assert 3 == len([text for text in figure.axes[0].texts if "deflation RL" in text.get_text()])
    assert figure.axes[1].get_title(loc="right").startswith("17 more changes of alarms")


def test_wheels_that_are_not_on_the_bus_are_not_drawn() -> None:
    """The rear pair alone: two curves, and a title that does not promise more."""
    figure = draw_replay(
        Drive(
            duration_s=30.0,
            state=lambda t, wheel: WheelState.LEARNING if wheel[0] == "r" else WheelState.UNAVAILABLE,
        )
        .record()
        .result(1.0)
    )

    assert ([], []) == (named(figure, "deviation fl"), named(figure, "change rl"))
    assert 1 == len(named(figure, "deviation rl"))
    assert "evening-drive: no alarm, but no wheel was monitored either" == figure.get_suptitle()


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_the_suffix_chooses_the_format(suffix: str, magic: bytes) -> None:
    """PNG, SVG and PDF are written as such."""
    assert plot_replay(Drive(duration_s=90.0, dt_s=0.5).record().result(1.0), suffix).startswith(magic)


def test_the_png_is_1200_pixels_wide_and_not_blank() -> None:
    """The picture has the promised width, and the colours of all four wheels."""
    from matplotlib.colors import to_rgb
    from matplotlib.image import imread

    from tpmsd.foundation.palette import STYLES

    pixels = imread(io.BytesIO(plot_replay(puncture().record().result(1.0), ".png")))[:, :, :3]

    assert 1200 == pixels.shape[1]
    for colour in (STYLES[wheel].colour for wheel in WHEELS):
        assert (np.abs(pixels - np.array(to_rgb(colour))).max(axis=2) < 0.01).sum() > 500


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("drive.bmp", "a plot ends in .png, .svg, .pdf, not in '.bmp'"),
        ("drive", "a plot ends in .png, .svg, .pdf, not in 'nothing'"),
    ],
)
def test_a_target_that_cannot_be_is_refused_in_one_line(tmp_path: Path, name: str, reason: str) -> None:
    """A wrong suffix is a ConfigError that names the file."""
    with pytest.raises(ConfigError, match=reason.replace(".", r"\.")) as caught:
        check_plot_target(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert name in str(caught.value)


def test_without_matplotlib_one_line_says_how_to_install_it(tmp_path: Path) -> None:
    """The missing extra is a ConfigError with the command that installs it; the import still works."""
    program = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "from pathlib import Path\n"
        "from tpmsd.foundation.errors import ConfigError\n"
        "from tpmsd.offline.report.replay_plot import check_plot_target\n"
        "try: check_plot_target(Path(sys.argv[1]))\n"
        "except ConfigError as error: print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "drive.png")],
        capture_output=True,
        text=True,
        check=True,
    )

    assert "plots need matplotlib, which is not installed: pip install 'tpmsd[plot]'\n" == done.stdout


def test_an_empty_drive_has_a_picture() -> None:
    """Not one tick: the picture says that there is nothing to draw."""
    result = ReplayRecorder("empty", VEHICLE, MONITOR).result(1.0)

    assert plot_replay(result, ".png").startswith(b"\x89PNG")
    assert "no ticks: nothing to draw" in [text.get_text() for text in draw_replay(result).texts]


def test_one_tick_is_enough_for_a_picture() -> None:
    """A single tick is drawn without a warning about empty axes."""
    figure = draw_replay(Drive(duration_s=0.1).record().result(1.0))

    assert START_S + 0.1 == pytest.approx(line(figure, "deviation fl")[0][0] + START_S)
