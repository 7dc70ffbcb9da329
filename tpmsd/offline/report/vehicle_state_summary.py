"""Summary of the vehicle state over a replay.

In: the state of each tick. Out: plain JSON values, a sentence, and the series that are drawn.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tpmsd.car.vehicle_state.record import VehicleState
from tpmsd.foundation.plain import finite
from tpmsd.foundation.wheels import FloatArray

MAX_ROWS = 20_000
"""Rows kept to be drawn, more than a picture has pixels; longer drives keep every second, fourth... tick."""
_DRAWN = ("velocity_lat_mps", "velocity_lat_std_mps", "side_slip_rad", "side_slip_std_rad")


class StateSummary:
    """Counts how long the state was known, and keeps its extremes and the series of what is drawn."""

    def __init__(self, method: str) -> None:
        self.method = method
        self.known_s = 0.0
        self.largest_side_slip_rad = self.largest_velocity_lat_mps = math.nan
        self.last: VehicleState | None = None
        self._rows: list[tuple[float, ...]] = []
        self._ticks, self._stride = 0, 1

    def add(self, dt_s: float, state: VehicleState | None, time_s: float) -> None:
        """Add the state at the end `time_s` of a tick of `dt_s` seconds; None where it is not known."""
        self.last = state
        if self._ticks % self._stride == 0:
            drawn = (math.nan,) * len(_DRAWN) if state is None else [getattr(state, name) for name in _DRAWN]
            self._rows.append((time_s, *drawn))
            if len(self._rows) > MAX_ROWS:
                self._rows, self._stride = self._rows[::2], 2 * self._stride
        self._ticks += 1
        if state is not None:
            self.known_s += dt_s
            self.largest_side_slip_rad = _larger_amount(self.largest_side_slip_rad, state.side_slip_rad)
            self.largest_velocity_lat_mps = _larger_amount(
                self.largest_velocity_lat_mps, state.velocity_lat_mps
            )

    def series(self) -> FloatArray:
        """Return (n, 5): time (s), lateral speed (m/s) and side slip (rad), each followed by its std."""
        return np.array(self._rows, dtype=np.float64).reshape(-1, 1 + len(_DRAWN))

    def to_json(self) -> dict[str, Any]:
        """Return method, seconds with a state, the largest amounts, and the last state (null where not
        known)."""
        values = [math.nan] * len(VehicleState._fields) if self.last is None else self.last
        return {
            "method": self.method,
            "known_s": finite(self.known_s),
            "largest_side_slip_rad": finite(self.largest_side_slip_rad),
            "largest_velocity_lat_mps": finite(self.largest_velocity_lat_mps),
            **{name: finite(value) for name, value in zip(VehicleState._fields, values, strict=True)},
        }

    def sentence(self) -> str:
        """Return the summary as one sentence."""
        if self.known_s <= 0.0:
            return f"Vehicle state ({self.method}): not known in any tick."
        return (
            f"Vehicle state ({self.method}): known for {self.known_s:.0f} s; side slip up to "
            f"{self.largest_side_slip_rad:.3f} rad, lateral speed up to {self.largest_velocity_lat_mps:.2f} "
            "m/s."
        )


def _larger_amount(before: float, value: float) -> float:
    """Return the larger of `before` and |value|; `before` may be NaN."""
    return abs(value) if math.isnan(before) else max(before, abs(value))
