"""Arrays as the frames and sentences of a car, so that tables go through the very core that recordings do.

In: `Signals`. Out: `Encoded`: CAN frames, NMEA sentences, and the DBC that decodes them. Nothing is lost that
matters: angles are counted in millionths of a turn, inertial signals are IEEE 754 doubles, positions have
1e-8 minutes (0.02 mm). Stamps are rounded to a microsecond, as logs have them. Pure.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.tables.roles import INERTIAL_UNITS
from tpmsd.offline.tables.signals import Fixes, SignalReadings, Signals
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import Sentence

COUNTS_PER_REV = 1_000_000
"""Counts of an angle's turn: six micrometres of road, and 32 bits last for 4,294 turns."""
FIRST_WHEEL_ID, FIRST_INERTIAL_ID = 0x100, 0x200
UTC_BASE_S = 1_700_000_000.0
"""Offset added to times that start near zero, s: NMEA has no dates before 1980."""
FIRST_NMEA_S = 315_964_800.0
"""1980-01-06, the first day of GPS."""
CHANNEL = "can0"
KNOT_MPS = 1852.0 / 3600.0
_MODES = {1: "A", 2: "D", 3: "P", 4: "R", 5: "F", 6: "E", 8: "S"}


@dataclass(frozen=True)
class Encoded:
    """Drive as the frames of a bus and the sentences of a receiver."""

    items: tuple[CanFrame | Sentence, ...]
    """Frames and sentences in the order of their stamps."""
    dbc: str
    signals: dict[str, str]
    """Role -> 'Message.Signal'."""
    counts_per_rev: float | None
    """Counts per revolution of the angles; None where the table had counts: then the configured teeth
    hold."""


def encode(signals: Signals) -> Encoded:
    """Return the signals as CAN frames and NMEA sentences, with their DBC."""
    items: list[CanFrame | Sentence] = []
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", "BU_: CAR", ""]
    roles: dict[str, str] = {}
    counted = bool(signals.counts)
    counts_per_rev = None if counted else signals.counts_per_rev or COUNTS_PER_REV
    scale = 1.0 if counts_per_rev is None else counts_per_rev / (2.0 * math.pi)
    wheels = signals.counts if counted else signals.angles
    for k, wheel in enumerate(WHEELS):
        if wheel not in wheels:
            continue
        name = f"WHEEL_{wheel.upper()}"
        lines += [f"BO_ {FIRST_WHEEL_ID + k} {name}: 4 CAR", ' SG_ COUNT : 0|32@1+ (1,0) [0|0] "" CAR', ""]
        roles[f"wheel_count_{wheel}"] = f"{name}.COUNT"
        items += _counter_frames(wheels[wheel].finite(), FIRST_WHEEL_ID + k, scale)
    doubles = []
    for k, (role, unit) in enumerate(INERTIAL_UNITS.items()):
        if role not in signals.inertial:
            continue
        name, identifier = role.upper(), FIRST_INERTIAL_ID + k
        lines += [f"BO_ {identifier} {name}: 8 CAR", f' SG_ VALUE : 0|64@1- (1,0) [0|0] "{unit}" CAR', ""]
        doubles.append(f"SIG_VALTYPE_ {identifier} VALUE : 2;")
        roles[role] = f"{name}.VALUE"
        items += _double_frames(signals.inertial[role].finite(), identifier)
    if signals.fixes is not None:
        items += _sentences(signals.fixes)
    items.sort(key=lambda item: item.time_s)  # stable: what bears one stamp stays in this order
    dbc = "\n".join([*lines, *doubles, ""])
    return Encoded(tuple(items), dbc, roles, None if counts_per_rev is None else float(counts_per_rev))


def _counter_frames(series: SignalReadings, identifier: int, scale: float) -> Iterator[CanFrame]:
    counts = np.rint(series.value * scale).astype(np.int64) & 0xFFFFFFFF
    for time_s, count in zip(_rounded_times(series), counts.tolist(), strict=True):
        yield _can_frame(time_s, identifier, int(count).to_bytes(4, "little"))


