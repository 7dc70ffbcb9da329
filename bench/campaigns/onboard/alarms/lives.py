"""Cars in order through confounding drives: any alarm is a false one.

In: the pool and a seed. Out: `Life`: a car, the drives on which it is learned, and drives that confound, each
from what was learned on the former, so that any of them can be played alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.worlds.instruments import START_S
from bench.worlds.surfaces import RESIZED, TAGS, road_for
from bench.worlds.trip_cars import Car, draw_car
from bench.worlds.trip_road import POOL_ROADS
from bench.worlds.trips import Leg

LEARNING = 2
LEGS = LEARNING + 8
WITH_OTHERS = ("load", "season", "sun", "outages", "multipath", "slip")
SLOW_ROADS = ("city", "suburb", "alpine")
SLIPPERY = (
    *(("ice",), ("slip",), ("ice", "multipath"), ("slip", "outages"), ("ice", "load"), ("slip", "season")),
    *(("gravel",), ("ice", "slip")),
)
SLIPPERY_OF = {"slippery": None, "slippery-front": "front", "slippery-rear": "rear", "slippery-all": "all"}
"""Names of such lives, with the driven axles."""
DAY_S = 90_000.0
KIND_S = 420.0
"""Of each leg of `kinds`; what a ferry or a tow adds comes on top."""


@dataclass(frozen=True)
class Life:
    """A car and its legs; the first `LEARNING` ones are for learning."""

    car: Car
    legs: tuple[Leg, ...]


def life(pool: str, seed: int) -> Life:
    """Confounders go round from car to car, each with another one now and then."""
    rng = np.random.default_rng([seed, 78, len(pool)])
    car = draw_car(rng, pool, seed)
    base_k = float(rng.uniform(263.0, 305.0))
    filled_k = base_k + float(rng.normal(0.0, 2.0))
    usual = float(rng.uniform(0.0, 0.3))
    roads = POOL_ROADS[pool]
    names = list(TAGS)
    legs = [
        Leg(
            k,
            roads[1 + k],
            1500.0 - 600.0 * k,
            base_k,
            filled_k,
            usual,
            tags=("plain",),
            start_s=START_S + k * DAY_S,
        )
        for k in range(LEARNING)
    ]
    for k in range(LEARNING, LEGS):
        tags: tuple[str, ...] = (names[(seed * (LEGS - LEARNING) + k) % len(names)],)
        if tags != ("plain",) and rng.random() < 0.35:
            other = str(rng.choice(WITH_OTHERS))
            tags = tags if other in tags else (*tags, other)
        weights = np.array(
            [
                0.5 if road in SLOW_ROADS else 1.3 if road in ("motorway", "autobahn") else 1.0
                for road in roads
            ]
        )
        road = road_for(tags, str(rng.choice(roads, p=weights / weights.sum())), roads)
        legs.append(
            Leg(
                seed=k,
                road=road,
                duration_s=float(rng.uniform(900.0, 2700.0)) * (0.5 if road in SLOW_ROADS else 1.0),
                ambient_k=base_k + float(rng.normal(0.0, 3.0)) + _season(tags, rng),
                filled_k=filled_k,
                pause_s=float(rng.choice([600.0, 3600.0, 40_000.0])),
                resized_m=_resized(tags, rng),
                tags=tags,
                start_s=START_S + k * DAY_S,
                **_load(tags, usual, rng),
            )
        )
    return Life(car, tuple(legs))


def kinds(pool: str, seed: int) -> Life:
    """One short leg for each kind of confounder, alone: so that even a short run has met them all."""
    rng = np.random.default_rng([seed, 79, len(pool)])
    taught = life(pool, seed)
    usual = taught.legs[0]
    roads = POOL_ROADS[pool]
    legs = list(taught.legs[:LEARNING])
    for k, tag in enumerate(TAGS, start=LEARNING):
        legs.append(
            Leg(
                seed=100 + k,
                road=road_for((tag,), roads[1 + k % 2], roads),
                duration_s=KIND_S,
                ambient_k=usual.ambient_k + float(rng.normal(0.0, 3.0)) + _season((tag,), rng),
                filled_k=usual.filled_k,
                pause_s=40_000.0,
                resized_m=_resized((tag,), rng),
                tags=(tag,),
                start_s=START_S + k * DAY_S,
                **_load((tag,), usual.load, rng),
            )
        )
    return Life(taught.car, tuple(legs))


def slippery(pool: str, seed: int, driven: str | None = None) -> Life:
    """The car and the roads of `life`, each leg on ice, snow or gravel. `driven`: axles of that car, in place
    of its own."""
    usual = life(pool, seed)
    rng = np.random.default_rng([seed, 4711])
    roads = POOL_ROADS[pool]
    legs = list(usual.legs[:LEARNING])
    for k, leg in enumerate(usual.legs[LEARNING:]):
        tags = SLIPPERY[(k + seed) % len(SLIPPERY)]
        load = _load(tags, usual.legs[0].load, rng)
        road = road_for(tags, str(rng.choice(roads)), roads)
        plain = {"load": load["load"], "trailer_kg": load.get("trailer_kg", 0.0), "resized_m": (0.0,) * 4}
        legs.append(replace(leg, seed=300 + k, tags=tags, road=road, **plain))
    car = usual.car
    if driven is not None:
        car = replace(car, spec=replace(car.spec, driven=driven))
    return Life(car, tuple(legs))


def _season(tags: tuple[str, ...], rng: np.random.Generator) -> float:
    return float(rng.choice([-15.0, 15.0])) if "season" in tags else 0.0


def _load(tags: tuple[str, ...], usual: float, rng: np.random.Generator) -> dict[str, Any]:
    if "load" not in tags:
        return {"load": usual}
    trailer = float(rng.uniform(600.0, 1400.0)) if rng.random() < 0.4 else 0.0
    return {"load": float(rng.uniform(0.5, 1.0)), "trailer_kg": trailer}


def _resized(tags: tuple[str, ...], rng: np.random.Generator) -> tuple[float, float, float, float]:
    """Other wheels than before; a mm of tread is a mm of radius."""
    change = np.zeros(4)
    wheel = int(rng.integers(4))
    if "new_tyre" in tags:
        change[wheel] = float(rng.uniform(1e-3, 2.5e-3))
    if "spare" in tags:
        change[wheel] = -0.31 * float(rng.uniform(0.01, 0.03))
    if "rotated" in tags:
        worn = float(rng.uniform(0.3e-3, 1.5e-3))
        change = np.array([worn, worn, -worn, -worn]) * float(rng.choice([-1.0, 1.0]))
    return (float(change[0]), float(change[1]), float(change[2]), float(change[3]))


def is_resized(tags: list[str] | tuple[str, ...]) -> bool:
    """Whether a wheel truly has another size than when the car was learned."""
    return any(tag in RESIZED for tag in tags)
