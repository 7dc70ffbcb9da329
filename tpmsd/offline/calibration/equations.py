"""Measurements of a drive, in windows of a second, as linear equations about the nominal motion.

In: `Recording`, `NominalMotion`, `Vehicle`. Out: `Equations`: residuals y, what they see of the windows'
unknown motion, and what they see of the parameters (X), such that y = H s + X theta + noise with the states s
of `LEANING_CAR`.

The motion (speed and yaw rate of each window, heading, position) is as unknown as the parameters: each
wheel, the gyro and the receiver merely measure it, and none of them is trusted alone. What the channels see
of an effect is the catalogue's own forward model (`inference.windows`), as in the diagnosis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS, FittedParameter, make_effect
from tpmsd.car.physics.effect import Parameter
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Motion, integrate
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.calibration.nominal import NominalMotion, Vehicle, calibrated_wheels
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import WINDOW_S, ReferenceTrajectory
from tpmsd.offline.inference.windows import CHANNELS, EAST, GYRO, Linearised, Reader

V, W, PSI = 0, 1, 2
"""Columns of a `Linearised` design."""
PARAMETERS = (
    *(f"radius_{wheel}" for wheel in WHEELS),
    "track_rear",
    "track_front",
    "antenna_forward",
    "antenna_left",
    "load_lateral",
    "slip_long",
    "slip_lateral",
    "growth",
    "gyro_gain",
    "latency",
    "doppler_lag",
)
"""Radii, tracks and gyro gain relative to the present ones; the others in SI units, with the signs of the
effects in `tpmsd.car.physics`. The last two belong to each drive."""
PIECES = 4
CHANGES = tuple(f"change_{wheel}_{piece}" for wheel in WHEELS for piece in range(PIECES))
"""Relative changes of single wheels, each over one quarter of the drive. They are let in only where noise
and outliers are judged, so that a tyre that loses pressure does not pass for noise; a calibration holds
none."""
COLUMNS = PARAMETERS + CHANGES
LOCAL = ("latency", "doppler_lag", *CHANGES)

MOVING_MPS = 3.0
"""Slower than this, Doppler speed (a magnitude) is biased and courses are loose."""
MAX_ACCEL_MPS2 = 2.5
"""Harder than this the tyres slip too much to be modelled: such windows' wheels weigh little."""
SLIPPING = 1e4
"""Factor on the variance of such a wheel's distance: slip of a few per cent is a hundred times road noise."""
_STOPPED_MPS = 0.3


@dataclass(frozen=True)
class Equations(Linearised):
    """One drive's, over w windows from its start; NaN in `y` is: not measured."""

    y: FloatArray
    """(w, 9) metres per window, rad/s, m/s, rad, metres: measured minus nominal."""
    X: FloatArray
    """(w, 9, p) by `COLUMNS`."""
    inflate: FloatArray
    """(w, 9) factors on the variances: large where the wheels may slip."""

    @property
    def here(self) -> np.ndarray:
        """(w, 9) True where a measurement exists."""
        return np.isfinite(self.y)

    @property
    def data(self) -> FloatArray:
        """(w, 9, 1 + p) residuals (missing ones 0) and columns side by side."""
        return np.concatenate([np.nan_to_num(self.y)[:, :, None], self.X], axis=2)


def calibration_parameters() -> dict[str, FittedParameter]:
    """Return a mapping from the name in a calibration to the effect's parameter that it stands for."""
    out = {}
    for effect in EFFECTS.values():
        numbers = {one.name: one for one in effect.parameters if isinstance(one, Parameter)}
        for name, what, _ in effect.in_calibration:
            similar = (one for one in numbers.values() if one.name.split("_")[0] == what.split("_")[0])
            one = numbers.get(what) or next(similar)
            out[name] = FittedParameter(effect.name, one.name, one.neutral + one.probe, one.neutral)
    return out


def make_equations(
    recording: Recording, motion: NominalMotion, car: Vehicle, reference_speed_mps: float = 0.0
) -> Equations:
    """Return a drive's measurements as linear equations about the nominal motion; ticks beyond the last whole
    window are left out.

    A radius is that at the reference speed: `growth` acts on v^2 beyond its square.
    """
    seen = _without_slow_courses(recording, motion)
    rolling = ExtendedModel(tuple(make_effect(one.name) for one in EFFECTS.values() if one.shortens))
    k = recording.ticks // round(WINDOW_S / recording.dt_s)
    load = make_effect(_PROBES["load_lateral"].effect, coefficient=car.load_lateral_s2)
    reader = Reader(seen, _reference(recording, motion, car), kept=np.arange(k), base=rolling.plus(load))
    windows = reader.windows
    y = windows.measured - reader.predicted(rolling)
    y[:, [wheel for wheel in range(4) if wheel not in calibrated_wheels(recording)]] = math.nan
    distances = np.abs(np.stack([windows.measured[:, :4], windows.measured[:, :4] - y[:, :4]]))
    y[:, :4][(distances < _STOPPED_MPS * WINDOW_S).all(axis=0)] = math.nan
    X = _response_columns(reader, rolling, car, reference_speed_mps)
    X[~np.isfinite(y)] = 0.0
    design = windows.design.copy()
    after = _fraction_after_fixes(seen, k)
    _fill_position_rows(design, windows, recording, motion, after[:, 2])
    inflate = np.ones((k, CHANNELS))
    inflate[np.abs(windows.covariates["accel_kinematic"]) > MAX_ACCEL_MPS2, :GYRO] = SLIPPING
    return Equations(
        index=windows.index,
        fixes=windows.fixes,
        after_fixes=after,
        covariates=windows.covariates,
        design=np.where(np.isfinite(y)[:, :, None], design, 0.0),
        to_east_north=windows.to_east_north,
        y=y,
        X=X,
        inflate=inflate,
    )


