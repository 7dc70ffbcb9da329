"""CAN messages as tables: their DBC text, and packing of whole columns of raw values.

In: `MessageLayout`s. Out: DBC text, and (n, 8) payload bytes from arrays of raw values. Packing whole columns
is a hundred times faster than encoding frame by frame; the tests hold it against cantools.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray

IntArray = NDArray[np.int64]
ByteArray = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """A signal as a DBC describes it, and the role (a key of `[can.signals]`) that it plays, if any."""

    name: str
    start: int
    """Least significant bit for little endian, most significant for big endian, in DBC numbering."""
    bits: int
    big_endian: bool = False
    signed: bool = False
    factor: float = 1.0
    offset: float = 0.0
    unit: str = ""
    role: str = ""

    def raw_of(self, physical: FloatArray) -> IntArray:
        """Return the nearest raw values, clipped to the signal's limits."""
        low, high = self.limits()
        raw = np.rint((physical - self.offset) / self.factor)
        return np.clip(raw, low, high).astype(np.int64)

    def limits(self) -> tuple[int, int]:
        """Return the smallest and largest raw value."""
        if self.signed:
            return -(1 << (self.bits - 1)), (1 << (self.bits - 1)) - 1
        return 0, (1 << self.bits) - 1

    def bit_positions(self) -> list[int]:
        """Return the position of each bit from the least significant: 8 * byte + bit within the byte."""
        if not self.big_endian:
            return [self.start + k for k in range(self.bits)]
        positions, position = [], self.start
        # From the most significant bit: down within a byte, then on to the next byte's top.
        for _ in range(self.bits):
            positions.append(position)
            position = position - 1 if position % 8 else position + 15
        return positions[::-1]


@dataclass(frozen=True, slots=True)
class MessageLayout:
    """A message of eight bytes, sent periodically."""

    frame_id: int
    name: str
    period_s: float
    signals: tuple[SignalLayout, ...]
    length: int = 8

    def pack(self, raw: Mapping[str, IntArray], count: int) -> ByteArray:
        """Return (count, length) payloads from raw values by signal name; signals that are not given are
        zero."""
        out = np.zeros((count, self.length), dtype=np.uint8)
        for signal in self.signals:
            if signal.name not in raw:
                continue
            value = raw[signal.name]
            for k, position in enumerate(signal.bit_positions()):
                out[:, position // 8] |= (((value >> k) & 1) << (position % 8)).astype(np.uint8)
        return out


def dbc_text(messages: Sequence[MessageLayout], with_periods: bool = True) -> str:
    """Return the DBC file of these messages; many in the field leave the periods out."""
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: CAR", ""]
    for message in messages:
        lines.append(f"BO_ {message.frame_id} {message.name}: {message.length} CAR")
        for s in message.signals:
            low, high = (limit * s.factor + s.offset for limit in s.limits())
            layout = f"{s.start}|{s.bits}@{0 if s.big_endian else 1}{'-' if s.signed else '+'}"
            lines.append(
                f" SG_ {s.name} : {layout} ({s.factor:.10g},{s.offset:.10g}) [{low:.10g}|{high:.10g}]"
                f' "{s.unit}" CAR'
            )
        lines.append("")
    if with_periods:
        lines.append('BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;')
        lines.append('BA_DEF_DEF_ "GenMsgCycleTime" 0;')
        for message in messages:
            lines.append(f'BA_ "GenMsgCycleTime" BO_ {message.frame_id} {round(1000 * message.period_s)};')
        lines.append("")
    return "\n".join(lines)
