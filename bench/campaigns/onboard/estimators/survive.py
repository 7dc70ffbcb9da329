"""Hours of driving: does a method stay finite, true and small?

In: a method and a number of hours. Out: errors, stated errors and size of the state, hour by hour.

The drive is chained: each begins where and as the last one ended, at a standstill, with the same radii.
Into it come outages of the receiver, counter resets (a tick or a few without rotation), and pauses of the
bus.
"""

from __future__ import annotations

import math
import pickle
import resource
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.campaigns.onboard.estimators.methods import ALL, build
from bench.campaigns.onboard.estimators.play import play
from bench.worlds.paper_drive import GROWTH_S2PM, RL, SCENARIOS, START_S, TICK_S, UNBALANCED_M, drive
from bench.worlds.paper_route import DURATION_S, Route, paper_route
from tpmsd.onboard.timeline.tick import Tick

Array = NDArray[np.float64]
OUTAGES = 2
RESETS = 3
PAUSES = 1
PAUSE_S = 5.0
"""Longer than a filter extrapolates the motion without wheels."""
OFFSETS_M = (0.9e-3, 0.4e-3, 0.7e-3 + UNBALANCED_M, 0.7e-3)
GROWN = 1.02
"""A state that is larger than this many times its largest size in the first half has grown."""
WORSE = 1.5
SLACK_M = 5e-5
"""The last hours' error may exceed the first ones' by this factor and this much before it is a drift."""
ASTRAY = 5.0
"""An hour after the first whose error is this many times the median hour's went astray."""


def legs(seed: int) -> Iterator[tuple[list[Tick], Array]]:
    """18 min at a time for ever: ticks and the true radius errors (n, 4)."""
    route = paper_route()
    speed = route.speed_mps[:: round(TICK_S * 100)]
    offsets = np.tile(np.array(OFFSETS_M), (speed.size, 1)) + GROWTH_S2PM * speed[:, None] ** 2
    at = np.zeros(2)
    turned = 0.0
    number = 0
    while True:
        rng = np.random.default_rng([seed, number, 11])
        leg = _turned(route, turned, at)
        driven = drive(SCENARIOS["unbalanced"], "correlated", seed * 1000 + number, leg, offsets)
        begin = number * (DURATION_S + PAUSE_S * PAUSES)
        ticks, kept = _spoiled(driven.ticks, begin, rng)
        yield ticks, driven.offsets_m[kept]
        at = np.array([leg.east_m[-1], leg.north_m[-1]])
        turned = math.remainder(float(leg.heading_rad[-1] - route.heading_rad[0]), 2 * math.pi)
        number += 1


def _turned(route: Route, angle: float, at: Array) -> Route:
    """The route begun elsewhere and in another direction."""
    cos, sin = math.cos(angle), math.sin(angle)
    return replace(
        route,
        heading_rad=route.heading_rad + angle,
        east_m=at[0] + route.east_m * cos - route.north_m * sin,
        north_m=at[1] + route.east_m * sin + route.north_m * cos,
    )


def _spoiled(ticks: list[Tick], begin_s: float, rng: np.random.Generator) -> tuple[list[Tick], list[int]]:
    """Ticks at their time of the day, with outages, resets and pauses; and which ones are left."""
    count = len(ticks)
    silent, torn, gone = np.zeros(count, bool), np.zeros(count, bool), np.zeros(count, bool)
    for _ in range(OUTAGES):
        first = int(rng.integers(count))
        silent[first : first + int(rng.uniform(20.0, 120.0) / TICK_S)] = True
    for _ in range(RESETS):
        first = int(rng.integers(count))
        torn[first : first + int(rng.integers(1, 8))] = True
    later = np.zeros(count)
    pauses = sorted(int(rng.integers(100, count)) for _ in range(PAUSES))
    for first in pauses:
        later[first:] += PAUSE_S
    out, kept = [], []
    for k, tick in enumerate(ticks):
        moved = begin_s + float(later[k])
        fixes = () if silent[k] else tuple(replace(f, time_s=f.time_s + moved) for f in tick.fixes)
        # During a pause the car drove on; what it rolled then is not known: the ticks are lost.
        if any(first - PAUSE_S / TICK_S <= k < first for first in pauses):
            gone[k] = True
            continue
        out.append(
            replace(
                tick,
                index=int(begin_s / TICK_S) + tick.index,
                time_s=tick.time_s + moved,
                host_time_s=tick.time_s + moved,
                fixes=fixes,
                rotation_rad=np.full(4, math.nan) if torn[k] else tick.rotation_rad,
                rotation_std_rad=np.full(4, math.nan) if torn[k] else tick.rotation_std_rad,
                gap_s=PAUSE_S if k in pauses else 0.0,
            )
        )
        kept.append(k)
    return out, kept


