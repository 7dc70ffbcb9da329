"""NMEA 0183 sentences.

In: one epoch of a receiver. Out: the text of its RMC, GGA, VTG, GST and ZDA sentences with checksums, without
line ends. A receiver without a fix leaves fields empty; one that stands leaves the course empty.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

SENTENCES = ("RMC", "GGA", "VTG", "GST", "ZDA")
_KNOT_MPS = 1852.0 / 3600.0


@dataclass(frozen=True, slots=True)
class Epoch:
    """Solution of a receiver at one instant."""

    utc_s: float
    """Unix seconds."""
    valid: bool
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    speed_mps: float
    course_deg: float
    """Clockwise from true north; NaN where the receiver gives none."""
    hdop: float
    satellites: int
    position_std_m: float
    """Standard deviation per axis, as the receiver states it, m."""
    geoid_separation_m: float = 47.0


def with_checksum(body: str) -> str:
    """Return `$body*hh` with the exclusive or of the body's bytes."""
    check = 0
    for byte in body.encode("ascii"):
        check ^= byte
    return f"${body}*{check:02X}"


def sentence(kind: str, epoch: Epoch, talker: str = "GN") -> str:
    """Return one sentence of an epoch; `kind` is one of SENTENCES."""
    return with_checksum(talker + _BODIES[kind](epoch))


def _time_field(utc_s: float) -> tuple[str, time.struct_time]:
    """Return the time of day as hhmmss.sss, and the date and time in parts."""
    milliseconds = round(utc_s * 1000)
    parts = time.gmtime(milliseconds // 1000)
    return f"{parts.tm_hour:02d}{parts.tm_min:02d}{parts.tm_sec:02d}.{milliseconds % 1000:03d}", parts


def _angle_fields(degrees: float, width: int, positive: str, negative: str) -> str:
    """Return the fields of an angle, (d)ddmm.mmmmmm, and of its hemisphere."""
    hemisphere = positive if degrees >= 0 else negative
    # Rounded as a whole, so that 59.999999 minutes never print as 60.
    units = round(abs(degrees) * 60 * 1e6)
    whole, minutes = divmod(units, 60_000_000)
    return f"{whole:0{width}d}{minutes // 1_000_000:02d}.{minutes % 1_000_000:06d},{hemisphere}"


def _position_fields(epoch: Epoch) -> str:
    """Return the fields of latitude and longitude, empty for an invalid fix."""
    if not epoch.valid:
        return ",,,"
    return (
        f"{_angle_fields(epoch.latitude_deg, 2, 'N', 'S')},{_angle_fields(epoch.longitude_deg, 3, 'E', 'W')}"
    )


def _number_field(value: float, digits: int, valid: bool = True) -> str:
    return f"{value:.{digits}f}" if valid and not math.isnan(value) else ""


def _course_field(epoch: Epoch) -> str:
    # 359.999 must not be printed as 360.00.
    return _number_field(round(epoch.course_deg, 2) % 360.0, 2, epoch.valid)


def _rmc(epoch: Epoch) -> str:
    """Return the NMEA sentence RMC: position, speed and course, with the date."""
    clock, date = _time_field(epoch.utc_s)
    status, mode = ("A", "A") if epoch.valid else ("V", "N")
    speed = _number_field(epoch.speed_mps / _KNOT_MPS, 3, epoch.valid)
    day = f"{date.tm_mday:02d}{date.tm_mon:02d}{date.tm_year % 100:02d}"
    return f"RMC,{clock},{status},{_position_fields(epoch)},{speed},{_course_field(epoch)},{day},,,{mode}"


def _gga(epoch: Epoch) -> str:
    """Return the NMEA sentence GGA: position, number of satellites and height."""
    clock, _ = _time_field(epoch.utc_s)
    if not epoch.valid:
        return f"GGA,{clock},,,,,0,{epoch.satellites:02d},,,M,,M,,"
    height = epoch.altitude_m - epoch.geoid_separation_m
    return (
        f"GGA,{clock},{_position_fields(epoch)},1,{epoch.satellites:02d},{epoch.hdop:.2f},"
        f"{height:.2f},M,{epoch.geoid_separation_m:.2f},M,,"
    )


def _vtg(epoch: Epoch) -> str:
    """Return the NMEA sentence VTG: course and speed over ground."""
    knots = _number_field(epoch.speed_mps / _KNOT_MPS, 3, epoch.valid)
    kmh = _number_field(epoch.speed_mps * 3.6, 3, epoch.valid)
    return f"VTG,{_course_field(epoch)},T,,M,{knots},N,{kmh},K,{'A' if epoch.valid else 'N'}"


def _gst(epoch: Epoch) -> str:
    """Return the NMEA sentence GST: standard deviations of the position."""
    clock, _ = _time_field(epoch.utc_s)
    if not epoch.valid:
        return f"GST,{clock},,,,,,,"
    std = epoch.position_std_m
    return f"GST,{clock},{std:.2f},{std:.2f},{std:.2f},0.0,{std:.2f},{std:.2f},{2 * std:.2f}"


def _zda(epoch: Epoch) -> str:
    """Return the NMEA sentence ZDA: date and time."""
    clock, date = _time_field(epoch.utc_s)
    return f"ZDA,{clock},{date.tm_mday:02d},{date.tm_mon:02d},{date.tm_year:04d},00,00"


_BODIES = {"RMC": _rmc, "GGA": _gga, "VTG": _vtg, "GST": _gst, "ZDA": _zda}
