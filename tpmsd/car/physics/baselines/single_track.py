"""The linear single-track car: two axles, linear tyres, small angles; speed is an input.

m (dv/dt + u r) = F_f + F_r, I dr/dt = a F_f - b F_r, F_f = C_f (delta - (v + a r) / u),
F_r = -C_r (v - b r) / u ([Riekert 1940]).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tpmsd.car.physics.baselines.base import Baseline, lateral_transfer, like
from tpmsd.car.physics.baselines.dugoff import grip_share
from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.motion import GRAVITY_MPS2


@dataclass(frozen=True, slots=True)
class SingleTrack(Baseline):
    """The linear single-track car."""

    name: ClassVar[str] = "single-track"

    def _loads(self, frame: Frame) -> None:
        """Axle loads with the transfer of longitudinal acceleration; lateral transfer for the effects."""
        base = frame.front + frame.rear
        rise = frame.mass * frame.accel_long * frame.height / base
        weight = frame.mass * GRAVITY_MPS2 / base
        frame.load = np.stack(np.broadcast_arrays(weight * frame.rear - rise, weight * frame.front + rise))
        frame.transfer = lateral_transfer(frame)

    def _angles(self, frame: Frame) -> None:
        """Small slip angles of the axles."""
        front = frame.steer - (frame.v + frame.front * frame.r) / frame.u
        rear = -(frame.v - frame.rear * frame.r) / frame.u
        frame.angle = np.stack(np.broadcast_arrays(front, rear))
        stiff = np.broadcast_arrays(frame.cornering_front, frame.cornering_rear)
        frame.stiffness = like(np.stack(stiff), frame.angle)

    def _tyres(self, frame: Frame) -> None:
        """Forces proportional to the slip angles, less where an effect sets a limit."""
        frame.side = like(frame.stiffness, frame.angle) * frame.angle
        if frame.friction is not None:
            linear = np.abs(frame.side)
            share = grip_share(linear, 1.0, frame.friction, frame.load, frame.tyre_shape)
            frame.side = frame.side * share
        frame.along = np.zeros_like(frame.side)
        frame.force_y = frame.side[0] + frame.side[1]
        frame.moment = frame.front * frame.side[0] - frame.rear * frame.side[1]
        frame.force_x = frame.mass * frame.accel_long
