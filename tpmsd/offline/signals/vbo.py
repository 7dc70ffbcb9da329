"""Racelogic VBO files as tables of signals.

In: a text file with sections `[header]`, `[channel units]`, `[column names]`, `[data]`: latitude and
longitude in minutes with west positive, time as HHMMSS.ss of UTC, speed in km/h, heading clockwise from
north. Out: columns of a table of signals in SI units and ISO 8855 axes; InputError in one line where it is
none.

Loggers write turn rates and accelerations with either sign, so the sign is taken from the recording: yaw rate
and steering by the rate of the course, lateral acceleration by speed times that rate, longitudinal
acceleration by the rate of the speed. A channel that does not follow any of these is left out.
"""

from __future__ import annotations

import codecs
import math
import re
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

import numpy as np

from tpmsd.foundation.english import counted
from tpmsd.foundation.errors import InputError
from tpmsd.foundation.text_file import opened
from tpmsd.foundation.wheels import FloatArray

Note = Callable[[str], None]
LARGEST_BYTES = 500_000_000
LONGEST_LINE = 16_384
MAX_COLUMNS = 500
MAX_VALUES = 20_000_000
"""Numbers kept of a file: 160 MB."""
MAX_HEAD_LINES = 20_000
FOLLOWS = 0.4
"""Least correlation by which a channel's sign is determined."""
SLOWEST_MPS = 5.0
"""Slower, the course tells nothing."""
SMOOTH_S = 0.5
G_MPS2 = 9.80665
_DATE = re.compile(r"created on\s+(\d{1,2})/(\d{1,2})/(\d{4})", re.IGNORECASE)
_UNITS = {
    "deg/s": math.pi / 180.0,
    "°/s": math.pi / 180.0,
    "rad/s": 1.0,
    "g": G_MPS2,
    "m/s2": 1.0,
    "m/s^2": 1.0,
    "m/s²": 1.0,
    "deg": math.pi / 180.0,
    "degrees": math.pi / 180.0,
    "°": math.pi / 180.0,
    "rad": 1.0,
    "km/h": 1.0 / 3.6,
    "kmh": 1.0 / 3.6,
    "kph": 1.0 / 3.6,
    "mph": 0.44704,
    "knots": 1852.0 / 3600.0,
    "m/s": 1.0,
    "m": 1.0,
    "metres": 1.0,
}


@dataclass(frozen=True)
class _ColumnRule:
    """Rule by which a column of the table is found in a file."""

    names: re.Pattern[str]
    """Pattern of the name in lower case without blanks, dots, underscores and hyphens."""
    units: tuple[str, ...]
    """Those it may have; the first where none is stated."""


_TURN = ("deg/s", "°/s", "rad/s")
_ACCELERATION = ("g", "m/s2", "m/s^2", "m/s²")
_ANGLE = ("deg", "degrees", "°", "rad")
_CHANNELS = {
    "gnss_speed_mps": _ColumnRule(
        re.compile(r"velocity(kmh|knots|mph|ms)?|speed"), ("km/h", "knots", "mph", "m/s")
    ),
    "gnss_course_rad": _ColumnRule(re.compile(r"heading|course"), _ANGLE),
    "gnss_altitude_m": _ColumnRule(re.compile(r"height|altitude"), ("m", "metres")),
    "yaw_rate_radps": _ColumnRule(re.compile(r"(imu)?yawrate|zrate|gyroz"), _TURN),
    "accel_long_mps2": _ColumnRule(
        re.compile(r"longacc(el)?|longitudinalacc(el(eration)?)?|(imu)?x(accel|acc)|accx"),
        _ACCELERATION,
    ),
    "accel_lat_mps2": _ColumnRule(
        re.compile(r"latacc(el)?|lateralacc(el(eration)?)?|(imu)?y(accel|acc)|accy"),
        _ACCELERATION,
    ),
    "steering_wheel_angle_rad": _ColumnRule(re.compile(r"steer(ing)?(wheel)?(angle|ang)?|swa"), _ANGLE),
}
_SIGNED = ("yaw_rate_radps", "accel_long_mps2", "accel_lat_mps2", "steering_wheel_angle_rad")
_TIME, _LATITUDE, _LONGITUDE, _SATELLITES = "time", "lat", "long", "sats"
_SIMILAR_NAMES = {
    "latitude": _LATITUDE,
    "longitude": _LONGITUDE,
    "lon": _LONGITUDE,
    "satellites": _SATELLITES,
}


