"""The linear single-track car: two axles, linear tyres, small angles; speed is an input.

m (dv/dt + u r) = F_f + F_r, I dr/dt = a F_f - b F_r, F_f = C_f (delta - (v + a r) / u),
F_r = -C_r (v - b r) / u ([Riekert 1940]).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tpmsd.car.physics.baselines.base import Baseline, axle_forces, lateral_transfer
from tpmsd.car.physics.baselines.dugoff import grip_share, lateral_friction_share
from tpmsd.car.physics.baselines.frame import Frame, Real, Unlimited, is_zero, like, stack_contacts
from tpmsd.car.physics.baselines.names import SINGLE_TRACK
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.wheels import FloatArray


def _carried_force_share(frame: Frame, linear: FloatArray, friction: Real) -> FloatArray:
    """Return the share of the linear force that each axle carries, (2, ...): the mean of its two wheels."""
    load = frame.load
    if not is_zero(frame.ellipse):
        longitudinal = stack_contacts(*axle_forces(frame))
        load = load * (1.0 - frame.ellipse * (1.0 - lateral_friction_share(longitudinal, friction, load)))
    if is_zero(frame.wheel_loads):
        return grip_share(linear, friction, load, frame.tyre_shape)
    part = frame.wheel_loads * frame.transfer
    inner, outer = (
        grip_share(linear, friction, load * (1.0 + sign * part), frame.tyre_shape) for sign in (-1, 1)
    )
    return 0.5 * (inner + outer)


@dataclass(frozen=True, slots=True)
class SingleTrack(Baseline):
    """The linear single-track car."""

    name: ClassVar[str] = SINGLE_TRACK

    def _fill_loads(self, frame: Frame) -> None:
        """Fill in axle loads with longitudinal transfer, and the lateral transfer that effects use."""
        base = frame.front + frame.rear
        rise = frame.mass * frame.load_accel_long * frame.height / base
        weight = frame.mass * GRAVITY_MPS2 / base
        frame.load = stack_contacts(weight * frame.rear - rise, weight * frame.front + rise)
        frame.transfer = lateral_transfer(frame)

    def _fill_slip_angles(self, frame: Frame) -> None:
        """Fill in the axles' slip angles, linear in the motion, and stiffnesses."""
        front = frame.steer - (frame.v + frame.front * frame.r) / frame.u
        rear = -(frame.v - frame.rear * frame.r) / frame.u
        frame.angle = stack_contacts(front, rear)
        stiff = np.broadcast_arrays(frame.cornering_front, frame.cornering_rear)
        frame.stiffness = like(np.stack(stiff), frame.angle)

    def _unlimited_forces(self, frame: Frame) -> Unlimited:
        """Return side forces proportional to the slip angles; none along the wheels."""
        side = like(frame.stiffness, frame.angle) * frame.angle
        return Unlimited(side, np.zeros_like(side), np.abs(side), np.ones(1), np.zeros(1))

    def _fill_tyre_forces(self, frame: Frame) -> None:
        """Fill in forces proportional to the slip angles, less where an effect sets a limit of friction."""
        assert frame.unlimited is not None
        frame.side, frame.along = frame.unlimited.side, frame.unlimited.along
        if frame.friction is not None:
            frame.side = frame.side * _carried_force_share(frame, frame.unlimited.total, frame.friction)
        frame.force_y = frame.side[0] + frame.side[1]
        frame.moment = frame.front * frame.side[0] - frame.rear * frame.side[1]
        frame.force_x = frame.mass * frame.accel_long
