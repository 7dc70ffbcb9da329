"""Drives under the conditions in which a diagnosis errs most easily: tight bends, poor receivers, poor gyros.

In: a generator. Out: `Spec` with its `tags`, and a `Course` of straights and corners. Each condition is drawn
on its own, so that a report can tell which of them go with a false finding:

    tight        corners of 6 to 15 m radius, all through the drive
    car_park     walking pace in aisles
    noisy_1hz    a receiver with one fix a second, Doppler errors of 0.08 to 0.2 m/s
    tunnels      6 to 15 outages an hour of up to 90 s
    noisy_gyro   a cheap MEMS gyro by its Allan variance
    few_teeth    20 to 60 teeth
    averaged     wheel speeds that are means over the last 10 to 40 ms
    filtered     wheel speeds behind a low-pass of 10 to 30 ms

Faults and events of the same conditions are drawn by `fault`: both wheels of an axle that spin on ice, counts
lost at low speed, 44 teeth configured as 48.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from bench.worlds.course import Array, Course, rigid, summed
from bench.worlds.spec import Spec, draw_spec

STEP_S = 0.02
PATH_STEP_M = 0.25
FAULTS = ("spin_on_ice", "counts_lost_at_low_speed", "teeth_44_as_48")


def wheel_signal(tags: Sequence[str], rng: np.random.Generator) -> dict[str, Any]:
    """What the conditions of the wheels' signal change of a specification."""
    speeds = "averaged" in tags or "filtered" in tags
    teeth = float(rng.integers(20, 61)) if "few_teeth" in tags else float(rng.choice([44, 48, 96, 100]))
    changed: dict[str, Any] = {"wheel_signal": "speeds" if speeds else "counts", "teeth": teeth}
    if "averaged" in tags:
        changed["speed_window_s"] = float(rng.uniform(0.01, 0.04))
    if "filtered" in tags:
        changed["speed_filter_s"] = float(rng.uniform(0.01, 0.03))
    return changed


def draw_wheels(rng: np.random.Generator, **fixed: Any) -> Spec:
    """An ordinary drive whose wheels' signal alone is awkward."""
    tag = str(rng.choice(["averaged", "averaged", "filtered", "few_teeth"]))
    changed = wheel_signal([tag], rng)
    return replace(draw_spec(rng), **{**changed, "tags": (tag,), **fixed})


def draw(rng: np.random.Generator, **fixed: Any) -> Spec:
    """A drive with at least one awkward condition."""
    while True:
        tags = [tag for tag in ("tight", "noisy_1hz", "tunnels", "noisy_gyro") if rng.random() < 0.4]
        tags += ["few_teeth"] if rng.random() < 0.5 else []
        if "tight" in tags and rng.random() < 0.35:
            tags[0] = "car_park"
        speeds = rng.random() < 0.4
        if speeds:
            tags.append("averaged" if rng.random() < 0.5 else "filtered")
        if tags:
            break
    changed: dict[str, Any] = {"with_gyro": True}
    if "car_park" in tags:
        changed |= {"duration_s": float(rng.uniform(400, 700)), "road": "city"}
    if "noisy_1hz" in tags:
        changed |= {
            "receiver_hz": 1.0,
            "doppler_mps": float(rng.uniform(0.08, 0.2)),
            "position_white_m": float(rng.uniform(0.3, 1.0)),
        }
    if "tunnels" in tags:
        changed |= {"outages_per_hour": float(rng.uniform(6, 15)), "longest_outage_s": 90.0}
    changed |= wheel_signal(tags, rng)
    return replace(draw_spec(rng), **{**changed, "tags": tuple(tags), **fixed})


def course(spec: Spec, rng: np.random.Generator) -> Course:
    """Straights and corners, every 20 ms: corners are slowed down for, stops are made now and then."""
    tight, park = "tight" in spec.tags, "car_park" in spec.tags
    most = float(rng.uniform(1.5, 3.5))
    up, down = float(rng.uniform(0.8, 2.0)), float(rng.uniform(1.0, 2.5))
    bends: list[Array] = []
    limits: list[Array] = []
    total = 0.0
    while total < 16.0 * spec.duration_s:
        straight = float(
            rng.uniform(8, 35) if park else rng.uniform(20, 160) if tight else rng.uniform(80, 700)
        )
        radius = float(rng.uniform(6, 9) if park else rng.uniform(6, 15) if tight else rng.uniform(20, 300))
        angle = float(rng.uniform(0.5, 2.2) * rng.choice([-1, 1]))
        fast = float(rng.uniform(1.2, 3.5) if park else rng.uniform(7, 14) if tight else rng.uniform(10, 30))
        for length, kappa in ((straight, 0.0), (abs(angle) * radius, np.sign(angle) / radius)):
            n = max(round(length / PATH_STEP_M), 1)
            bends.append(np.full(n, kappa))
            limits.append(np.full(n, min(fast, np.sqrt(most * radius)) if kappa else fast))
            total += n * PATH_STEP_M
        if rng.random() < 0.08:
            limits[-1][-1] = 0.3
    bend = gaussian_filter1d(np.concatenate(bends), (1.5 if tight or park else 6.0) / PATH_STEP_M)
    speed = _reachable(np.concatenate(limits), up, down)
    moments = np.concatenate([[0.0], np.cumsum(PATH_STEP_M / (0.5 * (speed[1:] + speed[:-1])))])
    time_s: Array = np.arange(0.0, min(spec.duration_s, moments[-1]), STEP_S)
    fast_s = np.maximum(gaussian_filter1d(np.interp(time_s, moments, speed), 0.5 / STEP_S), 0.0)
    distance = summed(fast_s, time_s)
    curve = np.interp(distance, np.arange(len(bend)) * PATH_STEP_M, bend)
    return rigid(time_s, fast_s, curve, np.zeros(len(time_s)), float(rng.uniform(-3, 3)))


def _reachable(limit: Array, up: float, down: float) -> Array:
    """The fastest speeds over the way below the limits with bounded acceleration and braking."""
    squares = np.square(np.maximum(limit, 0.3)).tolist()
    squares[0] = 0.09
    for k in range(1, len(squares)):
        squares[k] = min(squares[k], squares[k - 1] + 2.0 * up * PATH_STEP_M)
    for k in range(len(squares) - 2, -1, -1):
        squares[k] = min(squares[k], squares[k + 1] + 2.0 * down * PATH_STEP_M)
    return np.sqrt(np.array(squares))


def fault(kind: str, spec: Spec, rng: np.random.Generator) -> Spec:
    """The drive with one of `FAULTS`; ValueError for another name."""
    if kind == "spin_on_ice":
        long = float(rng.uniform(10, 40))
        event = {
            "wheels": [0, 1] if spec.driven == "front" else [2, 3],
            "slip": float(rng.uniform(0.005, 0.012)),
            "onset_s": float(rng.uniform(0.25, 0.7)) * spec.duration_s,
            "duration_s": long,
        }
        return replace(spec, physics={"wheel_spin": event})
    if kind == "counts_lost_at_low_speed":
        return replace(spec, blind_below_mps=float(rng.uniform(2.0, 3.0)), **_counted(spec))
    if kind == "teeth_44_as_48":
        return replace(spec, teeth=44.0, configured_teeth=48.0, **_counted(spec))
    raise ValueError(f"{kind}: not among {', '.join(FAULTS)}")


def _counted(spec: Spec) -> dict[str, Any]:
    """What makes it a drive with counters."""
    speeds = {"averaged", "filtered"}
    return {"wheel_signal": "counts", "tags": tuple(tag for tag in spec.tags if tag not in speeds)}
