"""Hard driving of multi-body cars as ticks: bends up to the tyres' limit, hard braking, hard pulling.

In: a seed and a car. Out: `HardDrive`: the ticks that its instruments would make, and the truth. Two thirds
of the time are driven as people drive in a hurry, a third calmly; nothing is held still for the estimator.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from bench.worlds.commonroad_car import DT_S, GRAVITY_MPS2, Now, Run, parameters, rolling_radius_m, run
from tpmsd.car.config.model import VehicleConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.timeline.tick import Fix, Tick

OFFSETS_M = np.array([0.0012, -0.0008, 0.0006, -0.0014])
"""True minus nominal radii of fl, fr, rl, rr."""
TEETH = 48
TICK_S = 0.1
STEERING_RATIO = 15.0
FIX_PERIOD_S = 0.2
START_S = 1_700_000_000.0


class HurriedDriver:
    """Legs of some seconds, each with a speed to reach and a bend to take, calm ones among them."""

    def __init__(self, rng: np.random.Generator, hard: bool, grip: float = 1.0, base_m: float = 2.58) -> None:
        self._rng, self._hard, self._grip, self._base_m = rng, hard, grip, base_m
        self._until = 0.0
        self._lateral = self._speed = self._pull = self._steer = 0.0
        self._brake, self._push = -2.0, 1.0

    def __call__(self, now: Now) -> tuple[float, float]:
        """Steering angle and acceleration."""
        rng = self._rng
        if now.time_s >= self._until:
            calm = not self._hard or rng.random() < 0.35
            self._until = now.time_s + float(rng.uniform(5.0, 10.0) if calm else rng.uniform(2.0, 6.0))
            self._speed = float(rng.uniform(9.0, 30.0))
            grip = self._grip
            self._brake = -float(rng.uniform(0.5, 1.0) if calm else grip * rng.uniform(2.0, 6.0))
            self._push = float(rng.uniform(0.3, 0.9) if calm else grip * rng.uniform(1.0, 2.5))
            size = rng.uniform(0.0, 1.5) if calm else grip * rng.uniform(2.0, 6.5)
            self._lateral = float(size * rng.choice([-1.0, 1.0])) if rng.random() < 0.75 else 0.0
        # Grip for both at once: in a bend there is less left for the brakes, and a rear-driven car spins.
        used = min(abs(now.forward_mps * now.yaw_rate_radps) / (8.0 * self._grip), 1.0)
        left = math.sqrt(max(1.0 - used**2, 0.0))
        wanted = 1.2 * (self._speed - now.forward_mps)
        wanted = max(min(wanted, self._push * left), self._brake * left)
        self._pull += float(np.clip(wanted - self._pull, -0.15, 0.10))
        speed = max(now.forward_mps, 5.0)
        curvature = float(np.clip(self._lateral / speed**2, -1 / 15, 1 / 15))
        yaw = curvature * speed
        steer = self._base_m * curvature + 0.0008 * curvature * speed**2 + 0.05 * (yaw - now.yaw_rate_radps)
        self._steer += float(np.clip(steer - self._steer, -0.002, 0.002))
        return self._steer, self._pull


@dataclass(frozen=True)
class HardDrive:
    """Ticks, and the truth at their ends."""

    ticks: list[Tick]
    vehicle: VehicleConfig
    state: FloatArray
    """(n, 3) v, u, r."""
    slip: FloatArray
    """(n, 4) longitudinal slip of the wheels over each tick, sigma."""
    accel: FloatArray
    """(n, 2) longitudinal and lateral, means over the ticks."""
    rear_m: float
    """Centre of gravity to rear axle."""


@dataclass(frozen=True)
class Setting:
    """A car on a road, with a driver who knows the grip."""

    car: int = 2
    friction: float = 1.0
    slip_stiffness: float = 1.0

    def parameters(self) -> Any:
        """Of the multi-body car."""
        return parameters(self.car, self.friction, self.slip_stiffness)


BMW_DRY = Setting()
SETTINGS = {
    f"{name}, {road}": Setting(car, friction, stiffness)
    for name, car, stiffness in (("Escort", 1, 0.8), ("BMW", 2, 1.0), ("Vanagon", 3, 1.25))
    for road, friction in (("dry", 1.0), ("wet", 0.6))
}
"""Three cars on two roads, each car with tyres of its own."""


def truth(seed: int, duration_s: float, hard: bool = True, setting: Setting = BMW_DRY) -> Run:
    """The car's run, up to five seconds before it spins or all but stops, if it does.

    Near standstill the library's model is another one, without slip.
    """
    p = setting.parameters()
    rng = np.random.default_rng(seed)
    # The Vanagon is tall: it would fall over where the others slide.
    driver = HurriedDriver(
        rng, hard, setting.friction * (0.8 if setting.car == 3 else 1.0), round(p.a + p.b, 2)
    )
    return until_spun(run(driver, duration_s, 15.0, p))


def until_spun(whole: Run) -> Run:
    """The part of a run that is driving."""
    side_slip = np.abs(np.arctan2(whole.left_mps, whole.forward_mps))
    lost = (side_slip > math.radians(10.0)) | (whole.forward_mps < 5.0)
    end = max(int(np.argmax(lost)) - round(5.0 / DT_S), 1) if lost.any() else len(lost)
    return Run(**{part.name: getattr(whole, part.name)[:end] for part in fields(Run)})


def vehicle(p: Any = None) -> VehicleConfig:
    """What the operator knows: geometry, and nominal radii that are a millimetre off."""
    p = parameters() if p is None else p
    driven: Literal["front", "rear"] = "front" if p.T_se > 0.5 else "rear"
    nominal = rolling_radius_m(p) - OFFSETS_M
    return VehicleConfig(
        wheel_radius_m=(float(nominal[0]), float(nominal[1]), float(nominal[2]), float(nominal[3])),
        track_rear_m=p.T_r,
        track_front_m=p.T_f,
        wheelbase_m=p.a + p.b,
        driven_axle=driven,
        steering_ratio=STEERING_RATIO,
        teeth_per_rev=TEETH,
    )


def _correlated(
    rng: np.random.Generator, count: int, period_s: float, std: float, tau_s: float
) -> FloatArray:
    keep = math.exp(-period_s / tau_s)
    out = np.empty((count, 2))
    out[0] = std * rng.standard_normal(2)
    kicks = std * math.sqrt(1.0 - keep**2) * rng.standard_normal((count, 2))
    for k in range(1, count):
        out[k] = keep * out[k - 1] + kicks[k]
    return out


def _fixes(truth_: Run, rng: np.random.Generator, bad: float, p: Any) -> list[Fix]:
    """Fixes of the rear axle's middle; `bad` is the share of time with reflected signals."""
    at = np.arange(0.07, truth_.time_s[-1], FIX_PERIOD_S)
    n = len(at)
    cos, sin = np.cos(truth_.heading_rad), np.sin(truth_.heading_rad)
    side = truth_.left_mps - p.b * truth_.yaw_rate_radps
    tracks = {
        "east": truth_.east_m - p.b * cos,
        "north": truth_.north_m - p.b * sin,
        "ve": truth_.forward_mps * cos - side * sin,
        "vn": truth_.forward_mps * sin + side * cos,
    }
    value = {name: np.interp(at, truth_.time_s, track) for name, track in tracks.items()}
    place = _correlated(rng, n, FIX_PERIOD_S, 1.0, 40.0) + 0.15 * rng.standard_normal((n, 2))
    velocity = _correlated(rng, n, FIX_PERIOD_S, 0.05, 1.0)
    k = 0
    while bad > 0.0 and k < n:  # a street canyon: some seconds with an offset of its own, and a wrong Doppler
        k += round(float(rng.exponential((1.0 - bad) / bad * 4.0)) / FIX_PERIOD_S)
        span = max(round(float(rng.exponential(4.0)) / FIX_PERIOD_S), 1)
        place[k : k + span] += rng.standard_normal(2) * 6.0
        velocity[k : k + span] += rng.standard_normal(2) * 0.6
        k += span
    fast = np.hypot(value["ve"] + velocity[:, 0], value["vn"] + velocity[:, 1])
    course = np.arctan2(value["vn"] + velocity[:, 1], value["ve"] + velocity[:, 0])
    return [
        Fix(
            time_s=START_S + float(at[i]),
            fraction=0.0,
            east_m=float(value["east"][i] + place[i, 0]),
            north_m=float(value["north"][i] + place[i, 1]),
            position_std_m=1.0,
            speed_mps=float(fast[i]),
            heading_rad=float(course[i]) if fast[i] > 1.0 else math.nan,
        )
        for i in range(n)
    ]


