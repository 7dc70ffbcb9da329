"""Decodes one NMEA 0183 sentence.

In: one line of bytes from `$` on. Out: an `NmeaReading` in SI units, or `SentenceError` that says whether the
checksum or the form is wrong. Second 60 of a leap second and all decimals of a time are kept. Where it was
built, compiled code (`_nmea.c`) reads the commonest sentences.
"""

from __future__ import annotations

import datetime
import math
import re
from functools import lru_cache, partial
from string import hexdigits
from typing import NamedTuple

from tpmsd.foundation.kernels import loaded

compiled = loaded("nmea")
NAN = math.nan
KNOT_MPS = 1852.0 / 3600.0
KMH_MPS = 1.0 / 3.6
MAX_SPEED_MPS = 150.0
_UNIX_DAY_0 = datetime.date(1970, 1, 1).toordinal()

# Fields that a sentence without a checksum must have: a line cut short then differs from a complete one.
_FULL_LENGTH = {"RMC": 11, "GGA": 14, "VTG": 8, "ZDA": 4, "GST": 8, "GNS": 12, "GLL": 6}
COLUMNS: dict[str, dict[str, int]] = {
    kind: {name: column for column, name in enumerate(names.split())}
    for kind, names in (
        (
            "RMC",
            "timestamp status lat lat_dir lon lon_dir speed_kn course_deg date "
            "magnetic_variation_deg magnetic_variation_dir mode",
        ),
        (
            "GGA",
            "timestamp lat lat_dir lon lon_dir quality satellites hdop altitude_m "
            "altitude_unit geoid_separation_m",
        ),
        (
            "VTG",
            "course_deg course_unit magnetic_course_deg magnetic_course_unit speed_kn "
            "speed_kn_unit speed_kmh speed_kmh_unit mode",
        ),
        ("ZDA", "timestamp day month year"),
        (
            "GST",
            "timestamp rms_m major_std_m minor_std_m orientation_deg latitude_std_m longitude_std_m",
        ),
        (
            "GNS",
            "timestamp lat lat_dir lon lon_dir mode satellites hdop altitude_m geoid_separation_m",
        ),
        ("GLL", "lat lat_dir lon lon_dir timestamp status mode"),
    )
}
"""Per type of sentence the column of each field that is read, counted after the address (NMEA 0183, 4.11)."""
_KEPT = 4
"""Texts of which the value is kept."""
_HEMISPHERES = {"N": 1.0, "E": 1.0, "S": -1.0, "W": -1.0}
ACCURACY = "PTPMSG"
"""tpmsd's own sentence (`gnss.solution`)."""
HANDLED = frozenset((*_FULL_LENGTH, ACCURACY))
OTHER = "other"

