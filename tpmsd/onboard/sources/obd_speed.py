"""Speed of the car by OBD-II, as bytes: the request and its answer.

In: the data of a CAN frame. Out: km/h. SAE J1979 service 01, PID 0D (vehicle speed, one byte, 1 km/h), in
single frames of ISO 15765-2; the identifiers of ISO 15765-4 are in `ObdConfig`. Pure.
"""

from __future__ import annotations

SPEED_REQUEST = bytes.fromhex("02010d5555555555")
"""Two bytes follow the length: service and PID. ISO 15765-4 wants eight in all and leaves open which; 0x55
needs the fewest stuff bits."""
_ANSWERS = bytes.fromhex("410d")
"""The service with 0x40 added, as in every positive answer, and the PID."""


def speed_answer_kmh(data: bytes) -> int | None:
    """Return the speed that a frame states, 0 to 255 km/h; None where it is no such answer."""
    if len(data) < 4 or not 3 <= data[0] <= 7 or len(data) <= data[0]:
        return None
    return data[3] if data[1:3] == _ANSWERS else None
