"""One leg of a car's life: from ignition on to ignition off.

In: `Car`, `Leg` and the tyres' temperatures. Out: the drive that its instruments saw, and the truth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bench.worlds import surfaces as events
from bench.worlds.causes import DRIVEN
from bench.worlds.course import Course, decayed, hub_speeds, rigid, summed
from bench.worlds.instruments import START_S, Drive, markov
from bench.worlds.magic_tyre import NOMINAL_PA, SLIP_STIFFNESS, Array, gauge_at
from bench.worlds.surfaces import Surface
from bench.worlds.trip_cars import G_MPS2, Car
from bench.worlds.trip_instruments import observe
from bench.worlds.trip_road import STEP_S, Profile

WARMING_K, WARMING_S, COOLING_S = 28.0, 500.0, 1500.0
"""Air in the tyre over ambient at 30 m/s and nominal load; time constants rolling and standing."""
BRAKE_KPW = 6e-4
ROLLING = 0.012
ENGINE_BRAKE_MPS2 = 0.6


@dataclass(frozen=True)
class Loss:
    """A tyre that loses air: `share` of its gauge pressure, evenly from the onset on."""

    wheel: int
    share: float
    onset_s: float = 0.0
    duration_s: float = 0.0
    """0: flat at the onset."""
    further_pa: float = 0.0
    """Gauge pressure that is lost besides."""
    of_cold: bool = False
    """Whether the share is of the pressure to which the cold tyre was filled: what it gained by warmth is
    lost besides, and what is left warms on."""

    @property
    def done_s(self) -> float:
        """When all of it is lost."""
        return self.onset_s + self.duration_s


@dataclass(frozen=True)
class Leg:
    """What is driven, with what load, in which weather, and what happens to the tyres."""

    seed: int
    road: str
    duration_s: float
    ambient_k: float = 293.0
    filled_k: float = 293.0
    load: float = 0.0
    trailer_kg: float = 0.0
    pause_s: float = 7200.0
    """Parked before."""
    losses: tuple[Loss, ...] = ()
    resized_m: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Other tyres than when the car was learned: new, spare, rotated."""
    tags: tuple[str, ...] = ()
    """What may confound; see `events`."""
    start_s: float = START_S


@dataclass(frozen=True)
class Driven:
    """A leg as it was driven."""

    leg: Leg
    drive: Drive
    distance_m: Array
    """(n,) rolled on the car's own wheels."""
    radius_m: Array
    """(n, 4) effective rolling radii."""
    lost_m: Array
    """(n, 4) how much larger they would be without loss of air."""
    temperature_k: Array
    """(4,) of the tyres at the end."""

    @property
    def kilometres(self) -> float:
        """Rolled."""
        return float(self.distance_m[-1]) / 1000.0


def drive_leg(car: Car, leg: Leg, temperature_k: Array | None = None) -> Driven:
    """Drive it; `temperature_k` is that of the tyres when the car was parked."""
    rng = np.random.default_rng([car.seed, leg.seed, 1])
    ride, surface = events.ride(leg.road, leg.duration_s, leg.tags, rng)
    course = _course(car, ride, rng)
    force, braking = _forces(car, leg, course)
    tyre_k = _temperatures(car, leg, course, braking, temperature_k, surface)
    healthy = gauge_at(tyre_k, leg.filled_k)
    gauge = healthy * (1.0 - _lost(leg, course.time_s, healthy))
    driven = np.array(DRIVEN[car.spec.driven], dtype=float)
    own = car.wear_m + np.array(leg.resized_m) + surface.chains_m * driven
    vertical = _vertical(car, leg, course)
    speed = np.abs(course.speed)
    radius = car.tyre.effective_radius_m(vertical, gauge, speed[:, None]) + own
    lost = np.zeros_like(radius)
    if leg.losses:
        lost = car.tyre.effective_radius_m(vertical, healthy, speed[:, None]) + own - radius
    n = len(speed)
    if car.spec.radius_drift > 0.0:
        radius_drift = [markov(rng, n, STEP_S, car.spec.radius_drift, 240.0) for _ in range(4)]
        radius = radius * (1.0 + np.stack(radius_drift, axis=1))
    slip = force / (vertical * SLIP_STIFFNESS * surface.grip) + surface.spin
    hubs = np.abs(hub_speeds(course, car.spec)) * surface.turns + surface.driven_mps
    rate = hubs / radius * (1.0 + slip)
    drive = observe(course, car.spec, np.maximum(rate, 0.0), surface, rng, leg.seed, leg.start_s)
    distance = summed(np.where(surface.turns.all(axis=1), speed, 0.0), course.time_s)
    return Driven(leg, drive, distance, radius, lost, tyre_k[-1])


