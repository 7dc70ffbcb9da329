"""Plan of the monitoring: the signals in use, and what is lost for those that are missing.

In: a configuration without problems, the DBC's signals of its roles. Out: `ConfigurationPlan`, for people and
programs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cantools.database.can import Message, Signal

from tpmsd.car.config.dbc import counter_modulus
from tpmsd.car.config.gnss_source import source_of
from tpmsd.car.config.model import FLAG_ROLES, GNSS_ROLES, OPTIONAL_ROLES, Config, SignalOptions
from tpmsd.car.config.units import assumed_unit, canonical_unit, stated_unit, to_si, wheel_speed_kind
from tpmsd.foundation.wheels import WHEELS

TOP_SPEED_MPS = 60.0
"""The speed for which counters are judged: 216 km/h."""

_LOST = {
    "yaw_rate": "turns are seen by the difference of the wheels alone, and no gyro can be diagnosed",
    "accel_long": "acceleration is taken from the wheels, so a slope does not show in it",
    "accel_lat": "lateral acceleration is speed times the yaw rate of gyro, receiver or wheels",
    "steering_wheel_angle": "at walking pace the heading rests on the wheels' coarse counts",
    "brake_pressure": "braking shows only as deceleration",
    "drive_torque": "slip under drive force is judged by the acceleration alone",
    "ambient_temp": "warm-up of the tyres cannot be distinguished from the weather",
}

_LOST_BY_SLIP_GATE = {
    "yaw_rate": "the slip gate takes the turn from the receiver or the wheels, half a second late",
    "accel_long": "the slip gate takes the wheels' acceleration for the force: late, and wrong on slopes",
    "steering_wheel_angle": "the slip gate does not see what driving through a bend costs in slip",
}
"""Said beside the above where [filter] gate is `slip`; without any of them it works all the same."""


@dataclass(frozen=True, slots=True)
class SignalPosition:
    """Position on the bus of a role's signal."""

    role: str
    signal: str
    """'Message.Signal'."""
    frame_id: int
    extended: bool
    period_s: float | None
    """The DBC's cycle time; None where it gives none."""
    unit: str | None
    """Unit as understood; None for counters."""
    multiplexed: bool


@dataclass(frozen=True, slots=True)
class WheelPlan:
    """One wheel and the signal of its rotation."""

    wheel: str
    radius_m: float
    source: SignalPosition
    kind: str
    """count | speed"""
    bits: int
    resolution_mm: float | None = None
    """Road under one step of a counter; None for a speed."""
    rollover_m: float | None = None
    """Road from one roll-over of a counter to the next; None for a speed."""
    unambiguous_s: float | None = None
    """Longest time between two frames for which the turn is certain at `TOP_SPEED_MPS`; None for a speed."""
    speed_step_mps: float | None = None
    """Resolution of a speed; None for a counter."""


@dataclass(frozen=True, slots=True)
class ConfigurationPlan:
    """All that the daemon would do with this configuration."""

    file: Path
    dbc: Path
    interface: str
    channel: str
    wheels: tuple[WheelPlan, ...]
    optional: tuple[SignalPosition, ...]
    losses: dict[str, str]
    """Mapping missing input -> loss of function by it."""
    config: Config


def make_plan(config: Config, found: Mapping[str, tuple[Message, Signal]]) -> ConfigurationPlan:
    """Return the plan of a configuration whose roles have all been found in the DBC."""
    wheels = tuple(
        _wheel_plan(config, index, role, *found[role])
        for index, wheel in enumerate(WHEELS)
        for role in (f"wheel_count_{wheel}", f"wheel_speed_{wheel}")
        if role in found
    )
    optional = tuple(
        _signal_position(role, *found[role], config.can.option(role))
        for role in OPTIONAL_ROLES + FLAG_ROLES + GNSS_ROLES
        if role in found
    )
    return ConfigurationPlan(
        file=config.file or Path("vehicle.toml"),
        dbc=config.can.dbc,
        interface=config.can.interface,
        channel=config.can.channel,
        wheels=wheels,
        optional=optional,
        losses=_losses(config, {wheel.wheel for wheel in wheels}),
        config=config,
    )


def _signal_position(role: str, message: Message, signal: Signal, option: SignalOptions) -> SignalPosition:
    stated = stated_unit(option.unit or signal.unit)
    return SignalPosition(
        role=role,
        signal=f"{message.name}.{signal.name}",
        frame_id=message.frame_id,
        extended=message.is_extended_frame,
        period_s=message.cycle_time / 1000 if message.cycle_time else None,
        unit=None if role.startswith("wheel_count_") else canonical_unit(stated) or assumed_unit(role),
        multiplexed=bool(signal.multiplexer_ids),
    )


def _wheel_plan(config: Config, index: int, role: str, message: Message, signal: Signal) -> WheelPlan:
    """Return, for people to read, a wheel's signal with its resolution, roll-over and longest gap."""
    radius_m = config.vehicle.wheel_radius_m[index]
    option = config.can.option(role)
    plan = WheelPlan(
        wheel=WHEELS[index],
        radius_m=radius_m,
        source=_signal_position(role, message, signal, option),
        kind="count" if role.startswith("wheel_count_") else "speed",
        bits=signal.length,
    )
    scale = signal.scale if option.scale is None else option.scale
    if plan.kind == "speed":
        unit = option.unit or signal.unit
        per_radius = radius_m if wheel_speed_kind(unit) == "angular" else 1.0
        return replace(plan, speed_step_mps=abs(scale) * to_si(role, unit)[0] * per_radius)
    step_m = abs(scale) / config.vehicle.teeth(index) * 2 * math.pi * radius_m
    rollover_m = step_m * (option.modulus or counter_modulus(signal))
    return replace(
        plan,
        resolution_mm=1000 * step_m,
        rollover_m=rollover_m,
        # Half a roll-over, since a wheel may also turn back.
        unambiguous_s=rollover_m / 2 / TOP_SPEED_MPS,
    )


def _losses(config: Config, wheels: set[str]) -> dict[str, str]:
    """Return missing signal, wheel pair or value -> what is lost without it, in words."""
    losses = {}
    if not {"fl", "fr"} <= wheels:
        losses["front wheels"] = "the daemon monitors the rear axle only; a soft front tyre stays unseen"
    for role in OPTIONAL_ROLES:
        if role not in config.can.signals:
            losses[role] = _LOST[role]
            if config.filter.gate == "slip" and role in _LOST_BY_SLIP_GATE:
                losses[role] += f"; {_LOST_BY_SLIP_GATE[role]}"
    if "steering_wheel_angle" not in losses and config.vehicle.steering_ratio is None:
        losses["steering_ratio"] = _LOST["steering_wheel_angle"]
    if source_of(config.gnss) is None:
        losses["[gnss] device"] = "a drive can be replayed, but 'tpmsd run' has no receiver"
    if config.state.file is None:
        losses["[state] file"] = "what was learnt and raised is forgotten at every restart"
    return losses
