"""Takes the known physics of an extended model out of the ticks, before any estimator sees them.

In: `Tick`s and an `ExtendedModel` (a `model.toml` that `diagnose` wrote). Out: ticks as the car would have
made them if its wheels rolled on constant radii and its sensors were as configured. The effects' own forward
hooks are used, so simulator, diagnosis and compensation cannot disagree on what an effect does.

An effect says itself whether it stays: the fault that is to be found does, and so does what belongs to one
drive alone. `uncompensated_effects` says all this of a model, one line each.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from tpmsd.car.config.model import Config
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.grade import GradeTracker
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import GRAVITY_MPS2, Car, Motion, driven_mask
from tpmsd.foundation.wheels import RL, RR, FloatArray
from tpmsd.onboard.timeline.tick import Fix, Tick

SMOOTHING_S = 0.5
RATE_SMOOTHING_S = 0.3
"""Time constant of the smoothing of the steering wheel's rate, s."""


def uncompensated_effects(config: Config, model: ExtendedModel) -> list[str]:
    """Return one line for each effect of the model that is not compensated, with the reason, for the user."""
    notes = []
    for effect in model:
        if (why := _reason_not_compensated(config, effect)) is not None:
            notes.append(f"{effect.name} is not compensated: {why}")
        elif (note := effect.left_in()) is not None:
            notes.append(note)
    return notes


def _reason_not_compensated(config: Config, effect: Effect) -> str | None:
    """Return the reason for which an effect must stay in the ticks; None if it is compensated."""
    return effect.not_compensated(frozenset(config.can.signals))


def with_model_constants(config: Config, model: ExtendedModel) -> Config:
    """Return the configuration with the model's tracks, antenna position and latency added to its own."""
    front, rear = model.track_error_m()
    forward, left = model.antenna_offset_m()
    vehicle = dataclasses.replace(
        config.vehicle,
        track_front_m=config.vehicle.track_front_m + front,
        track_rear_m=config.vehicle.track_rear_m + rear,
    )
    gnss = dataclasses.replace(
        config.gnss,
        antenna_forward_m=config.gnss.antenna_forward_m + forward,
        antenna_left_m=config.gnss.antenna_left_m + left,
        latency_s=max(config.gnss.latency_s + model.fix_age_s(), 0.0),
    )
    return dataclasses.replace(config, vehicle=vehicle, gnss=gnss)