@dataclass(frozen=True)
class VboTable:
    """Columns of a Racelogic VBO file in SI units, and their names in the file."""

    columns: dict[str, FloatArray]
    """(n,) each, NaN where there is no value; rows in the order of time."""
    sources: dict[str, str]
    """The file's own name of each column."""


@dataclass
class _Head:
    """The sections before the data."""

    date: datetime | None = None
    sections: dict[str, list[str]] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """Names of the columns in their order; the short ones where there are any."""
        short = " ".join(self.sections.get("column names", [])).split()
        return short or [line.split("(")[0].strip() for line in self.sections.get("header", [])]

    def units(self, count: int) -> list[str]:
        """Return the stated unit of each column, empty where there is none: those of `[channel units]` belong
        to the last columns.
        """
        stated = [line.strip().lower() for line in self.sections.get("channel units", [])]
        long = [line.strip().lower().split(" ") for line in self.sections.get("header", [])]
        out = [""] * count
        if len(long) == count:
            out = [words[-1] if len(words) > 1 and words[-1] in _UNITS else "" for words in long]
        if len(stated) <= count:
            out[count - len(stated) :] = [
                unit if unit in _UNITS else before
                for unit, before in zip(stated, out[count - len(stated) :], strict=True)
            ]
        return out


def read_vbo(path: Path, note: Note) -> VboTable:
    """Return the table of a VBO file; lines that cannot be read are skipped, and their number passed to
    `note`.

    Raises InputError where the file cannot be read, has no section `[data]`, no time, or no usable row.
    """
    try:
        with opened(path) as file:
            lines = _numbered_lines(path, file)
            head = _read_head(path, lines)
            names = head.names
            indices = _column_indices(path, names)
            values = _read_rows(path, lines, len(names), sorted(set(indices.values())), note)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror or error}") from None
    at = {column: k for k, column in enumerate(sorted(set(indices.values())))}
    raw = {name: values[:, at[index]] for name, index in indices.items()}
    units = head.units(len(names))
    time_s = _times(raw[_TIME], head.date)
    good = np.isfinite(time_s)
    if good.sum() < 2:
        raise InputError(path, "fewer than two rows with a time")
    columns = {"time_s": time_s, **_positions(raw)}
    if head.date is not None:
        columns["gnss_utc_s"] = time_s
    sources = {"time_s": names[indices[_TIME]]}
    for column, channel in _CHANNELS.items():
        if column in indices:
            unit = units[indices[column]]
            scale = _UNITS[unit if unit in channel.units else channel.units[0]]
            columns[column] = raw[column] * scale
            sources[column] = names[indices[column]]
    columns = {name: taken[good] for name, taken in columns.items()}
    _apply_signs(columns, sources, path, note)
    return VboTable(columns, {name: source for name, source in sources.items() if name in columns})


def _numbered_lines(path: Path, file: BinaryIO) -> Iterator[tuple[int, str]]:
    """Yield number and text of each line; InputError for a file or a line that is too long, or has NUL
    bytes.
    """
    total = 0
    for number in range(1, 1 << 62):
        line = file.readline(LONGEST_LINE)
        total += len(line)
        if not line:
            return
        if total > LARGEST_BYTES:
            raise InputError(path, f"longer than {LARGEST_BYTES // 1_000_000} MB")
        if len(line) == LONGEST_LINE or b"\0" in line:
            raise InputError(path, "no VBO file: a line that is no text", number)
        text = line.removeprefix(codecs.BOM_UTF8) if number == 1 else line
        yield number, text.decode("latin-1").strip()


