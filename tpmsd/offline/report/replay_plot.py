"""A replayed drive as a picture: PNG, SVG or PDF by the file's suffix.

In: a `ReplayResult`. Out: the matplotlib figure (`draw_replay`), or the picture's bytes (`plot_replay`).
matplotlib is the optional extra `tpmsd[plot]`; it is imported only to draw, and needs no display.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.report.replay_result import ReplayResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".svg", ".pdf")
DPI = 100


def check_plot_target(target: Path) -> None:
    """Raise ConfigError, before a long replay, for a suffix that is no picture or a missing matplotlib."""
    if target.suffix.lower() not in SUFFIXES:
        raise ConfigError(
            f"{target}: a plot ends in {', '.join(SUFFIXES)}, not in {target.suffix or 'nothing'!r}"
        )
    _require_matplotlib()


def draw_replay(result: ReplayResult) -> Figure:
    """Return the figure: deviation, change against the baseline, probability of deflation, speed, faults if
    any.

    ConfigError if matplotlib is not installed.
    """
    _require_matplotlib()
    from tpmsd.offline.report.replay_panels import draw_panels  # needs matplotlib

    return draw_panels(result)


def plot_replay(result: ReplayResult, suffix: str) -> bytes:
    """Return the drive as a picture of the form `suffix` (one of `SUFFIXES`)."""
    return picture(draw_replay(result), suffix)


def picture(figure: Figure, suffix: str) -> bytes:
    """Return a figure as the bytes of a file with this suffix (one of `SUFFIXES`)."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=DPI, format=suffix.lower().lstrip("."))
    return buffer.getvalue()


def _require_matplotlib() -> None:
    """Raise ConfigError if matplotlib is not installed."""
    try:
        import matplotlib  # noqa: F401  only whether it is there
    except ImportError:
        raise ConfigError(
            "plots need matplotlib, which is not installed: pip install 'tpmsd[plot]'"
        ) from None
