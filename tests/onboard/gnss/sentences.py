"""Writes sentences for the tests, on its own terms: nothing of the code under test is used."""

from __future__ import annotations

import datetime
import functools
import operator

KNOT = 1852.0 / 3600.0


def nmea(body: str) -> bytes:
    """`$body*hh`."""
    return f"${body}*{functools.reduce(operator.xor, body.encode(), 0):02X}".encode()


def clock(utc_s: float) -> str:
    at = datetime.datetime.fromtimestamp(round(utc_s, 3), tz=datetime.UTC)
    return at.strftime("%H%M%S.") + f"{round(at.microsecond / 1000):03d}"


def date(utc_s: float) -> str:
    return datetime.datetime.fromtimestamp(round(utc_s, 3), tz=datetime.UTC).strftime("%d%m%y")


def angle(degrees: float, width: int, letters: str) -> str:
    whole = int(abs(degrees))
    return f"{whole:0{width}d}{(abs(degrees) - whole) * 60:010.7f},{letters[degrees < 0]}"


def place(latitude: float, longitude: float) -> str:
    return f"{angle(latitude, 2, 'NS')},{angle(longitude, 3, 'EW')}"


def rmc(
    utc_s: float,
    *,
    at: tuple[float, float] = (48.0, 11.0),
    speed_mps: float | None = 20.0,
    course_deg: float | None = 90.0,
    status: str = "A",
    mode: str = "A",
    talker: str = "GN",
) -> bytes:
    knots = "" if speed_mps is None else f"{speed_mps / KNOT:.6f}"
    course = "" if course_deg is None else f"{course_deg:.2f}"
    return nmea(f"{talker}RMC,{clock(utc_s)},{status},{place(*at)},{knots},{course},{date(utc_s)},,,{mode}")


def gga(
    utc_s: float,
    *,
    at: tuple[float, float] = (48.0, 11.0),
    quality: int | str = 1,
    hdop: float | str = 0.9,
    altitude: float | str = 500.0,
    separation: float | str = 47.5,
    talker: str = "GN",
) -> bytes:
    return nmea(f"{talker}GGA,{clock(utc_s)},{place(*at)},{quality},12,{hdop},{altitude},M,{separation},M,,")


def vtg(speed_mps: float, *, course_deg: float | None = None, mode: str = "A", talker: str = "GN") -> bytes:
    course = "" if course_deg is None else f"{course_deg:.2f}"
    return nmea(f"{talker}VTG,{course},T,,M,{speed_mps / KNOT:.5f},N,{speed_mps * 3.6:.5f},K,{mode}")


def zda(utc_s: float) -> bytes:
    at = datetime.datetime.fromtimestamp(round(utc_s, 3), tz=datetime.UTC)
    return nmea(f"GNZDA,{clock(utc_s)},{at.day:02d},{at.month:02d},{at.year},00,00")


def gst(utc_s: float, latitude_std: float | str, longitude_std: float | str) -> bytes:
    return nmea(f"GNGST,{clock(utc_s)},1.0,2.0,1.0,45.0,{latitude_std},{longitude_std},2.5")
