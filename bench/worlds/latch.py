"""A control unit that reads its counters in a rhythm of its own.

In: instants at which frames are sent, `Spec`. Out: the instants whose counts the frames carry. The unit
latches all counters every `latch_period_s` of its own clock; a frame holds what was latched last, so that a
count is between nothing and a period old. Where the rhythm is near the frames', the age sweeps slowly over
the period and falls back at once: it beats.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bench.worlds.instruments import Array
from bench.worlds.spec import Spec

LONGEST_S, SHORTEST_S = 0.02, 0.002
CLOCK = 2e-5
"""Relative standard deviation of a wheel module's own clock, where each wheel has one."""


def latched_at(time_s: Array, spec: Spec, seed: int, wheel: int) -> Array:
    """(n,) instants at which the counts were taken that frames of these times (n,) carry."""
    if spec.latch_period_s <= 0.0:
        return time_s
    rng = np.random.default_rng([seed, 6, wheel if spec.latch_apart else 0])
    period_s, phase = spec.latch_period_s, spec.latch_phase
    if spec.latch_apart:
        period_s *= 1.0 + CLOCK * float(rng.standard_normal())
        phase += float(rng.random())
    number = math.ceil((time_s[-1] - time_s[0]) / period_s) + 8
    moments = (math.floor(time_s[0] / period_s) - 4 + phase % 1.0 + np.arange(number)) * period_s
    # A task that starts late does not run before the one ahead of it.
    moments = np.maximum.accumulate(moments + rng.exponential(spec.latch_jitter_s, number))
    return np.asarray(moments[np.searchsorted(moments, time_s, side="right") - 1])


def draw_latch(rng: np.random.Generator) -> dict[str, Any]:
    """What a latch changes of a specification: any period of 2 to 20 ms, or near a part of the frames'."""
    hz = float(rng.choice([20.0, 25.0, 50.0, 100.0]))
    period_s = math.exp(float(rng.uniform(math.log(SHORTEST_S), math.log(LONGEST_S))))
    if rng.random() < 0.4:
        off = float(rng.choice([-1.0, 1.0])) * 10.0 ** float(rng.uniform(-5.0, -2.0))
        period_s = _part_of(1.0 / hz, rng) * (1.0 + off)
    return _latch(rng, hz, period_s)


def draw_beat(rng: np.random.Generator) -> dict[str, Any]:
    """The same with a latch whose age sweeps over its period within 3 to 300 s."""
    hz = float(rng.choice([20.0, 25.0, 50.0, 100.0]))
    period_s = _part_of(1.0 / hz, rng)
    sweep_s = math.exp(float(rng.uniform(math.log(3.0), math.log(300.0))))
    period_s *= 1.0 + float(rng.choice([-1.0, 1.0])) * period_s / sweep_s
    return {**_latch(rng, hz, period_s), "frame_jitter_s": float(rng.choice([0.0, 0.0, 1e-4]))}


def _part_of(frame_s: float, rng: np.random.Generator) -> float:
    """A period that the frames' is a multiple of."""
    least = math.ceil(frame_s / LONGEST_S - 1e-9)
    return frame_s / int(rng.integers(least, math.floor(frame_s / SHORTEST_S + 1e-9) + 1))


def _latch(rng: np.random.Generator, hz: float, period_s: float) -> dict[str, Any]:
    return {
        "wheel_signal": "counts",
        "wheel_hz": hz,
        "count_bits": 16,
        "latch_period_s": period_s,
        "latch_phase": float(rng.random()),
        "latch_jitter_s": float(rng.choice([0.0, 0.0, 1e-5, 2e-4])),
        "latch_apart": bool(rng.random() < 0.5),
        "split_wheels": bool(rng.random() < 0.6),
    }
