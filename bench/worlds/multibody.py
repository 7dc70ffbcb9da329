"""A world whose tyres slip by their own law: the multi-body cars of CommonRoad on made-up roads.

In: `Spec`, a generator, a folder for the integrated drives. Out: `Course`. The cars are those of
`commonroad-vehicle-models` (Ford Escort, BMW 320i, VW Vanagon; 29 states, suspension, Magic Formula tyres
with combined slip, spinning wheels). Integrating is slow, so a few long drives are integrated once and kept;
each drive of a benchmark is a piece of one, as it is or mirrored, with instruments and concealed physics of
its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.worlds.commonroad_car import advance, at_rest_on_springs, hub_speeds, parameters
from bench.worlds.course import Course, summed
from bench.worlds.instruments import markov
from bench.worlds.road import STEP_S, profile
from bench.worlds.spec import Spec

Array = NDArray[np.float64]
BASE_S = 960.0
WARM_S = 20.0
BASES = ((1, "rural"), (2, "mixed"), (3, "rural"), (1, "mixed"), (2, "motorway"))
"""Car and road of each long drive."""
SLOWEST_MPS = 5.5
"""The model's slip is stiff at walking pace."""
SWAPPED = (1, 0, 3, 2)
FORMAT = 2


def prepare(folder: Path, say: Callable[[str], None] = lambda text: None) -> None:
    """Integrate the long drives that are not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, (car, road) in enumerate(BASES):
        target = file_of(folder, number)
        if not target.exists():
            say(f"multi-body drive {number + 1} of {len(BASES)} (car {car}, {road}): some minutes, once")
            arrays = integrated(car, road, BASE_S, number)
            _check(course_of(arrays, parameters(car)), f"car {car}, {road}")
            part = target.with_suffix(".part.npz")
            np.savez_compressed(part, **arrays)
            part.rename(target)


def piece(spec: Spec, rng: np.random.Generator, folder: Path) -> tuple[Course, Spec]:
    """A piece of a long drive, and the specification with that car's measures."""
    number = int(rng.integers(len(BASES)))
    with np.load(file_of(folder, number)) as loaded:
        arrays = dict(loaded)
    p = parameters(BASES[number][0])
    whole = course_of(arrays, p)
    length = min(round(spec.duration_s / STEP_S), len(whole.time_s))
    first = int(rng.integers(len(whole.time_s) - length + 1))
    course = whole.cut(first, first + length)
    if rng.random() < 0.5:
        course = mirrored(course)
    measures = {"track_front_m": p.T_f, "track_rear_m": p.T_r, "wheelbase_m": p.a + p.b, "radius_m": p.R_w}
    driven = "front" if p.T_se > 0.5 else "rear"
    return course, replace(spec, driven=driven, **{key: float(value) for key, value in measures.items()})


def file_of(folder: Path, number: int) -> Path:
    """Where a long drive is kept."""
    car, road = BASES[number]
    return folder / f"multibody-{FORMAT}-{number}-car{car}-{road}-{BASE_S:.0f}s.npz"


def integrated(car: int, road: str, duration_s: float, seed: int) -> dict[str, Array]:
    """Drive it: arrays every 20 ms of the state, without the time in which the car settles on its springs."""
    p = parameters(car)
    rng = np.random.default_rng([seed, car])
    speed, bend, _ = profile(Spec(duration_s=duration_s + WARM_S, road=road), rng)
    bend = bend + markov(rng, len(bend), STEP_S, 2e-4, 3.0)
    tight = 2.8 / np.maximum(speed, 7.3) ** 2
    bend = np.clip(bend, -tight, tight)
    target = np.maximum(speed, SLOWEST_MPS)
    state = at_rest_on_springs(float(target[0]), p)
    rows = []
    for k in range(len(target) - 1):
        v = state[3]
        kappa = float(bend[min(k + 15, len(bend) - 1)])
        # what understeer asks for, and the rest by what the driver feels
        wanted = math.atan((p.a + p.b) * kappa * (1.0 + 5e-4 * v * v)) + 0.1 * (v * float(bend[k]) - state[5])
        turn = min(max(12.0 * (wanted - state[2]), -0.8), 0.8)
        pull = float(target[k + 1] - target[k]) / STEP_S + 1.5 * float(target[k] - v)
        control = [turn, min(max(pull, -4.0), 3.0)]
        steps = 20 if v < 8.0 else 10
        h = STEP_S / steps
        rows.append(list(state))
        for _ in range(steps):
            state, _ = advance(state, control, h, p)
    table = np.array(rows)[round(WARM_S / STEP_S) :]
    return {"state": table[:, [2, 3, 4, 5, 10, 23, 24, 25, 26]]}


def _check(course: Course, name: str) -> None:
    """RuntimeError if the car skidded: a wheel that locks in the model stays locked."""
    assert course.spin is not None
    slip, pull = float(np.abs(course.spin).max()), float(np.abs(course.a_lat).max())
    if slip > 0.05 or pull > 5.0:
        raise RuntimeError(f"multi-body drive of {name}: slip {slip:.2f}, {pull:.1f} m/s2 to the side")


def course_of(arrays: dict[str, Array], p: Any) -> Course:
    """The motion of the middle of the rear axle, hubs and spin of the wheels."""
    steer, v, heading, yaw, across, *spins = arrays["state"].T
    hubs = hub_speeds(steer, v, across, yaw, p)
    turning = np.stack([spins[k] for k in SWAPPED], axis=1)
    time_s: Array = np.arange(len(v), dtype=np.float64) * STEP_S
    return Course(
        time_s=time_s,
        speed=v,
        yaw=yaw,
        grade=np.zeros(len(v)),
        heading=heading[0] + summed(yaw, time_s),
        accel=np.gradient(v, STEP_S),
        a_lat=v * yaw,
        bend=np.tan(steer) / (p.a + p.b),
        beta=np.arctan2(across - p.b * yaw, v),
        hubs=hubs,
        spin=turning * p.R_w / hubs - 1.0,
    )


def mirrored(course: Course) -> Course:
    """The same drive seen in a mirror."""
    assert course.hubs is not None
    assert course.spin is not None
    order = list(SWAPPED)
    return replace(
        course,
        yaw=-course.yaw,
        heading=-course.heading,
        a_lat=-course.a_lat,
        bend=-course.bend,
        beta=-course.beta,
        hubs=course.hubs[:, order],
        spin=course.spin[:, order],
    )
