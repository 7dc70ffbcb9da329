"""Radii and tracks of a car from its recorded drives, by either method.

In: `Recording`s and the configured vehicle. Out: `FittedGeometry`; `RefusedError` where it cannot be had.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from tpmsd.car.config.model import VehicleConfig
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.calibration.checks import check_fit, check_recordings
from tpmsd.offline.calibration.joint import PRIOR, JointFit, fit
from tpmsd.offline.calibration.nominal import Vehicle, calibrated_wheels, vehicle_of
from tpmsd.offline.calibration.odometry import pose_error
from tpmsd.offline.calibration.paper import PaperFit, fit_paper
from tpmsd.offline.calibration.result import EstimatedEffect, FittedGeometry, WheelResult
from tpmsd.offline.inference.recording import Recording

METHODS = ("joint", "paper")
_MAX_STD_RATIO = 0.7
"""Ratio of posterior to prior standard deviation below which an effect is reported."""


def calibrate(
    recordings: Sequence[Recording],
    config: VehicleConfig,
    method: str = "joint",
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[FittedGeometry, Vehicle]:
    """Return the calibrated geometry, and the vehicle with it; `progress` is called with the fraction of the
    work done.

    ValueError on an unknown method, `RefusedError` (one, too).
    """
    if method not in METHODS:
        raise ValueError(f"no such method: {method!r} (methods: {' '.join(METHODS)})")
    drives = list(recordings)
    start = vehicle_of(config)
    check_recordings(drives, start)
    found = fit(drives, start, progress)
    check_fit(drives, found)  # the paper's method has no test of its own for tyres that lose pressure
    if method == "paper":
        by_paper = fit_paper(drives, start)
        return _geometry_of_paper_fit(drives, start, by_paper, found.reference_speed_mps), by_paper.vehicle
    return _geometry_of_joint_fit(drives, start, found), found.vehicle


def _geometry_of_joint_fit(drives: list[Recording], start: Vehicle, found: JointFit) -> FittedGeometry:
    car = found.vehicle
    read = sorted({k for drive in drives for k in calibrated_wheels(drive)})
    front = 0 in read
    wheels = {
        WHEELS[k]: WheelResult(
            float(car.radius_m[k]), float(start.radius_m[k]) * found.std(f"radius_{WHEELS[k]}")
        )
        for k in read
    }
    difference = np.zeros(len(found.names))
    difference[found.names.index("radius_rr")] = start.radius_m[3]
    difference[found.names.index("radius_rl")] = -start.radius_m[2]
    return FittedGeometry(
        method="joint",
        drives=tuple(drive.name for drive in drives),
        wheels=wheels,
        difference_std_m=float(np.sqrt(difference @ found.covariance @ difference)),
        track_rear_m=car.geometry.track_rear_m,
        track_rear_std_m=start.geometry.track_rear_m * found.std("track_rear"),
        track_front_m=car.geometry.track_front_m if front else math.nan,
        track_front_std_m=start.geometry.track_front_m * found.std("track_front") if front else math.nan,
        reference_speed_mps=found.reference_speed_mps,
        iterations=found.iterations,
        stopped_because=found.stopped_because,
        pose_error_before_m=pose_error(drives, start),
        pose_error_after_m=pose_error(drives, car),
        effects=_estimated_effects(found),
        history_m=[_radii_by_wheel(radii, read) for radii in found.history],
    )


def _geometry_of_paper_fit(
    drives: list[Recording], start: Vehicle, found: PaperFit, speed_mps: float
) -> FittedGeometry:
    rear = (2, 3)
    return FittedGeometry(
        method="paper",
        drives=tuple(drive.name for drive in drives),
        wheels={
            WHEELS[k]: WheelResult(float(found.vehicle.radius_m[k]), float(found.std_m[k - 2])) for k in rear
        },
        difference_std_m=found.difference_std_m,
        track_rear_m=start.geometry.track_rear_m,
        track_rear_std_m=math.nan,
        track_front_m=math.nan,
        track_front_std_m=math.nan,
        reference_speed_mps=speed_mps,
        iterations=found.iterations,
        stopped_because=found.stopped_because,
        pose_error_before_m=pose_error(drives, start),
        pose_error_after_m=pose_error(drives, found.vehicle),
        effects={},
        history_m=[_radii_by_wheel(radii, list(rear)) for radii in found.history],
    )


def _radii_by_wheel(radii: FloatArray, wheels: list[int]) -> dict[str, float]:
    """Return the radii of the wheels with these indices by their names; `radii` are those of all four."""
    return {WHEELS[k]: float(radii[k]) for k in wheels}


_UNITS = {
    "antenna_forward": "m",
    "antenna_left": "m",
    "load_lateral": "s2",
    "slip_long": "s2/m",
    "slip_lateral": "rad.s2/m",
    "growth": "s2/m",
    "gyro_gain": "1",
    "latency": "s",
    "doppler_lag": "s",
}


def _estimated_effects(found: JointFit) -> dict[str, EstimatedEffect]:
    """Return the other parameters that the drives determine, those whose standard deviation is well below the
    prior's.
    """
    out = {}
    for name in found.names:
        base = name.split("@")[0]
        if base in _UNITS and found.std(name) < _MAX_STD_RATIO * PRIOR[base][1]:
            out[name] = EstimatedEffect(found.value(name), found.std(name), _UNITS[base])
    return out
