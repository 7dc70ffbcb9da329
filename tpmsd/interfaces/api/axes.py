"""Axes for the plots that results make of themselves.

In: the caller's axes, or None. Out: these, or new ones in a figure of their own. matplotlib is an extra.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tpmsd.offline.tables.extras import import_extra

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def given_or_new_axes(ax: Axes | None) -> Axes:
    """Return `ax`, or the axes of a new figure that leaves room for its labels; ConfigError without
    matplotlib."""
    if ax is not None:
        return ax
    _, made = import_extra("matplotlib.pyplot", "plot", "plots").subplots(layout="constrained")
    axes: Axes = made
    return axes
