"""Other instruments of the bus: drive torque and ambient temperature for a motion.

In: `Motion`, `Car`. Out: the same motion with them as measured covariates, so that effects
may depend on them.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray

ENGINE_BRAKE_MPS2 = -0.5
"""Deceleration by the engine alone, m/s2; more is the brakes' work."""
ZERO_DEGC_K = 273.15
_AMBIENT_DEGC = 15.0
_MASS_KG = 1500.0
_DRAG_PER_MASS = 2.7e-4
"""Half rho c_d A over the mass, 1/m."""
_ROLLING_MPS2 = 0.1


def with_instruments(motion: Motion, car: Car) -> Motion:
    """Return the motion with drive torque (Nm) and temperature (K) added; those that were measured stay as
    they are.
    """
    torque = (
        np.maximum(drive_force_per_mass(motion), ENGINE_BRAKE_MPS2) * _MASS_KG * float(car.radius_m.mean())
    )
    ambient = np.full(len(motion), _AMBIENT_DEGC + ZERO_DEGC_K)
    return dataclasses.replace(motion, measured={"torque": torque, "temperature": ambient, **motion.measured})


def drive_force_per_mass(motion: Motion) -> FloatArray:
    """Return the (n,) force at the driven wheels per mass, m/s2: acceleration, slope, drag and rolling
    resistance.
    """
    drag = _DRAG_PER_MASS * motion.speed_mps**2
    return np.asarray(motion.specific_force_long_mps2 + drag + _ROLLING_MPS2)
