"""Where numbers begin and end in raw payloads."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.frames import MessageLog
from tpmsd.offline.discovery.raw_fields import dbc_start, raw_fields

FRAMES = 20_000
STAMPS_S: FloatArray = 0.02 * np.arange(FRAMES, dtype=np.float64)


def slow_number(seed: int) -> NDArray[np.int64]:
    """(n,) numbers of twelve bits that step by one every thirteenth frame or so, as a coarse speed does."""
    steps = np.random.default_rng(seed).choice([-1, 0, 1], FRAMES, p=[0.035, 0.925, 0.04])
    return np.asarray(np.abs(np.cumsum(steps) + 300) % 4096, dtype=np.int64)


@pytest.mark.parametrize("alive_bits", [2, 4])
def test_a_number_above_an_alive_counter(alive_bits: int) -> None:
    """The counter's flip rates halve from bit to bit, so that they fall into those of a slower number."""
    word = slow_number(3) << alive_bits | np.arange(FRAMES) % (1 << alive_bits)
    data = np.zeros((FRAMES, 8), dtype=np.uint8)
    for byte in range(2):
        data[:, byte] = word >> 8 * byte & 0xFF
    found = raw_fields(MessageLog(0x215, STAMPS_S, data))

    starts = {dbc_start(one) for one in found if not one.layout.big_endian}

    assert alive_bits in starts


def test_no_number_where_nothing_changes() -> None:
    """Bytes that stay the same hold no candidate."""
    assert [] == raw_fields(MessageLog(1, STAMPS_S, np.zeros((FRAMES, 8), dtype=np.uint8)))
