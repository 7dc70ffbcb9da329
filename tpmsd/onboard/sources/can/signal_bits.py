"""The bits of a signal in many frames at once.

In: a `BitField`, the data of frames as rows. Out: raw bits, and the numbers that they stand for. Pure.
`BitField` does the same for one frame; both give the same bits and numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.can.signal_plan import BitField

RawArray = NDArray[np.uint64]

_FLOATS: dict[int, tuple[type[np.unsignedinteger], type[np.floating]]] = {
    16: (np.uint16, np.float16),
    32: (np.uint32, np.float32),
    64: (np.uint64, np.float64),
}


def raw_bits(field: BitField, data: NDArray[np.uint8]) -> RawArray:
    """Return (n,) unsigned raw bits of data (n, bytes); ValueError if that is too short to hold the field."""
    if field.min_bytes > data.shape[1]:
        raise ValueError("beyond the payload")
    # The field lies within the last bytes of the integer that it was planned on.
    last, first = field.min_bytes, field.shift // 8
    if field.big_endian:
        first = (8 * field.word_bytes - field.shift - field.length) // 8
        skip = field.shift - 8 * (field.word_bytes - last)
    else:
        skip = field.shift - 8 * first
    columns = data[:, first:last].astype(np.uint64)
    if not field.big_endian:
        columns = columns[:, ::-1]
    raw = np.zeros(len(data), dtype=np.uint64)
    count = columns.shape[1]
    for k in range(count):
        weight = 8 * (count - 1 - k) - skip
        column = columns[:, k]
        if weight >= 0:
            raw |= column << np.uint64(weight) if weight < 64 else np.uint64(0)
        else:
            raw |= column >> np.uint64(-weight)
    return raw & np.uint64(field.mask)


def numbers(field: BitField, raw: RawArray) -> FloatArray:
    """Return (n,) the numbers in raw bits: integers (two's complement if signed) or IEEE 754 numbers."""
    if field.is_float:
        unsigned, floating = _FLOATS[field.length]
        return raw.astype(unsigned).view(floating).astype(np.float64)
    if not field.signed:
        return raw.astype(np.float64)
    unused = np.int64(64 - field.length)
    return (raw.view(np.int64) << unused >> unused).astype(np.float64)
