"""One epoch of a receiver that does not speak NMEA, written as NMEA.

In: a `Solution` (from gpsd, from UBX). Out: its sentences. So one assembler judges all receivers, and a
recording holds what a replay needs, in a form that other programs read, too.

Three sentences are the standard's: RMC, GGA, GST, with more digits than a receiver writes. The fourth is
tpmsd's own, for what the standard has no place for:

    $PTPMSG,hhmmss.ssssss,S*hh      S: standard deviation of the speed over ground, m/s
"""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass
from functools import reduce

NAN = math.nan
KNOT_MPS = 1852.0 / 3600.0
_MODE_LETTERS = {1: "A", 2: "D", 3: "P", 4: "R", 5: "F", 6: "E", 8: "S"}


@dataclass(frozen=True, slots=True)
class Solution:
    """Solution of a receiver at one instant. NaN where it reports nothing."""

    utc_s: float = NAN
    """Unix seconds at which it is valid."""
    quality: int = 0
    """GGA quality; 0: no solution."""
    latitude_deg: float = NAN
    longitude_deg: float = NAN
    altitude_m: float = NAN
    """Above the ellipsoid."""
    satellites: int | None = None
    hdop: float = NAN
    latitude_std_m: float = NAN
    longitude_std_m: float = NAN
    altitude_std_m: float = NAN
    speed_mps: float = NAN
    """Over ground, horizontal."""
    speed_std_mps: float = NAN
    course_deg: float = NAN


def sentences(solution: Solution) -> list[bytes]:
    """Return the epoch as sentences without line ends, RMC first; empty if its time is unknown or
    impossible."""
    try:
        at = datetime.datetime.fromtimestamp(round(solution.utc_s, 6), tz=datetime.UTC)
    except (ValueError, OverflowError, OSError):
        return []
    if not 1980 <= at.year < 2080:  # beyond what two digits of a year can say
        return []
    clock, date = at.strftime("%H%M%S.%f"), at.strftime("%d%m%y")
    has_position = math.isfinite(solution.latitude_deg) and math.isfinite(solution.longitude_deg)
    if solution.quality == 0 or not has_position:
        return [_framed_sentence(f"GNRMC,{clock},V,,,,,,,{date},,,N")]
    position = (
        f"{_angle_field(solution.latitude_deg, 2, 'NS')},{_angle_field(solution.longitude_deg, 3, 'EW')}"
    )
    letter = _MODE_LETTERS.get(solution.quality, "A")
    knots, course = _number_field(solution.speed_mps / KNOT_MPS, 5), _number_field(solution.course_deg, 4)
    out = [_framed_sentence(f"GNRMC,{clock},A,{position},{knots},{course},{date},,,{letter}")]
    if math.isfinite(solution.speed_std_mps):
        out.append(_framed_sentence(f"PTPMSG,{clock},{_number_field(solution.speed_std_mps, 4)}"))
    used = "" if solution.satellites is None else f"{solution.satellites:02d}"
    height = (
        f"{_number_field(solution.altitude_m, 3)},M,0.0,M" if math.isfinite(solution.altitude_m) else ",M,,M"
    )
    out.append(
        _framed_sentence(
            f"GNGGA,{clock},{position},{solution.quality},{used},{_number_field(solution.hdop, 2)},{height},,"
        )
    )
    if math.isfinite(solution.latitude_std_m) and math.isfinite(solution.longitude_std_m):
        stds = (solution.latitude_std_m, solution.longitude_std_m, solution.altitude_std_m)
        out.append(_framed_sentence(f"GNGST,{clock},,,,,{','.join(_number_field(std, 4) for std in stds)}"))
    return out


def _angle_field(degrees: float, width: int, letters: str) -> str:
    """Return degrees as an NMEA field of degrees, minutes and hemisphere letter."""
    # In units of 1e-7 minutes (0.2 mm), so that no rounding makes 60 minutes.
    units = round(abs(degrees) * 600_000_000)
    whole, rest = divmod(units, 600_000_000)
    return f"{whole:0{width}d}{rest // 10_000_000:02d}.{rest % 10_000_000:07d},{letters[degrees < 0]}"


def _number_field(value: float, digits: int) -> str:
    """Return a number as an NMEA field; empty if it is not finite."""
    return f"{value:.{digits}f}" if math.isfinite(value) and abs(value) < 1e9 else ""


def _framed_sentence(body: str) -> bytes:
    """Return the sentence with its `$` and checksum."""
    data = body.encode("ascii")
    return b"$%s*%02X" % (data, reduce(lambda total, byte: total ^ byte, data, 0))