def instrumented(
    truth_: Run, seed: int, bad_fixes: float = 0.0, inertial: bool = True, setting: Setting = BMW_DRY
) -> HardDrive:
    """Ticks of 0.1 s as the timeline would make them; without `inertial` the bus has wheels only."""
    p = setting.parameters()
    rng = np.random.default_rng(seed)
    n = len(truth_.time_s)
    quantum = 2 * math.pi / TEETH
    counted = np.floor(truth_.angle_rad / quantum + rng.random(4)) * quantum
    per_tick = round(TICK_S / DT_S)
    edges = np.arange(0, n, per_tick)

    def mean(values: FloatArray) -> FloatArray:
        whole = np.concatenate([[0.0], np.cumsum(values)])
        return np.diff(whole[edges]) / per_tick

    def error(noise: float, bias: float) -> FloatArray:
        return noise * rng.standard_normal(n) + bias * rng.standard_normal()

    lateral = truth_.accel_lat_mps2 * np.cos(truth_.roll_rad) + GRAVITY_MPS2 * np.sin(truth_.roll_rad)
    along = truth_.accel_long_mps2 * np.cos(truth_.pitch_rad) + GRAVITY_MPS2 * np.sin(truth_.pitch_rad)
    gyro = mean(truth_.yaw_rate_radps + error(math.radians(0.15), math.radians(0.15)))
    accel_long, accel_lat = mean(along + error(0.06, 0.1)), mean(lateral + error(0.06, 0.1))
    steer = STEERING_RATIO * mean(truth_.steer_rad + error(0.0005, 0.001))
    fixes = _fixes(truth_, rng, bad_fixes, p)
    rotation = np.diff(counted[edges], axis=0)
    ticks, at = [], 0
    for k in range(len(rotation)):
        end = START_S + float(truth_.time_s[edges[k + 1]])
        inside = []
        while at < len(fixes) and fixes[at].time_s <= end:
            inside.append(replace(fixes[at], fraction=1.0 - (end - fixes[at].time_s) / TICK_S))
            at += 1
        known = {
            "yaw_rate_radps": float(gyro[k]),
            "accel_long_mps2": float(accel_long[k]),
            "accel_lat_mps2": float(accel_lat[k]),
            "steering_wheel_angle_rad": float(steer[k]),
        }
        ticks.append(
            Tick(
                index=k,
                time_s=end,
                dt_s=TICK_S,
                rotation_rad=rotation[k],
                rotation_std_rad=np.full(4, quantum / math.sqrt(6.0)),
                fixes=tuple(inside),
                host_time_s=end,
                **(known if inertial else {}),
            )
        )
    ends = edges[1:]
    radius = rolling_radius_m(p)
    slip = np.diff(truth_.angle_rad[edges], axis=0) * radius / np.diff(truth_.path_m[edges], axis=0) - 1.0
    state = np.stack([truth_.left_mps, truth_.forward_mps, truth_.yaw_rate_radps], axis=1)[ends]
    accel = np.stack([mean(truth_.accel_long_mps2), mean(truth_.accel_lat_mps2)], axis=1)
    return HardDrive(ticks, vehicle(p), state, slip, accel, p.b)
