"""Counters in raw fields, as real encoders and buses make them."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.frames import MessageLog
from tpmsd.offline.discovery.series import MessageField, unwrap
from tpmsd.onboard.sources.can.signal_plan import BitField

MODULUS = 1 << 32


def encoder(seed: int = 3) -> tuple[FloatArray, FloatArray]:
    """Stamps (s) and true counts (n,): a minute at rest with a trembling quadrature encoder, then 25 m/s."""
    rng = np.random.default_rng(seed)
    time_s = 0.01 * np.arange(18_000)
    speed = np.clip(time_s - 60.0, 0.0, 25.0) * 20_192.0
    trembling = np.where(time_s < 60.0, rng.integers(-9, 10, len(time_s)), 0)
    return time_s, np.cumsum(speed * 0.01).round() + trembling


def bits(length: int) -> BitField:
    """The first `length` bits of a frame, little-endian and unsigned."""
    return BitField(False, length // 8, length, 0, length // 8, False, False, (1 << length) - 1)


def log(time_s: FloatArray) -> MessageLog:
    """Frames at these stamps."""
    return MessageLog(0x120, time_s, np.zeros((len(time_s), 8), dtype=np.uint8))


def test_trembling_at_rest_and_a_corrupt_frame() -> None:
    """Counts up and down about zero and one frame of other bits leave the counts as they are."""
    time_s, counts = encoder()
    raw = (counts.astype(np.int64) % MODULUS).astype(np.uint64)
    raw[15_000] ^= np.uint64(0xFF << 24)
    found = unwrap(MessageField("ENCODERS", "COUNT", 0x120, bits(32)), log(time_s), raw)
    assert found is not None
    assert len(time_s) - 1 == len(found.time_s)
    kept = np.delete(counts, 15_000)
    assert pytest.approx(kept - kept[0]) == found.counts


def test_a_speed_is_no_counter() -> None:
    """A field that falls as often as it rises is refused."""
    time_s, _ = encoder()
    raw = (2_000 + 1_000 * np.sin(time_s)).astype(np.uint64)
    assert unwrap(MessageField("ENGINE", "SPEED", 0x120, bits(16)), log(time_s), raw) is None
