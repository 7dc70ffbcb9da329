"""A calibration as a picture: un-fused odometry before and after on the receiver's positions, radii by
iteration.

In: `Calibration`, its `Recording`s, the vehicle before and after. Out: a matplotlib figure. matplotlib is the
optional extra `tpmsd[plot]` and needs no display.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tpmsd.calibration.nominal import Vehicle, vehicle_of
from tpmsd.calibration.odometry import pieces
from tpmsd.calibration.recording import Recording
from tpmsd.calibration.result import Calibration
from tpmsd.config.model import VehicleConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GREY, _RED, _BLUE = "0.6", "tab:red", "tab:blue"


def draw_calibration(
    found: Calibration, recordings: list[Recording], config: VehicleConfig, car: Vehicle
) -> Figure:
    """The figure: tracks on the left, radii by iteration on the right."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 5.5), layout="constrained")
    place, course = figure.subplots(1, 2)
    before, after = vehicle_of(config), car
    for recording in recordings:
        for vehicle, colour, label in ((before, _RED, "before"), (after, _BLUE, "after")):
            for piece in pieces(recording, vehicle):
                if vehicle is before:
                    place.plot(*piece.position_m.T, color=_GREY, lw=3, label="receiver")
                place.plot(*piece.odometry_m.T, color=colour, lw=0.9, label=f"odometry {label}")
    handles, labels = place.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    place.legend(unique.values(), unique.keys(), fontsize=8)
    place.set(xlabel="east / m", ylabel="north / m", aspect="equal")
    place.set_title(
        f"un-fused odometry: {found.pose_error_before_m:.1f} m before, "
        f"{found.pose_error_after_m:.1f} m after",
        fontsize=10,
    )
    for wheel, result in found.wheels.items():
        radii = np.array([step[wheel] for step in found.history_m]) * 1e3
        (line,) = course.plot(np.arange(1, len(radii) + 1), radii, marker=".", label=wheel)
        course.axhspan(
            (result.radius_m - result.radius_std_m) * 1e3,
            (result.radius_m + result.radius_std_m) * 1e3,
            color=line.get_color(),
            alpha=0.15,
        )
    course.set(xlabel="iteration", ylabel="radius / mm")
    course.legend(fontsize=8)
    course.set_title("radii by iteration, one standard deviation shaded", fontsize=10)
    return figure
