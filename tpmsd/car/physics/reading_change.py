"""Effects as changes of readings that exist already: what a recording would show with them, or without.

In: a motion, a car, an `ExtendedModel`. Out: factors on the wheels' turns and what the receiver's antenna
shows with and without the effects, at the motion's times. Pure. An effect is put into a recording, or taken
out of one, by these: all else in the readings (road, noise, rounding) stays what it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.forward import AntennaTruth, antenna_truth, wheel_rates
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

ROLLING = ExtendedModel()
MIN_MPS = 0.05
"""Speed of a wheel (m/s) below which its factor is that of a standing one, 1."""
FACTORS = (0.0, 3.0)
"""Least and greatest factor on a wheel's turn: a locked wheel, and one that spins as tyres do on ice."""
ANGLE_STEP_RAD = 1e-4
"""Over which the slope of a ring's error is taken."""


def acts_by_road_slope(effect: Effect) -> bool:
    """Return True if an effect acts by the slopes of the road, which every recording holds already."""
    cls = type(effect)
    return any(
        getattr(cls, hook) is not getattr(Effect, hook) for hook in ("horizontal_factor", "grade_factor")
    )


def wheel_rotation_factors(motion: Motion, car: Car, model: ExtendedModel) -> FloatArray:
    """(n, 4) turn of each wheel with the effects over its turn without them; 1 where the car stands."""
    plain = wheel_rates(motion, car, ROLLING)
    acting = wheel_rates(motion, car, model)
    rolls = np.abs(plain) * car.radius_m > MIN_MPS
    factors = np.divide(acting, plain, out=np.ones_like(plain), where=rolls)
    return np.clip(factors, *FACTORS)


def indicated_angle(angle_rad: FloatArray, wheel: int, car: Car, model: ExtendedModel) -> FloatArray:
    """Return the angle that counts show, at the configured teeth, for a true angle; same shape."""
    shown = angle_rad + model.tooth_angle_error_rad(angle_rad, wheel)
    teeth = model.true_teeth_per_rev(wheel, car.teeth_per_rev) / car.teeth_per_rev
    return np.asarray(shown * teeth)


def indicated_rate_factor(angle_rad: FloatArray, wheel: int, car: Car, model: ExtendedModel) -> FloatArray:
    """Return the derivative of `indicated_angle` by the true angle; same shape."""
    before, after = (
        model.tooth_angle_error_rad(angle_rad + step, wheel) for step in (-ANGLE_STEP_RAD, ANGLE_STEP_RAD)
    )
    teeth = model.true_teeth_per_rev(wheel, car.teeth_per_rev) / car.teeth_per_rev
    return np.asarray((1.0 + (after - before) / (2.0 * ANGLE_STEP_RAD)) * teeth)


@dataclass(frozen=True)
class FixChange:
    """Changes that effects make in fixes of some instants; arrays (m,)."""

    east_m: FloatArray
    north_m: FloatArray
    plain_mps: FloatArray
    """Velocity (m,) without the effects as a complex number, east + i north."""
    acting_mps: FloatArray
    """Velocity with the effects, in the same form."""


class AntennaChange:
    """The antenna's path with and without effects."""

    def __init__(self, motion: Motion, car: Car, model: ExtendedModel) -> None:
        self._time_s = motion.time_s
        self._plain = antenna_truth(motion, car, ROLLING)
        self._acting = antenna_truth(motion, car, model)
        self._lag_s = model.velocity_age_s()

    def at(self, time_s: FloatArray) -> FixChange:
        """Return the changes in fixes valid at times (m,), seconds since the motion's start."""

        def position(truth: AntennaTruth) -> tuple[FloatArray, FloatArray]:
            east = np.interp(time_s, self._time_s, truth.east_m)
            return east, np.interp(time_s, self._time_s, truth.north_m)

        def velocity(truth: AntennaTruth, when: FloatArray) -> FloatArray:
            east = np.interp(when, self._time_s, truth.shown_east_mps)
            return np.asarray(east + 1j * np.interp(when, self._time_s, truth.shown_north_mps))

        (east, north), (plain_east, plain_north) = position(self._acting), position(self._plain)
        return FixChange(
            east - plain_east,
            north - plain_north,
            velocity(self._plain, time_s),
            velocity(self._acting, time_s - self._lag_s),
        )