def _read_head(path: Path, lines: Iterator[tuple[int, str]]) -> _Head:
    """Return the sections up to `[data]`."""
    head, section = _Head(), ""
    for number, line in lines:
        if number > MAX_HEAD_LINES:
            break
        if line.startswith("[") and line.endswith("]"):
            section = line[1:-1].strip().lower()
            if section == "data":
                return head
        elif line and section:
            head.sections.setdefault(section, []).append(line)
        elif found := _DATE.search(line):
            day, month, year = map(int, found.groups())
            try:
                head.date = datetime(year, month, day, tzinfo=UTC)
            except ValueError:
                head.date = None
    raise InputError(path, "no VBO file: it has no section [data]")


def _column_indices(path: Path, names: list[str]) -> dict[str, int]:
    """Return the column index of each quantity; InputError without time, or with too many columns."""
    if len(names) > MAX_COLUMNS:
        raise InputError(path, f"{len(names)} columns; at most {MAX_COLUMNS} are read")
    found: dict[str, int] = {}
    for index, name in enumerate(names):
        plain = re.sub(r"[\s._-]+", "", name.lower())
        plain = _SIMILAR_NAMES.get(plain, plain)
        if plain in (_TIME, _LATITUDE, _LONGITUDE, _SATELLITES):
            found.setdefault(plain, index)
            continue
        stem = re.sub(r"(g|deg|kmh|m)$", "", plain) if plain.startswith(("lat", "long", "height")) else plain
        for column, channel in _CHANNELS.items():
            if channel.names.fullmatch(plain) or channel.names.fullmatch(stem):
                found.setdefault(column, index)
    if _TIME not in found:
        raise InputError(path, "no VBO file: no column time in [column names] or [header]")
    return found


