"""Inputs of a baseline model: what the driver does, and the speed where it is not an output.

In: arrays of any one shape. Out: `Inputs`, and `Span`, the inputs over a step, interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True, slots=True)
class Inputs:
    """Inputs at one instant or at many; arrays of one shape."""

    time_s: FloatArray
    """Since the drive's start."""
    steer_rad: FloatArray
    """Angle of the road wheels as configured, left positive."""
    steer_rate_radps: FloatArray
    speed_mps: FloatArray
    """Longitudinal speed of the centre of gravity; unused where it is a state."""
    accel_long_mps2: FloatArray
    """Longitudinal specific force."""
    drive_n: FloatArray
    """Sum of the drive forces at the road."""
    brake_n: FloatArray
    """Sum of the brake forces at the road, positive."""
    _shifts: dict[float, Inputs] = field(init=False, default_factory=dict, compare=False, repr=False)
    """The last ones interpolated, by the time they are shifted by: derivatives ask for the same ones."""
    _steered: dict[float, Inputs] = field(init=False, default_factory=dict, compare=False, repr=False)
    """The last one whose steering was shifted, which keeps what is interpolated of it."""

    def at(self, fraction: float) -> Inputs:
        """Return the inputs held over a step (zero-order hold)."""
        return self

    def take(self, rows: slice | NDArray[np.intp]) -> Inputs:
        """Return the inputs at some rows of the first axis."""
        return Inputs(*(getattr(self, name)[rows] for name in FIELDS))

    def shifted(self, by_s: float | FloatArray) -> Inputs:
        """Return the inputs `by_s` seconds later: interpolated in a recording, else with the steering
        extrapolated by its rate."""
        if self.time_s.ndim == 1 and len(self.time_s) > 3 and np.ndim(by_s) == 0:
            known = self._shifts.get(float(by_s))
            if known is None:
                if len(self._shifts) >= MAX_SHIFTS:
                    self._shifts.clear()
                known = self._shifts[float(by_s)] = self._interpolated(float(by_s))
            return known
        steer = self.steer_rad + by_s * self.steer_rate_radps
        return Inputs(
            self.time_s + by_s,
            steer,
            self.steer_rate_radps,
            self.speed_mps,
            self.accel_long_mps2,
            self.drive_n,
            self.brake_n,
        )

    def with_steering_shifted(self, by_s: float) -> Inputs:
        """Return the inputs with the steering of `by_s` seconds later."""
        known = self._steered.get(by_s)
        if known is None:
            then = self.shifted(by_s)
            known = replace(self, steer_rad=then.steer_rad, steer_rate_radps=then.steer_rate_radps)
            self._steered.clear()
            self._steered[by_s] = known
        return known

    def _interpolated(self, by_s: float) -> Inputs:
        """Return the inputs of n rows at times between them: steering by a cubic, the others linear.

        Beyond the ends and in pauses the nearest row is held, its steering extrapolated by its rate.
        """
        time, at = self.time_s, self.time_s + by_s
        row = np.clip(np.searchsorted(time, at, "right") - 1, 0, len(time) - 2)
        h = time[row + 1] - time[row]
        part = (at - time[row]) / h
        near = (part >= 0.0) & (part <= 1.0) & (h <= PAUSE_STEPS * float(np.median(np.diff(time))))
        part = np.clip(part, 0.0, 1.0)

        known: dict[int, FloatArray] = {}  # inputs that are not given are one array of zeros

        def interpolate_rows(values: FloatArray) -> FloatArray:
            """Return values (n,) linear between rows; beyond the ends and in pauses those of the row."""
            if id(values) not in known:
                known[id(values)] = np.where(
                    near, values[row] + part * (values[row + 1] - values[row]), values
                )
            return known[id(values)]

        steer, rate = self.steer_rad, self.steer_rate_radps
        slope = (steer[row + 1] - steer[row]) / h
        bend = h * part * (1.0 - part) * ((1.0 - part) * (rate[row] - slope) - part * (rate[row + 1] - slope))
        return Inputs(
            at,
            np.where(near, interpolate_rows(steer) + bend, steer + by_s * rate),
            interpolate_rows(rate),
            interpolate_rows(self.speed_mps),
            interpolate_rows(self.accel_long_mps2),
            interpolate_rows(self.drive_n),
            interpolate_rows(self.brake_n),
        )


PAUSE_STEPS = 5.0
"""Usual steps of a recording from which a longer one is a pause, over which nothing is interpolated."""
MAX_SHIFTS = 24
"""Shifted inputs that are kept: the stages of a step back for two delays need so many."""
FIELDS = tuple(one.name for one in fields(Inputs) if one.init)
"""Names of the arrays."""


@dataclass(frozen=True, slots=True)
class Span:
    """Inputs at both ends of a step; between them they change linearly, the steering as a cubic."""

    start: Inputs
    end: Inputs

    def at(self, fraction: float) -> Inputs:
        """Return the inputs at a fraction of the step."""
        if fraction == 0.0:
            return self.start
        if fraction == 1.0:
            return self.end
        mixed = Inputs(
            *(
                (1.0 - fraction) * getattr(self.start, name) + fraction * getattr(self.end, name)
                for name in FIELDS
            )
        )
        h = self.end.time_s - self.start.time_s
        slope = (self.end.steer_rad - self.start.steer_rad) / np.where(h > 0.0, h, 1.0)
        before, after = self.start.steer_rate_radps - slope, self.end.steer_rate_radps - slope
        bend = h * fraction * (1.0 - fraction) * ((1.0 - fraction) * before - fraction * after)
        return replace(mixed, steer_rad=mixed.steer_rad + bend)


def make_inputs(
    time_s: FloatArray,
    steer_rad: FloatArray,
    speed_mps: FloatArray | None = None,
    accel_long_mps2: FloatArray | None = None,
    drive_n: FloatArray | None = None,
    brake_n: FloatArray | None = None,
) -> Inputs:
    """Return inputs over a recording of n rows; what is not given is 0, the steering's rate its gradient."""
    zero = np.zeros(len(time_s))
    rate = np.gradient(steer_rad, time_s) if len(time_s) > 1 else zero
    given = (speed_mps, accel_long_mps2, drive_n, brake_n)
    return Inputs(time_s, steer_rad, rate, *(zero if one is None else one for one in given))
