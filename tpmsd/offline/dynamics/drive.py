"""A recorded drive for the diagnosis of vehicle dynamics: inputs, outputs, blocks.

In: arrays. Out: `DynamicsDrive`; the number of outputs and their rates are values, an output that is not
there at a row is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from tpmsd.car.physics.baselines.inputs import Inputs
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.arrays import BoolArray, IntArray
from tpmsd.offline.dynamics.settings import SETTINGS


@dataclass(frozen=True)
class DynamicsDrive:
    """Rows in the order of time."""

    name: str
    inputs: Inputs
    """(n,) each; times since the drive's start."""
    outputs: Mapping[str, FloatArray]
    """(n,) each, NaN where there is no value."""
    forces: bool = False
    """True if drive and brake forces are given."""
    start_s: float = 0.0
    """Time of the drive's start on the recording's own clock."""
    key: str = ""
    """Name of this drive in the names of terms that belong to its own time."""
    notes: tuple[str, ...] = ()
    """Notes on how the recording was read."""

    @property
    def time_s(self) -> FloatArray:
        """Return the times of the rows since the drive's start."""
        return self.inputs.time_s

    @property
    def block_s(self) -> float:
        """Return the length of blocks: shorter in a short drive, so that there are enough of them."""
        least, most = SETTINGS.shortest_block_s, SETTINGS.block_s
        return float(np.clip((self.time_s[-1] - self.time_s[0]) / SETTINGS.blocks, least, most))

    @cached_property
    def starts(self) -> IntArray:
        """Return the first row of each block, ascending; block b ends where b + 1 begins."""
        time = self.time_s
        pause = np.flatnonzero(np.diff(time) > SETTINGS.gap_s) + 1
        edges = [0, *pause.tolist(), len(time)]
        starts: list[int] = []
        for first, last in pairwise(edges):
            count = max(round((time[last - 1] - time[first]) / self.block_s), 1)
            starts += np.linspace(first, last, count + 1).astype(int)[:-1].tolist()
        return np.unique(np.asarray(starts))

    @cached_property
    def ends(self) -> IntArray:
        """Return the row after each block."""
        return np.append(self.starts[1:], len(self.time_s))

    @cached_property
    def linked(self) -> BoolArray:
        """Return for each row but the last whether the next one belongs to the same block, (n - 1,)."""
        out = np.ones(len(self.time_s) - 1, dtype=bool)
        out[self.starts[1:] - 1] = False
        return out

    @cached_property
    def moving(self) -> BoolArray:
        """Return for each row whether the car is fast enough to be judged, (n,)."""
        speed = self.outputs.get("speed")
        known = self.inputs.speed_mps if speed is None else filled(self.time_s, speed)
        return np.asarray(known >= SETTINGS.slowest_mps)

    def whole(self) -> DynamicsDrive:
        """Return the drive with blocks that end at pauses alone."""
        out = replace(self)
        pause = np.flatnonzero(np.diff(self.time_s) > SETTINGS.gap_s) + 1
        out.__dict__["starts"] = np.concatenate([[0], pause])
        return out

    def bounded(self, max_rows: int) -> DynamicsDrive:
        """Return the drive, or blocks of a longer one spread evenly over it, with a note."""
        n, blocks = len(self.time_s), len(self.starts)
        if n <= max_rows:
            return self
        every = -(-n // max_rows)
        kept = range(every // 2, blocks, every)
        rows = np.concatenate([np.arange(self.starts[k], self.ends[k]) for k in kept])
        outputs = {name: values[rows] for name, values in self.outputs.items()}
        note = (
            f"the drive has {n} rows: {len(rows)} of them are looked at, in {len(kept)} blocks spread over it"
        )
        return replace(self, inputs=self.inputs.take(rows), outputs=outputs, notes=(*self.notes, note))

    def part(self, first: int, last: int) -> DynamicsDrive:
        """Return rows first to last (excluded), times as they are."""
        rows = slice(first, last)
        outputs = {name: values[rows] for name, values in self.outputs.items()}
        return DynamicsDrive(
            self.name, self.inputs.take(rows), outputs, self.forces, self.start_s, self.key, self.notes
        )


def filled(time_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return values with gaps interpolated; zeros where there is none at all."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros_like(values)
    return np.interp(time_s, time_s[known], values[known])
