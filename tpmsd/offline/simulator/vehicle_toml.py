"""The vehicle.toml of a simulated drive.

In: the vehicle, the bus's messages, the receiver. Out: its text.
"""

from __future__ import annotations

import json

from tpmsd.car.config.model import VehicleConfig
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.simulator.frame_layout import MessageLayout
from tpmsd.offline.simulator.receiver import ReceiverSpec


def vehicle_toml(
    vehicle: VehicleConfig,
    messages: tuple[MessageLayout, ...],
    receiver: ReceiverSpec,
    antenna_forward_m: float = 0.0,
    antenna_left_m: float = 0.0,
    *,
    interface: str = "socketcan",
    channel: str = "can0",
    device: str = "/dev/ttyACM0",
) -> str:
    """Return as TOML the configuration that the operator of the simulated car has; the keywords name the
    ports of a live drive.
    """
    lines = ["[vehicle]"]
    if vehicle.name is not None:
        lines.append(f"name = {json.dumps(vehicle.name)}")
    lines += [f"wheel_radius_m = {_radius_value(vehicle)}"]
    for key in ("track_front_m", "track_rear_m", "wheelbase_m"):
        lines.append(f"{key} = {getattr(vehicle, key)!r}")
    lines.append(f'driven_axle = "{vehicle.driven_axle}"')
    if vehicle.steering_ratio is not None:
        lines.append(f"steering_ratio = {vehicle.steering_ratio!r}")
    lines += [
        f"teeth_per_rev = {vehicle.teeth_per_rev:.12g}",
        "",
        "[can]",
        f"interface = {json.dumps(interface)}",
        f"channel = {json.dumps(channel)}",
        'dbc = "bus.dbc"',
        "",
        "[can.signals]",
    ]
    roles = {
        signal.role: f"{message.name}.{signal.name}"
        for message in messages
        for signal in message.signals
        if signal.role
    }
    # Wheels first, in their order.
    ordered = sorted(roles, key=lambda role: (not role.startswith("wheel_"), _wheel_sort_key(role), role))
    lines += [f'{role} = "{roles[role]}"' for role in ordered]
    lines += [
        "",
        "[gnss]",
        f"device = {json.dumps(device)}",
        f"baud = {receiver.baud}",
        f"antenna_forward_m = {antenna_forward_m!r}",
        f"antenna_left_m = {antenna_left_m!r}",
        f"latency_s = {receiver.latency_s!r}",
    ]
    return "\n".join(lines) + "\n"


def _wheel_sort_key(role: str) -> int:
    return WHEELS.index(role[-2:]) if role.startswith("wheel_") else len(WHEELS)


def _radius_value(vehicle: VehicleConfig) -> str:
    """Return the TOML value of `wheel_radius_m`: a number, or a table where the wheels differ."""
    radii = vehicle.wheel_radius_m
    if len(set(radii)) == 1:
        return repr(radii[0])
    pairs = (f"{wheel} = {radius!r}" for wheel, radius in zip(WHEELS, radii, strict=True))
    return "{ " + ", ".join(pairs) + " }"
