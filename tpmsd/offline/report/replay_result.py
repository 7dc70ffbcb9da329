"""One replayed drive as a record, for the document, the summary and the plot.

In: nothing (plain records). Out: `ReplayResult` and its parts; `tpmsd.offline.report.replay_recorder` fills
them. Times are seconds of the drive's host clock; NaN stands for a number nobody knows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tpmsd.car.config.model import MonitorConfig, VehicleConfig
from tpmsd.foundation.plain import brief
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.records import AlarmEvent, WheelState
from tpmsd.onboard.resonance.watch import ResonanceStatus

if TYPE_CHECKING:
    from tpmsd.offline.report.vehicle_state_summary import StateSummary

GNSS_GAP_S = 5.0
"""From this age on the last fix counts as lost: an outage in the summary, a shaded span in the plot."""


@dataclass(frozen=True, slots=True)
class AlarmThresholds:
    """Thresholds of each wheel's deviation from its baseline, in metres, positive."""

    deflation_m: FloatArray
    """(4,) loss of radius from which a wheel counts as deflated."""
    deviation_m: FloatArray
    """(4,) change of either sign from which radius_deviation is raised."""

    @classmethod
    def from_config(cls, vehicle: VehicleConfig, monitor: MonitorConfig) -> AlarmThresholds:
        """Return the thresholds in metres: the configured percentages of each wheel's nominal radius."""
        nominal = np.asarray(vehicle.wheel_radius_m, dtype=np.float64)
        return cls(nominal * (monitor.deflation_percent / 100), nominal * (monitor.deviation_percent / 100))


@dataclass(frozen=True, slots=True)
class WheelOutcome:
    """State of one wheel at the end of the drive."""

    wheel: str
    state: WheelState
    """At the last tick."""
    deviation_m: float
    """Radius minus nominal: the last value known, even if the wheel was lost later; NaN if there was none."""
    std_m: float
    change_m: float
    change_std_m: float
    deflation_probability: float
    seen_s: float
    """Driving time in which the wheel was available."""
    monitored_s: float
    """Driving time in which it could have alarmed."""
    monitored_from_s: float
    """Host time from which it was monitored; NaN if never."""


@dataclass(frozen=True, slots=True)
class GnssHealth:
    """Quality of the receiver over the drive."""

    fixes: int
    outages: int
    """Spans of more than GNSS_GAP_S without a usable fix, the wait for the first one included."""
    outage_s: float
    """Time in outages, counted from the fix before each."""
    longest_outage_s: float


@dataclass(frozen=True, slots=True)
class FinalPose:
    """Pose of the car at the end by the filter, in the local plane."""

    east_m: float
    north_m: float
    heading_rad: float
    position_std_m: float
    heading_std_rad: float


@brief
@dataclass(frozen=True, slots=True)
class ReplayResult:
    """A drive after its replay. Series have n rows, at most `max_points`; columns are as in WHEELS."""

    drive: str
    start_s: float
    """Host time at which the first tick began; drive time counts from here."""
    duration_s: float
    realtime_factor: float
    """Driving time over the time that the replay took; NaN if not known."""
    nominal_m: FloatArray
    """(4,)"""
    thresholds: AlarmThresholds
    learn_s: float
    """Informative driving that a baseline takes."""
    time_s: FloatArray
    """(n,) host time."""
    speed_mps: FloatArray
    deviation_m: FloatArray
    """(n, 4), as the next four; NaN while unknown."""
    std_m: FloatArray
    change_m: FloatArray
    change_std_m: FloatArray
    deflation_probability: FloatArray
    informative: NDArray[np.bool_]
    """(n,)"""
    gnss_age_s: FloatArray
    """(n,) infinite before the first fix."""
    can_faults: NDArray[np.int64]
    """(n,) faults of the bus up to this row, cumulative; likewise `gnss_faults`."""
    gnss_faults: NDArray[np.int64]
    wheels: tuple[WheelOutcome, ...]
    """All four, in the order of WHEELS."""
    alarms: tuple[AlarmEvent, ...]
    """Everything raised and cleared, in order."""
    active: tuple[AlarmEvent, ...]
    """Alarms that stand at the end."""
    fault_counts: dict[str, int]
    """'can lost' -> how often."""
    gnss: GnssHealth
    pose: FinalPose | None
    distance_m: float
    moving_s: float
    informative_s: float
    learning_fraction: float
    tick_gaps: int
    """Pauses in which there were no ticks, and their sum."""
    tick_gap_s: float
    resonance: tuple[ResonanceStatus, ...] = ()
    """The torsional resonance of each wheel, in the order of WHEELS; empty where nobody looked."""
    vehicle_state: StateSummary | None = None
    """None where it is not estimated."""

    @property
    def states(self) -> dict[str, WheelState]:
        """Return the state of each wheel at the end."""
        return {outcome.wheel: outcome.state for outcome in self.wheels}