_ADDRESS = re.compile(
    r"\$(?:(?P<proprietary>P[A-Z0-9]{3,})|(?P<talker>[A-Z0-9]{2})(?P<kind>[A-Z0-9]{3}))[,*]"
)
_HEAD = len("$GPRMC,")
_BYTES = {high + low: int(high + low, 16) for high in hexdigits for low in hexdigits}
"""Checksums as they are written."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)", re.ASCII)
_TIME = re.compile(r"(\d\d)(\d\d)(\d\d(?:\.\d*)?)", re.ASCII)
_ANGLE = re.compile(r"(\d{1,3})(\d\d(?:\.\d*)?)", re.ASCII)
_DATE = re.compile(r"(\d\d)(\d\d)(\d\d)", re.ASCII)

# FAA mode indicator (NMEA 2.3, 4.1) -> GGA quality.
_MODE_QUALITY = {"A": 1, "D": 2, "P": 3, "R": 4, "F": 5, "E": 6, "M": 7, "S": 8, "N": 0}
_MEASURED = frozenset({1, 2, 3, 4, 5, 6, 8})
"""7 is a position typed in by hand; 8 is a receiver fed by a signal simulator, as on a test bench."""


class SentenceError(ValueError):
    """A line that is no sound sentence; `kind` is 'checksum' or 'garbage'."""

    def __init__(self, kind: str, detail: str) -> None:
        super().__init__(f"{kind}: {detail}")
        self.kind = kind
        self.detail = detail


class NmeaReading(NamedTuple):
    """Values of one sentence, NaN or None where it has none. A named tuple: a drive has tens of thousands."""

    kind: str
    """RMC | GGA | VTG | ZDA | GST | GNS | GLL | PTPMSG | other"""
    checksummed: bool = True
    proprietary: bool = False
    time_of_day_s: float = NAN
    """UTC; 86400 up to 86401 within a leap second."""
    unix_day: int | None = None
    """Days since 1970-01-01."""
    valid: bool | None = None
    """True if the receiver declares its solution valid; None where this sentence does not state it."""
    latitude_deg: float = NAN
    longitude_deg: float = NAN
    altitude_m: float = NAN
    quality: int | None = None
    hdop: float = NAN
    speed_mps: float = NAN
    course_rad: float = NAN
    position_std_m: float = NAN
    """GST: root mean square of the latitude's and the longitude's standard deviation."""
    speed_std_mps: float = NAN
    """PTPMSG: standard deviation of the speed over ground."""
    out_of_range: str = ""
    """Name of the quantity that was impossible and was left out; empty if none."""


_of_values = partial(tuple.__new__, NmeaReading)


def decode_sentence(line: bytes) -> NmeaReading:
    """Return the reading of one line, of kind `other` for types that are not used. Raises `SentenceError`.

    Raises `SentenceError` for a wrong checksum ('checksum') or anything that is no sentence ('garbage').
    """
    values = None if compiled is None else compiled.decode(line, NAN)
    return _decode_by_fields(line) if values is None else _of_values(values)


def _decode_by_fields(line: bytes) -> NmeaReading:
    """Return the reading of any line by splitting it into fields. Raises `SentenceError`."""
    try:
        text = line.decode("ascii").strip()
    except UnicodeDecodeError:
        raise SentenceError("garbage", "bytes that are not ASCII") from None
    address = _ADDRESS.match(text)
    if address is None:
        raise SentenceError("garbage", f"no NMEA address in {text[:20]!r}")
    checksummed = "*" in text
    if checksummed:
        _verify_checksum(text)
    kind = address["kind"]
    if address["proprietary"] == ACCURACY and checksummed:
        return _decode_accuracy(text)
    if kind not in HANDLED:
        return NmeaReading(OTHER, checksummed, proprietary=address["proprietary"] is not None)
    if text[_HEAD - 1] != ",":
        raise SentenceError("garbage", f"{kind} has no fields")
    data = text[_HEAD:].partition("*")[0].split(",")
    if not checksummed and len(data) < _FULL_LENGTH[kind]:
        raise SentenceError("garbage", f"{kind} cut short: {len(data)} of {_FULL_LENGTH[kind]} fields")
    return _DECODERS[kind](_Fields(zip(COLUMNS[kind], map(str.strip, data), strict=False)), checksummed)


def _decode_accuracy(text: str) -> NmeaReading:
    """Return the reading of the proprietary sentence that states the speed's standard deviation."""
    fields = text.partition("*")[0].split(",")
    if len(fields) != 3:
        raise SentenceError("garbage", f"{ACCURACY} has {len(fields) - 1} fields, not 2")
    std = float(fields[2]) if _NUMBER.fullmatch(fields[2]) else NAN
    return NmeaReading(
        ACCURACY,
        proprietary=True,
        time_of_day_s=_time_of_day(fields[1]),
        speed_std_mps=std if 0.0 < std <= MAX_SPEED_MPS else NAN,
    )


def _verify_checksum(text: str) -> None:
    """Raise `SentenceError` if the checksum is cut short or wrong."""
    body, _, stated = text.partition("*")
    if stated not in _BYTES:
        raise SentenceError("garbage", f"checksum cut short in {text[-8:]!r}")
    computed = exclusive_or(body[1:].encode("ascii"))
    if computed != _BYTES[stated]:
        raise SentenceError("checksum", f"{text[1:6]} says {stated.upper()}, its bytes give {computed:02X}")


def exclusive_or(data: bytes) -> int:
    """Return the exclusive or of all bytes, by halves of one long number."""
    folded, half = int.from_bytes(data, "little"), 4 << max(len(data) - 1, 0).bit_length()
    while half >= 8:
        folded ^= folded >> half
        half >>= 1
    return folded & 0xFF


