"""What is drawn for a drive: car, road, receiver, bus, and the physics that it conceals.

In: a generator. Out: `Spec`. Plain numbers; nothing here knows the program that is tested.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

ROADS = ("mixed", "rural", "motorway", "city", "hills")
FINE_TEETH = 39931.0
"""An optical encoder on the wheel, as survey vans carry."""


@dataclass
class Spec:
    """What is drawn for a drive."""

    duration_s: float = 1200.0
    road: str = "mixed"
    radius_m: float = 0.31
    radius_spread_m: float = 8e-4
    radius_off: float = 0.0
    """How far the configured radius is off, relative to the true one."""
    track_front_m: float = 1.55
    """As configured, like the rear one and the antenna's place."""
    track_rear_m: float = 1.53
    wheelbase_m: float = 2.7
    driven: str = "front"
    teeth: float = 48.0
    frame_jitter_s: float = 0.0003
    receiver_hz: float = 5.0
    position_slow_m: float = 1.2
    position_tau_s: float = 40.0
    position_white_m: float = 0.2
    doppler_mps: float = 0.05
    doppler_tau_s: float = 1.0
    gyro_std: float = 0.0015
    gyro_drift: float = 2e-6
    accel_std: float = 0.04
    rough: float = 3.0e-4
    """Standard deviation of a wheel's way in metres per square root of a metre."""
    hilly: float = 0.0
    """Standard deviation of the slope."""
    climb: float = 0.0
    """Mean slope of a pass: up over the first half of the way, down over the second."""
    antenna_forward_m: float = 0.0
    antenna_left_m: float = 0.0
    rising_speed: bool = False
    """A driver who goes faster and faster: speed is tied to time."""
    steady: bool = False
    stops: bool = False
    """Traffic lights and queues."""

    wheel_signal: str = "counts"
    """counts | speeds"""
    speed_step_kmh: float = 0.01
    """Resolution of a speed signal."""
    edge_noise_rad: float = 2e-4
    """Of the edges from which a control unit makes its speed signal."""
    speed_window_s: float = 0.0
    """A speed is the mean over this time before the frame; 0: over 20 ms around it."""
    speed_filter_s: float = 0.0
    """Time constant of a first-order low-pass in the control unit; 0: none."""
    blind_below_mps: float = 0.0
    """A wheel sensor gives no edges below this speed of its wheel."""
    configured_teeth: float = 0.0
    """What the vehicle file says of the teeth; 0: the truth."""
    count_bits: int = 16
    wheel_hz: float = 50.0
    latch_period_s: float = 0.0
    """Rhythm in which a control unit reads its counters; a frame has the last; 0: read at the frame."""
    latch_phase: float = 0.0
    """Share of that period by which the rhythm is behind the drive's start."""
    latch_jitter_s: float = 0.0
    """Mean delay of a reading behind its rhythm."""
    latch_apart: bool = False
    """Each wheel has a rhythm and a clock of its own."""
    inertial_hz: float = 50.0
    split_wheels: bool = False
    """Front and rear axle in messages of their own, out of step."""
    with_gyro: bool = True
    with_accel: bool = True
    with_steering: bool = True
    with_temperature: bool = False
    host_offset_s: float = 0.0
    """Host clock minus UTC."""
    lost_share: float = 0.0
    repeated_share: float = 0.0

    with_course: bool = True
    doppler_age_s: float = 0.0
    """Velocity lag: by how much speed and course lag the position of the same fix."""
    arrival_jitter_s: float = 0.0
    bursts_per_hour: float = 0.0
    """Multipath: position metres off and Doppler several times noisier for a while."""
    outages_per_hour: float = 0.0
    longest_outage_s: float = 30.0
    place_digits: int = 8
    """Decimals of the minutes of latitude and longitude."""
    speed_digits: int = 4
    """Decimals of the knots."""
    course_digits: int = 3

    radius_drift: float = 0.0
    """Standard deviation of the radius drift of each wheel, relative; real cars show 2e-4 to 5e-4."""
    radius_drift_tau_s: float = 240.0
    tags: tuple[str, ...] = ()
    """Conditions of the drive, in words, for the report."""
    physics: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Concealed physics by name; `radius_change_2` is a second radius change."""

    @property
    def configured_radius_m(self) -> float:
        """What the vehicle file says."""
        return self.radius_m * (1.0 + self.radius_off)


def draw_spec(rng: np.random.Generator, **fixed: Any) -> Spec:
    """A car, a road, a receiver and a bus, newly drawn; `fixed` overrides what is drawn."""
    drawn = {**_road(rng), **_car(rng), **_receiver(rng), **_bus(rng)}
    return Spec(**{**drawn, **fixed})


def _road(rng: np.random.Generator) -> dict[str, Any]:
    road = str(rng.choice(["mixed", "mixed", "rural", "rural", "motorway", "city"]))
    return {
        "duration_s": float(rng.uniform(600, 1200)),
        "road": road,
        "stops": road == "city" or bool(rng.random() < 0.25),
        "rough": float(rng.uniform(2e-4, 6e-4)),
        "radius_drift": float(rng.uniform(0.0, 5e-6)),
    }


def _car(rng: np.random.Generator) -> dict[str, Any]:
    fine = bool(rng.random() < 0.12)
    return {
        "radius_m": float(rng.uniform(0.28, 0.37)),
        "radius_off": float(rng.uniform(-0.008, 0.008)),
        "track_front_m": float(rng.uniform(1.42, 1.68)),
        "track_rear_m": float(rng.uniform(1.42, 1.68)),
        "wheelbase_m": float(rng.uniform(2.35, 3.2)),
        "driven": str(rng.choice(["front", "front", "rear", "all"])),
        "teeth": FINE_TEETH if fine else float(rng.choice([40, 43, 44, 46, 47, 48, 48, 52, 60, 80, 96, 100])),
    }


def _receiver(rng: np.random.Generator) -> dict[str, Any]:
    ahead = bool(rng.random() < 0.5)
    digits = int(rng.choice([4, 5, 5, 8]))
    return {
        "receiver_hz": float(rng.choice([1, 5, 10])),
        "with_course": bool(rng.random() < 0.8),
        "position_slow_m": float(rng.uniform(0.5, 3.0)),
        "position_tau_s": float(rng.uniform(20, 100)),
        "position_white_m": float(rng.uniform(0.05, 0.3)),
        "doppler_mps": float(np.exp(rng.uniform(np.log(0.02), np.log(0.1)))),
        "doppler_tau_s": float(rng.uniform(0.5, 1.5)),
        "doppler_age_s": float(rng.uniform(0.02, 0.1)) if rng.random() < 0.3 else 0.0,
        "arrival_jitter_s": float(rng.choice([0.0, 0.0005, 0.002])),
        "bursts_per_hour": float(rng.choice([0.0, 0.0, 3.0, 8.0])),
        "outages_per_hour": float(rng.choice([0.0, 0.0, 3.0, 6.0])),
        "place_digits": digits,
        "speed_digits": int(rng.choice([2, 3, 4])),
        "course_digits": int(rng.choice([1, 2, 3])),
        "antenna_forward_m": float(rng.uniform(0.0, 2.0)) if ahead else 0.0,
        "antenna_left_m": float(rng.uniform(-0.5, 0.5)) if ahead else 0.0,
        "host_offset_s": float(rng.choice([0.0, float(rng.uniform(-30, 30))])),
    }


def _bus(rng: np.random.Generator) -> dict[str, Any]:
    speeds = bool(rng.random() < 0.25)
    hz = float(rng.choice([20, 25, 50, 100]))
    bits = int(rng.choice([8, 10, 16, 16]))
    return {
        "wheel_signal": "speeds" if speeds else "counts",
        "speed_step_kmh": float(rng.choice([0.01, 0.03, 0.05])),
        # eight bits would turn over twice between the frames of a slow bus
        "count_bits": 16 if bits < 16 and hz < 50 else bits,
        "wheel_hz": hz,
        "inertial_hz": float(rng.choice([20, 50, 100])),
        "split_wheels": bool(rng.random() < 0.4),
        "with_gyro": bool(rng.random() < 0.85),
        "with_accel": bool(rng.random() < 0.75),
        "with_steering": bool(rng.random() < 0.6),
        "gyro_std": float(rng.uniform(0.001, 0.003)),
        "gyro_drift": float(rng.uniform(1e-6, 3e-6)),
        "accel_std": float(rng.uniform(0.02, 0.08)),
        "frame_jitter_s": float(rng.uniform(0.0, 0.0005)),
        "lost_share": float(rng.choice([0.0, 0.0, 0.001])),
        "repeated_share": float(rng.choice([0.0, 0.0, 0.0005])),
    }
