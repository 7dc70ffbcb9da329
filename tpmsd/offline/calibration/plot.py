"""A calibration as a picture: un-fused odometry before and after on the receiver's positions, radii by
iteration and against the configured ones.

In: `FittedGeometry`, its `Recording`s, the vehicle before and after. Out: a figure. matplotlib is the
optional extra `tpmsd[plot]` and needs no display.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tpmsd.car.config.model import VehicleConfig
from tpmsd.foundation.palette import STYLES, line_style
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.calibration.nominal import Vehicle, vehicle_of
from tpmsd.offline.calibration.odometry import OdometryStretch, odometry_stretches
from tpmsd.offline.calibration.result import FittedGeometry
from tpmsd.offline.inference.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LONG = 1.6
"""Times its height from which a track is drawn above the radii instead of beside them."""


def draw_calibration(
    found: FittedGeometry, recordings: list[Recording], config: VehicleConfig, car: Vehicle
) -> Figure:
    """Return the figure: tracks, radii by iteration, radii against the configured ones."""
    from matplotlib.figure import Figure

    paths = {
        name: [piece for recording in recordings for piece in odometry_stretches(recording, vehicle)]
        for name, vehicle in (("before", vehicle_of(config)), ("after", car))
    }
    positions = [piece.position_m for piece in paths["before"]]
    extent = np.ptp(np.concatenate(positions), axis=0) if positions else np.ones(2)
    long = extent[0] > LONG * extent[1]
    figure = Figure(figsize=(10.5, 7.5) if long else (12.5, 5.2), layout="constrained")
    if long:
        grid = figure.add_gridspec(
            2, 2, height_ratios=[max(0.45, 1.2 * extent[1] / extent[0]), 1.0], width_ratios=[1.6, 1.0]
        )
        track_axes, course, radii = (
            figure.add_subplot(grid[at]) for at in ((0, slice(None)), (1, 0), (1, 1))
        )
    else:
        track_axes, course, radii = figure.subplots(1, 3, width_ratios=[1.5, 1.2, 0.8])
    _draw_tracks(track_axes, found, positions, paths)
    _draw_iterations(course, found)
    _draw_radii(radii, found, config)
    for axes in (track_axes, course, radii):
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _draw_tracks(
    axes: Axes, found: FittedGeometry, positions: list[FloatArray], paths: dict[str, list[OdometryStretch]]
) -> None:
    for k, position_m in enumerate(positions):
        axes.plot(*position_m.T, color=STYLES["line"].colour, lw=5, label=None if k else "receiver")
    for name, own in paths.items():
        for k, piece in enumerate(own):
            label = None if k else f"odometry {name}"
            axes.plot(*piece.odometry_m.T, lw=1.3, label=label, **line_style(name))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="east (m)", ylabel="north (m)")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)
    axes.set_title(
        f"distance of un-fused odometry: {found.pose_error_before_m:.1f} m before,"
        f" {found.pose_error_after_m:.1f} m after",
        fontsize=11,
        loc="left",
        pad=26,
    )


def _draw_iterations(axes: Axes, found: FittedGeometry) -> None:
    """Draw each radius over the iterations of the fit."""
    for wheel, result in found.wheels.items():
        radii = np.array([step[wheel] for step in found.history_m]) * 1e3
        axes.plot(np.arange(1, len(radii) + 1), radii, marker="o", ms=4, label=wheel, **line_style(wheel))
        axes.axhspan(
            (result.radius_m - result.radius_std_m) * 1e3,
            (result.radius_m + result.radius_std_m) * 1e3,
            color=STYLES[wheel].colour,
            alpha=0.15,
            lw=0,
        )
    axes.locator_params(axis="x", integer=True)
    axes.ticklabel_format(useOffset=False)
    axes.set(xlabel="iteration", ylabel="radius (mm)")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)
    axes.set_title("radii by iteration, ± one standard deviation", fontsize=11, loc="left", pad=26)


def _draw_radii(axes: Axes, found: FittedGeometry, config: VehicleConfig) -> None:
    """Draw the calibrated minus configured radius of each wheel with two standard deviations."""
    for k, (wheel, result) in enumerate(found.wheels.items()):
        change_mm = 1e3 * (result.radius_m - config.wheel_radius_m[WHEELS.index(wheel)])
        axes.errorbar(
            [k], [change_mm], yerr=[2e3 * result.radius_std_m], fmt="o", capsize=5, color=STYLES[wheel].colour
        )
    axes.axhline(0.0, color=STYLES["soft"].colour, lw=0.8)
    axes.set_xticks(range(len(found.wheels)), list(found.wheels))
    axes.set_xlim(-0.6, len(found.wheels) - 0.4)
    axes.set(ylabel="radius minus configured (mm)")
    axes.set_title("± two standard deviations", fontsize=11, loc="left", pad=26)