class _Fields(dict[str, str]):
    """A sentence's fields by name, as text; those that it does not have are empty."""

    def __missing__(self, name: str) -> str:
        return ""

    def number(self, name: str) -> float:
        """Return a field as a number; NaN if it is empty or none."""
        text = self[name]
        plain = text.replace(".", "", 1).isdigit()  # most numbers have no sign
        return float(text) if plain or (text and _NUMBER.fullmatch(text)) else NAN

    def time_of_day(self) -> float:
        return _time_of_day(self["timestamp"])

    def position(self) -> tuple[float, float, str]:
        """Return latitude and longitude, degrees, and the reason for which they are rejected, empty if they
        are not."""
        return _position(self["lat"], self["lat_dir"], self["lon"], self["lon_dir"])

    def altitude(self) -> float:
        """Return the altitude, m: above the ellipsoid if the geoid's separation is given, else above mean sea
        level."""
        height, separation = self.number("altitude_m"), self.number("geoid_separation_m")
        return height if math.isnan(separation) else height + separation

    def course(self, name: str) -> float:
        """Return a field in degrees as radians; NaN outside 0 to 360."""
        degrees = self.number(name)
        return math.radians(degrees % 360.0) if 0.0 <= degrees <= 360.0 else NAN


def _angle_deg(text: str, hemisphere: str, limit: float) -> float:
    """Return degrees and minutes with a hemisphere letter; NaN if empty, infinite if impossible."""
    match, sign = _ANGLE.fullmatch(text), _HEMISPHERES.get(hemisphere)
    if match is None or sign is None:
        return NAN
    minutes = float(match[2])
    angle = int(match[1]) + minutes / 60.0
    return sign * angle if minutes < 60.0 and angle <= limit else math.inf


# The sentences of an epoch say the same instant, day and place: what was converted last is kept.


@lru_cache(maxsize=_KEPT)
def _position(
    latitude: str, latitude_side: str, longitude: str, longitude_side: str
) -> tuple[float, float, str]:
    """Return latitude and longitude, degrees, and the reason for which they are rejected, empty if they are
    not."""
    latitude_deg = _angle_deg(latitude, latitude_side, 90.0)
    longitude_deg = _angle_deg(longitude, longitude_side, 180.0)
    if math.isinf(latitude_deg) or math.isinf(longitude_deg):
        return NAN, NAN, f"position {latitude},{longitude}"
    if math.isnan(latitude_deg) or math.isnan(longitude_deg):
        return NAN, NAN, ""
    return latitude_deg, longitude_deg, ""


@lru_cache(maxsize=_KEPT)
def _time_of_day(text: str) -> float:
    """Return the seconds of the day of hhmmss.ss; NaN if empty or impossible."""
    match = _TIME.fullmatch(text)
    if match is None:
        return NAN
    hour, minute, second = int(match[1]), int(match[2]), float(match[3])
    if hour > 23 or minute > 59 or second >= 61.0:
        return NAN
    return 3600.0 * hour + 60.0 * minute + second


def _checked_speed(mps: float) -> tuple[float, str]:
    """Return the speed, m/s, and an empty text; NaN and the reason for an impossible one."""
    if math.isnan(mps) or 0.0 <= mps <= MAX_SPEED_MPS:
        return mps, ""
    return NAN, f"speed {mps:.1f} m/s"


def unix_day(year: int, month: int, day: int) -> int | None:
    """Return days since 1970-01-01; None for a day that no calendar has."""
    try:
        return datetime.date(year, month, day).toordinal() - _UNIX_DAY_0
    except (ValueError, OverflowError):
        return None


@lru_cache(maxsize=_KEPT)
def _day_of_date(text: str) -> int | None:
    """Return the days since 1970-01-01 of a date ddmmyy; None if it is none."""
    match = _DATE.fullmatch(text)
    if match is None:
        return None
    year = int(match[3])
    # There was no GPS before 1980.
    return unix_day(year + (1900 if year >= 80 else 2000), int(match[2]), int(match[1]))