def _read_rows(
    path: Path, lines: Iterator[tuple[int, str]], width: int, kept: list[int], note: Note
) -> FloatArray:
    """Return the kept columns of `[data]`, (n, k); lines that cannot be read are skipped."""
    values = array("d")
    bad, first = 0, ""
    for number, line in lines:
        if not line:
            continue
        if line.startswith("["):
            break
        words = line.split()
        try:
            if len(words) != width:
                raise ValueError(f"{len(words)} values, {width} columns")
            values.extend([float(words[index]) for index in kept])
        except ValueError as error:
            values = values[: len(values) // len(kept) * len(kept)]
            bad, first = bad + 1, first or f"{path}:{number}: {str(error)[:80]}"
        if len(values) > MAX_VALUES:
            raise InputError(path, f"more than {MAX_VALUES // len(kept)} rows", number)
    if not values:
        raise InputError(path, f"no row that can be read{f', first {first}' if first else ''}")
    if bad:
        note(f"{counted(bad, 'bad line')} skipped, first {first}")
    return np.frombuffer(values, dtype=np.float64).reshape(-1, len(kept)).copy()


def _times(clock: FloatArray, date: datetime | None) -> FloatArray:
    """Return HHMMSS.ss as seconds, of the Unix epoch where the day is known; continuous over midnight.

    NaN where the digits are no time of day.
    """
    known = np.isfinite(clock) & (clock >= 0.0) & (clock < 240_000.0)
    clean = np.where(known, clock, 0.0)
    hours, minutes = np.floor(clean / 1e4), np.floor(clean / 1e2) % 100.0
    seconds = clean - 1e4 * hours - 1e2 * minutes
    known &= (minutes < 60.0) & (seconds < 61.0)
    day_s = np.where(known, 3600.0 * hours + 60.0 * minutes + seconds, np.nan)
    good = np.flatnonzero(known)
    back = np.diff(day_s[good]) < -43_200.0
    out = day_s.copy()
    out[good[1:]] += 86_400.0 * np.cumsum(back)
    return np.asarray(out + (0.0 if date is None else date.timestamp()))


def _positions(raw: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """Return latitude and longitude in degrees with east positive, and the quality of the fix.

    NaN where there are no satellites, or the value is none of the globe. The upper bits of the number of
    satellites are the brake trigger's and the differential correction's.
    """
    if _LATITUDE not in raw or _LONGITUDE not in raw:
        return {}
    latitude, longitude = raw[_LATITUDE] / 60.0, -raw[_LONGITUDE] / 60.0
    good = (np.abs(latitude) <= 90.0) & (np.abs(longitude) <= 180.0)
    good &= (latitude != 0.0) | (longitude != 0.0)
    if _SATELLITES in raw:
        satellites = raw[_SATELLITES]
        good &= np.where(np.isfinite(satellites), np.nan_to_num(satellites) % 64.0, 0.0) >= 3.0
    return {
        "gnss_latitude_deg": np.where(good, latitude, np.nan),
        "gnss_longitude_deg": np.where(good, longitude, np.nan),
        "gnss_quality": good.astype(np.float64),
    }


def _apply_signs(columns: dict[str, FloatArray], sources: dict[str, str], path: Path, note: Note) -> None:
    """Give each inertial channel the sign of ISO 8855; remove those whose sign the drive does not show."""
    signed = [name for name in _SIGNED if name in columns]
    known = "gnss_speed_mps" in columns and "gnss_course_rad" in columns
    for name in signed:
        sign = _sign_by_motion(columns, name) if known else 0
        if sign == 0:
            del columns[name]
            note(f"{path}: {sources[name]} is left out: the drive does not tell its sign")
        elif sign < 0:
            columns[name] = -columns[name]
            note(f"{path}: {sources[name]} is turned round: x forward, y left")


def _sign_by_motion(columns: dict[str, FloatArray], name: str) -> int:
    """Return the sign of a channel's correlation with the receiver's motion, 1 or -1; 0 where it is
    too weak.
    """
    time, order = np.unique(columns["time_s"], return_index=True)
    speed, course, own = (columns[key][order] for key in ("gnss_speed_mps", "gnss_course_rad", name))
    use = np.isfinite(speed) & np.isfinite(course)
    if use.sum() < 20:
        return 0
    turned = np.interp(time, time[use], np.unwrap(course[use]))
    speed = np.interp(time, time[use], speed[use])
    later, before = time + SMOOTH_S / 2, time - SMOOTH_S / 2
    left = -(np.interp(later, time, turned) - np.interp(before, time, turned)) / SMOOTH_S
    ahead = (np.interp(later, time, speed) - np.interp(before, time, speed)) / SMOOTH_S
    expected = {"accel_long_mps2": ahead, "accel_lat_mps2": speed * left}.get(name, left)
    good = np.isfinite(own) & (speed > SLOWEST_MPS)
    if good.sum() < 20 or own[good].std() == 0.0 or expected[good].std() == 0.0:
        return 0
    correlation = float(np.corrcoef(own[good], expected[good])[0, 1])
    return 0 if not abs(correlation) >= FOLLOWS else 1 if correlation > 0.0 else -1


CAR_TEMPLATE = """\
# The car of this recording. tpmsd diagnose --baseline single-track and tpmsd replay --vehicle-state need
# the values below; take away the marks and fill them in.
[vehicle]
# steering_ratio = 15.0
# track_front_m = 1.5
# track_rear_m = 1.5
# driven_axle = "front"

[dynamics]
# mass_kg = 1500.0
# yaw_inertia_kgm2 = 2500.0
# cg_to_front_m = 1.2
# cg_to_rear_m = 1.5
# cornering_stiffness_front_n_per_rad = 110000.0
# cornering_stiffness_rear_n_per_rad = 130000.0
"""
