"""The forward model: what wheels, counters and antenna do when the car moves so and these effects act.

In: `Motion`, `Car`, `ExtendedModel`. Out: wheel rates and angles, counter angles, readings of gyro,
accelerometers and steering wheel, and the antenna's position and velocity. Pure; used by the simulator as its
world and by the diagnosis as its prediction.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.kinematics import wheel_speeds
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Car, Motion, integrate
from tpmsd.foundation.wheels import FloatArray

WHEELS_READ, GYRO_READ, RECEIVER_READ = "wheels", "gyro", "receiver"
"""Groups of channels."""
_OF_MOTION = ("axle_course_rad", "grade_factor", "wheels_time_constant_s")
_OF_TYRES = ("radius_change_m", "wheel_slip")
_OF_TEETH = ("tooth_angle_error_rad", "true_teeth_per_rev")
_HOOKS = {
    WHEELS_READ: (*_OF_MOTION, *_OF_TYRES, *_OF_TEETH, "track_error_m"),
    GYRO_READ: ("grade_factor", "wheels_time_constant_s", "read_yaw_rate", "yaw_rate_error_radps"),
    RECEIVER_READ: (
        *_OF_MOTION,
        *("horizontal_factor", "antenna_offset_m", "fix_age_s", "velocity_age_s"),
        *("gnss_speed_error_mps", "gnss_course_error_rad"),
    ),
}
"""Hooks of an effect that the readings of each group depend on, as the functions below do."""


def affected_channels(effect: Effect) -> frozenset[str]:
    """Return the groups of channels that an effect may change, by the hooks that it overrides."""
    return frozenset(group for group, hooks in _HOOKS.items() if _overrides(effect, hooks))


def acts_by_radius_or_slip(effect: Effect) -> bool:
    """Return True if an effect acts on the wheels by changes of radius and slip alone."""
    others = tuple(hook for hook in _HOOKS[WHEELS_READ] if hook not in _OF_TYRES)
    return _overrides(effect, _OF_TYRES) and not _overrides(effect, others)


def acts_on_tooth_angles(effect: Effect) -> bool:
    """Return True if an effect changes the angles or counts that counters show."""
    return _overrides(effect, _OF_TEETH)


def _overrides(effect: Effect, hooks: Iterable[str]) -> bool:
    """Return True if the effect overrides any of these hooks."""
    return any(getattr(type(effect), hook) is not getattr(Effect, hook) for hook in hooks)


@dataclass(frozen=True, slots=True)
class Rolling:
    """Rolling of the wheels at a model, in pieces, so that one more effect costs little; arrays (n, 4)."""

    speeds_mps: FloatArray
    """Speeds of the hubs, along their rolling directions."""
    stretched: FloatArray
    """1 + slip."""
    radii_m: FloatArray
    rates: FloatArray
    """(rad/s)"""

    @classmethod
    def evaluate(cls, motion: Motion, car: Car, model: ExtendedModel) -> Rolling:
        """Return the pieces of a model's wheel rates, for a motion on slopes as the wheels feel them."""
        speeds, radii = _hub_speeds(motion, car, model), wheel_radii(motion, car, model)
        stretched = 1.0 + model.wheel_slip(motion, car)
        return cls(speeds, stretched, radii, speeds * stretched / radii)

    def rates_with_effect(self, effect: Effect, motion: Motion, car: Car) -> FloatArray:
        """Return the (n, 4) rates (rad/s) with one more effect, which acts by radius and slip alone."""
        longer = self.stretched
        if _overrides(effect, ("wheel_slip",)):
            longer = longer + effect.wheel_slip(motion, car)
        if not _overrides(effect, ("radius_change_m",)):
            return np.asarray(self.speeds_mps * longer / self.radii_m)
        return np.asarray(self.speeds_mps * longer / (self.radii_m + effect.radius_change_m(motion, car)))


def wheel_radii(motion: Motion, car: Car, model: ExtendedModel) -> FloatArray:
    """(n, 4) effective rolling radii in metres: nominal plus all radius changes."""
    return car.radius_m + model.radius_change_m(motion, car)


def wheel_rates(
    motion: Motion, car: Car, model: ExtendedModel, radii_m: FloatArray | None = None
) -> FloatArray:
    """(n, 4) turning rates in rad/s: omega = hub speed along the rolling direction * (1 + slip) / radius.

    `radii_m` (n, 4) takes the place of the modelled radii (where the world adds roughness or offsets).
    """
    speeds = _hub_speeds(motion, car, model)
    radii = wheel_radii(motion, car, model) if radii_m is None else radii_m
    return np.asarray(speeds * (1.0 + model.wheel_slip(motion, car)) / radii)


