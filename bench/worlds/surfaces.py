"""What may confound, without any fault: surfaces, ferries, towing, chains, the sky.

In: road, duration, tags, a generator. Out: the ride and the `Surface` under it. Tags are listed in `TAGS`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from bench.worlds.instruments import markov
from bench.worlds.magic_tyre import Array
from bench.worlds.trip_road import STEP_S, Profile, profile

TAGS = {
    "plain": "nothing but warm-up, centrifugal growth and the road",
    "load": "another load than on the drive before, a trailer among them",
    "season": "15 K warmer or colder than on the drive before",
    "sun": "one side of the car in the sun",
    "slip": "wet or snow: half the grip, hills",
    "hard_bends": "lateral acceleration up to 5 m/s2",
    "gravel": "loose ground: wheels jump and slip",
    "ice": "patches of ice: wheels spin and lock",
    "snow_chains": "chains on the driven axle",
    "outages": "tunnels, and a receiver that loses its fix",
    "multipath": "reflections now and then",
    "canyon": "streets between high houses: reflections most of the time",
    "ferry": "the car stands, its position moves",
    "car_wash": "driven wheels turn on rollers, the position stands",
    "towing": "towed with the front axle lifted, ignition on",
    "roundabouts": "one roundabout after the other",
    "parking": "manoeuvres forth and back with the wheels turned",
    "new_tyre": "one tyre is new: 1 to 2.5 mm larger",
    "rotated": "wheels changed front to rear",
    "spare": "a temporary spare wheel, 1 to 3 % smaller",
}
FRAMES_NEEDED = ("ferry", "car_wash", "towing", "ice")
"""Wheels that stand or spin alone are first judged by the decoder: such legs must go through it."""
RESIZED = ("new_tyre", "rotated", "spare")
LIFTED = np.array([0.0, 0.0, 1.0, 1.0])


@dataclass
class Surface:
    """What the ride rolls on and drives under; arrays over n samples of 20 ms."""

    grip: Array
    """(n, 1) factor on the slip stiffness."""
    spin: Array
    """(n, 4) slip that no force explains."""
    turns: Array
    """(n, 4) 1 where a wheel turns with the road, 0 where it stands although the car moves."""
    driven_mps: Array
    """(n, 4) speed of wheels on rollers."""
    chains_m: float
    """How much larger chains make the driven wheels."""
    warmer_k: Array
    """(4,) the sun on one side."""
    rough: Array
    """(n,) factor on the roughness."""
    sky: Array
    """(n, 3) factor on the Doppler noise, standard deviation of the place in m, 0 without a fix."""


def ride(
    road: str, duration_s: float, tags: tuple[str, ...], rng: np.random.Generator
) -> tuple[Profile, Surface]:
    """A ride with what its tags say."""
    limit = 12.0 if "snow_chains" in tags else 18.0 if "gravel" in tags else 99.0
    for name in ("roundabouts", "parking"):
        road = name if name in tags else road
    lateral = 5.0 if "hard_bends" in tags else None
    special: list[str] = [tag for tag in ("ferry", "car_wash", "towing") if tag in tags]
    parts = [profile(road, duration_s / (1 + len(special)), rng, limit, lateral, stop=bool(special))]
    kinds: list[str] = ["road"]
    for tag in special:
        parts.append(_carried(tag, rng))
        parts.append(profile(road, duration_s / (1 + len(special)), rng, limit, lateral, stop=True))
        kinds += [tag, "road"]
    whole = Profile(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("speed", "bend", "slope"))
    )
    if "parking" in tags:
        whole = dataclasses.replace(whole, speed=_forth_and_back(whole.speed, rng))
    surface = _plain(len(whole.speed))
    begin = 0
    for part, kind in zip(parts, kinds, strict=True):
        span = slice(begin, begin + len(part.speed))
        if kind in ("ferry", "towing"):
            surface.turns[span] = 0.0 if kind == "ferry" else LIFTED
        if kind == "car_wash":
            length = span.stop - span.start
            swell = np.minimum(np.arange(length), np.arange(length)[::-1]) * STEP_S / 5.0
            surface.driven_mps[span, :2] = float(rng.uniform(3.0, 14.0)) * np.minimum(swell, 1.0)[:, None]
        begin = span.stop
    for tag in tags:
        _lay(tag, surface, whole, rng)
    return whole, surface


def _plain(n: int) -> Surface:
    sky = np.tile([1.0, 0.0, 1.0], (n, 1))
    ones, zeros = np.ones((n, 4)), np.zeros((n, 4))
    return Surface(np.ones((n, 1)), zeros.copy(), ones, zeros, 0.0, np.zeros(4), np.ones(n), sky)


def _carried(tag: str, rng: np.random.Generator) -> Profile:
    """Standing on something that moves, or on rollers."""
    long_s = {"ferry": (300.0, 900.0), "car_wash": (60.0, 240.0), "towing": (200.0, 600.0)}[tag]
    n = round(float(rng.uniform(*long_s)) / STEP_S)
    if tag == "car_wash":
        return Profile(np.zeros(n), np.zeros(n), np.zeros(n))
    if tag == "towing":
        return profile("city", n * STEP_S, rng, 14.0, stop=True)
    ends = np.minimum(np.arange(n), np.arange(n)[::-1]) * STEP_S / 60.0
    speed = float(rng.uniform(3.0, 9.0)) * np.minimum(ends, 1.0)
    return Profile(speed, markov(rng, n, STEP_S, 1e-3, 60.0), np.zeros(n))


def _forth_and_back(speed: Array, rng: np.random.Generator) -> Array:
    """Between two stops some moves go backwards."""
    standing = speed < 0.05
    starts = np.flatnonzero(standing[:-1] & ~standing[1:]) + 1
    sign = np.ones(len(speed))
    for begin, end in zip(starts, [*starts[1:], len(speed)], strict=True):
        if rng.random() < 0.4:
            sign[begin:end] = -1.0
    return np.asarray(speed * sign)


def _spells(rng: np.random.Generator, n: int, per_hour: float, long_s: tuple[float, float]) -> list[slice]:
    hours = n * STEP_S / 3600.0
    begins = rng.integers(0, n, rng.poisson(per_hour * hours))
    return [slice(int(b), int(b) + round(float(rng.uniform(*long_s)) / STEP_S)) for b in begins]


def _lay(tag: str, surface: Surface, ride_: Profile, rng: np.random.Generator) -> None:
    """Put what the tag says onto the surface."""
    n = len(ride_.speed)
    if tag == "slip":
        surface.grip *= float(rng.uniform(0.35, 0.6))
    elif tag == "sun":
        surface.warmer_k += float(rng.uniform(4.0, 10.0)) * np.array([1.0, 0.0, 1.0, 0.0])
    elif tag == "gravel":
        surface.grip *= 0.4
        surface.rough *= float(rng.uniform(3.0, 8.0))
        surface.spin += np.stack([markov(rng, n, STEP_S, 3e-3, 0.4) for _ in range(4)], axis=1)
    elif tag == "snow_chains":
        surface.grip *= 0.6
        surface.rough *= 6.0
        surface.chains_m = float(rng.uniform(4e-3, 9e-3))
    elif tag == "ice":
        for spell in _spells(rng, n, 40.0, (0.5, 5.0)):
            length = len(surface.spin[spell])
            wheels = np.flatnonzero(rng.random(4) < 0.5)
            swell = np.sin(np.linspace(0.0, np.pi, length)) ** 2
            surface.spin[spell, wheels] += float(rng.uniform(-0.6, 0.8)) * swell[:, None]
        surface.grip *= 0.5
    elif tag == "outages":
        for spell in _spells(rng, n, 12.0, (5.0, 60.0)) + _spells(rng, n, 2.0, (60.0, 240.0)):
            surface.sky[spell, 2] = 0.0
    elif tag == "multipath":
        for spell in _spells(rng, n, 20.0, (5.0, 30.0)):
            surface.sky[spell, :2] = float(rng.uniform(2.0, 8.0)), float(rng.uniform(3.0, 15.0))
    elif tag == "canyon":
        for spell in _spells(rng, n, 150.0, (5.0, 40.0)):
            surface.sky[spell, :2] = float(rng.uniform(1.5, 6.0)), float(rng.uniform(3.0, 20.0))
        for spell in _spells(rng, n, 40.0, (1.0, 10.0)):
            surface.sky[spell, 2] = 0.0


def road_for(tags: tuple[str, ...], road: str, roads: tuple[str, ...]) -> str:
    """Where such a thing happens; `roads` are those of the pool: town, country, motorway, hills."""
    if "canyon" in tags:
        return roads[0]
    if "gravel" in tags:
        return roads[1]
    if "slip" in tags or "snow_chains" in tags:
        return roads[3]
    return road
