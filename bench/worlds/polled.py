"""A bus of averaged speeds beside a receiver that the host polls: sampled twice, by nobody's common clock.

In: a generator, a `Spec`. Out: `Spec`, then a `Drive` whose rings are uneven and whose sentences are late.

    speeds      means of 4 samples 10 ms apart, of which one is sent at each period of the bus, in steps of
                0.01 km/h
    sentences   of 5 fixes a second, taken from the serial port every 100 ms of a clock that is off by some
                1e-5: what arrived meanwhile gets the stamp of the next poll, up to 100 ms late
    rings       off their centre and oval: two harmonics of 0.1 to 0.5 mrad on each wheel, of any phase

The rings are too even for a finding, and a sentence states its own time: nothing here has a name.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from bench.worlds.instruments import Array, Drive
from bench.worlds.spec import Spec, draw_spec

SAMPLES, SAMPLE_S = 4, 0.01
POLL_S = 0.1
POLL_CLOCK = 1e-5
"""Relative standard deviation of the host's timer."""
LEAST_RAD, MOST_RAD = 1e-4, 5e-4


def draw(rng: np.random.Generator, **fixed: Any) -> Spec:
    """An ordinary car on an ordinary road with this bus and this receiver."""
    changed = {
        "wheel_signal": "speeds",
        "speed_step_kmh": 0.01,
        "speed_window_s": SAMPLES * SAMPLE_S,
        "wheel_hz": float(rng.choice([20.0, 25.0, 50.0])),
        "receiver_hz": 5.0,
        "arrival_jitter_s": 0.0,
    }
    return replace(draw_spec(rng), **{**changed, **fixed})


def sampled(drive: Drive, seed: int) -> Drive:
    """The drive with uneven rings and polled sentences."""
    rng = np.random.default_rng([seed, 7])
    shown = drive.shown_rad + np.stack([uneven(angle, rng) for angle in drive.shown_rad.T], axis=1)
    late = polled_late(drive.fix_true_s + drive.fix_age_s, rng)
    return replace(drive, shown_rad=shown, fix_lag_s=drive.fix_lag_s + late)


def uneven(angle_rad: Array, rng: np.random.Generator) -> Array:
    """(n,) angle that a ring shows beyond the one turned: two harmonics."""
    sizes, phases = rng.uniform(LEAST_RAD, MOST_RAD, 2), rng.uniform(0.0, 2.0 * math.pi, 2)
    return np.asarray(sum(sizes[k] * np.sin((k + 1) * angle_rad + phases[k]) for k in range(2)))


def polled_late(arrival_s: Array, rng: np.random.Generator) -> Array:
    """(m,) time from each arrival to the next poll."""
    every = POLL_S * (1.0 + POLL_CLOCK * float(rng.standard_normal()))
    return np.asarray(np.mod(float(rng.random()) * every - arrival_s, every))
