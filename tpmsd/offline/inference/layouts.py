"""Layouts of a drive's states, for diagnosis and calibration.

In: nothing (tables). Out: `DRIFTING_RADII`, `LEANING_CAR`. They share all but the slow changes of a radius:
the diagnosis lets each radius drift by itself, the calibration lets the car lean (one side's radii against
the other's) and its rear axle's course leave the heading.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import IS_LEFT, WHEELS, FloatArray
from tpmsd.offline.inference.blocks import GaussMarkov, Layout, MotionErrors, RandomWalk, Readings
from tpmsd.offline.inference.trajectory import WINDOW_S
from tpmsd.offline.inference.windows import CHANNELS, COURSE, EAST, GYRO, NORTH, SPEED, Linearised

GYRO_BIAS_STD_RADPS = 0.05
"""Standard deviation of a gyro's zero at the drive's start, where no column stands for it."""

AGE_STD_S = 1e-3
"""Standard deviation of the drift of the fixes' age at the drive's start."""


def _speed_mps(windows: Linearised) -> FloatArray:
    """Return the (w,) speed of each window, at least 1 m/s."""
    return np.maximum(windows.covariates["speed"], 1.0)


def _response(windows: Linearised, *seen: tuple[int, int, FloatArray | float]) -> FloatArray:
    """Return the (w, 9, n) response with these (channel, state, values), zero elsewhere."""
    out = np.zeros((len(windows), CHANNELS, 1 + max(state for _, state, _ in seen)))
    for channel, state, values in seen:
        out[:, channel, state] = values
    return out


def _clock_response(windows: Linearised) -> FloatArray:
    """Return the (w, 9, 1) response of the fixes to an error of their time."""
    v = _speed_mps(windows)
    velocity = windows.to_east_north[:, :, 0] / WINDOW_S * v[:, None]
    return _response(
        windows,
        (SPEED, 0, -windows.covariates["accel_kinematic"]),
        (COURSE, 0, -windows.covariates["yaw_rate"]),
        (EAST, 0, -velocity[:, 0]),
        (NORTH, 0, -velocity[:, 1]),
    )


def _side_slip_response(windows: Linearised) -> FloatArray:
    """Return the (w, 9, 1) response of course and position to a side slip."""
    late = -windows.after_fixes[:, 2:] * windows.to_east_north[:, :, 2]
    return _response(windows, (COURSE, 0, 1.0), (EAST, 0, late[:, 0]), (NORTH, 0, late[:, 1]))


def _left_right_drift_response(windows: Linearised) -> FloatArray:
    """Return the (w, 9, 1) response of the wheels' distances to a drift of left against right."""
    distance_m = _speed_mps(windows) * WINDOW_S
    return _response(
        windows, *((wheel, 0, -distance_m if IS_LEFT[wheel] else distance_m) for wheel in range(4))
    )


READINGS, MOTION = Readings(), MotionErrors()
SLOW_POSITION = GaussMarkov(
    ("slow_east", "slow_north"),
    "slow_m",
    "slow_tau_s",
    lambda windows: _response(windows, (EAST, 0, 1.0), (NORTH, 1, 1.0)),
    jumps=True,
)
SPEED_ERROR = GaussMarkov(
    ("gnss_speed",), "speed_mps", "speed_memory", lambda windows: _response(windows, (SPEED, 0, 1.0))
)
CROSS_ERROR = GaussMarkov(
    ("gnss_cross_speed",),
    "cross_mps",
    "speed_memory",
    lambda windows: _response(windows, (COURSE, 0, 1.0 / _speed_mps(windows))),
)
CLOCK = GaussMarkov(("gnss_clock",), "clock_s", "clock_tau_s", _clock_response)
AGE = RandomWalk("gnss_age", "age_s", AGE_STD_S, _clock_response)
RADIUS_DRIFT = GaussMarkov(
    tuple(f"drift_{wheel}" for wheel in WHEELS),
    "radius_drift",
    "radius_drift_tau_s",
    lambda windows: _response(
        windows, *((wheel, wheel, -_speed_mps(windows) * WINDOW_S) for wheel in range(4))
    ),
)
LEFT_RIGHT_DRIFT = GaussMarkov(
    ("left_right_drift",), "left_right_drift", "left_right_drift_tau_s", _left_right_drift_response
)
SIDE_SLIP = GaussMarkov(("side_slip",), "side_slip_rad", "side_slip_tau_s", _side_slip_response, turns=True)


def gyro_bias(start_std: float) -> RandomWalk:
    """Return the state of the gyro's zero, with this standard deviation (rad/s) at the drive's start."""
    return RandomWalk(
        "gyro_bias", "gyro_drift_radps", start_std, lambda windows: _response(windows, (GYRO, 0, 1.0))
    )


_RECEIVER = (SLOW_POSITION, SPEED_ERROR, CROSS_ERROR)
DRIFTING_RADII = Layout((READINGS, MOTION, *_RECEIVER, gyro_bias(0.0), CLOCK, RADIUS_DRIFT))
"""Layout of the diagnosis, in which a constant of the gyro has a column of its own."""
LEANING_CAR = Layout(
    (READINGS, MOTION, *_RECEIVER, gyro_bias(GYRO_BIAS_STD_RADPS), AGE, LEFT_RIGHT_DRIFT, SIDE_SLIP)
)
"""Layout of the calibration."""