class Compensation:
    """Removes the effects of a model from ticks; keeps the motion that they depend on."""

    def __init__(self, config: Config, model: ExtendedModel) -> None:
        kept = [
            (effect, std)
            for effect, std in zip(model.effects, model.stds, strict=True)
            if _reason_not_compensated(config, effect) is None
        ]
        self._model = ExtendedModel(tuple(e for e, _ in kept), tuple(s for _, s in kept))
        vehicle = config.vehicle
        self._car = Car(
            radius_m=np.array(vehicle.wheel_radius_m),
            geometry=WheelPositions(vehicle.track_front_m, vehicle.track_rear_m, vehicle.wheelbase_m),
            driven=driven_mask(vehicle.driven_axle),
            teeth_per_rev=vehicle.teeth_per_rev,
            **({} if vehicle.steering_ratio is None else {"steering_ratio": vehicle.steering_ratio}),
        )
        teeth = [self._model.true_teeth_per_rev(w, vehicle.teeth_per_rev) for w in range(4)]
        self._tooth_factor = vehicle.teeth_per_rev / np.array(teeth)
        zero, one = self._model.read_yaw_rate(np.array([0.0, 1.0]))
        self._gyro_bias, self._gyro_scale = float(zero), float(one - zero)
        self._grade = GradeTracker()
        self._start_s: float | None = None
        self._distance_m = self._heading_rad = 0.0
        self._speed_mps = math.nan
        self._accel_mps2 = self._yaw_rate_radps = self._yaw_error_radps = 0.0
        self._steering_rad = math.nan
        self._steering_rate_radps = 0.0

    def apply(self, tick: Tick) -> Tick:
        """Return the tick with the model's effects on rotations, yaw rate and fixes removed."""
        yaw_rate = (tick.yaw_rate_radps - self._gyro_bias) / self._gyro_scale
        rotation = tick.rotation_rad * self._tooth_factor
        self._update_motion(tick, rotation, yaw_rate - self._yaw_error_radps)
        self._update_steering_rate(tick)
        for fix in tick.fixes:
            self._grade.update(fix.up_m)
        motion = self._motion(tick)
        change = self._model.radius_change_m(motion, self._car)[0] / self._car.radius_m
        factor: FloatArray = (1.0 + change) / (1.0 + self._model.wheel_slip(motion, self._car)[0])
        course = float(self._model.axle_course_rad(motion)[0])
        course += float(self._model.gnss_course_error_rad(motion, self._car)[0])
        faster = float(self._model.gnss_speed_error_mps(motion, self._car)[0])
        self._yaw_error_radps = (
            float(self._model.yaw_rate_error_radps(motion, self._car)[0]) / self._gyro_scale
        )
        return dataclasses.replace(
            tick,
            rotation_rad=rotation * factor,
            rotation_std_rad=tick.rotation_std_rad * self._tooth_factor,
            yaw_rate_radps=yaw_rate - self._yaw_error_radps,
            fixes=tuple(_without_errors(fix, course, faster) for fix in tick.fixes),
        )

    def _update_motion(self, tick: Tick, rotation: FloatArray, yaw_rate: float) -> None:
        """Update the smoothed speed, acceleration and yaw rate, the distance and the heading; NaN changes
        none."""
        if self._start_s is None:
            self._start_s = tick.time_s - tick.dt_s
        if tick.gap_s > 0.0:
            self._grade.reset()
        rolls = rotation * self._car.radius_m
        rolled_m = float(rolls[RL] + rolls[RR]) / 2
        if not math.isfinite(rolled_m):
            return
        wheels = float(rolls[RR] - rolls[RL]) / self._car.geometry.track_rear_m / tick.dt_s
        turning = yaw_rate if math.isfinite(yaw_rate) else wheels
        speed = rolled_m / tick.dt_s
        share = 1.0 - math.exp(-tick.dt_s / SMOOTHING_S)
        if math.isnan(self._speed_mps):
            self._speed_mps = speed
        before = self._speed_mps
        self._speed_mps += share * (speed - before)
        self._accel_mps2 += share * ((self._speed_mps - before) / tick.dt_s - self._accel_mps2)
        self._yaw_rate_radps += share * (turning - self._yaw_rate_radps)
        self._distance_m += rolled_m
        self._heading_rad += turning * tick.dt_s
        self._grade.move(rolled_m)

    def _update_steering_rate(self, tick: Tick) -> None:
        """Update the smoothed rate of the steering wheel; NaN leaves it as it was."""
        angle = tick.steering_wheel_angle_rad
        if not math.isfinite(angle):
            return
        if math.isfinite(self._steering_rad) and tick.gap_s == 0.0:
            share = 1.0 - math.exp(-tick.dt_s / RATE_SMOOTHING_S)
            rate = (angle - self._steering_rad) / tick.dt_s
            self._steering_rate_radps += share * (rate - self._steering_rate_radps)
        self._steering_rad = angle

    def _motion(self, tick: Tick) -> Motion:
        """Return the present motion as arrays of one sample, the argument of the catalogue's effects."""
        speed = 0.0 if math.isnan(self._speed_mps) else self._speed_mps
        grade = math.asin(self._grade.sine)
        accel = self._accel_mps2
        if math.isfinite(tick.accel_long_mps2):
            # The sensor reads specific force; the catalogue adds gravity to the acceleration itself.
            accel = tick.accel_long_mps2 - GRAVITY_MPS2 * self._grade.sine
        curvature = self._yaw_rate_radps / speed if speed > 1.0 else 0.0
        start = self._start_s if self._start_s is not None else tick.time_s
        values = {
            "time_s": tick.time_s - start,
            "distance_m": self._distance_m,
            "speed_mps": speed,
            "accel_long_mps2": accel,
            "accel_lat_mps2": speed * self._yaw_rate_radps,
            "yaw_rate_radps": self._yaw_rate_radps,
            "grade_rad": grade,
            "heading_rad": self._heading_rad,
            "steering_rad": math.atan(self._car.geometry.wheelbase_m * curvature),
        }
        known = {"torque": tick.drive_torque_nm, "temperature": tick.ambient_temp_k}
        if math.isfinite(self._steering_rad):
            known |= {"steering": self._steering_rad, "steering_rate": self._steering_rate_radps}
        measured = {name: np.array([value]) for name, value in known.items()}
        return Motion(measured=measured, **{name: np.array([value]) for name, value in values.items()})


def _without_errors(fix: Fix, course_error_rad: float, speed_error_mps: float) -> Fix:
    """Return the fix less these errors of course and speed; quantities that it lacks stay NaN."""
    if course_error_rad == 0.0 and speed_error_mps == 0.0:
        return fix
    return dataclasses.replace(
        fix, heading_rad=fix.heading_rad - course_error_rad, speed_mps=fix.speed_mps - speed_error_mps
    )
