"""Simulated world: true motion and readings of car and receiver, before any sensor.

In: motion, car, effects, per-wheel radii, roughness, a Generator. Out: `World` with wheel angles and antenna
truth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.catalogue import SLOPES
from tpmsd.car.physics.forward import (
    AntennaTruth,
    antenna_truth,
    shown_counts,
    wheel_angles,
    wheel_radii,
)
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.simulator.clock import Clocks
from tpmsd.offline.simulator.instruments import with_instruments
from tpmsd.offline.simulator.noise import gauss_markov

ROUGHNESS_STD_M = 2e-4
"""Effective radius over a smooth road at 100 Hz. A RAV4's wheel-to-wheel ratio on a suburban road is 0.023 %
over 0.5 s, which this makes."""
_ROUGHNESS_TAU_S = 0.03


@dataclass(frozen=True)
class World:
    """The truth over time; arrays (n,) or (n, 4) on `motion.time_s`."""

    motion: Motion
    car: Car
    model: ExtendedModel
    """All that acts: the user's effects, the faults, and the slopes where there are any."""
    radii_m: FloatArray
    """(n, 4) without roughness."""
    angles_rad: FloatArray
    antenna: AntennaTruth

    def angle_at(self, time_s: FloatArray, wheel: int) -> FloatArray:
        """Return the angle turned by a wheel at any times within the motion; same shape."""
        return np.interp(time_s, self.motion.time_s, self.angles_rad[:, wheel])

    def host_s(self, clocks: Clocks, time_s: FloatArray) -> FloatArray:
        """Return the host's clock, with the errors that effects give it, at times since the start; same
        shape.
        """
        return clocks.host_s(time_s) + self.model.clock_error_s(time_s)

    def counts_at(self, time_s: FloatArray, wheel: int) -> FloatArray:
        """Return the counts since the start, not yet rounded down, that the wheel's ring has shown; same
        shape.
        """
        return shown_counts(self.angle_at(time_s, wheel), wheel, self.car, self.model)


def make_world(
    motion: Motion,
    car: Car,
    model: ExtendedModel,
    rng: np.random.Generator,
    *,
    radius_offset_m: FloatArray | None = None,
    roughness_std_m: float = ROUGHNESS_STD_M,
) -> World:
    """Return the true motion, radii, wheel angles and antenna path of a car under the effects of a model.

    `radius_offset_m` (4,) is true minus nominal radius, constant over the drive. A road that is not level
    always shortens what the receiver sees: that effect is added where it is missing.
    """
    motion = with_instruments(motion, car)
    if np.any(motion.grade_rad != 0.0) and not any(effect.shortens for effect in model):
        model = model.plus(SLOPES())
    offset = np.zeros(4) if radius_offset_m is None else radius_offset_m
    radii = wheel_radii(motion, car, model) + offset
    step = float(motion.time_s[1] - motion.time_s[0])
    rough = gauss_markov(rng, len(motion), step, roughness_std_m, _ROUGHNESS_TAU_S, 4)
    return World(
        motion=motion,
        car=car,
        model=model,
        radii_m=radii,
        angles_rad=wheel_angles(motion, car, model, radii + rough),
        antenna=antenna_truth(motion, car, model),
    )
