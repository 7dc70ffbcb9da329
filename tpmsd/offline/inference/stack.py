"""Many columns of a drive side by side, most of which show in one channel alone.

In: columns one by one. Out: `ColumnStack`, which holds each once and as small as it is, and lays them side by
side, all channels of some windows at a time: written out, hundreds of columns take three times the memory,
and to touch memory for the first time takes as long as to whiten it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.windows import CHANNELS

WINDOWS_AT_ONCE = 32
"""Number of windows whose columns all fit into a processor's cache while they are laid side by side."""


@dataclass(frozen=True)
class _Run:
    """Neighbouring columns of the same kind."""

    channel: int | None
    """The only one that they show in; None where they show in any."""
    arrays: list[FloatArray]
    """Each (w, 9), or all together (w, k) of the one channel."""

    @property
    def width(self) -> int:
        """Return the number of columns."""
        return len(self.arrays) if self.channel is None else int(self.arrays[0].shape[1])


class ColumnStack:
    """Columns (w, 9) in order. Arrays are taken as they are and never changed."""

    def __init__(self, *columns: FloatArray) -> None:
        self._runs: list[_Run] = []
        for column in columns:
            self.add(column)

    def add(self, column: FloatArray) -> None:
        """Append one column (w, 9)."""
        if not self._runs or self._runs[-1].channel is not None:
            self._runs.append(_Run(None, []))
        self._runs[-1].arrays.append(column)

    def add_of_channel(self, channel: int, values: FloatArray) -> None:
        """Append columns that are zero but in one channel, with values (w, k) there."""
        self._runs.append(_Run(channel, [values]))

    def __add__(self, other: ColumnStack) -> ColumnStack:
        """Those of both."""
        out = ColumnStack()
        for run in (*self._runs, *other._runs):
            if run.channel is None:
                for array in run.arrays:
                    out.add(array)
            else:
                out._runs.append(run)
        return out

    @property
    def shape(self) -> tuple[int, int, int]:
        """Return (w, 9, p), the shape of the array of all columns."""
        windows = len(self._runs[0].arrays[0]) if self._runs else 0
        return windows, CHANNELS, sum(run.width for run in self._runs)

    def __getitem__(self, column: int) -> FloatArray:
        """Return one column (w, 9)."""
        return self.take([column])[:, :, 0]

    def take(self, columns: Sequence[int] | np.ndarray) -> FloatArray:
        """Return the chosen columns, (w, 9, k)."""
        wanted = [int(column) for column in columns]
        out = np.zeros((*self.shape[:2], len(wanted)))
        first = 0
        for run in self._runs:
            for k, column in enumerate(wanted):
                if 0 <= column - first < run.width:
                    if run.channel is None:
                        out[:, :, k] = run.arrays[column - first]
                    else:
                        out[:, run.channel, k] = run.arrays[0][:, column - first]
            first += run.width
        return out

    def parts(self, first: int = 0) -> Iterator[FloatArray]:
        """Yield the columns from `first` on, (some windows, 9, p - first), block after block of windows."""
        windows, _, width = self.shape
        runs = list(self._runs_from(first))
        for start in range(0, windows, WINDOWS_AT_ONCE):
            here = slice(start, start + WINDOWS_AT_ONCE)
            out = np.zeros((min(WINDOWS_AT_ONCE, windows - start), CHANNELS, width - first))
            at = 0
            for channel, arrays in runs:
                if channel is None:
                    out[:, :, at : at + len(arrays)] = np.stack([array[here] for array in arrays], axis=2)
                    at += len(arrays)
                else:
                    values = arrays[0][here]
                    out[:, channel, at : at + values.shape[1]] = values
                    at += values.shape[1]
            yield out

    def whole(self) -> FloatArray:
        """Return all columns, (w, 9, p)."""
        out = np.empty(self.shape)
        start = 0
        for part in self.parts():
            out[start : start + len(part)] = part
            start += len(part)
        return out

    def _runs_from(self, first: int) -> Iterator[tuple[int | None, list[FloatArray]]]:
        """Yield (channel, arrays) of each run, without the first `first` columns."""
        for run in self._runs:
            skipped = min(first, run.width)
            first -= skipped
            if skipped < run.width:
                cut = run.arrays[skipped:] if run.channel is None else [run.arrays[0][:, skipped:]]
                yield run.channel, cut