def _course(car: Car, ride: Profile, rng: np.random.Generator) -> Course:
    time_s: Array = np.arange(len(ride.speed), dtype=np.float64) * STEP_S
    heading = float(rng.uniform(-3.0, 3.0))
    return rigid(time_s, ride.speed, ride.bend, ride.slope, heading, car.side_slip)


def _forces(car: Car, leg: Leg, course: Course) -> tuple[Array, Array]:
    """(n, 4) longitudinal forces at the wheels, and (n,) what the brakes take of it, both N."""
    mass = float(car.loads_n(leg.load, leg.trailer_kg).sum()) / G_MPS2 + 0.94 * leg.trailer_kg
    forward = np.where(course.speed < 0.0, -1.0, 1.0)
    moving = np.abs(course.speed) > 0.1
    drag = ROLLING * mass * G_MPS2 + 0.6 * (car.drag_m2 + (1.2 if leg.trailer_kg else 0.0)) * course.speed**2
    total = np.where(moving, mass * course.force * forward + drag, 0.0)
    driven = np.array(DRIVEN[car.spec.driven], dtype=float)
    engine = np.maximum(total, -ENGINE_BRAKE_MPS2 * mass)
    brakes = np.minimum(total - engine, 0.0)
    shared = np.array([car.brake_front, car.brake_front, 1.0 - car.brake_front, 1.0 - car.brake_front]) / 2.0
    return engine[:, None] * driven / driven.sum() + brakes[:, None] * shared, brakes


def _vertical(car: Car, leg: Leg, course: Course) -> Array:
    static = car.loads_n(leg.load, leg.trailer_kg)
    mass = float(static.sum()) / G_MPS2
    spec = car.spec
    pitch = mass * course.force * car.height_m / (2.0 * spec.wheelbase_m)
    roll = mass * course.a_lat * car.height_m / (spec.track_front_m + spec.track_rear_m)
    out = static + pitch[:, None] * np.array([-1.0, -1.0, 1.0, 1.0])
    out += roll[:, None] * np.array([-1.0, 1.0, -1.0, 1.0])
    return np.asarray(np.maximum(out, 300.0))


def _temperatures(
    car: Car, leg: Leg, course: Course, braking_n: Array, before_k: Array | None, surface: Surface
) -> Array:
    """(n, 4) of the air in the tyres: rolling warms, standing cools, brakes and sun add."""
    every = round(1.0 / STEP_S)
    speed = np.abs(course.speed[::every])
    share = car.loads_n(leg.load, leg.trailer_kg) / (4000.0 * car.tyre.load)
    power = decayed(-braking_n * np.abs(course.speed), STEP_S / 60.0)[::every]
    brake_share = np.array([car.brake_front, car.brake_front, 1 - car.brake_front, 1 - car.brake_front]) / 2.0
    target = leg.ambient_k + surface.warmer_k + WARMING_K * (speed / 30.0)[:, None] * share
    target += 2.0 * BRAKE_KPW * power[:, None] * brake_share
    now = np.full(4, leg.ambient_k) + surface.warmer_k
    if before_k is not None:
        now = now + (before_k - now) * math.exp(-leg.pause_s / COOLING_S)
    out = np.empty_like(target)
    for k in range(len(target)):
        out[k] = now
        now = now + (target[k] - now) / (WARMING_S if speed[k] > 2.0 else COOLING_S)
    seconds = course.time_s[::every]
    return np.stack([np.interp(course.time_s, seconds, out[:, w]) for w in range(4)], axis=1)


def _lost(leg: Leg, time_s: Array, healthy: Array) -> Array:
    """(n, 4) share of the gauge pressure that is gone; healthy (n, 4): over nominal, without losses."""
    out = np.zeros((len(time_s), 4))
    for loss in leg.losses:
        done = np.clip((time_s - loss.onset_s) / max(loss.duration_s, 1e-9), 0.0, 1.0)
        out[:, loss.wheel] = np.maximum(out[:, loss.wheel], _share(loss, time_s, healthy) * done)
    return out


def _share(loss: Loss, time_s: Array, healthy: Array) -> float:
    """Share of the gauge pressure that is gone once all is lost."""
    then = float(healthy[min(int(np.searchsorted(time_s, loss.done_s)), len(time_s) - 1), loss.wheel])
    further = loss.further_pa / NOMINAL_PA
    left = 1.0 - loss.share if loss.of_cold else then * (1.0 - loss.share)
    return min(max(1.0 - (left - further) / then, 0.0), 1.0)
