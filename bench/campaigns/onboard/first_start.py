"""A tyre that was soft before the program ever saw the car: is it reported in the first ten minutes?

    python -m bench run first-start [--cars 12] [--seed 1] [--held-out] [--healthy 12] [--remember FOLDER]

Cars, roads and receivers are those of the campaign `alarms` (`bench/worlds/trips.py`), which shares no
physics with the program. Each car is met for the first time on a drive of ten minutes: without a fault, or
with one wheel 1.5 to 2.2 % smaller than its nominal radius. Found: a `deflation` of that wheel within the
drive, and of no other. Of a car without a fault any tyre alarm is false.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.onboard.alarms.lives import life
from bench.campaigns.onboard.alarms.play import Said, replay_leg
from bench.statistics import percent, rate, share
from bench.worlds.trip_road import POOL_ROADS
from bench.worlds.trips import Leg, drive_leg
from tpmsd.foundation.wheels import WHEELS

DRIVE_S = 600.0
SMALLER = (0.015, 0.022)


def first_leg(pool: str, seed: int, wheel: int | None) -> tuple[Any, Leg]:
    """A car and the drive on which it is met; `wheel` is small, None: none is."""
    met = life(pool, seed)
    rng = np.random.default_rng([seed, 80, len(pool)])
    off = float(rng.uniform(*SMALLER))
    resized = [0.0] * 4
    if wheel is not None:
        resized[wheel] = -off * float(met.car.spec.radius_m)
    roads = POOL_ROADS[pool]
    leg = replace(
        met.legs[0],
        road=roads[seed % len(roads)],
        duration_s=DRIVE_S,
        resized_m=(resized[0], resized[1], resized[2], resized[3]),
    )
    return met.car, leg


def tyre_alarms(
    pool: str, seed: int, wheel: int | None, memory: Path | None = None
) -> tuple[list[Said], float]:
    """Tyre alarms of the first drive, and how far it went, km. `memory`: a folder of estimates."""
    car, leg = first_leg(pool, seed, wheel)
    driven = drive_leg(car, leg, None)
    outcome = replay_leg(driven, memory=memory)
    return [*outcome.raised("deflation"), *outcome.raised("radius_deviation")], driven.kilometres


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--cars", type=int, default=12, help="cars with a soft tyre")
    parser.add_argument("--healthy", type=int, default=12, help="cars without a fault")
    parser.add_argument("--seed", type=int, default=1, help="thousands of the first car's seed")
    parser.add_argument("--held-out", action="store_true", help="the other half of the cars")
    parser.add_argument(
        "--remember",
        type=Path,
        metavar="FOLDER",
        help="keep the estimates here, as `alarms` does: another monitor takes a sixth of the time",
    )


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print."""
    pool = "held-out" if args.held_out else "development"
    first = 1000 * args.seed
    found, rows = 0, []
    for seed in range(first, first + args.cars):
        wheel = seed % 4
        said, _ = tyre_alarms(pool, seed, wheel, args.remember)
        named = [(one.wheel, one.kind, round(one.time_s)) for one in said]
        good = any(one.kind == "deflation" for one in said) and {one.wheel for one in said} == {WHEELS[wheel]}
        found += good
        rows.append({"seed": seed, "wheel": WHEELS[wheel], "named": named, "found": good})
        print(f"{pool}/{seed} {WHEELS[wheel]} soft: {named or 'nothing named'}", flush=True)
    false, kilometres = 0, 0.0
    for seed in range(first, first + args.healthy):
        said, km = tyre_alarms(pool, seed, None, args.remember)
        false, kilometres = false + bool(said), kilometres + km
        if said:
            print(f"{pool}/{seed} healthy: {[(one.wheel, one.kind, round(one.time_s)) for one in said]}")
    print(f"soft, found on the right wheel within ten minutes: {percent(share(found, args.cars))}")
    print(f"healthy cars with a tyre alarm: {percent(share(false, args.healthy))}, {kilometres:.0f} km")
    return {"soft": rows, "false": rate(false, float(args.healthy), 1.0), "kilometres": kilometres}
