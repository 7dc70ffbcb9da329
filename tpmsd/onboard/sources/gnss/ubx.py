"""u-blox's binary protocol: frames out of a byte stream, and the one message that is wanted of it.

In: bytes of a serial line, NMEA in between as it comes. Out: payloads of NAV-PVT, and the bytes that are in
no frame. Source: u-blox M8 and F9 interface descriptions, chapters "UBX frame structure" and "UBX-NAV-PVT".

NAV-PVT says what no NMEA sentence does: the accuracy of the speed, and the instant of the solution to the
nanosecond instead of to the hundredth of a second.
"""

from __future__ import annotations

import datetime
import math
import struct

from tpmsd.onboard.sources.gnss.solution import NAN, Solution

SYNC = b"\xb5\x62"
NAV_PVT = 0x0107
"""Class and number of the message."""
MAX_PAYLOAD_BYTES = 1024
"""NAV-SAT of 72 satellites has 872; what claims more is taken for noise."""
_HEAD_BYTES, _CHECKSUM_BYTES = 6, 2
_PVT = struct.Struct("<IHBBBBBBIiBBBBiiiiIIiiiiiIIH")
"""Fields from iTOW to pDOP, 78 bytes; receivers of all generations agree on these."""
_VALID_DATE, _VALID_TIME, _FIX_OK, _DIFFERENTIAL = 0x01, 0x02, 0x01, 0x02
_ANY_FIX = frozenset({1, 2, 3, 4})
"""Dead reckoning, 2D, 3D, GNSS with dead reckoning; 0 is none and 5 time alone."""


class UbxFramer:
    """Takes UBX frames out of a stream; what comes out does not depend on how it was cut into pieces.

    `counts`: `frames` with a right checksum, `bad` ones without.
    """

    def __init__(self) -> None:
        self.counts = {"frames": 0, "bad": 0}
        self._held = b""

    def feed(self, data: bytes) -> list[tuple[bool, bytes]]:
        """Return the pieces of the stream in order: (True, a frame) or (False, bytes of no frame)."""
        data = self._held + data
        out: list[tuple[bool, bytes]] = []
        plain = at = 0
        while (start := data.find(SYNC, at)) >= 0:
            size = _frame_bytes(data, start)
            if size is None or start + size > len(data):
                break
            frame = data[start : start + size]
            if size == 0 or checksum(frame[2:-2]) != frame[-2:]:
                self.counts["bad"] += 1
                at = start + 1
                continue
            self.counts["frames"] += 1
            if start > plain:
                out.append((False, data[plain:start]))
            out.append((True, frame))
            plain = at = start + size
        else:
            start = len(data) - data.endswith(SYNC[:1])
        if start > plain:
            out.append((False, data[plain:start]))
        self._held = data[max(start, plain) :]
        return out

    @property
    def held(self) -> int:
        """Bytes of an unfinished frame."""
        return len(self._held)

    def reset(self) -> None:
        """Forget the unfinished frame."""
        self._held = b""


def _frame_bytes(data: bytes, start: int) -> int | None:
    """Return the length of the frame that begins there; 0 if it cannot be one, None if it is not known
    yet."""
    if len(data) < start + _HEAD_BYTES:
        return None
    payload = int.from_bytes(data[start + 4 : start + 6], "little")
    return 0 if payload > MAX_PAYLOAD_BYTES else _HEAD_BYTES + payload + _CHECKSUM_BYTES


def checksum(body: bytes) -> bytes:
    """Return the 8-bit Fletcher checksum over class, number, length and payload."""
    one = two = 0
    for byte in body:
        one = (one + byte) & 0xFF
        two = (two + one) & 0xFF
    return bytes((one, two))


def nav_pvt(frame: bytes) -> Solution | None:
    """Return the solution in a frame whose checksum is right; None if it is another message."""
    payload = frame[_HEAD_BYTES:-_CHECKSUM_BYTES]
    if int.from_bytes(frame[2:4], "big") != NAV_PVT or len(payload) < _PVT.size:
        return None
    _, year, month, day, hour, minute, second, valid, _, nano, *solution = _PVT.unpack_from(payload)
    fix, flags, _, satellites, longitude, latitude, height, _, h_acc, v_acc, *motion = solution
    _, _, _, speed, course, s_acc, _, _ = motion
    utc_s = NAN
    if valid & _VALID_DATE and valid & _VALID_TIME:
        utc_s = _unix_s(year, month, day, hour, minute, second) + 1e-9 * nano
    if not (flags & _FIX_OK and fix in _ANY_FIX):
        return Solution(utc_s)
    # h_acc is a radius (68 %); per axis it is smaller by the root of two.
    per_axis_m = 1e-3 * h_acc / math.sqrt(2.0)
    return Solution(
        utc_s=utc_s,
        quality=_quality(fix, flags),
        latitude_deg=1e-7 * latitude,
        longitude_deg=1e-7 * longitude,
        altitude_m=1e-3 * height,
        satellites=satellites,
        latitude_std_m=per_axis_m,
        longitude_std_m=per_axis_m,
        altitude_std_m=1e-3 * v_acc,
        speed_mps=1e-3 * speed,
        speed_std_mps=1e-3 * s_acc if s_acc else NAN,
        course_deg=(1e-5 * course) % 360.0,
    )


def _quality(fix: int, flags: int) -> int:
    """Return the NMEA quality indicator of a NAV-PVT solution."""
    if fix == 1:
        return 6
    carrier = flags >> 6
    if carrier in (1, 2):
        return 5 if carrier == 1 else 4
    return 2 if flags & _DIFFERENTIAL else 1


def _unix_s(year: int, month: int, day: int, hour: int, minute: int, second: int) -> float:
    """Return the Unix time of a UTC date and time, s; NaN if there is no such."""
    try:
        midnight = datetime.datetime(year, month, day, tzinfo=datetime.UTC).timestamp()
    except (ValueError, OverflowError):
        return NAN
    if hour > 23 or minute > 59 or second > 60:
        return NAN
    return midnight + 3600.0 * hour + 60.0 * minute + second
