"""Simulated bus: the frames that the control units put on CAN.

In: the world's truth, the bus's qualities, clocks, a Generator. Out: `FrameLog`, all frames in order of
arrival. A count is the ring's edges up to the frame's sampling instant, floor(angle * teeth / 2 pi), on a
counter that rolls over at its width; a speed is the turn since the last sample times the maker's radius.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.forward import accelerations, gyro_rates, steering_wheel_angles
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.simulator.bus_layouts import ALIVE, bus_layout
from tpmsd.offline.simulator.clock import Clocks
from tpmsd.offline.simulator.frame_layout import ByteArray, IntArray, MessageLayout, SignalLayout
from tpmsd.offline.simulator.instruments import ENGINE_BRAKE_MPS2, ZERO_DEGC_K, drive_force_per_mass
from tpmsd.offline.simulator.noise import gauss_markov
from tpmsd.offline.simulator.world import World

_UNIT_PER_SI = {
    "km/h": 3.6,
    "deg/s": 180 / np.pi,
    "rad/s": 1.0,
    "deg": 180 / np.pi,
    "rad": 1.0,
    "m/s2": 1.0,
    "g": 1 / GRAVITY_MPS2,
    "Nm": 1.0,
    "bar": 1e-5,
    "degC": 1.0,
}
MAX_WIDTH_SHARE = 0.7
"""Share of a counter's width that a wheel may count from frame to frame: what it may gain meanwhile, and a
stamp that is late, must be distinguished from one turn more. At 0.73 0.4 % of the ticks are lost, at 0.92 a
fifth."""
_SENSOR_TAU_S = 0.02
_BRAKE_PA_PER_MPS2 = 8e5


@dataclass(frozen=True)
class BusSpec:
    """Kind of wheel signal on the simulated bus, how many wheels it has, and its errors in time."""

    kind: str = "counts16"
    wheels: int = 4
    jitter_s: float = 0.0004
    """Mean of the (exponential) delay between sampling and the host's time stamp."""
    lost_fraction: float = 0.0
    repeated_fraction: float = 0.0
    """Share of frames that are sent twice."""
    resets_s: tuple[float, ...] = ()
    """Times since the drive's start at which the wheel counters start again from zero, s."""
    yaw_rate_std_radps: float = 0.002
    accel_std_mps2: float = 0.03
    steering_std_rad: float = 0.005
    """Standard deviation of the angle at the steering wheel, rad."""


@dataclass(frozen=True)
class FrameLog:
    """Frames in order of arrival."""

    time_s: FloatArray
    """(n,) arrival on the host clock, s."""
    frame_id: IntArray
    data: ByteArray
    """(n, 8)"""

    def __len__(self) -> int:
        return len(self.time_s)


def frames_of(world: World, spec: BusSpec, clocks: Clocks, rng: np.random.Generator) -> FrameLog:
    """Return all CAN frames of the drive."""
    times, ids, datas = [], [], []
    start = {wheel: int(rng.integers(0, 1 << 32)) for wheel in WHEELS}
    layout = bus_layout(spec.kind, spec.wheels)
    _check_rollover_rates(world, layout)
    for message in layout:
        sampled, payload = _message_frames(world, spec, message, start, rng)
        arrival = sampled + rng.exponential(spec.jitter_s, len(sampled)) if spec.jitter_s > 0 else sampled
        # A control unit never sends a message before the one that it sent earlier.
        arrival = np.maximum.accumulate(arrival)
        kept = rng.random(len(sampled)) >= spec.lost_fraction
        again = kept & (rng.random(len(sampled)) < spec.repeated_fraction)
        times += [arrival[kept], arrival[again] + 0.0003]
        datas += [payload[kept], payload[again]]
        ids.append(np.full(int(kept.sum() + again.sum()), message.frame_id, dtype=np.int64))
    time_s, frame_id, data = np.concatenate(times), np.concatenate(ids), np.concatenate(datas)
    order = np.argsort(time_s, kind="stable")
    return FrameLog(world.host_s(clocks, time_s[order]), frame_id[order], data[order])


