"""Frames of a log as arrays, some ten thousand at a time.

In: nothing (a plain record). Out: `FrameBlock`, and the same frames one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.signal_plan import EXTENDED

FD, ERROR, REMOTE = 1, 2, 4
"""Bits of `FrameBlock.flags`."""
CLASSIC_BYTES = 8


@dataclass(frozen=True, slots=True)
class FrameBlock:
    """n frames in the order of the log."""

    time_s: FloatArray
    """(n,) host time stamps, epoch seconds."""
    identifier: NDArray[np.uint32]
    """(n,) with `EXTENDED` for 29-bit ones."""
    flags: NDArray[np.uint8]
    """(n,) sums of `FD`, `ERROR` and `REMOTE`; 0 for nearly all."""
    size: NDArray[np.uint8]
    """(n,) bytes of data."""
    data: NDArray[np.uint8]
    """(n, 8), or as many bytes as the longest CAN FD frame has; zeros behind the data."""
    channel: NDArray[np.intp]
    """(n,) index into `channels`."""
    line: NDArray[np.int64]
    """(n,) line in the log; 0 where there are no lines."""
    channels: tuple[str, ...]
    """Names of the interfaces."""

    def __len__(self) -> int:
        return len(self.time_s)

    def select(self, where: slice | NDArray[np.bool_]) -> FrameBlock:
        """Return the frames of a slice, or those where a mask is True."""
        return FrameBlock(
            self.time_s[where],
            self.identifier[where],
            self.flags[where],
            self.size[where],
            self.data[where],
            self.channel[where],
            self.line[where],
            self.channels,
        )

    def payload(self, index: int) -> bytes:
        """Return the data of one frame."""
        return self.data[index, : self.size[index]].tobytes()

    def frame(self, index: int) -> CanFrame:
        """Return one frame."""
        key, flags = int(self.identifier[index]), int(self.flags[index])
        return CanFrame(
            float(self.time_s[index]),
            self.channels[self.channel[index]],
            key & ~EXTENDED,
            key >= EXTENDED,
            flags & FD != 0,
            flags & ERROR != 0,
            flags & REMOTE != 0,
            self.payload(index),
            int(self.line[index]),
        )

    def frames(self, start: int = 0, stop: int | None = None) -> Iterator[CanFrame]:
        """Yield the frames one by one, from `start` to before `stop`."""
        part = slice(start, len(self) if stop is None else stop)
        width = self.data.shape[1]
        data = np.ascontiguousarray(self.data[part]).tobytes()
        columns = (self.time_s, self.channel, self.identifier, self.flags, self.size, self.line)
        at = 0
        for time_s, channel, key, flags, size, line in zip(
            *(column[part].tolist() for column in columns), strict=True
        ):
            yield CanFrame(
                time_s,
                self.channels[channel],
                key & ~EXTENDED,
                key >= EXTENDED,
                flags & FD != 0,
                flags & ERROR != 0,
                flags & REMOTE != 0,
                data[at : at + size],
                line,
            )
            at += width


def block_of(frames: Sequence[CanFrame]) -> FrameBlock:
    """Return frames as arrays."""
    width = max((len(frame.data) for frame in frames), default=0)
    data = np.zeros((len(frames), max(width, CLASSIC_BYTES)), dtype=np.uint8)
    for row, frame in zip(data, frames, strict=True):
        row[: len(frame.data)] = np.frombuffer(frame.data, dtype=np.uint8)
    names = {name: number for number, name in enumerate(dict.fromkeys(f.channel for f in frames))}
    keys = [f.arbitration_id | (EXTENDED if f.is_extended else 0) for f in frames]
    flags = [FD * f.is_fd + ERROR * f.is_error + REMOTE * f.is_remote for f in frames]
    return FrameBlock(
        np.array([f.time_s for f in frames], dtype=np.float64),
        np.array(keys, dtype=np.uint32),
        np.array(flags, dtype=np.uint8),
        np.array([len(f.data) for f in frames], dtype=np.uint8),
        data,
        np.array([names[f.channel] for f in frames], dtype=np.intp),
        np.array([f.line for f in frames], dtype=np.int64),
        tuple(names),
    )


def float_sequence(values: FloatArray) -> Sequence[float]:
    """Return an array (n,) as a sequence of Python floats, without a copy: taking each from an array takes
    ten times as long, and on a full bus a list of all takes longer than taking those that are needed."""
    return cast("Sequence[float]", values.data)
