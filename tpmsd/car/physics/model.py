"""The extended model: the rolling model plus a list of effects, acting together.

In: effects. Out: `ExtendedModel`, whose hooks are the effects' hooks combined: additive changes are summed,
factors multiplied, so that the order of the effects does not matter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from tpmsd.car.physics.effect import Effect, Std
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class ExtendedModel:
    """Effects, and for each the standard deviations of its fitted parameters where they are known."""

    effects: tuple[Effect, ...] = ()
    stds: tuple[Mapping[str, Std], ...] = field(default=())
    """One mapping per effect (may be empty), or none at all."""

    def __post_init__(self) -> None:
        if not self.stds:
            object.__setattr__(self, "stds", tuple({} for _ in self.effects))
        if len(self.stds) != len(self.effects):
            raise ValueError(f"{len(self.stds)} sets of standard deviations for {len(self.effects)} effects")

    def __iter__(self) -> Iterator[Effect]:
        return iter(self.effects)

    def __len__(self) -> int:
        return len(self.effects)

    def plus(self, *effects: Effect) -> ExtendedModel:
        """Return this model with more effects."""
        return ExtendedModel(self.effects + effects, self.stds + tuple({} for _ in effects))

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) sum of the radius changes."""
        out = np.zeros((len(motion), 4))
        for effect in self.effects:
            out += effect.radius_change_m(motion, car)
        return out

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) sum of the slips."""
        out = np.zeros((len(motion), 4))
        for effect in self.effects:
            out += effect.wheel_slip(motion, car)
        return out

    def axle_course_rad(self, motion: Motion) -> FloatArray:
        """(n,) sum of the rear axle's course angles."""
        out = np.zeros(len(motion))
        for effect in self.effects:
            out += effect.axle_course_rad(motion)
        return out

    def horizontal_factor(self, motion: Motion) -> FloatArray:
        """(n,) product of the horizontal factors."""
        out = np.ones(len(motion))
        for effect in self.effects:
            out *= effect.horizontal_factor(motion)
        return out

    def fix_age_s(self) -> float:
        """Return the sum of the latencies."""
        return sum(effect.fix_age_s() for effect in self.effects)

    def velocity_age_s(self) -> float:
        """Return the sum of the ages of speed and course beyond the position's, s."""
        return sum(effect.velocity_age_s() for effect in self.effects)

    def grade_factor(self) -> float:
        """Return the product of the shares of the slopes that the wheels feel."""
        return float(np.prod([effect.grade_factor() for effect in self.effects]))

    def wheels_time_constant_s(self) -> float:
        """Return the sum of the low-passes' time constants, s: the delay of slow changes."""
        return sum(effect.wheels_time_constant_s() for effect in self.effects)

    def antenna_offset_m(self) -> tuple[float, float]:
        """(forward, left), summed."""
        offsets = [effect.antenna_offset_m() for effect in self.effects]
        return sum(f for f, _ in offsets), sum(left for _, left in offsets)

    def track_error_m(self) -> tuple[float, float]:
        """(front, rear), summed."""
        errors = [effect.track_error_m() for effect in self.effects]
        return sum(front for front, _ in errors), sum(rear for _, rear in errors)

    def read_yaw_rate(self, true_radps: FloatArray) -> FloatArray:
        """Return the truth plus each effect's own error, so that a bias is not scaled."""
        out = true_radps.copy()
        for effect in self.effects:
            out += effect.read_yaw_rate(true_radps) - true_radps
        return out

    def yaw_rate_error_radps(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n,) sum of the gyro's errors that depend on the motion, rad/s."""
        out = np.zeros(len(motion))
        for effect in self.effects:
            out += effect.yaw_rate_error_radps(motion, car)
        return out

    def accel_error_mps2(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 2) sum of the errors of the accelerometers (forward, left) by all effects."""
        out = np.zeros((len(motion), 2))
        for effect in self.effects:
            out += effect.accel_error_mps2(motion, car)
        return out

    def steering_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """Return the (n,) sum of the errors of the steering wheel's sensor, rad."""
        out = np.zeros(len(motion))
        for effect in self.effects:
            out += effect.steering_error_rad(motion, car)
        return out

    def clock_error_s(self, time_s: FloatArray) -> FloatArray:
        """(n,) sum of the clock's errors."""
        out = np.zeros_like(time_s)
        for effect in self.effects:
            out += effect.clock_error_s(time_s)
        return out

    def gnss_speed_error_mps(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) sum of the errors of the receiver's speed."""
        out = np.zeros(len(motion))
        for effect in self.effects:
            out += effect.gnss_speed_error_mps(motion, car)
        return out

    def gnss_course_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) sum of the errors of the receiver's course."""
        out = np.zeros(len(motion))
        for effect in self.effects:
            out += effect.gnss_course_error_rad(motion, car)
        return out

    def tooth_angle_error_rad(self, angle_rad: FloatArray, wheel: int) -> FloatArray:
        """Return the sum of the tooth errors of one wheel; same shape as `angle_rad`."""
        out = np.zeros_like(angle_rad)
        for effect in self.effects:
            out += effect.tooth_angle_error_rad(angle_rad, wheel)
        return out

    def true_teeth_per_rev(self, wheel: int, configured: float) -> float:
        """Return the true counts per revolution: those of the last effect that changes them, else as
        configured."""
        teeth = configured
        for effect in self.effects:
            changed = effect.true_teeth_per_rev(wheel)
            teeth = teeth if changed is None else changed
        return teeth
