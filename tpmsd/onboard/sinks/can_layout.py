"""Layout of tpmsd's own CAN frames: position and scale of each signal, and the checksum.

In: physical values by signal name (NaN: not available). Out: 8 bytes.

The layout is kept here as constants, and in `dbc/tpmsd.dbc` for everybody else; a test compares the two
signal by signal. So the daemon needs no file at run time that an installation could lose, and the two cannot
drift apart.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

STATUS_DATA_ID = 0xF0
ALARM_DATA_ID = 0xF1
"""First byte under the checksum; stays the same when the identifiers are configured differently, so that a
gateway may renumber the frames, yet one frame can never pass for the other."""

FRAME_BYTES = 8
COUNTER_MODULO = 16
SEQUENCE_MODULO = 256

PAGE_FRONT, PAGE_REAR, PAGE_CHANGE = range(3)
STATUS_PAGES = (PAGE_FRONT, PAGE_REAR, PAGE_CHANGE)

WHEEL_STATE_CODES = {"unavailable": 0, "learning": 1, "monitoring": 2, "alarm": 3}
ALARM_KIND_CODES = {"deflation": 1, "radius_deviation": 2, "malfunction": 3, "slow_leak": 4}
WHEEL_CODES = {"fl": 0, "fr": 1, "rl": 2, "rr": 3}
NO_WHEEL_CODE = 7


@dataclass(frozen=True, slots=True)
class Field:
    """One signal in Intel byte order: bit `start` is its least significant one."""

    name: str
    start: int
    length: int
    signed: bool = False
    factor: float = 1.0
    unit: str = ""
    not_available: int | None = None
    """Raw value that says 'not available'; it lies outside the range of values."""
    rounding: Literal["nearest", "up", "down"] = "nearest"

    @property
    def raw_range(self) -> tuple[int, int]:
        """Smallest and greatest raw value that is a number."""
        low, high = (
            (-(1 << (self.length - 1)), (1 << (self.length - 1)) - 1)
            if self.signed
            else (0, (1 << self.length) - 1)
        )
        if self.not_available == low:
            low += 1
        elif self.not_available == high:
            high -= 1
        return low, high

    def raw(self, value: float) -> int:
        """Return the raw value nearest to `value`, saturated at the range; the code 'not available' for
        NaN."""
        if math.isnan(value):
            if self.not_available is None:
                raise ValueError(f"{self.name} has no code for a value that is not available")
            return self.not_available
        low, high = self.raw_range
        scaled = value / self.factor
        if not low <= scaled <= high:
            return low if scaled < low else high
        # A hair of slack, so that 0.06 / 0.02 does not become 4 counts.
        if self.rounding == "up":
            return math.ceil(scaled - 1e-9)
        return math.floor(scaled + 1e-9) if self.rounding == "down" else round(scaled)


def _wheel_fields(left: str, right: str) -> tuple[Field, ...]:
    fields: list[Field] = []
    for wheel, start in ((left, 16), (right, 40)):
        fields += [
            Field(f"Deviation_{wheel}", start, 12, signed=True, factor=0.01, unit="mm", not_available=-2048),
            Field(f"State_{wheel}", start + 12, 3),
            Field(f"Valid_{wheel}", start + 15, 1),
            # Rounded up: the bus must never claim more certainty than the filter has.
            Field(f"Std_{wheel}", start + 16, 8, factor=0.02, unit="mm", not_available=255, rounding="up"),
        ]
    return tuple(fields)


STATUS_HEAD = (Field("StatusChecksum", 0, 8), Field("StatusCounter", 8, 4), Field("StatusPage", 12, 4))
STATUS_FIELDS: dict[int, tuple[Field, ...]] = {
    PAGE_FRONT: _wheel_fields("FL", "FR"),
    PAGE_REAR: _wheel_fields("RL", "RR"),
    PAGE_CHANGE: tuple(
        Field(f"Change_{wheel}", start, 12, signed=True, factor=0.01, unit="mm", not_available=-2048)
        for wheel, start in (("FL", 16), ("FR", 28), ("RL", 40), ("RR", 52))
    ),
}
"""Fields of each page behind the head."""

ALARM_FIELDS = (
    Field("AlarmChecksum", 0, 8),
    Field("AlarmCounter", 8, 4),
    Field("ActiveAlarms", 12, 4),
    *(Field(f"Deflation_{wheel}", 16 + bit, 1) for bit, wheel in enumerate(("FL", "FR", "RL", "RR"))),
    *(Field(f"RadiusDeviation_{wheel}", 20 + bit, 1) for bit, wheel in enumerate(("FL", "FR", "RL", "RR"))),
    Field("Malfunction", 24, 1),
    Field("AlarmRaised", 25, 1),
    Field("AlarmKind", 26, 3),
    Field("AlarmWheel", 29, 3),
    Field("AlarmSequence", 32, 8),
    Field("AlarmChange", 40, 12, signed=True, factor=0.01, unit="mm", not_available=-2048),
    Field("AlarmPressureLoss", 52, 4, factor=5.0, unit="%", not_available=15),
    # Rounded down: 99.8 % must not become a certainty.
    Field("AlarmProbability", 56, 8, factor=0.5, unit="%", not_available=255, rounding="down"),
)


def crc8_j1850(data: bytes) -> int:
    """Return CRC-8/SAE-J1850: polynomial 0x1D, start 0xFF, final XOR 0xFF, not reflected ('123456789' ->
    0x4B)."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ 0x1D if crc & 0x80 else crc << 1
        crc &= 0xFF
    return crc ^ 0xFF


def checksum(data_id: int, data: bytes) -> int:
    """Return the checksum byte that belongs in byte 0: over the data id and bytes 1 to 7."""
    return crc8_j1850(bytes((data_id,)) + data[1:FRAME_BYTES])


def pack(fields: tuple[Field, ...], values: Mapping[str, float], data_id: int) -> bytes:
    """Return 8 bytes with the `values` and the checksum; fields without a value are zero.

    Raises KeyError for a name that is no field of the frame.
    """
    by_name = {field.name: field for field in fields}
    word = 0
    for name, value in values.items():
        field = by_name[name]
        word |= (field.raw(value) & ((1 << field.length) - 1)) << field.start
    data = word.to_bytes(FRAME_BYTES, "little")
    return bytes((checksum(data_id, data),)) + data[1:]
