"""J1939: `TIRE` (PGN 65268) and `DM1` (PGN 65226), as far as a system without pressure sensors can fill them.

In: the values of `output_values`. Out: the data of frames. The table is in `docs/reference/can-output.md`.
DM1 with one trouble code fits into one frame; the gravest is sent, so no transport protocol is needed.
"""

from __future__ import annotations

from collections.abc import Mapping

from tpmsd.foundation.wheels import WHEELS

PGN = {"tire": 65268, "dm1": 65226}
PRIORITY = 6
LOCATIONS = {"fl": 0x00, "fr": 0x01, "rl": 0x10, "rr": 0x11}
"""SPN 929: high four bits the axle from the front, low four bits the position from the left."""
NO_FAULT, LEAK, ERROR, NOT_SUPPORTED = 0b00, 0b01, 0b10, 0b11
"""SPN 1698, tyre status."""
UNDER_PRESSURE, FAILURE, NOT_AVAILABLE = 0b011, 0b110, 0b111
"""SPN 2587, tyre pressure threshold detection."""
SPN_TYRE_PRESSURE = 241
FMI_BELOW_NORMAL, FMI_NOT_WORKING = 18, 12
"""Below normal, moderately severe; bad intelligent device."""
_AMBER_ON, _LAMPS_OFF = 0x04, 0x00
"""SPN 624 in bits 3-4 of byte 1: the amber warning lamp."""
_NO_FLASH = 0xFF


def j1939_identifier(kind: str, source_address: int) -> int:
    """Return the 29-bit identifier of a broadcast (PDU2)."""
    return PRIORITY << 26 | PGN[kind] << 8 | source_address


def j1939_frames(kind: str, values: Mapping[str, float]) -> list[bytes]:
    """Return four frames of TIRE, or one of DM1."""
    return [_tire_bytes(wheel, values) for wheel in WHEELS] if kind == "tire" else [_dm1_bytes(values)]


def _tire_bytes(wheel: str, values: Mapping[str, float]) -> bytes:
    if values[f"deflation_{wheel}"] == 1.0:
        status, threshold = LEAK, UNDER_PRESSURE
    elif values["malfunction"] == 1.0:
        status, threshold = ERROR, FAILURE
    else:
        watched = values[f"state_{wheel}"] in (2, 3)
        # That no pressure is too low only a sensor of pressure could say.
        status, threshold = NO_FAULT if watched else NOT_SUPPORTED, NOT_AVAILABLE
    # Pressure, temperature, electrical states and leakage rate are not available: ones.
    return bytes((LOCATIONS[wheel], 0xFF, 0xFF, 0xFF, 0xF3 | status << 2, 0xFF, 0xFF, threshold << 5 | 0x1F))


def _dm1_bytes(values: Mapping[str, float]) -> bytes:
    if values["malfunction"] == 1.0:
        fmi = FMI_NOT_WORKING
    elif values["alarm"] == 1.0:
        fmi = FMI_BELOW_NORMAL
    else:
        # No trouble code: SPN, FMI and count are zero, the two last bytes reserved (J1939-73).
        return bytes((_LAMPS_OFF, _NO_FLASH, 0, 0, 0, 0, 0xFF, 0xFF))
    spn = SPN_TYRE_PRESSURE
    code = (spn & 0xFF, spn >> 8 & 0xFF, (spn >> 16) << 5 | fmi)
    # How often it occurred is not counted: 127 says so.
    return bytes((_AMBER_ON, _NO_FLASH, *code, 0x7F, 0xFF, 0xFF))
