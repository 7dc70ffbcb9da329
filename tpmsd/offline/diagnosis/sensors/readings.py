"""Residuals of sensors against the reference motion, and responses to effects there.

In: a `Reader`. Out: `Rows` per sensor. These sensors measure nothing of wheels or receiver, so that they are
no channels of the windows: the motion is known without them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.catalogue import FittedParameter
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.forward import accelerations, steering_wheel_angles
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.trajectory import slope_by_heights, to_edges
from tpmsd.offline.inference.windows import Reader

ACCELEROMETERS = ("accel_long", "accel_lat")
STEERING, CLOCK = "steering", "clock"
ROLES = {"accel_long": "accel_long_mps2", "accel_lat": "accel_lat_mps2", STEERING: "steering_wheel_angle_rad"}
ROLLING = ExtendedModel()


@dataclass(frozen=True)
class Rows:
    """One sensor's readings over windows, or over fixes for the clock."""

    time_s: FloatArray
    """(k,) since the drive's start."""
    residual: FloatArray
    """(k,) reading minus what it should be, in the sensor's unit."""


def rows_of(reader: Reader) -> dict[str, Rows]:
    """Return the residuals by sensor, of those that the drive has."""
    out = {}
    recording = reader.recording
    for name, role in ROLES.items():
        if np.isfinite(recording.inertial[role]).mean() < SETTINGS.sensors.known_share:
            continue
        expected = _expected(reader, name)
        if expected is not None:
            residual = to_edges(recording.inertial[role], 1.0) - expected
            out[name] = Rows(reader.windows.time_s, reader.over_windows(residual))
    known = np.isfinite(recording.host_minus_utc_s)
    if known.sum() >= SETTINGS.sensors.fewest_fixes:
        off = recording.host_minus_utc_s[known]
        steps = np.diff(off, prepend=off[0])
        set_by = np.cumsum(np.where(np.abs(steps) > SETTINGS.sensors.clock_step_s, steps, 0.0))
        out[CLOCK] = Rows(recording.fix_time_s[known], off - set_by)
    return out


def response(reader: Reader, name: str, rows: Rows, probe: FittedParameter) -> FloatArray:
    """(k,) what one unit of a parameter adds to a sensor's readings."""
    effect = probe.probing_effect()
    if name == CLOCK:
        return effect.clock_error_s(rows.time_s) / (probe.value - probe.neutral)
    return reader.over_windows(_read(reader, name, effect)) / (probe.value - probe.neutral)


def _read(reader: Reader, name: str, effect: Effect) -> FloatArray:
    """(n + 1,) what an effect adds to a sensor's readings."""
    motion, car = reader.reference.motion, reader.reference.car
    if name == STEERING:
        return effect.steering_error_rad(motion, car)
    return effect.accel_error_mps2(motion, car)[:, ACCELEROMETERS.index(name)]


def _expected(reader: Reader, name: str) -> FloatArray | None:
    """(n + 1,) what a sensor in order reads; None where that is not known.

    Slopes come from the receiver's heights: those by the accelerometer hold its own errors.
    """
    motion, car = reader.reference.motion, reader.reference.car
    if name == STEERING:
        return steering_wheel_angles(motion, car, ROLLING)
    if name == "accel_lat":
        return accelerations(motion, car, ROLLING)[:, 1]
    slope = slope_by_heights(reader.recording, motion.speed_mps)
    return None if slope is None else motion.accel_long_mps2 + GRAVITY_MPS2 * slope
