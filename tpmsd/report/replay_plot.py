"""A replayed drive as a picture: PNG, SVG or PDF by the file's suffix.

In: a `ReplayResult` and a file name. Out: the file (`plot_replay`), or the matplotlib figure (`draw_replay`).
matplotlib is the optional extra `tpmsd[plot]`; it is imported only to draw, and needs no display.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from tpmsd.errors import ConfigError
from tpmsd.report.replay_result import ReplayResult

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".svg", ".pdf")
DPI = 100


def check_plot_target(target: Path) -> None:
    """Say before a long replay what would stop its picture: ConfigError with one line."""
    if target.suffix.lower() not in SUFFIXES:
        raise ConfigError(
            f"{target}: a plot ends in {', '.join(SUFFIXES)}, not in {target.suffix or 'nothing'!r}"
        )
    if not target.parent.is_dir():
        raise ConfigError(f"{target}: there is no folder {target.parent}")
    if target.is_dir() or not os.access(target if target.exists() else target.parent, os.W_OK):
        raise ConfigError(f"{target}: cannot be written")
    _require_matplotlib()


def draw_replay(result: ReplayResult) -> Figure:
    """The figure: deviation, change against the baseline, probability of deflation, speed, faults if any.

    ConfigError if matplotlib is not installed.
    """
    _require_matplotlib()
    from tpmsd.report.replay_panels import draw  # needs matplotlib

    return draw(result)


def plot_replay(result: ReplayResult, target: Path) -> None:
    """Draw the drive into `target`; ConfigError for a wrong suffix, no such folder or no matplotlib."""
    check_plot_target(target)
    figure = draw_replay(result)
    try:
        figure.savefig(target, dpi=DPI)
    except OSError as error:
        raise ConfigError(f"{target}: {error.strerror or error}") from error


def _require_matplotlib() -> None:
    try:
        import matplotlib  # noqa: F401  only whether it is there
    except ImportError:
        raise ConfigError(
            "plots need matplotlib, which is not installed: pip install 'tpmsd[plot]'"
        ) from None
