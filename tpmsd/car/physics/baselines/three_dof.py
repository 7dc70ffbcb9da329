"""The 3-DOF car of [Liu 2022]: four wheels, Dugoff tyres, quasi-static wheel loads.

Hub i lies x_i ahead and y_i to the left of the centre of gravity and moves with (u - r y_i, v + r x_i). A
wheel's longitudinal slip is that which carries its share of the force, sigma / (1 + sigma) = F / C_sigma, of
the given forces or of m a_x. Loads follow from a_x and the steady a_y = u r; `instant_loads` lets them
follow all of a_y. Each sign is taken from a free-body drawing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tpmsd.car.physics.baselines.base import MIN_MPS, Baseline, axle_forces, lateral_transfer, pad_axes
from tpmsd.car.physics.baselines.dugoff import grip_share, lateral_friction_share
from tpmsd.car.physics.baselines.frame import Frame, Unlimited, is_zero, like, stack_contacts
from tpmsd.car.physics.baselines.names import THREE_DOF
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.wheels import FloatArray

MAX_SLIP_FORCE = 0.3
"""Largest F / C_sigma that is turned into a slip: beyond, a wheel spins or locks."""


@dataclass(frozen=True, slots=True)
class ThreeDof(Baseline):
    """The car of [Liu 2022]."""

    name: ClassVar[str] = THREE_DOF
    nonlinear: ClassVar[bool] = True

    def _fill_loads(self, frame: Frame) -> None:
        """Fill in quasi-static wheel loads, [Liu 2022, eq. 8] with the division by the wheelbase."""
        base = frame.front + frame.rear
        rise = frame.mass * frame.load_accel_long * frame.height / base
        weight = frame.mass * GRAVITY_MPS2 / base
        front, rear = 0.5 * (weight * frame.rear - rise), 0.5 * (weight * frame.front + rise)
        frame.transfer = lateral_transfer(frame)
        left_front = 0.5 * weight * frame.rear * frame.transfer[0]
        left_rear = 0.5 * weight * frame.front * frame.transfer[1]
        loads = (front - left_front, front + left_front, rear - left_rear, rear + left_rear)
        frame.load = stack_contacts(*loads)

    def _fill_slip_angles(self, frame: Frame) -> None:
        """Fill in the wheels' slip angles and stiffnesses."""
        ahead = frame.v + frame.front * frame.r
        behind = frame.v - frame.rear * frame.r
        front, rear = 0.5 * frame.track_front * frame.r, 0.5 * frame.track_rear * frame.r
        along = [np.maximum(frame.u + side, MIN_MPS) for side in (-front, front, -rear, rear)]
        across = (ahead, ahead, behind, behind)
        turned = (frame.steer, frame.steer, 0.0, 0.0)
        angles = [t - np.arctan(a / u) for t, a, u in zip(turned, across, along, strict=True)]
        frame.angle = stack_contacts(*angles)
        front_n, rear_n = np.broadcast_arrays(
            0.5 * np.asarray(frame.cornering_front), 0.5 * np.asarray(frame.cornering_rear)
        )
        frame.stiffness = like(np.stack([front_n, front_n, rear_n, rear_n]), frame.angle)

    def _unlimited_forces(self, frame: Frame) -> Unlimited:
        """Return Dugoff's forces without limit: C tan(alpha) / (1 + sigma), C_sigma sigma / (1 + sigma)."""
        share, angle = pad_axes(slip_force_shares(frame), frame.angle)
        # 1 / (1 + sigma) is 1 - F / C_sigma
        side = like(frame.stiffness, angle) * np.tan(angle) * (1.0 - share)
        along = frame.longitudinal * share
        # cosine and sine by the tangent of half the angle, which takes a fifth of their time
        half = np.tan(0.5 * (frame.steer + frame.turned_front))
        square = half * half
        cos, sin = (1.0 - square) / (1.0 + square), 2.0 * half / (1.0 + square)
        side, along = np.broadcast_arrays(side, along)
        return Unlimited(side, along, np.sqrt(along * along + side * side), cos, sin)

    def _fill_tyre_forces(self, frame: Frame) -> None:
        """Fill in forces in the wheels' frames, and their sums in the car's."""
        tyres = frame.unlimited
        assert frame.friction is not None and tyres is not None
        side, along, total, load = pad_axes(tyres.side, tyres.along, tyres.total, frame.load)
        share = grip_share(total, frame.friction, load, frame.tyre_shape)
        frame.side, frame.along = side * share, along * share
        if not is_zero(frame.ellipse):
            frame.side = frame.side + frame.ellipse * (_side_force_by_ellipse(frame, side, load) - frame.side)
        ahead = [*(frame.along[k] * tyres.cos - frame.side[k] * tyres.sin for k in (0, 1)), *frame.along[2:]]
        left = [*(frame.along[k] * tyres.sin + frame.side[k] * tyres.cos for k in (0, 1)), *frame.side[2:]]
        if not is_zero(frame.turned_rear):  # some hundredths of a radian, whose cosine is 1
            for k in (2, 3):
                ahead[k] = ahead[k] - frame.turned_rear * frame.side[k]
                left[k] = left[k] + frame.turned_rear * frame.along[k]
        frame.force_x = ahead[0] + ahead[1] + ahead[2] + ahead[3]
        front, rear = left[0] + left[1], left[2] + left[3]
        frame.force_y = front + rear
        frame.moment = (
            frame.front * front
            - frame.rear * rear
            + 0.5 * frame.track_front * (ahead[1] - ahead[0])
            + 0.5 * frame.track_rear * (ahead[3] - ahead[2])
        )


def _side_force_by_ellipse(frame: Frame, side: FloatArray, load: FloatArray) -> FloatArray:
    """Return the (4, ...) side forces, limited to the friction that longitudinal forces leave (ellipse)."""
    assert frame.friction is not None
    front, rear = (0.5 * np.asarray(one) for one in axle_forces(frame))
    longitudinal = stack_contacts(front, front, rear, rear)
    longitudinal, load, share, side = pad_axes(longitudinal, load, slip_force_shares(frame), side)
    left = load * lateral_friction_share(longitudinal, frame.friction, load)
    alone = side / (1.0 - share)
    return alone * grip_share(np.abs(alone), frame.friction, left, frame.tyre_shape)


def slip_force_shares(frame: Frame) -> FloatArray:
    """Return F / C_sigma = sigma / (1 + sigma) of the wheels, (4, ...), which carry their shares of drive and
    brake force."""
    halves = [0.5 * np.asarray(one) / frame.longitudinal for one in axle_forces(frame)]
    return np.repeat(np.clip(stack_contacts(*halves), -MAX_SLIP_FORCE, MAX_SLIP_FORCE), 2, axis=0)
