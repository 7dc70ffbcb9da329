"""The regulations' cases: which tyres lose how much air, how fast, on which car and road.

In: the pool and a car's seed. Out: the car, the healthy drives on which it is learned, and its cases.

UN R141, Annex 3 (before: R64): 20 % of the warm pressure. One tyre (puncture): within ten minutes at 40 to
120 km/h. All four and a further 7 kPa (diffusion): within 60 minutes of driving, with a stop of 1 to 3
minutes after 20 to 40. Time under the service brake does not count.
FMVSS 138 (49 CFR 571.138): 25 % below the placard's cold pressure, one to four tyres, within 20 minutes at 50
to 100 km/h.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.worlds.instruments import START_S
from bench.worlds.trip_cars import Car, draw_car
from bench.worlds.trip_road import POOL_ROADS
from bench.worlds.trips import Leg, Loss

ONSETS = ("fast", "slow", "start")
SUBSETS = {
    1: ((0,), (1,), (2,), (3,)),
    2: ((0, 1), (2, 3), (0, 2), (1, 3), (0, 3), (1, 2)),
    3: ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
    4: ((0, 1, 2, 3),),
}
FAST_S = 10.0
SLOW_S = (600.0, 1800.0)
CASES_PER_CAR = 10
FAST_SHARE = {"city": 0.3, "suburb": 0.5, "alpine": 0.6}
"""Of the time on such a road, above 40 km/h."""
ONE_BAR_S, FOUR_BAR_S, R141_S, FMVSS_S = 600.0, 1200.0, 600.0, 1200.0
"""Our own limits, of driving above 40 km/h."""
FURTHER_PA = 7000.0
STOP_AFTER_S, STOP_S = (1200.0, 2400.0), (60.0, 180.0)


@dataclass(frozen=True)
class Law:
    """Time that a regulation allows, and which driving counts."""

    limit_s: float
    speeds_kmh: tuple[float, float]


LAWS = {
    "r141-puncture": Law(600.0, (40.0, 120.0)),
    "r141-diffusion": Law(3600.0, (0.5, 999.0)),
    "r141-malfunction": Law(600.0, (40.0, 120.0)),
    **{f"fmvss-{count}": Law(1200.0, (50.0, 100.0)) for count in (1, 2, 3, 4)},
}


@dataclass(frozen=True)
class Case:
    """One fault on one car."""

    name: str
    """pool/seed/standard-wheels-onset-road"""
    standard: str
    """r141-puncture | r141-diffusion | fmvss-1 ... fmvss-4"""
    onset: str
    leg: Leg
    limit_s: float
    """Driving above 40 km/h, after all is lost, until which an alarm counts as a detection."""
    season: str
    reloaded: bool
    """Another load than on the learning drive."""
    then: Leg | None = None
    """The drive goes on after a stop with the ignition off."""

    @property
    def wheels(self) -> tuple[int, ...]:
        """The soft ones."""
        return tuple(loss.wheel for loss in self.leg.losses)

    @property
    def done_s(self) -> float:
        """When all the air is lost that will be."""
        return max(loss.done_s for loss in self.leg.losses)


@dataclass(frozen=True)
class Group:
    """A car, how it is learned, and what then befalls it."""

    car: Car
    healthy: tuple[Leg, ...]
    cases: tuple[Case, ...]


def group(pool: str, seed: int, number: int = CASES_PER_CAR) -> Group:
    """All of one car. Wheels, onsets, roads and loads go round from car to car."""
    rng = np.random.default_rng([seed, 77, len(pool)])
    car = draw_car(rng, pool, seed)
    season, ambient = _season(rng)
    filled = ambient + float(rng.normal(0.0, 2.0))
    usual = float(rng.uniform(0.0, 0.3))
    roads = POOL_ROADS[pool]
    base: dict[str, Any] = {"ambient_k": ambient, "filled_k": filled, "load": usual}
    first, second = roads[1], roads[seed % len(roads)]
    healthy = (
        Leg(seed=1, road=first, duration_s=900.0, **base),
        Leg(seed=2, road=second, duration_s=600.0, **base, start_s=START_S + 90_000.0),
    )
    cases = []
    for k, (standard, count, share) in enumerate(_standards(number)):
        subsets = SUBSETS[count]
        wheels = subsets[(seed + k) % len(subsets)]
        onset = (
            ONSETS[(seed + k) % 3]
            if count < 4 or standard.startswith("fmvss")
            else ONSETS[1 + (seed + k) % 2]
        )
        road = roads[(seed // 3 + k) % len(roads)]
        if standard.startswith("fmvss") and pool == "development":
            road = "track"
        begin = 0.0 if onset == "start" else float(rng.uniform(90.0, 240.0))
        ramp = {"start": 0.0, "fast": FAST_S, "slow": float(rng.uniform(*SLOW_S))}[onset]
        limit = FOUR_BAR_S if count == 4 else R141_S if standard.startswith("r141") else FMVSS_S
        further = FURTHER_PA if standard == "r141-diffusion" else 0.0
        losses = tuple(
            Loss(wheel, share, begin, ramp, further, standard.startswith("fmvss")) for wheel in wheels
        )
        reloaded = (seed + k) % 2 == 1
        trailer = float(rng.uniform(600.0, 1400.0)) if rng.random() < 0.4 else 0.0
        more: dict[str, Any] = (
            {"load": float(rng.uniform(0.4, 1.0)), "trailer_kg": trailer} if reloaded else {}
        )
        letters = "".join(("fl", "fr", "rl", "rr")[wheel] for wheel in wheels)
        name = f"{pool}/{seed}/{standard}-{letters}-{onset}-{road}"
        leg = Leg(
            seed=100 + k,
            road=road,
            duration_s=begin + ramp + 1.15 * limit / FAST_SHARE.get(road, 0.95),
            losses=losses,
            start_s=START_S + 180_000.0,
            **{**base, **more},
        )
        leg = replace(leg, ambient_k=leg.ambient_k + float(rng.normal(0.0, 3.0)))
        then = None
        if standard == "r141-diffusion":
            leg, then = _with_stop(leg, np.random.default_rng([seed, 79, k]))
        cases.append(Case(name, standard, onset, leg, limit, season, reloaded, then))
    return Group(car, healthy, tuple(cases))


def _with_stop(leg: Leg, rng: np.random.Generator) -> tuple[Leg, Leg]:
    """The leg until the stop after 20 to 40 minutes with all that is lost, and the rest of the hour."""
    before_s = float(rng.uniform(*STOP_AFTER_S))
    first = replace(leg, duration_s=max(loss.done_s for loss in leg.losses) + before_s)
    stop_s = float(rng.uniform(*STOP_S))
    return first, replace(
        leg,
        seed=leg.seed + 50,
        duration_s=1.15 * (LAWS["r141-diffusion"].limit_s - before_s),
        losses=tuple(replace(loss, onset_s=0.0, duration_s=0.0) for loss in leg.losses),
        pause_s=stop_s,
        start_s=leg.start_s + first.duration_s + stop_s,
    )


def _season(rng: np.random.Generator) -> tuple[str, float]:
    season = str(rng.choice(["summer", "mild", "winter"]))
    spans = {"summer": (297.0, 308.0), "mild": (281.0, 293.0), "winter": (258.0, 276.0)}
    return season, float(rng.uniform(*spans[season]))


def _standards(number: int) -> list[tuple[str, int, float]]:
    """Standard, number of tyres, share of pressure lost."""
    every = [
        *[("r141-puncture", 1, 0.20)] * 4,
        ("r141-diffusion", 4, 0.20),
        *[(f"fmvss-{count}", count, 0.25) for count in (1, 2, 3, 4)],
        ("r141-puncture", 1, 0.20),
    ]
    order = (0, 4, 6, 1, 8, 2, 7, 3, 5, 9)
    return [every[k] for k in order[:number]]
