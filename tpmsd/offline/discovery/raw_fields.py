"""Fields of raw frames, without a DBC: where numbers begin and end.

In: the payloads of a message. Out: `MessageField`s in both byte orders.

In a number the lower a bit, the oftener it flips. So, going up from a lowest bit, flip rates fall; where
they rise again, another number begins (Marchetti, Stabili 2018, who use the same for reverse engineering). A
checksum's bits all flip half the time, an alive counter's lowest bit always: both are no candidates.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.discovery.frames import MessageLog
from tpmsd.offline.discovery.series import MessageField
from tpmsd.offline.discovery.settings import SETTINGS
from tpmsd.onboard.sources.can.signal_plan import BUS_SHIFT, EXTENDED, BitField

MAX_BYTES = 16
MIN_BITS, MAX_BITS = 6, 33


def message_name(key: int) -> str:
    """Return `ID_0B0`: the identifier in hexadecimal."""
    number = key & (1 << BUS_SHIFT) - 1
    return f"ID_{number & ~EXTENDED:08X}" if key & EXTENDED else f"ID_{number:03X}"


def flip_rates(log: MessageLog) -> FloatArray:
    """Return (bytes, 8) share of frames in which a bit differs from the frame before; bit 0 is the lowest."""
    data = log.data[: SETTINGS.flip_sample, :MAX_BYTES]
    flips = np.unpackbits(data[1:] ^ data[:-1], axis=1, bitorder="little").reshape(
        len(data) - 1, data.shape[1], 8
    )
    return np.asarray(flips.mean(axis=0))


def raw_fields(log: MessageLog) -> list[MessageField]:
    """Return the fields of one message that may be numbers, by the flip rates of its bits, in both byte
    orders.
    """
    if len(log.data) < 50:
        return []
    rates = flip_rates(log)
    count = len(rates)
    fields: dict[tuple[bool, int, int], MessageField] = {}
    for big in (False, True):
        # Bits from the lowest up, as the byte order has them.
        order = range(count - 1, -1, -1) if big else range(count)
        positions = [(byte, bit) for byte in order for bit in range(8)]
        line = np.array([rates[byte, bit] for byte, bit in positions])
        for start, length in _falling_runs(line):
            parts = _subfields(start, length, _count_alive_bits(line[start : start + length]))
            # Top bits that did not change on this drive: a number ends with a byte more often than not.
            room = -(start + length) % 8
            if room and not line[start + length : start + length + room].any():
                parts.append((start, length + room))
            for first, bits in parts:
                field = _field_of_bits(log, positions[first], bits, big)
                if field is not None:
                    fields.setdefault(
                        (big and _spans_bytes(positions[first], bits), *_layout_identity(field)), field
                    )
    return list(fields.values())


def _falling_runs(line: FloatArray) -> list[tuple[int, int]]:
    """Return start and length of stretches in which flip rates fall, never-flipping bits on top left out."""
    runs = []
    start = 0
    while start < len(line):
        if line[start] == 0.0:
            start += 1
            continue
        end = start + 1
        least = line[start]
        while end < len(line) and end - start < MAX_BITS:
            if least < SETTINGS.flip_slow and line[end] > SETTINGS.flip_rise * least + SETTINGS.flip_noise:
                break
            if line[end] > 0.0:
                least = min(least, line[end])
            end += 1
        top = end
        while top > start and line[top - 1] == 0.0:
            top -= 1
        if top - start >= MIN_BITS:
            runs.append((start, top - start))
        start = max(end, start + 1)
    return runs


def _count_alive_bits(rates: FloatArray) -> int:
    """Return the number of alive-counter bits at the low end of a run: they flip in every frame, every second
    one, ...
    """
    halving = np.abs(rates * 2.0 ** np.arange(len(rates)) - 1.0) < SETTINGS.flip_halving
    return len(rates) if halving.all() else int(np.argmin(halving))


def _subfields(start: int, length: int, alive: int) -> list[tuple[int, int]]:
    """Return fields to try: the whole run, what stands above an alive counter of so many bits, and parts that
    begin or end at bytes, where fast top bits hide the end."""
    end = start + length
    starts = {start, start + alive, *range(-(-start // 8) * 8, end, 8)}
    ends = {end, *range(-(-start // 8) * 8, end, 8)}
    return sorted((a, b - a) for a in starts for b in ends if MIN_BITS <= b - a <= MAX_BITS)


def _spans_bytes(position: tuple[int, int], bits: int) -> bool:
    """Return whether a field of so many bits from (byte, bit) on crosses a byte boundary."""
    return position[1] + bits > 8


def _layout_identity(field: MessageField) -> tuple[int, int]:
    return field.layout.shift + 1000 * field.layout.word_bytes, field.layout.length


def _field_of_bits(log: MessageLog, lowest: tuple[int, int], bits: int, big: bool) -> MessageField | None:
    """Return the field of so many bits from the lowest (byte, bit) up; None where the message is too short
    for it.
    """
    byte, bit = lowest
    mask = (1 << bits) - 1
    if big:
        size = byte + 1
        if 8 * size - bit - bits < 0:
            return None
        start = _motorola_start(byte, bit, bits)
        layout = BitField(True, size, bits, bit, size, False, False, mask)
    else:
        start = 8 * byte + bit
        size = (start + bits + 7) // 8
        if size > log.data.shape[1]:
            return None
        layout = BitField(False, size, bits, start, size, False, False, mask)
    name = f"{'M' if big else 'I'}{start}_{bits}"
    return MessageField(message_name(log.key), name, log.key, layout)


def _motorola_start(byte: int, bit: int, bits: int) -> int:
    """Return the DBC number of a big-endian field's highest bit, from its lowest byte and bit."""
    layout = 8 * byte + bit
    for _ in range(bits - 1):
        layout = layout + 1 if layout % 8 < 7 else layout - 15
    return layout


def dbc_start(field: MessageField) -> int:
    """Return the start bit as a DBC has it."""
    layout = field.layout
    if not layout.big_endian:
        return layout.shift
    byte = layout.word_bytes - 1 - layout.shift // 8
    return _motorola_start(byte, layout.shift % 8, layout.length)
