"""The car as the dynamics see it: masses, lengths, tyres, and where a wheel's force comes from.

In: measured values, or the geometry alone. Out: `CarDynamics`. Only ratios to the mass act on the motion, so
`typical` can do without a weighing: stiffness, friction and inertia of passenger cars per mass lie within a
third of each other.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.vehicle_state.settings import SETTINGS
from tpmsd.car.vehicle_state.tyre import DugoffTyre
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class CarDynamics:
    """Constants of the 3-DOF model; `ValueError` where one makes no car."""

    mass_kg: float
    yaw_inertia_kgm2: float
    front_m: float
    """Centre of gravity to front axle (the paper's a)."""
    rear_m: float
    """Centre of gravity to rear axle (b)."""
    height_m: float
    """Centre of gravity above the road (h)."""
    track_front_m: float
    track_rear_m: float
    cornering_front_n: float
    """C_alpha of one front wheel, N/rad."""
    cornering_rear_n: float
    longitudinal_n: float
    """C_sigma of one wheel, N per unit of slip."""
    friction: float = 1.0
    drive_front_share: float = 1.0
    """Share of the driving force at the front axle: 1 front, 0 rear drive."""
    brake_front_share: float = SETTINGS.brake_front_share
    roll_rad_per_mps2: float = 0.0
    """Roll of the body per lateral acceleration. A sensor fixed to the body reads a_y * (1 + g * roll)."""
    forward_m: FloatArray = field(init=False, repr=False, compare=False)
    """(4,) hubs ahead of the centre of gravity: fl, fr, rl, rr."""
    left_m: FloatArray = field(init=False, repr=False, compare=False)
    """(4,) hubs to the left of it."""
    cornering_n: FloatArray = field(init=False, repr=False, compare=False)
    """(4,) C_alpha, N/rad."""
    tyres: DugoffTyre = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        for name in ("mass_kg", "yaw_inertia_kgm2", "front_m", "rear_m", "track_front_m", "track_rear_m"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)!r} is not above 0")
        for name in ("cornering_front_n", "cornering_rear_n", "longitudinal_n", "friction"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)!r} is not above 0")
        front, rear = self.track_front_m / 2, self.track_rear_m / 2
        stiff, other = self.cornering_front_n, self.cornering_rear_n
        per_wheel = {
            "forward_m": [self.front_m, self.front_m, -self.rear_m, -self.rear_m],
            "left_m": [front, -front, rear, -rear],
            "cornering_n": [stiff, stiff, other, other],
        }
        for name, values in per_wheel.items():  # made once: the filters ask for them thousands of times
            object.__setattr__(self, name, np.array(values))
        object.__setattr__(self, "tyres", DugoffTyre(self.longitudinal_n, self.cornering_n, self.friction))

    @property
    def wheelbase_m(self) -> float:
        """Return the distance from front to rear axle, metres."""
        return self.front_m + self.rear_m

    @property
    def understeer_gradient_s2pm(self) -> float:
        """Return K in delta = (l + K u^2) r / u of the linear bicycle: m / l * (b / C_f - a / C_r), axle
        stiffnesses."""
        front, rear = 2 * self.cornering_front_n, 2 * self.cornering_rear_n
        return self.mass_kg / self.wheelbase_m * (self.rear_m / front - self.front_m / rear)


def typical(wheelbase_m: float, track_front_m: float, track_rear_m: float, driven: str) -> CarDynamics:
    """Return a passenger car of this geometry; `driven` is front, rear or all."""
    share = {
        "front": SETTINGS.front_load_driven_front,
        "rear": SETTINGS.front_load_driven_rear,
        "all": SETTINGS.front_load_driven_all,
    }[driven]
    front_m, rear_m = (1.0 - share) * wheelbase_m, share * wheelbase_m
    mass = SETTINGS.mass_kg
    front_load, rear_load = mass * GRAVITY_MPS2 * share / 2, mass * GRAVITY_MPS2 * (1.0 - share) / 2
    return CarDynamics(
        mass_kg=mass,
        yaw_inertia_kgm2=mass * front_m * rear_m,
        front_m=front_m,
        rear_m=rear_m,
        height_m=SETTINGS.height_per_wheelbase * wheelbase_m,
        track_front_m=track_front_m,
        track_rear_m=track_rear_m,
        cornering_front_n=SETTINGS.cornering_front_per_load * front_load,
        cornering_rear_n=SETTINGS.cornering_rear_per_load * rear_load,
        longitudinal_n=SETTINGS.longitudinal_per_load * mass * GRAVITY_MPS2 / 4,
        drive_front_share={"front": 1.0, "rear": 0.0, "all": 0.5}[driven],
    )
