"""The frames of a drive as arrays, one pair per message of a bus.

In: frames in the order of their stamps. Out: `BusLog`: stamps and payloads by message; raw bits of a field.
A log may hold several buses: each channel that it names is one, numbered in the order of appearance.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.settings import SETTINGS
from tpmsd.onboard.sources.can.block import ERROR, REMOTE, FrameBlock
from tpmsd.onboard.sources.can.signal_bits import RawArray, raw_bits
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT, BitField

MAX_MESSAGES = 4096
"""Identifiers of one log; a bus has some hundred."""
_IDENTIFIER = (1 << BUS_SHIFT) - 1


@dataclass(frozen=True, slots=True)
class MessageLog:
    """All frames of one message."""

    key: int
    """Identifier, with `EXTENDED` set for 29-bit ones, and the number of the bus above `BUS_SHIFT`."""
    time_s: FloatArray
    """(n,)"""
    data: NDArray[np.uint8]
    """(n, bytes); the most common length, frames of other lengths left out."""

    @property
    def period_s(self) -> float:
        """Median time between two frames; infinite for fewer than three."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 2 else float("inf")

    def selected(self, selectors: Sequence[tuple[BitField, frozenset[int]]]) -> MessageLog:
        """Return the frames in which each multiplexer field has one of its numbers; all frames where there
        are no selectors.
        """
        if not selectors:
            return self
        kept = np.ones(len(self.time_s), dtype=np.bool_)
        for layout, numbers in selectors:
            kept &= np.isin(self.bits(layout), np.array(sorted(numbers), dtype=np.uint64))
        return MessageLog(self.key, self.time_s[kept], self.data[kept])

    def bits(self, layout: BitField) -> RawArray:
        """Return (n,) raw bits of a field; ValueError if the payload does not hold it."""
        return raw_bits(layout, self.data)


@dataclass(slots=True)
class _Growing:
    times: array[float] = field(default_factory=lambda: array("d"))
    data: dict[int, tuple[array[float], bytearray]] = field(default_factory=dict)


class BusLog:
    """Gathers frames; error and remote frames are left out."""

    def __init__(self) -> None:
        self._messages: dict[int, _Growing] = {}
        self.channels: list[str] = []
        """Names of the buses by their numbers."""
        self.frames = 0
        self.left_out = 0
        """Frames of more identifiers than a bus has."""

    def add(self, block: FrameBlock) -> None:
        """Append the data frames of a block."""
        data_frames = np.flatnonzero((block.flags & (ERROR | REMOTE) == 0) & (block.size > 0))
        self.frames += len(data_frames)
        numbers = np.array([self._bus_number(name) for name in block.channels], dtype=np.int64)
        bus = numbers[block.channel[data_frames]]
        kinds = (bus << BUS_SHIFT | block.identifier[data_frames]) << 8 | block.size[data_frames]
        order = np.argsort(kinds, kind="stable")
        found, first = np.unique(kinds[order], return_index=True)
        for kind, these in zip(found.tolist(), np.split(data_frames[order], first[1:]), strict=True):
            key, size = kind >> 8, kind & 0xFF
            message = self._messages.get(key)
            if message is None:
                if len(self._messages) >= MAX_MESSAGES:
                    self.left_out += len(these)
                    continue
                message = self._messages[key] = _Growing()
            kept = message.data.setdefault(size, (array("d"), bytearray()))
            kept[0].frombytes(block.time_s[these].tobytes())
            kept[1].extend(block.data[these, :size].tobytes())

    def _bus_number(self, channel: str) -> int:
        """Return the number of a channel's bus, a new one for a new channel."""
        if channel not in self.channels:
            self.channels.append(channel)
        return self.channels.index(channel)

    def keys(self) -> frozenset[int]:
        """Return the keys of all messages."""
        return frozenset(self._messages)

    def messages(self, copies: bool = False) -> dict[int, MessageLog]:
        """Return the messages by key, in order of buses and identifiers; stamps sorted.

        `copies`: also what a gateway copies from one bus to another, or two interfaces record of one bus;
        else it is given once.
        """
        logs: dict[int, MessageLog] = {}
        for key in sorted(self._messages):
            size, (times, data) = max(self._messages[key].data.items(), key=lambda item: len(item[1][0]))
            time_s = np.frombuffer(times, dtype=np.float64)
            rows = np.frombuffer(bytes(data), dtype=np.uint8).reshape(-1, size)
            order = np.argsort(time_s, kind="stable")
            message = MessageLog(key, time_s[order], rows[order])
            before = (logs.get(bus << BUS_SHIFT | key & _IDENTIFIER) for bus in range(key >> BUS_SHIFT))
            if copies or not any(other is not None and _is_copy(message, other) for other in before):
                logs[key] = message
        return logs


def _is_copy(one: MessageLog, other: MessageLog) -> bool:
    """Return whether a message of another bus carries the same payloads, by a sample of them."""
    if one.data.shape[1] != other.data.shape[1]:
        return False
    sample = one.data[:: 1 + len(one.data) // SETTINGS.compared_payloads]
    there = {row.tobytes() for row in other.data}
    return sum(row.tobytes() in there for row in sample) >= SETTINGS.copy_share * len(sample)
