"""Checksums of car makers, by name.

In: the bytes of a frame without the checksum's own. Out: one byte. Sources: SAE J1850; AUTOSAR,
"Specification of CRC Routines" (CRC8 and CRC8H2F); the others are sums as DBC collections describe them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

Algorithm = Callable[[int, bytes, int], int]
"""Identifier of the frame, its bytes without the checksum's, length of the whole frame -> checksum."""


def crc8(data: bytes, polynomial: int) -> int:
    """Return the CRC-8 of the data, not reflected, start 0xFF, final XOR 0xFF."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ polynomial if crc & 0x80 else crc << 1
        crc &= 0xFF
    return crc ^ 0xFF


def _toyota(identifier: int, data: bytes, length: int) -> int:
    """Return the sum of the identifier's bytes, the length and the data."""
    return (sum(identifier.to_bytes(4, "big")) + length + sum(data)) & 0xFF


ALGORITHMS: dict[str, Algorithm] = {
    "crc8_j1850": lambda _, data, __: crc8(data, 0x1D),
    "crc8_autosar": lambda _, data, __: crc8(data, 0x2F),
    "xor8": lambda _, data, __: reduce(lambda total, byte: total ^ byte, data, 0),
    "sum8": lambda _, data, __: sum(data) & 0xFF,
    "sum8_inverted": lambda _, data, __: ~sum(data) & 0xFF,
    "toyota": _toyota,
}
