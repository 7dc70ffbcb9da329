"""The origins of simulated drives behind one interface: each draws a specification and drives it.

In: a name, a generator. Out: `Spec`, then `Course` and `Drive`. What an origin shares with another is stated
by its summary, so that a report by origin can tell where a difference comes from. Effects of `Spec.physics`
act on every origin alike. Seeds of development and of the held-out half are kept apart by who draws them;
recorded noise comes from other recordings in the held-out half.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from bench.worlds import awkward, kinematic, mems_gyro, polled, receiver_residuals, traffic
from bench.worlds.course import Course
from bench.worlds.instruments import Drive, Errors, observe
from bench.worlds.latch import draw_beat, draw_latch
from bench.worlds.spec import Spec, draw_spec

TRACES = 40
"""Networks with their traffic in each half: a trace is simulated once and serves every effect."""
HELD_OUT_TRACES = 50_000
TRACE_S = 900.0


@dataclass(frozen=True)
class Places:
    """Where an origin finds what it needs."""

    recordings: Path
    memory: Path
    """Folder for what is integrated or simulated once."""
    held_out: bool = False


class Draw(Protocol):
    """Draws a specification; keywords override what is drawn."""

    def __call__(self, rng: np.random.Generator, **fixed: Any) -> Spec:
        """A drive's car, road, receiver and bus."""


@dataclass(frozen=True)
class Origin:
    """Where drives come from."""

    name: str
    summary: str
    spec: Draw
    drive: Callable[[Spec, np.random.Generator, int, Places], tuple[Course, Drive]]
    """Specification, generator and seed to course and drive."""
    own_tyres: bool = False
    """Whether its cars' tyres slip and yield by themselves, so that findings of slip and load are true."""


def _kinematic(spec: Spec, rng: np.random.Generator, seed: int, places: Places) -> tuple[Course, Drive]:
    course = kinematic.course(spec, rng)
    return course, observe(course, spec, rng, seed)


def _multibody(spec: Spec, rng: np.random.Generator, seed: int, places: Places) -> tuple[Course, Drive]:
    from bench.worlds import multibody

    multibody.prepare(places.memory)
    course, spec = multibody.piece(spec, rng, places.memory)
    return course, observe(course, spec, rng, seed)


def _traffic(spec: Spec, rng: np.random.Generator, seed: int, places: Places) -> tuple[Course, Drive]:
    number = seed % TRACES + (HELD_OUT_TRACES if places.held_out else 0)
    trace = traffic.remembered(number, TRACE_S, places.memory)
    course = traffic.course_of(trace, rng, spec.hilly)
    if spec.duration_s < TRACE_S:
        course = course.cut(0, round(spec.duration_s / traffic.STEP_S))
    return course, observe(course, replace(spec, tags=(trace.network,)), rng, seed)


def _traffic_spec(rng: np.random.Generator, **fixed: Any) -> Spec:
    return draw_spec(rng, **{"duration_s": TRACE_S, "road": "city", "hilly": 0.0, **fixed})


@cache
def _library(recordings: Path, held_out: bool) -> receiver_residuals.Library:
    names = receiver_residuals.HELD_OUT if held_out else receiver_residuals.DEVELOPMENT
    return receiver_residuals.library(recordings, names)


def _receiver(spec: Spec, rng: np.random.Generator, seed: int, places: Places) -> tuple[Course, Drive]:
    library = _library(places.recordings, places.held_out)
    course = kinematic.course(spec, rng)
    return course, observe(course, spec, rng, seed, Errors(receiver=library.drawn))


def _mems(spec: Spec, rng: np.random.Generator, seed: int, places: Places) -> tuple[Course, Drive]:
    sensor = mems_gyro.draw(np.random.default_rng([seed, 5]))
    course = kinematic.course(spec, rng)
    return course, observe(course, spec, rng, seed, Errors(gyro=mems_gyro.zeroed(sensor)))


def _mems_spec(rng: np.random.Generator, **fixed: Any) -> Spec:
    return draw_spec(rng, **{"with_gyro": True, **fixed})


def _latched_spec(rng: np.random.Generator, **fixed: Any) -> Spec:
    changed = (draw_beat if rng.random() < 0.5 else draw_latch)(rng)
    return draw_spec(rng, **{**changed, **fixed})


def _polled(spec: Spec, rng: np.random.Generator, seed: int, places: Places) -> tuple[Course, Drive]:
    course = kinematic.course(spec, rng)
    return course, polled.sampled(observe(course, spec, rng, seed), seed)


def _awkward(spec: Spec, rng: np.random.Generator, seed: int, places: Places) -> tuple[Course, Drive]:
    course = awkward.course(spec, rng)
    errors = Errors()
    if "noisy_gyro" in spec.tags:
        sensor = mems_gyro.draw(np.random.default_rng([seed, 5]), cheap=True)
        errors = Errors(gyro=mems_gyro.zeroed(sensor))
    return course, observe(course, spec, rng, seed, errors)


ORIGINS = {
    origin.name: origin
    for origin in (
        Origin("kinematic", "a rigid car on drawn roads, first-order noise", draw_spec, _kinematic),
        Origin(
            "multibody", "CommonRoad cars with slipping tyres, first-order noise", draw_spec, _multibody, True
        ),
        Origin("traffic", "SUMO's trajectories, first-order noise", _traffic_spec, _traffic),
        Origin("receiver", "a rigid car, receiver errors resampled from recordings", draw_spec, _receiver),
        Origin("mems", "a rigid car, gyro by its Allan variance", _mems_spec, _mems),
        Origin("wheels", "a rigid car, averaged speeds or 20 to 60 teeth", awkward.draw_wheels, _kinematic),
        Origin("latched", "a rigid car, counts latched in a rhythm of their own", _latched_spec, _kinematic),
        Origin("polled", "averaged speeds, uneven rings, stamps of a coarse loop", polled.draw, _polled),
        Origin("awkward", "tight bends, poor receivers and gyros, averaged speeds", awkward.draw, _awkward),
    )
}
