"""How a car moved: the record that all worlds make and all instruments read.

In: arrays. Out: `Course`. Frames: x forward, y left, z up; yaw rate and lateral acceleration positive to the
left. Wheels: fl fr rl rr.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G = 9.80665


@dataclass(frozen=True)
class Course:
    """Arrays over n evenly spaced instants; the reference point is the middle of the rear axle."""

    time_s: Array
    speed: Array
    """Along the body."""
    yaw: Array
    grade: Array
    """Angle of the slope."""
    heading: Array
    """Mathematical angle of the body, not wrapped."""
    accel: Array
    """Rate of the speed."""
    a_lat: Array
    bend: Array
    """Curvature, for the steering wheel."""
    beta: Array
    """The rear axle's course minus the heading, by the world's own tyres."""
    hubs: Array | None = None
    """(n, 4) speeds of the hubs where the world has its own suspension; None: of a rigid body."""
    spin: Array | None = None
    """(n, 4) relative surplus of turning by the world's own tyres."""

    @property
    def force(self) -> Array:
        """Specific force along the body: what an accelerometer reads."""
        return np.asarray(self.accel + G * np.sin(self.grade))

    def every(self, step: int) -> Course:
        """The same course at every `step`-th instant."""
        parts = {name: None if value is None else value[::step] for name, value in vars(self).items()}
        return Course(**parts)

    def cut(self, first: int, last: int) -> Course:
        """Instants `first` to `last`, the time beginning again."""
        parts = {name: None if value is None else value[first:last] for name, value in vars(self).items()}
        return replace(Course(**parts), time_s=self.time_s[first:last] - self.time_s[first])


def summed(rate: Array, time_s: Array) -> Array:
    """Integral over time by trapezoids, zero at the start; along the first axis."""
    out = np.zeros_like(rate)
    step = float(time_s[1] - time_s[0])
    out[1:] = np.cumsum(0.5 * (rate[1:] + rate[:-1]) * step, axis=0)
    return out