def _double_frames(series: SignalReadings, identifier: int) -> Iterator[CanFrame]:
    for time_s, value in zip(_rounded_times(series), series.value.tolist(), strict=True):
        yield _can_frame(time_s, identifier, struct.pack("<d", value))


def _rounded_times(series: SignalReadings) -> list[float]:
    return [round(time_s, 6) for time_s in series.time_s.tolist()]


def _can_frame(time_s: float, identifier: int, data: bytes) -> CanFrame:
    return CanFrame(time_s, CHANNEL, identifier, False, False, False, False, data)


def _sentences(fixes: Fixes) -> Iterator[Sentence]:
    """Yield RMC, GGA and GST of each fix; none for a fix without a time."""
    base = utc_base_s(fixes)
    number = 0
    for k in range(len(fixes)):
        arrival_s, utc_s = float(fixes.arrival_s[k]), float(fixes.utc_s[k]) + base
        if not math.isfinite(arrival_s + utc_s):
            continue
        for body in _sentence_bodies(fixes, k, utc_s):
            number += 1
            check = 0
            for byte in body.encode("ascii"):
                check ^= byte
            yield Sentence(round(arrival_s, 6), f"${body}*{check:02X}".encode("ascii"), number)


def utc_base_s(fixes: Fixes) -> float:
    """Return the offset, s, that makes the receiver's times dates that NMEA can state; 0 where they are."""
    known = fixes.utc_s[np.isfinite(fixes.utc_s)]
    return UTC_BASE_S if known.size and float(known.min()) < FIRST_NMEA_S else 0.0


def _sentence_bodies(fixes: Fixes, k: int, utc_s: float) -> Iterator[str]:
    clock, date = _nmea_clock(utc_s)
    latitude, longitude = float(fixes.latitude_deg[k]), float(fixes.longitude_deg[k])
    placed = math.isfinite(latitude + longitude)
    given = float(fixes.quality[k])
    quality = int(given) if math.isfinite(given) else int(placed or math.isfinite(float(fixes.speed_mps[k])))
    position = f"{_nmea_angle(latitude, 2, 'NS')},{_nmea_angle(longitude, 3, 'EW')}" if placed else ",,,"
    speed = _nmea_number(float(fixes.speed_mps[k]) / KNOT_MPS, 6)
    course = _nmea_number(math.degrees(float(fixes.course_rad[k])) % 360.0, 6)
    status, mode = ("A", _MODES.get(quality, "A")) if quality else ("V", "N")
    yield f"GNRMC,{clock},{status},{position},{speed},{course},{date},,,{mode}"
    hdop, altitude = _nmea_number(float(fixes.hdop[k]), 3), _nmea_number(float(fixes.altitude_m[k]), 4)
    yield f"GNGGA,{clock},{position},{quality if placed else 0},,{hdop},{altitude},M,0.0,M,,"
    std = _nmea_number(float(fixes.position_std_m[k]), 4)
    if std:
        yield f"GNGST,{clock},{std},{std},{std},0.0,{std},{std},{std}"


def _nmea_clock(utc_s: float) -> tuple[str, str]:
    """Return hhmmss.ssssss and ddmmyy."""
    micros = round(utc_s * 1e6)
    day, micros = divmod(micros, 86_400_000_000)
    seconds, micros = divmod(micros, 1_000_000)
    date = np.datetime64(day, "D").item()
    hms = f"{seconds // 3600:02d}{seconds // 60 % 60:02d}{seconds % 60:02d}"
    return f"{hms}.{micros:06d}", f"{date.day:02d}{date.month:02d}{date.year % 100:02d}"


def _nmea_angle(degrees: float, width: int, hemispheres: str) -> str:
    units = round(abs(degrees) * 60 * 1e8)
    whole, minutes = divmod(units, 6_000_000_000)
    hemisphere = hemispheres[0] if degrees >= 0 else hemispheres[1]
    return f"{whole:0{width}d}{minutes // 100_000_000:02d}.{minutes % 100_000_000:08d},{hemisphere}"


def _nmea_number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else ""