def _without_slow_courses(recording: Recording, motion: NominalMotion) -> Recording:
    """Return the recording with the receiver's speeds and courses NaN where the car is slow."""
    moving = np.interp(recording.fix_time_s, motion.time_s, motion.speed_mps) > MOVING_MPS
    return replace(
        recording,
        speed_mps=np.where(moving, recording.speed_mps, math.nan),
        course_rad=np.where(moving, recording.course_rad, math.nan),
    )


def _reference(recording: Recording, motion: NominalMotion, car: Vehicle) -> ReferenceTrajectory:
    """Return the nominal motion as the reference of a `Reader`."""
    speed, yaw = motion.speed_mps, motion.yaw_rate_radps
    curvature = np.divide(yaw, speed, out=np.zeros_like(speed), where=speed > 1.0)
    return ReferenceTrajectory(
        motion=Motion(
            time_s=motion.time_s,
            distance_m=integrate(speed, motion.time_s),
            speed_mps=speed,
            accel_long_mps2=motion.accel_mps2,
            accel_lat_mps2=speed * yaw,
            yaw_rate_radps=yaw,
            grade_rad=motion.grade_rad,
            heading_rad=motion.heading_rad,
            steering_rad=np.arctan(car.geometry.wheelbase_m * curvature),
        ),
        car=replace(recording.car, radius_m=car.radius_m, geometry=car.geometry),
        valid=np.ones(recording.ticks, dtype=bool),
        grade_known=True,
        grade_by="heights",
        min_mps=0.0,
    )


def _response_columns(
    reader: Reader, rolling: ExtendedModel, car: Vehicle, reference_mps: float
) -> FloatArray:
    """Return (w, 9, p) response of the channels to each of `COLUMNS`."""
    k = len(reader.windows)
    X = np.zeros((k, CHANNELS, len(COLUMNS)))
    always = np.ones(len(reader.reference.motion.time_s))
    at = (np.arange(k) + 0.5) / max(k, 1) * PIECES
    for wheel in range(4):
        per_m = reader.by_radius(wheel, always, rolling)
        X[:, wheel, wheel] = per_m * car.radius_m[wheel]
        X[:, wheel, _parameter_index("growth")] -= per_m * reference_mps**2
        for piece in range(PIECES):
            share = np.clip(at - piece, 0.0, 1.0)
            X[:, wheel, len(PARAMETERS) + wheel * PIECES + piece] = X[:, wheel, wheel] * share
    for name, probe in _PROBES.items():
        size = (probe.value - probe.neutral) / getattr(car.geometry, f"{name}_m", 1.0)  # tracks: relative
        X[:, :, _parameter_index(name)] += reader.change(rolling, probe.probing_effect()) / size
    return X


def _fraction_after_fixes(recording: Recording, count: int) -> FloatArray:
    """Return the (w, 3) mean fraction of each window that follows its speeds, courses and positions."""
    position, late = np.divmod(recording.fix_time_s / WINDOW_S, 1.0)
    out = np.zeros((count, 3))
    for column, values in enumerate((recording.speed_mps, recording.course_rad, recording.east_m)):
        use = np.isfinite(values) & (position >= 0) & (position < count)
        where = position[use].astype(int)
        number = np.bincount(where, minlength=count)
        total = np.bincount(where, weights=1.0 - late[use], minlength=count)
        np.divide(total, number, out=out[:, column], where=number > 0)
    return out


def _fill_position_rows(
    design: FloatArray, windows: Linearised, recording: Recording, motion: NominalMotion, after: FloatArray
) -> None:
    """Fill the rows of positions with the effect of yaw rate and heading at their own instant: by the
    antenna's arm and by the distance that follows them in the window. `Reader` takes them in the middle."""
    forward, left = recording.car.antenna_forward_m, recording.car.antenna_left_m
    middle = np.interp(windows.time_s, motion.time_s, motion.heading_rad)
    cos, sin = np.cos(middle), np.sin(middle)
    arms = np.stack([-forward * sin - left * cos, forward * cos - left * sin], axis=1)
    grow = windows.to_east_north[:, :, 2]
    design[:, EAST:, W] = 0.5 * after[:, None] ** 2 * WINDOW_S * grow - after[:, None] * WINDOW_S * arms
    design[:, EAST:, PSI] = arms


def _parameter_index(name: str) -> int:
    return PARAMETERS.index(name)


_PROBES = calibration_parameters()