def survive(plan: tuple[str, float, int]) -> dict[str, Any]:
    """One method for that many hours, by that seed."""
    method, hours, seed = plan
    estimator = build(method, None, seed, inputs=ALL)
    hourly: list[dict[str, float]] = []
    errors: list[Array] = []
    stds: list[Array] = []
    finite = True
    lost_before = ticks_done = 0
    begun = time.process_time()
    for ticks, truth in legs(seed):
        played = play(estimator, ticks)
        ticks_done += len(ticks)
        finite = finite and bool(
            np.all(np.isfinite(played.rear_m)) and np.all(np.isfinite(played.covariance_m2))
        )
        errors.append(played.rear_m - truth[:, RL:])
        P = played.covariance_m2
        stds.append(np.sqrt(P[:, 0, 0] + P[:, 1, 1] - 2 * P[:, 0, 1]))
        done = ticks[-1].time_s - START_S >= hours * 3600.0
        if ticks[-1].time_s - START_S >= (len(hourly) + 1) * 3600.0 or done:
            error, std = np.concatenate(errors), np.concatenate(stds)
            off = error[:, 0] - error[:, 1]
            hourly.append(
                {
                    "rmse_difference_mm": 1e3 * math.sqrt(float(np.mean(off**2))),
                    "rmse_radius_mm": 1e3 * math.sqrt(float(np.mean(error**2))),
                    "std_difference_mm": 1e3 * float(np.mean(std)),
                    "state_bytes": float(len(pickle.dumps(estimator))),
                    "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
                    "lost_pose": float(played.lost - lost_before),
                }
            )
            lost_before = played.lost
            errors, stds = [], []
        if done:
            break
    cpu_ms = 1e3 * (time.process_time() - begun) / ticks_done
    reported = {"method": method, "hours": hours, "seed": seed, "finite": finite, "cpu_ms": cpu_ms}
    return reported | {"hourly": hourly} | verdict(hourly, finite)


def verdict(hourly: list[dict[str, float]], finite: bool) -> dict[str, Any]:
    """Whether it survived, and if not, why."""
    faults = [] if finite else ["not finite"]
    half = max(len(hourly) // 2, 1)
    if len(hourly) >= 3:
        errors = [h["rmse_difference_mm"] for h in hourly]
        usual = float(np.median(errors))
        astray = [k for k, e in enumerate(errors[1:], start=2) if e > ASTRAY * usual + 1e3 * SLACK_M]
        if astray:
            hours = ", ".join(f"{k}" for k in astray)
            faults.append(f"astray in hour {hours}: {max(errors[1:]):.3f} mm, the median {usual:.3f} mm")
        early = float(np.median([h["rmse_difference_mm"] for h in hourly[:half]]))
        late = float(np.median([h["rmse_difference_mm"] for h in hourly[half:]]))
        if not late <= WORSE * early + 1e3 * SLACK_M:
            faults.append(f"the error grew from {early:.3f} to {late:.3f} mm")
        stated_early = float(np.median([h["std_difference_mm"] for h in hourly[:half]]))
        stated_late = float(np.median([h["std_difference_mm"] for h in hourly[half:]]))
        if not stated_early / WORSE - 1e3 * SLACK_M <= stated_late <= WORSE * stated_early + 1e3 * SLACK_M:
            faults.append(f"the stated error went from {stated_early:.3f} to {stated_late:.3f} mm")
    # A set of weights counts for nothing while it is the even one: so against the largest, not the first.
    begun = max((h["state_bytes"] for h in hourly[:half]), default=math.inf)
    if len(hourly) >= 2 and hourly[-1]["state_bytes"] > GROWN * begun:
        faults.append(f"the state grew from {begun:.0f} to {hourly[-1]['state_bytes']:.0f} bytes")
    return {"survived": not faults, "faults": faults}