def _hub_speeds(motion: Motion, car: Car, model: ExtendedModel) -> FloatArray:
    """(n, 4) speeds of the hubs along their rolling directions, m/s."""
    lateral = motion.speed_mps * np.tan(model.axle_course_rad(motion))
    geometry = car.with_tracks(*model.track_error_m())
    return wheel_speeds(motion.speed_mps, motion.yaw_rate_radps, geometry, lateral)


def wheel_angles(
    motion: Motion, car: Car, model: ExtendedModel, radii_m: FloatArray | None = None
) -> FloatArray:
    """(n, 4) angles in rad that the wheels have turned since the motion began."""
    return integrate(wheel_rates(motion, car, model, radii_m), motion.time_s)


def shown_counts(angle_rad: FloatArray, wheel: int, car: Car, model: ExtendedModel) -> FloatArray:
    """Return the unrounded counts that the wheel's ring shows at these true angles; same shape."""
    shown = angle_rad + model.tooth_angle_error_rad(angle_rad, wheel)
    return shown * (model.true_teeth_per_rev(wheel, car.teeth_per_rev) / (2 * np.pi))


def gyro_rates(motion: Motion, car: Car, model: ExtendedModel) -> FloatArray:
    """Return the (n,) readings, rad/s, of a gyro that has these effects and no noise."""
    return model.read_yaw_rate(motion.yaw_rate_radps) + model.yaw_rate_error_radps(motion, car)


def accelerations(motion: Motion, car: Car, model: ExtendedModel) -> FloatArray:
    """Return the (n, 2) readings, m/s2, of accelerometers (forward, left) with these effects, no noise."""
    acting = np.stack([motion.specific_force_long_mps2, motion.accel_lat_mps2], axis=1)
    return np.asarray(acting + model.accel_error_mps2(motion, car))


def steering_wheel_angles(motion: Motion, car: Car, model: ExtendedModel) -> FloatArray:
    """Return the (n,) steering wheel angles, rad, of a sensor that has these effects and no noise."""
    return np.asarray(car.steering_ratio * motion.steering_rad + model.steering_error_rad(motion, car))


@dataclass(frozen=True, slots=True)
class AntennaTruth:
    """Readings of a perfect receiver; arrays (n,)."""

    east_m: FloatArray
    """From where the middle of the rear axle was at the motion's start."""
    north_m: FloatArray
    east_mps: FloatArray
    north_mps: FloatArray
    up_m: FloatArray
    shown_east_mps: FloatArray
    """The velocity as the receiver reports it; differs where an effect acts on its speed or course alone."""
    shown_north_mps: FloatArray


def antenna_truth(motion: Motion, car: Car, model: ExtendedModel) -> AntennaTruth:
    """Return horizontal position and velocity of the antenna, and the velocity as the receiver reports it.

    The rear axle's middle moves along heading + beta at v / cos(beta), shortened to the horizontal; the
    antenna adds its lever arm (configured plus error) turned by the heading.
    """
    beta = model.axle_course_rad(motion)
    factor = model.horizontal_factor(motion)
    forward = motion.speed_mps * factor
    left = forward * np.tan(beta)
    cos, sin = np.cos(motion.heading_rad), np.sin(motion.heading_rad)
    axle_east = integrate(forward * cos - left * sin, motion.time_s)
    axle_north = integrate(forward * sin + left * cos, motion.time_s)
    more_forward, more_left = model.antenna_offset_m()
    arm_x, arm_y = car.antenna_forward_m + more_forward, car.antenna_left_m + more_left
    vx = forward - motion.yaw_rate_radps * arm_y
    vy = left + motion.yaw_rate_radps * arm_x
    east, north = vx * cos - vy * sin, vx * sin + vy * cos
    speed = np.hypot(east, north)
    more = model.gnss_speed_error_mps(motion, car)
    longer = np.divide(speed + more, speed, out=np.ones_like(speed), where=speed > 0.1)
    shown = (east + 1j * north) * longer * np.exp(1j * model.gnss_course_error_rad(motion, car))
    return AntennaTruth(
        east_m=axle_east + arm_x * cos - arm_y * sin,
        north_m=axle_north + arm_x * sin + arm_y * cos,
        east_mps=east,
        north_mps=north,
        up_m=integrate(motion.speed_mps * np.sin(motion.grade_rad), motion.time_s),
        shown_east_mps=shown.real.copy(),
        shown_north_mps=shown.imag.copy(),
    )
