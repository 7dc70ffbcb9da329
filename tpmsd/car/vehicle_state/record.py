"""The estimated vehicle state as a plain record.

In: nothing. Out: `VehicleState`, whose fields are the columns of the tick table.
"""

from __future__ import annotations

from typing import NamedTuple


class VehicleState(NamedTuple):
    """The state of the centre of gravity at the end of a tick, with standard deviations; ISO 8855 axes."""

    velocity_long_mps: float
    velocity_long_std_mps: float
    velocity_lat_mps: float
    velocity_lat_std_mps: float
    side_slip_rad: float
    """atan2(lateral, longitudinal speed)."""
    side_slip_std_rad: float
    yaw_rate_estimate_radps: float
    yaw_rate_estimate_std_radps: float
