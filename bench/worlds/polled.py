"""A bus of averaged speeds beside a receiver whose sentences get coarse stamps of the host.

In: a generator, a `Spec`. Out: `Spec`, then a `Drive` whose rings are uneven and whose stamps are rounded.

    speeds      means of 4 samples 10 ms apart, of which one is sent at each period of the bus, in steps of
                0.01 km/h
    stamps      of 5 fixes a second, of a loop that comes round every 100 ms and some time on top: the nearest
                of its instants, up to 50 ms before or after the arrival; the error sweeps within minutes
    rings       off their centre and oval: two harmonics of 0.1 to 0.5 mrad on each wheel, of any phase

The rings are too even for a finding, stamps are right on the average, and a sentence states its own time:
nothing here has a name.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from bench.worlds.instruments import Array, Drive
from bench.worlds.spec import Spec, draw_spec

SAMPLES, SAMPLE_S = 4, 0.01
LOOP_S = 0.1
MIN_MORE, MAX_MORE = 1e-4, 3e-3
"""By which share a loop takes longer than it waits: what it does, and its timer."""
MIN_RAD, MAX_RAD = 1e-4, 5e-4


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
    """The drive with uneven rings and rounded stamps."""
    rng = np.random.default_rng([seed, 7])
    shown = drive.shown_rad + np.stack([uneven(angle, rng) for angle in drive.shown_rad.T], axis=1)
    late = rounded_late(drive.fix_true_s + drive.fix_age_s, rng)
    return replace(drive, shown_rad=shown, fix_lag_s=drive.fix_lag_s + late)


def uneven(angle_rad: Array, rng: np.random.Generator) -> Array:
    """(n,) angle that a ring shows beyond the one turned: two harmonics."""
    sizes, phases = rng.uniform(MIN_RAD, MAX_RAD, 2), rng.uniform(0.0, 2.0 * math.pi, 2)
    return np.asarray(sum(sizes[k] * np.sin((k + 1) * angle_rad + phases[k]) for k in range(2)))


def rounded_late(arrival_s: Array, rng: np.random.Generator) -> Array:
    """(m,) time from each arrival to the nearest instant of the loop, of either sign."""
    every = LOOP_S * (1.0 + math.exp(float(rng.uniform(math.log(MIN_MORE), math.log(MAX_MORE)))))
    return np.asarray(np.mod(float(rng.random()) * every - arrival_s, every) - 0.5 * every)
