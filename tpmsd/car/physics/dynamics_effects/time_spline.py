"""Slopes of the road as splines over time, and terms without a name as splines over a covariate.

In: knots and values. Out: `DynamicsRoadGrade`, `DynamicsRoadBank` and `DynamicsUnknown`, effects that are a
spline and nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame, sine
from tpmsd.car.physics.dynamics_effect import FREE, PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.car.physics.parameters import TextParameter, VectorParameter
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray

EQUATIONS = {
    "force_x": "m/s2",
    "force_y": "m/s2",
    "moment": "rad/s2",
    "force_front": "m/s2",
    "force_rear": "m/s2",
}
"""Equations, per mass or inertia, with the unit of what is added; the last two are side forces of an axle,
which act on both lateral equations."""
ACTS_ON = (
    *EQUATIONS,
    *("yaw_rate", "accel_lat", "accel_long", "velocity_lat", "side_slip", "speed", "roll"),
)
"""Equations (per mass or inertia) and outputs that a term without a name may change."""
COVARIATES = ("time", "speed", "steering", "steering_rate", "accel_long", "accel_lat", "yaw_rate")


@dataclass(frozen=True)
class _Spline(DynamicsEffect):
    """Linear between knots, constant beyond them."""

    knots: tuple[float, ...] = (0.0, 1.0)
    heights: tuple[float, ...] = (0.0, 0.0)

    def __post_init__(self) -> None:
        DynamicsEffect.__post_init__(self)
        if len(self.knots) != len(self.heights) or any(np.diff(self.knots) <= 0.0):
            raise ConfigError(f"effect {self.name}: as many heights as knots, and knots that rise")

    def at(self, covariate: FloatArray) -> FloatArray:
        """Return the spline's values at a covariate, same shape."""
        return np.asarray(np.interp(covariate, self.knots, self.heights))


def _spline_parameters(unit: str) -> tuple[VectorParameter, VectorParameter]:
    """Return the parameters of a spline: knots, and heights in this unit."""
    return (
        VectorParameter("knots", (0.0, 60.0), "where the spline bends", ""),
        VectorParameter("heights", (0.0, 0.0), "its values there", unit),
    )


@dataclass(frozen=True)
class DynamicsRoadGrade(_Spline):
    """du/dt gains -g * sin(grade), grade a spline over time, positive uphill.

    Source: gravity along an inclined plane.
    """

    name = "road_grade"
    kind = PHYSICS
    wording = Wording(
        formula="du/dt gains -g * sin(grade(t))",
        sentence="the road rises and falls",
        distinguished_by="drive the same road there and back",
    )
    channel = "speed"
    needs_forces = True
    parameters = _spline_parameters("rad")

    def add_forces(self, frame: Frame) -> None:
        """Subtract g * sin(grade) from du/dt."""
        frame.gravity_x = frame.gravity_x - GRAVITY_MPS2 * sine(self.at(frame.inputs.time_s))


@dataclass(frozen=True)
class DynamicsRoadBank(_Spline):
    """dv/dt gains -g * sin(bank), bank a spline over time, positive where the left side is higher.

    Source: gravity along an inclined plane.
    """

    name = "road_bank"
    kind = PHYSICS
    wording = Wording(
        formula="dv/dt gains -g * sin(bank(t))",
        sentence="the road is banked",
        distinguished_by="drive the same road there and back",
    )
    channel = "velocity_lat"
    parameters = _spline_parameters("rad")

    def add_forces(self, frame: Frame) -> None:
        """Subtract g * sin(bank) from dv/dt."""
        frame.gravity_y = frame.gravity_y - GRAVITY_MPS2 * sine(self.at(frame.inputs.time_s))


@dataclass(frozen=True)
class DynamicsUnknown(_Spline):
    """A spline over a covariate, added to an equation per mass or inertia, or to an output."""

    name = "unknown"
    kind = FREE
    wording = Wording(
        formula="an equation or an output gains a spline over a covariate",
        sentence="something that no effect of the catalogue describes",
    )
    parameters = (
        TextParameter("on", "moment", "equation (force_x force_y moment force_front force_rear) or output"),
        TextParameter("over", "speed", "covariate"),
        *_spline_parameters(""),
    )
    on: str = "moment"
    over: str = "speed"

    def __post_init__(self) -> None:
        _Spline.__post_init__(self)
        if self.on not in ACTS_ON or self.over not in COVARIATES:
            raise ConfigError(f"effect unknown: no term on {self.on!r} over {self.over!r}")

    def add_forces(self, frame: Frame) -> None:
        """Add the spline, times mass or inertia, to the equation `on` if it is one."""
        if self.on not in EQUATIONS:
            return
        size = frame.inertia if self.on == "moment" else frame.mass
        value = self.at(covariate_of(frame, self.over)) * size
        if self.on in ("force_front", "force_rear"):
            lever = frame.front if self.on == "force_front" else -frame.rear
            frame.force_y = frame.force_y + value
            frame.moment = frame.moment + lever * value
        else:
            setattr(frame, self.on, getattr(frame, self.on) + value)

    def read(self, frame: Frame) -> None:
        """Add the spline to the reading `on` if it is an output."""
        if self.on in frame.outputs:
            frame.outputs[self.on] = frame.outputs[self.on] + self.at(covariate_of(frame, self.over))


def covariate_of(frame: Frame, name: str) -> FloatArray:
    """Return a covariate of one evaluation: lateral acceleration is the steady one, u r, the longitudinal one
    that of loads. A reading would share its noise with what is explained."""
    values = {
        "time": frame.inputs.time_s,
        "speed": frame.u,
        "steering": frame.steer,
        "steering_rate": frame.inputs.steer_rate_radps,
        "accel_long": np.asarray(frame.load_accel_long),
        "accel_lat": frame.u * frame.r,
        "yaw_rate": frame.r,
    }
    return values[name]
