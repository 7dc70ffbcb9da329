"""Cars with their buses and receivers, drawn from a pool; the held-out pool has others.

In: a generator and the pool's name. Out: `Car`. Nothing here knows the program that is tested.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.worlds.magic_tyre import Array, Tyre
from bench.worlds.spec import Spec

POOLS = ("development", "held-out")
G_MPS2 = 9.80665


@dataclass(frozen=True)
class Car:
    """What is drawn for a car. Masses in kg, lengths in m; wheels are fl fr rl rr."""

    seed: int
    kind: str
    kerb_kg: float
    """With driver."""
    payload_kg: float
    front_share: float
    height_m: float
    """Of the centre of gravity."""
    drag_m2: float
    """Drag coefficient times frontal area."""
    tyre: Tyre
    wear_m: Array
    """(4,) radii differ by tread and make."""
    side_slip: float
    """Side slip of the rear axle per lateral acceleration, rad s2/m."""
    brake_front: float
    filled_k: float
    """Temperature at which the tyres were filled to nominal."""
    spec: Spec = field(default_factory=Spec)
    """Geometry, bus and receiver, as the writer of folders takes them."""

    def loads_n(self, load: float, trailer_kg: float) -> Array:
        """(4,) static vertical forces; `load` is the share of the payload, driver alone 0."""
        more = load * self.payload_kg
        front = self.kerb_kg * self.front_share + 0.3 * more
        rear = self.kerb_kg * (1.0 - self.front_share) + 0.7 * more
        if trailer_kg > 0.0:
            nose, overhang = min(0.06 * trailer_kg, 90.0), 0.4
            front -= nose * overhang
            rear += nose * (1.0 + overhang)
        lean = 12.0 * (1.0 - load)  # a driver alone sits on the left
        left_right = np.array([lean, -lean, lean, -lean])
        return np.asarray((np.array([front, front, rear, rear]) / 2.0 + left_right) * G_MPS2)


KINDS: dict[str, dict[str, Any]] = {
    # kerb, payload, front share, height, drag, size, load, driven, wheelbase, track
    "small": {"kg": (950, 1150), "pay": 380, "front": 0.61, "size": (0.90, 0.97), "load": 0.8, "base": 2.45},
    "compact": {
        "kg": (1250, 1450),
        "pay": 450,
        "front": 0.60,
        "size": (0.98, 1.04),
        "load": 1.0,
        "base": 2.63,
    },
    "saloon": {
        "kg": (1500, 1800),
        "pay": 500,
        "front": 0.52,
        "size": (1.02, 1.08),
        "load": 1.2,
        "base": 2.85,
    },
    "van": {"kg": (1900, 2200), "pay": 900, "front": 0.55, "size": (1.04, 1.10), "load": 1.6, "base": 3.2},
    "suv": {"kg": (1700, 2100), "pay": 550, "front": 0.54, "size": (1.08, 1.18), "load": 1.45, "base": 2.75},
    "electric": {
        "kg": (1750, 2150),
        "pay": 450,
        "front": 0.48,
        "size": (1.03, 1.12),
        "load": 1.4,
        "base": 2.9,
    },
}
POOL_KINDS = {
    "development": ("small", "compact", "compact", "saloon"),
    "held-out": ("van", "suv", "electric"),
}
DRIVEN = {
    "small": "front",
    "compact": "front",
    "saloon": "rear",
    "van": "rear",
    "suv": "all",
    "electric": "rear",
}


def draw_car(rng: np.random.Generator, pool: str, seed: int) -> Car:
    """A car of the pool, with its bus and receiver."""
    kind = str(rng.choice(POOL_KINDS[pool]))
    facts = KINDS[kind]
    tyre = Tyre(
        size=float(rng.uniform(*facts["size"])),
        load=float(facts["load"]),
        softness=float(rng.uniform(0.9, 1.15)),
        growth=float(rng.uniform(0.8, 1.2)),
    )
    kerb = float(rng.uniform(*facts["kg"]))
    car = Car(
        seed=seed,
        kind=kind,
        kerb_kg=kerb + 75.0,
        payload_kg=float(facts["pay"]),
        front_share=float(facts["front"]),
        height_m=0.7 if kind in ("van", "suv") else 0.55,
        drag_m2=1.1 if kind == "van" else 0.68,
        tyre=tyre,
        wear_m=rng.normal(0.0, 6e-4, 4),
        side_slip=float(rng.uniform(0.003, 0.007)),
        brake_front=float(rng.uniform(0.6, 0.72)),
        filled_k=float(rng.uniform(283.0, 298.0)),
    )
    radius = float(
        tyre.effective_radius_m(car.loads_n(0.2, 0.0), np.ones(4), np.full(4, 20.0)).mean()
        + car.wear_m.mean()
    )
    spec = Spec(
        radius_m=radius,
        radius_off=float(rng.uniform(-0.004, 0.004)),
        track_front_m=float(rng.uniform(1.45, 1.62)),
        track_rear_m=float(rng.uniform(1.45, 1.62)),
        wheelbase_m=float(facts["base"]),
        driven=DRIVEN[kind],
        **_bus(rng, pool),
        **_receiver(rng, pool),
    )
    return Car(**{**vars(car), "spec": spec})


def _bus(rng: np.random.Generator, pool: str) -> dict[str, Any]:
    held = pool == "held-out"
    speeds = bool(rng.random() < 0.4)
    return {
        "teeth": float(rng.choice([44, 60, 96] if held else [43, 47, 48, 52])),
        "wheel_signal": "speeds" if speeds else "counts",
        "speed_step_kmh": float(rng.choice([0.03, 0.05625] if held else [0.01, 0.03])),
        "wheel_hz": float(rng.choice([20, 100] if held else [50])),
        "split_wheels": bool(rng.random() < 0.5),
        "with_gyro": bool(rng.random() < 0.8),
        "with_accel": bool(rng.random() < 0.8),
        "with_steering": bool(rng.random() < 0.6),
        "frame_jitter_s": float(rng.uniform(0.0, 0.0005)),
        "gyro_std": float(rng.uniform(0.001, 0.003)),
        "gyro_drift": float(rng.uniform(1e-6, 3e-6)),
        "accel_std": float(rng.uniform(0.02, 0.08)),
        "rough": float(rng.uniform(2e-4, 5e-4)),
        "radius_drift": float(rng.uniform(0.0, 1.5e-4)),
        "physics": {"yaw_rate_bias": {"bias": float(rng.normal(0.0, 2e-3))}},
    }


def _receiver(rng: np.random.Generator, pool: str) -> dict[str, Any]:
    held = pool == "held-out"
    ahead = bool(rng.random() < 0.5)
    return {
        "receiver_hz": float(rng.choice([1, 5, 10])),
        "with_course": bool(rng.random() < (0.6 if held else 0.9)),
        "position_slow_m": float(rng.uniform(0.8, 3.0)),
        "position_tau_s": float(rng.uniform(20, 100)),
        "position_white_m": float(rng.uniform(0.05, 0.3)),
        "doppler_mps": float(np.exp(rng.uniform(np.log(0.03), np.log(0.12 if held else 0.08)))),
        "doppler_tau_s": float(rng.uniform(0.5, 2.0 if held else 1.2)),
        "doppler_age_s": float(rng.uniform(0.05, 0.2)) if held and rng.random() < 0.5 else 0.0,
        "arrival_jitter_s": float(rng.choice([0.0, 0.002])),
        "speed_digits": int(rng.choice([2, 3])),
        "course_digits": int(rng.choice([1, 2])),
        "place_digits": int(rng.choice([4, 5, 7])),
        "antenna_forward_m": float(rng.uniform(0.0, 2.0)) if ahead else 0.0,
        "antenna_left_m": float(rng.uniform(-0.5, 0.5)) if ahead else 0.0,
    }
