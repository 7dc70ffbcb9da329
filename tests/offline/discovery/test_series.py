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


@pytest.mark.parametrize(
    "length,modulus,reserved", [(10, 1001, (1023,)), (8, 240, (254, 255)), (12, 4095, (4095,))]
)
def test_a_number_for_no_value_is_not_the_modulus(
    length: int, modulus: int, reserved: tuple[int, ...]
) -> None:
    """Reserved numbers above the counts are left out and named; the modulus is that of the roll-overs."""
    rng = np.random.default_rng(5)
    time_s = 0.02 * np.arange(30_000)
    counts = np.floor(np.cumsum(0.02 * (300.0 + 280.0 * np.sin(time_s / 40.0)))).astype(np.int64)
    raw = counts % modulus
    silent = rng.random(len(raw)) < 0.004
    raw[silent] = rng.choice(reserved, int(silent.sum()))
    field = MessageField("WHEELS", "COUNT", 0x120, bits(length))
    found = unwrap(field, log(time_s), raw.astype(np.uint64))
    assert found is not None
    assert (modulus, True) == (found.modulus, found.modulus_seen)
    assert frozenset(reserved) == found.no_value
    assert pytest.approx(counts[~silent] - counts[~silent][0]) == found.counts


def test_the_last_numbers_of_a_counter_are_counts() -> None:
    """The numbers before a roll-over are counts, also where a slow drive becomes a fast one."""
    time_s = 0.02 * np.arange(30_000)
    counts = np.floor(np.cumsum(0.02 * np.where(time_s < 500.0, 40.0, 1_000.0))).astype(np.int64)
    raw = (counts % 256).astype(np.uint64)
    found = unwrap(MessageField("WHEELS", "COUNT", 0x120, bits(8)), log(time_s), raw)
    assert found is not None
    assert frozenset() == found.no_value
    assert pytest.approx(counts - counts[0]) == found.counts