def _message_frames(
    world: World, spec: BusSpec, message: MessageLayout, start: dict[str, int], rng: np.random.Generator
) -> tuple[FloatArray, ByteArray]:
    """Return the sampling times (k,) and payloads (k, bytes) of one message over the drive."""
    end = float(world.motion.time_s[-1])
    phase = float(rng.uniform(0, message.period_s))
    ticks = np.arange(int((end - phase) / message.period_s) + 1, dtype=np.float64)
    sampled = phase + message.period_s * ticks
    raw = {}
    for signal in message.signals:
        if signal.name == ALIVE:
            raw[signal.name] = np.arange(len(sampled)) % (1 << signal.bits)
        elif signal.role.startswith("wheel_count_"):
            raw[signal.name] = _counter_values(world, spec, signal, sampled, start)
        else:
            value = _sensor_readings(world, spec, signal.role, sampled, message.period_s, rng)
            raw[signal.name] = signal.raw_of(value * _UNIT_PER_SI[signal.unit])
    return sampled, message.pack(raw, len(sampled))


def _counter_values(
    world: World, spec: BusSpec, signal: SignalLayout, sampled: FloatArray, start: dict[str, int]
) -> IntArray:
    """Return the (k,) raw values of a wheel's counter, rolled over and reset as specified."""
    wheel = signal.role[-2:]
    counts = world.counts_at(sampled, WHEELS.index(wheel)) / signal.factor
    edges = np.floor(counts).astype(np.int64) + start[wheel]
    for reset in sorted(spec.resets_s):
        after = sampled >= reset
        if after.any():
            edges[after] -= edges[after][0]
    return edges % (1 << signal.bits)


def _check_rollover_rates(world: World, layout: tuple[MessageLayout, ...]) -> None:
    """Raise ConfigError if a counter rolls over so fast that no reader can follow it; of several, the one
    that does so at the lowest speed is named.
    """
    teeth, end = world.car.teeth_per_rev, float(world.motion.time_s[-1])
    held = []
    for message in layout:
        sampled = np.arange(0.0, end, message.period_s)
        for signal in message.signals:
            if signal.role.startswith("wheel_count_"):
                counts = world.counts_at(sampled, WHEELS.index(signal.role[-2:])) / signal.factor
                most = float(np.max(np.abs(np.diff(counts)), initial=0.0))
                room = MAX_WIDTH_SHARE * (1 << signal.bits)
                held.append((teeth * room / max(most, 1e-9), signal))
    if not held:
        return
    least, signal = min(held, key=lambda one: one[0])
    if least < teeth:
        speed = float(world.motion.speed_mps.max())
        raise ConfigError(
            f"teeth_per_rev = {teeth:g}: the {signal.bits} bits of {signal.name} turn over from frame to"
            f" frame at {speed:.0f} m/s, where this bus holds up to {least:.0f} counts per revolution"
        )


def _sensor_readings(
    world: World, spec: BusSpec, role: str, sampled: FloatArray, period_s: float, rng: np.random.Generator
) -> FloatArray:
    """Return the (k,) readings of a role's sensor at the sampling instants, SI units (degC for the
    temperature).
    """
    motion = world.motion

    def at(values: FloatArray) -> FloatArray:
        return np.interp(sampled, motion.time_s, values)

    def noise(std: float) -> FloatArray:
        return gauss_markov(rng, len(sampled), period_s, std, _SENSOR_TAU_S, 1)[:, 0]

    if role.startswith("wheel_speed_"):
        wheel = WHEELS.index(role[-2:])
        counts = world.counts_at(sampled, wheel) - world.counts_at(sampled - period_s, wheel)
        turned = counts * (2 * np.pi / world.car.teeth_per_rev)
        return turned / period_s * float(world.car.radius_m[wheel])
    if role == "yaw_rate":
        return at(gyro_rates(motion, world.car, world.model)) + noise(spec.yaw_rate_std_radps)
    if role in ("accel_long", "accel_lat"):
        read = accelerations(motion, world.car, world.model)[:, int(role == "accel_lat")]
        return at(read) + noise(spec.accel_std_mps2)
    if role == "steering_wheel_angle":
        return at(steering_wheel_angles(motion, world.car, world.model)) + noise(spec.steering_std_rad)
    if role == "drive_torque":
        return at(motion.measured["torque"])
    if role == "brake_pressure":
        return _BRAKE_PA_PER_MPS2 * np.maximum(ENGINE_BRAKE_MPS2 - at(drive_force_per_mass(motion)), 0.0)
    if role == "ambient_temp":
        return at(motion.measured["temperature"]) - ZERO_DEGC_K
    raise ValueError(f"no such role: {role}")