def _rmc(fields: _Fields, checksummed: bool) -> NmeaReading:
    status, mode = fields["status"].upper(), fields["mode"].upper()
    quality = _MODE_QUALITY.get(mode[:1], 1) if status == "A" else 0
    latitude, longitude, wrong = fields.position()
    speed, too_fast = _checked_speed(fields.number("speed_kn") * KNOT_MPS)
    return NmeaReading(
        "RMC",
        checksummed,
        time_of_day_s=fields.time_of_day(),
        unix_day=_day_of_date(fields["date"]),
        valid=quality in _MEASURED,
        latitude_deg=latitude,
        longitude_deg=longitude,
        quality=quality,
        speed_mps=speed,
        course_rad=fields.course("course_deg"),
        out_of_range=wrong or too_fast,
    )


def _gga(fields: _Fields, checksummed: bool) -> NmeaReading:
    text = fields["quality"]
    quality = int(text) if text.isascii() and text.isdigit() and len(text) == 1 else 0
    return _position_with_height("GGA", fields, checksummed, quality)


def _gns(fields: _Fields, checksummed: bool) -> NmeaReading:
    # One letter per satellite system; the best of them made the position.
    qualities = [_MODE_QUALITY.get(letter, 0) for letter in fields["mode"].upper()]
    quality = next((q for q in (4, 5, 3, 2, 1, 6, 8) if q in qualities), 0)
    return _position_with_height("GNS", fields, checksummed, quality)


def _position_with_height(kind: str, fields: _Fields, checksummed: bool, quality: int) -> NmeaReading:
    """Return the reading of GGA or GNS; they differ in how they state the quality."""
    latitude, longitude, wrong = fields.position()
    return NmeaReading(
        kind,
        checksummed,
        time_of_day_s=fields.time_of_day(),
        valid=quality in _MEASURED,
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=fields.altitude(),
        quality=quality,
        hdop=fields.number("hdop"),
        out_of_range=wrong,
    )


def _gll(fields: _Fields, checksummed: bool) -> NmeaReading:
    # Status is missing before NMEA 2.0.
    quality = _MODE_QUALITY.get(fields["mode"].upper()[:1], 1)
    if fields["status"].upper() == "V":
        quality = 0
    latitude, longitude, wrong = fields.position()
    return NmeaReading(
        "GLL",
        checksummed,
        time_of_day_s=fields.time_of_day(),
        valid=quality in _MEASURED,
        latitude_deg=latitude,
        longitude_deg=longitude,
        quality=quality,
        out_of_range=wrong,
    )


def _vtg(fields: _Fields, checksummed: bool) -> NmeaReading:
    mode = fields["mode"].upper()[:1]
    # km/h first: at the same number of decimals it is the finer unit.
    kmh, knots = fields.number("speed_kmh"), fields.number("speed_kn")
    speed, too_fast = _checked_speed(knots * KNOT_MPS if math.isnan(kmh) else kmh * KMH_MPS)
    quality = _MODE_QUALITY.get(mode)
    return NmeaReading(
        "VTG",
        checksummed,
        # Without a mode (before NMEA 2.3) it cannot say whether there is a solution.
        valid=None if quality is None else quality in _MEASURED,
        quality=quality,
        speed_mps=speed,
        course_rad=fields.course("course_deg"),
        out_of_range=too_fast,
    )


def _zda(fields: _Fields, checksummed: bool) -> NmeaReading:
    year, month, day = fields.number("year"), fields.number("month"), fields.number("day")
    known = not math.isnan(year + month + day) and 1980 <= year <= 9999
    return NmeaReading(
        "ZDA",
        checksummed,
        time_of_day_s=fields.time_of_day(),
        unix_day=unix_day(int(year), int(month), int(day)) if known else None,
    )


def _gst(fields: _Fields, checksummed: bool) -> NmeaReading:
    axes = [fields.number("latitude_std_m"), fields.number("longitude_std_m")]
    if math.isnan(axes[0] + axes[1]):
        axes = [fields.number("major_std_m"), fields.number("minor_std_m")]
    return NmeaReading(
        "GST",
        checksummed,
        time_of_day_s=fields.time_of_day(),
        position_std_m=math.sqrt((axes[0] ** 2 + axes[1] ** 2) / 2.0),
    )


_DECODERS = {"RMC": _rmc, "GGA": _gga, "GNS": _gns, "GLL": _gll, "VTG": _vtg, "ZDA": _zda, "GST": _gst}
