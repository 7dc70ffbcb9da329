"""Sixteen realistic cases of soft tyres on one car.

In: the pool and a seed. Out: the car, and its cases: drives in order, resets before some of them, which tyres
are soft, from which drive on an alarm counts, and until when.

Transport and Environment (2016) found that indirect systems which pass the approval test failed most of
sixteen tests of everyday use: worn tyres, two tyres of an axle or a side, loads, short trips, town and low
speed, tyres that are soft from the beginning, resets at low pressure. Its exact drives were not at hand;
these are made after its list. All are of one car, so that one description of the bus serves for them all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.worlds.instruments import START_S
from bench.worlds.trip_cars import Car, draw_car
from bench.worlds.trip_road import POOL_ROADS
from bench.worlds.trips import Leg, Loss

DAY_S = 90_000.0
LEARN_S = (900.0, 600.0)
SHARE = 0.25
"""Of the pressure that is lost; in a reset and at the beginning a third, as nobody presses it for less."""
LOW_SHARE = 0.35
ONE_S, SEVERAL_S = 600.0, 1200.0
"""Driving until which one tyre, or several, have to be found."""
TRIP_S = 240.0
FRONT, REAR, LEFT, EVERY = (0, 1), (2, 3), (0, 2), (0, 1, 2, 3)


@dataclass(frozen=True)
class Act:
    """A drive, and whether the driver reset the system before it."""

    leg: Leg
    reset: bool = False


@dataclass(frozen=True)
class RealCase:
    """One case."""

    name: str
    acts: tuple[Act, ...]
    first: int
    """The act from which on an alarm is asked for; earlier ones are false."""
    wheels: tuple[int, ...]
    limit_s: float
    """Driving since then."""


def car_of(pool: str, seed: int) -> Car:
    """Return the car of all cases."""
    return draw_car(np.random.default_rng([seed, 81, len(pool)]), pool, seed)


def cases_of(pool: str, seed: int) -> tuple[RealCase, ...]:
    """All sixteen."""
    rng = np.random.default_rng([seed, 82, len(pool)])
    town, country, motorway, _ = POOL_ROADS[pool]
    ambient = float(rng.uniform(275.0, 298.0))
    usual: dict[str, Any] = {"ambient_k": ambient, "filled_k": ambient, "load": float(rng.uniform(0.0, 0.2))}
    learned = tuple(
        Act(Leg(seed=1 + k, road=road, duration_s=s, start_s=START_S + k * DAY_S, **usual))
        for k, (road, s) in enumerate(zip((country, motorway), LEARN_S, strict=True))
    )
    worn = tuple(replace(act, leg=replace(act.leg, resized_m=WORN_M)) for act in learned)

    def drive(road: str, wheels: tuple[int, ...], share: float = SHARE, **more: Any) -> Act:
        """The drive on which these are soft: air is lost from 60 s on, in 10 s."""
        limit_s = ONE_S if len(wheels) == 1 else SEVERAL_S
        begin_s, ramp_s = more.pop("onset", (60.0, 10.0))
        reset = bool(more.pop("reset", False))
        losses = tuple(Loss(wheel, share, begin_s, ramp_s) for wheel in wheels)
        base = {"seed": 10, "duration_s": limit_s + 120.0, "start_s": START_S + 2 * DAY_S, **usual, **more}
        return Act(Leg(road=road, losses=losses, **base), reset)

    def trips(wheels: tuple[int, ...]) -> tuple[Act, ...]:
        """Six short trips in town, cold each time; soft since before the first."""
        first = drive(town, wheels, onset=(0.0, 0.0), duration_s=TRIP_S)
        return tuple(
            Act(replace(first.leg, seed=20 + k, start_s=first.leg.start_s + k * 9000.0)) for k in range(6)
        )

    start = (0.0, 0.0)
    soft_first = tuple(
        replace(act, leg=replace(act.leg, losses=(Loss(1, LOW_SHARE),)))
        for act in (learned[0], replace(learned[1], leg=replace(learned[1].leg, seed=3)))
    )
    made: list[tuple[str, tuple[Act, ...], int, tuple[int, ...]]] = [
        ("one-motorway", (*learned, drive(motorway, (0,))), 2, (0,)),
        ("one-town", (*learned, drive(town, (3,))), 2, (3,)),
        ("one-low-speed", (*learned, drive("zone", (2,))), 2, (2,)),
        ("one-worn", (*worn, drive(country, (1,), resized_m=WORN_M)), 2, (1,)),
        ("one-loaded", (*learned, drive(country, (2,), load=1.0)), 2, (2,)),
        ("front-country", (*learned, drive(country, FRONT)), 2, FRONT),
        ("rear-loaded", (*learned, drive(country, REAR, load=0.8)), 2, REAR),
        ("rear-overnight", (*learned, drive(country, REAR, onset=start)), 2, REAR),
        ("side-town", (*learned, drive(town, LEFT)), 2, LEFT),
        ("all-country", (*learned, drive(country, EVERY)), 2, EVERY),
        ("all-motorway", (*learned, drive(motorway, EVERY, onset=start)), 2, EVERY),
        ("short-trips-one", (*learned, *trips((0,))), 2, (0,)),
        ("short-trips-pair", (*learned, *trips(FRONT)), 2, FRONT),
        ("soft-at-first", soft_first, 0, (1,)),
        ("reset-one-soft", (*learned, drive(country, (0,), LOW_SHARE, onset=start, reset=True)), 2, (0,)),
        ("reset-all-soft", (*learned, drive(country, EVERY, LOW_SHARE, onset=start, reset=True)), 2, EVERY),
    ]
    return tuple(
        RealCase(name, acts, first, wheels, ONE_S if len(wheels) == 1 else SEVERAL_S)
        for name, acts, first, wheels in made
    )


WORN_M = (-5e-3, -4.4e-3, -2e-3, -2.6e-3)
"""Four to five millimetres of tread less in front than behind, not quite alike."""
