"""A world of its own: a car on a road, with physics written apart from the program it tests.

In: a `Spec` (car, road, receiver, bus, concealed physics) and a seed. Out: `Drive`: what counters, gyro,
accelerometers and receiver saw. It imports nothing of the program: equations, noise and file formats are
written independently from the public description of the formats, so that a shared mistake cannot hide.
"""

from __future__ import annotations

import numpy as np

from bench.worlds.course import Array, Course, rigid
from bench.worlds.instruments import Drive, markov, observe
from bench.worlds.road import STEP_S, profile
from bench.worlds.spec import Spec, draw_spec

__all__ = ["STEP_S", "Array", "Drive", "Spec", "course", "draw_spec", "drive"]


def course(spec: Spec, rng: np.random.Generator) -> Course:
    """A rigid car on a made-up road, every 20 ms."""
    speed, bend, slope = profile(spec, rng)
    n = len(speed)
    # the driver never drives quite straight
    bend = bend + markov(rng, n, STEP_S, 2e-4, 3.0)
    tight = 3.2 / np.maximum(speed, 7.3) ** 2
    bend = np.clip(bend, -tight, tight)
    time_s: Array = np.arange(n, dtype=np.float64) * STEP_S
    return rigid(time_s, speed, bend, slope, float(rng.uniform(-3, 3)))


def drive(spec: Spec, seed: int) -> Drive:
    """Drive it."""
    rng = np.random.default_rng(seed)
    return observe(course(spec, rng), spec, rng, seed)
