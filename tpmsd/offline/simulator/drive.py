"""A whole simulated drive, in memory.

In: `DriveSpec` (and, if the caller has one, a `Motion`). Out: `SimulatedDrive` with frames, sentences,
configuration and truth. The same spec gives the same drive, bit for bit; route, world, bus and receiver draw
from generators of their own, so that another fault or bus leaves everything else as it was.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tpmsd.car.config.model import VehicleConfig
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Car, Motion, driven_mask
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.simulator.bus import BusSpec, FrameLog, frames_of
from tpmsd.offline.simulator.bus_layouts import bus_layout
from tpmsd.offline.simulator.clock import Clocks
from tpmsd.offline.simulator.faults import Fault
from tpmsd.offline.simulator.frame_layout import dbc_text
from tpmsd.offline.simulator.receiver import Epochs, NmeaLine, ReceiverSpec, measure_epochs, nmea_lines
from tpmsd.offline.simulator.route import make_route
from tpmsd.offline.simulator.vehicle_toml import vehicle_toml
from tpmsd.offline.simulator.world import ROUGHNESS_STD_M, World, make_world

_STEERING_RATIO = 15.3
"""Steering ratio of a car whose configuration states none."""
DEFAULT_VEHICLE = VehicleConfig(
    wheel_radius_m=(0.316, 0.316, 0.316, 0.316),
    track_front_m=1.53,
    track_rear_m=1.52,
    wheelbase_m=2.63,
    driven_axle="front",
    steering_ratio=_STEERING_RATIO,
    teeth_per_rev=48.0,
)


@dataclass(frozen=True)
class DriveSpec:
    """All that is needed to simulate a drive."""

    route: str = "mixed"
    duration_s: float = 600.0
    seed: int = 1
    vehicle: VehicleConfig = DEFAULT_VEHICLE
    """Vehicle data as in the configuration."""
    antenna_forward_m: float = 0.0
    antenna_left_m: float = 0.0
    radius_offset_std_m: float = 1e-3
    """Standard deviation of the drawn true-minus-nominal radii."""
    radius_offset_m: tuple[float, float, float, float] | None = None
    """True minus nominal radii where they are not to be drawn."""
    roughness_std_m: float = ROUGHNESS_STD_M
    flat: bool = False
    faults: tuple[Fault, ...] = ()
    model: ExtendedModel = field(default_factory=ExtendedModel)
    """The effects that act beyond the rolling model."""
    receiver: ReceiverSpec = field(default_factory=ReceiverSpec)
    bus: BusSpec = field(default_factory=BusSpec)
    clocks: Clocks = field(default_factory=Clocks)


@dataclass(frozen=True)
class SimulatedDrive:
    """Recordings of the drive's instruments, and the truth."""

    spec: DriveSpec
    world: World
    epochs: Epochs
    frames: FrameLog
    nmea: list[NmeaLine]
    dbc: str
    vehicle_toml: str
    """Configuration as for a recording; `configuration` names the ports of a live drive."""

    def configuration(self, interface: str, channel: str, device: str) -> str:
        """Return the vehicle.toml with which a daemon listens to this drive while it is played live."""
        return live_configuration(self.spec, interface, channel, device)

    def truth(self) -> dict[str, Any]:
        """Return the true values that an estimator should find, in JSON's types: radii once per second on the
        drive's host clock.
        """
        motion = self.world.motion
        per_second = max(1, round(1.0 / float(motion.time_s[1] - motion.time_s[0])))
        radii = self.world.radii_m[::per_second]
        nominal = self.world.car.radius_m
        return {
            "seed": self.spec.seed,
            "route": self.spec.route,
            "duration_s": float(motion.time_s[-1]),
            "distance_m": float(motion.distance_m[-1]),
            "start_host_s": float(self.world.host_s(self.spec.clocks, np.zeros(1))[0]),
            "clocks": dataclasses.asdict(self.spec.clocks),
            "nominal_radius_m": dict(zip(WHEELS, nominal.tolist(), strict=True)),
            "faults": [dataclasses.asdict(fault) for fault in self.spec.faults],
            "effects": [{"name": effect.name, "parameters": effect.values()} for effect in self.world.model],
            "fix_age_s": self.spec.receiver.latency_s + self.world.model.fix_age_s(),
            "time_s": self.world.host_s(self.spec.clocks, motion.time_s[::per_second]).tolist(),
            "speed_mps": motion.speed_mps[::per_second].tolist(),
            "radius_m": {wheel: radii[:, k].tolist() for k, wheel in enumerate(WHEELS)},
            "deviation_m": {wheel: (radii[:, k] - nominal[k]).tolist() for k, wheel in enumerate(WHEELS)},
        }


def simulated_car(vehicle: VehicleConfig, antenna_forward_m: float = 0.0, antenna_left_m: float = 0.0) -> Car:
    """Return the car to simulate: that of a configuration, with a usual steering ratio if it states none."""
    return Car(
        radius_m=np.array(vehicle.wheel_radius_m, dtype=np.float64),
        geometry=WheelPositions(vehicle.track_front_m, vehicle.track_rear_m, vehicle.wheelbase_m),
        driven=driven_mask(vehicle.driven_axle),
        teeth_per_rev=vehicle.teeth_per_rev,
        antenna_forward_m=antenna_forward_m,
        antenna_left_m=antenna_left_m,
        steering_ratio=vehicle.steering_ratio or _STEERING_RATIO,
    )


def live_dbc(spec: DriveSpec) -> str:
    """Return the DBC of the bus of a drive of this kind, simulated or not yet."""
    return dbc_text(bus_layout(spec.bus.kind, spec.bus.wheels), with_periods=spec.bus.kind != "speeds")


def live_configuration(spec: DriveSpec, interface: str, channel: str, device: str) -> str:
    """Return the vehicle.toml with which a daemon listens to a drive of this kind, simulated or not yet."""
    return vehicle_toml(
        spec.vehicle,
        bus_layout(spec.bus.kind, spec.bus.wheels),
        spec.receiver,
        spec.antenna_forward_m,
        spec.antenna_left_m,
        interface=interface,
        channel=channel,
        device=device,
    )


def simulate_drive(spec: DriveSpec, motion: Motion | None = None) -> SimulatedDrive:
    """Simulate a drive; `motion` replaces a route drawn at random. ConfigError for impossible settings."""
    if spec.seed < 0:
        raise ConfigError(f"seed {spec.seed} is negative")
    seeds = np.random.SeedSequence(spec.seed).spawn(6)
    for_route, for_radii, for_world, for_bus, for_receiver, for_lines = map(np.random.default_rng, seeds)
    car = simulated_car(spec.vehicle, spec.antenna_forward_m, spec.antenna_left_m)
    if motion is None:
        motion = make_route(
            spec.route, spec.duration_s, for_route, wheelbase_m=spec.vehicle.wheelbase_m, flat=spec.flat
        )
    faults = tuple(effect for fault in spec.faults for effect in fault.effects(car.radius_m))
    world = make_world(
        motion,
        car,
        spec.model.plus(*faults),
        for_world,
        radius_offset_m=_radius_offsets_m(spec, for_radii),
        roughness_std_m=spec.roughness_std_m,
    )
    epochs = measure_epochs(world, spec.receiver, spec.clocks, for_receiver)
    layout = bus_layout(spec.bus.kind, spec.bus.wheels)
    return SimulatedDrive(
        spec=spec,
        world=world,
        epochs=epochs,
        frames=frames_of(world, spec.bus, spec.clocks, for_bus),
        nmea=nmea_lines(world, epochs, spec.receiver, spec.clocks, for_lines),
        dbc=dbc_text(layout, with_periods=spec.bus.kind != "speeds"),
        vehicle_toml=vehicle_toml(
            spec.vehicle, layout, spec.receiver, spec.antenna_forward_m, spec.antenna_left_m
        ),
    )


def _radius_offsets_m(spec: DriveSpec, rng: np.random.Generator) -> FloatArray:
    """Return the (4,) offsets of the true radii from the nominal ones: those specified, or drawn."""
    drawn = spec.radius_offset_std_m * rng.standard_normal(4)
    return drawn if spec.radius_offset_m is None else np.array(spec.radius_offset_m, dtype=np.float64)
