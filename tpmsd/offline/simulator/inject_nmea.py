"""A receiver's log with effects in it.

In: a log of NMEA sentences with or without the host's stamps, an `Injection`. Out: the log with other
positions, speeds, courses and stamps where effects act on them; every other byte stays what it was. A
checksum is written again only where its sentence changed. Lines that are damaged stay as they are.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tpmsd.car.physics.reading_change import FixChange
from tpmsd.foundation.errors import ConfigError
from tpmsd.offline.simulator.geodesy import radii_of_curvature
from tpmsd.offline.simulator.inject_can import copy_file, lines_of, open_for_writing
from tpmsd.offline.simulator.injection import Injection
from tpmsd.onboard.sources.gnss.nmea_log import bears_host_times, read_nmea_log

KNOT_MPS = 1852.0 / 3600.0
KMH_MPS = 1.0 / 3.6
STATIONARY_MPS = 0.3
"""Speed (m/s) below which a receiver's course is none, and is left alone."""
_STAMP = re.compile(rb"\s*\((\d{1,12})(?:\.(\d*))?\)", re.ASCII)
_SENTENCE = re.compile(rb"\$([A-Z0-9]{2}([A-Z]{3}),[^*$\r\n]*)(?:\*([0-9A-Fa-f]{2}))?")
_NUMBER = re.compile(rb"\d+(?:\.\d*)?", re.ASCII)


@dataclass(frozen=True)
class SentenceLayout:
    """Fields of a sentence by their number, 0 where it has none; its address is field 0."""

    latitude: int = 0
    longitude: int = 0
    knots: int = 0
    kmh: int = 0
    course: int = 0
    magnetic: int = 0
    needs: tuple[int, bytes] | None = None
    """A field, and what in it says that there is no fix."""


LAYOUTS = {
    b"RMC": SentenceLayout(latitude=3, longitude=5, knots=7, course=8, needs=(2, b"V")),
    b"GGA": SentenceLayout(latitude=2, longitude=4, needs=(6, b"0")),
    b"GNS": SentenceLayout(latitude=2, longitude=4),
    b"GLL": SentenceLayout(latitude=1, longitude=3, needs=(6, b"V")),
    b"VTG": SentenceLayout(course=1, magnetic=3, knots=5, kmh=7),
}


@dataclass
class NmeaRewriter:
    """Rewrites one log."""

    injection: Injection
    offset_s: float = 0.0
    """Offset added to the time of every line of a log without stamps, to be on the host's clock, s."""
    _left: dict[tuple[bytes, int], float] = field(default_factory=dict)
    """Remainder of rounding by sentence and field: it is added to the next one, so that changes below the
    last digit have their mean."""

    def rewrite(self, source: Path, target: Path) -> bool:
        """Write the log with the effects; return whether anything changed. Otherwise it is a copy.

        Raises:
            InputError: the log cannot be read.
            ConfigError: fixes cannot be later in a log that does not say when they came.
        """
        stamped = bears_host_times(source)
        later_s = self.injection.fix_age_s
        if later_s != 0.0 and not stamped:
            raise ConfigError(f"{source}: what delays fixes needs the host's stamps in front of the lines")
        times = {number: time_s + self.offset_s for time_s, _, number in read_nmea_log(source)}
        numbers = sorted(times)
        host_s = np.array([times[number] for number in numbers])
        change = self.injection.fix_changes(host_s)
        clock_s = self.injection.clock_error_s(host_s)
        index_of = {number: k for k, number in enumerate(numbers)}
        out: list[bytes] = []
        changed = False
        for number, line in enumerate(lines_of(source), 1):
            made = line
            if (k := index_of.get(number)) is not None:
                made = self._rewritten_sentence(line, _change_of_fix(change, k))
                if stamped and (shift := later_s + float(clock_s[k])) != 0.0:
                    made = _delay_stamp(made, shift)
            changed = changed or made != line
            out.append(made)
        if not changed:
            copy_file(source, target)
            return False
        with open_for_writing(target) as file:
            file.write(b"".join(out))
        return True

    def _rewritten_sentence(self, line: bytes, change: FixChange) -> bytes:
        """Return the line with position, speed and course changed and a new checksum; unchanged where its
        checksum is wrong.
        """
        found = list(_SENTENCE.finditer(line))
        if not found or found[-1][2] not in LAYOUTS:
            return line
        match, layout = found[-1], LAYOUTS[found[-1][2]]
        body, check = match[1], match[3]
        if check is not None and int(check, 16) != _nmea_checksum(body):
            return line
        fields = body.split(b",")
        if layout.needs is not None and _field_or_empty(fields, layout.needs[0]) == layout.needs[1]:
            return line
        self._change_position(match[2], fields, layout, change)
        self._change_velocity(match[2], fields, layout, change)
        made = b",".join(fields)
        if made == body:
            return line
        if check is not None:
            digits = f"{_nmea_checksum(made):02x}".encode("ascii")
            made += b"*" + (digits if check.lower() == check and check.upper() != check else digits.upper())
        return line[: match.start(1)] + made + line[match.end() :]

    def _change_position(
        self, kind: bytes, fields: list[bytes], layout: SentenceLayout, change: FixChange
    ) -> None:
        """Add the change of position to latitude and longitude."""
        if not layout.latitude or len(fields) <= layout.longitude + 1:
            return
        latitude, longitude = fields[layout.latitude], fields[layout.longitude]
        if not (_NUMBER.fullmatch(latitude) and _NUMBER.fullmatch(longitude)):
            return
        radians = math.radians(_minutes_of_arc(latitude) / 60.0)
        meridian, prime = radii_of_curvature(radians)
        north_minutes = 60.0 * math.degrees(float(change.north_m[0]) / float(meridian))
        east_minutes = 60.0 * math.degrees(float(change.east_m[0]) / (float(prime) * math.cos(radians)))
        for number, more, negative in (
            (layout.latitude, north_minutes, b"S"),
            (layout.longitude, east_minutes, b"W"),
        ):
            sign = -1.0 if fields[number + 1] == negative else 1.0
            fields[number] = self._add_minutes(kind, number, fields[number], sign * more)

    def _add_minutes(self, kind: bytes, number: int, text: bytes, more: float) -> bytes:
        """Return a latitude or longitude with `more` minutes of arc added, in as many digits."""
        if more == 0.0:
            return text
        whole, _, digits = text.partition(b".")
        step = 10 ** len(digits)
        units = round(_minutes_of_arc(text) * step)
        moved = max(units + self._round_with_remainder(kind, number, more * step), 0)
        degrees, rest = divmod(moved, 60 * step)
        minutes, part = divmod(rest, step)
        made = f"{degrees:0{max(len(whole) - 2, 1)}d}{minutes:02d}"
        return (made + (f".{part:0{len(digits)}d}" if digits else "")).encode("ascii")

    def _change_velocity(
        self, kind: bytes, fields: list[bytes], layout: SentenceLayout, change: FixChange
    ) -> None:
        """Change speed and course as vectors; the speed alone where no course is stated."""
        plain, acting = complex(change.plain_mps[0]), complex(change.acting_mps[0])
        if plain == acting:
            return
        units = ((layout.knots, KNOT_MPS), (layout.kmh, KMH_MPS))
        speeds = [
            (float(fields[number]) * unit, number, unit)
            for number, unit in units
            if number and _NUMBER.fullmatch(_field_or_empty(fields, number))
        ]
        if not speeds:
            return
        speed, course = speeds[0][0], _field_or_empty(fields, layout.course)
        if _NUMBER.fullmatch(course) and speed > STATIONARY_MPS:
            before = speed * np.exp(1j * math.radians(90.0 - float(course)))
            after = before + acting - plain
            faster = abs(after) - abs(before)
            turned = -math.degrees(float(np.angle(after / before)))
            for number in filter(None, (layout.course, layout.magnetic)):
                if _NUMBER.fullmatch(_field_or_empty(fields, number)):
                    fields[number] = self._add_to_number(kind, number, fields[number], turned, 360.0)
        else:
            faster = abs(acting) - abs(plain)
        for _, number, unit in speeds:
            fields[number] = self._add_to_number(kind, number, fields[number], faster / unit)

    def _add_to_number(
        self, kind: bytes, number: int, text: bytes, more: float, around: float = math.inf
    ) -> bytes:
        """Return a number's text with `more` added, in as many digits; it stays at or above 0, or modulo
        `around`.
        """
        if more == 0.0:
            return text
        whole, _, digits = text.partition(b".")
        step = 10 ** len(digits)
        units = round(float(text) * step)
        moved = units + self._round_with_remainder(kind, number, more * step)
        moved = max(moved, 0) if math.isinf(around) else moved % round(around * step)
        if moved == units:
            return text
        first, part = divmod(moved, step)
        padded = len(whole) if whole.startswith(b"0") and len(whole) > 1 else 1
        return (f"{first:0{padded}d}" + (f".{part:0{len(digits)}d}" if digits else "")).encode("ascii")

    def _round_with_remainder(self, kind: bytes, number: int, steps: float) -> int:
        """Return the steps as a whole number; the rounding error is carried over to the next call for this
        field.
        """
        wanted = steps + self._left.get((kind, number), 0.0)
        made = round(wanted)
        self._left[kind, number] = wanted - made
        return made


def _change_of_fix(change: FixChange, k: int) -> FixChange:
    """Return the change of the k-th fix alone."""
    one = slice(k, k + 1)
    return FixChange(change.east_m[one], change.north_m[one], change.plain_mps[one], change.acting_mps[one])


def _delay_stamp(line: bytes, later_s: float) -> bytes:
    """Return the line with its stamp `later_s` later, in as many digits."""
    match = _STAMP.match(line)
    if match is None:
        return line
    digits = match[2] or b""
    step = 10 ** len(digits)
    units = int(match[1] + digits) + round(later_s * step)
    whole, part = divmod(units, step)
    stamp = f"{whole}" + (f".{part:0{len(digits)}d}" if digits else "")
    end = match.end(2) if match[2] is not None else match.end(1)
    return line[: match.start(1)] + stamp.encode("ascii") + line[end:]


def _minutes_of_arc(text: bytes) -> float:
    """Return the minutes of arc of `ddmm.mmm`."""
    whole, _, digits = text.partition(b".")
    return 60.0 * int(whole[:-2] or b"0") + float(whole[-2:] + b"." + (digits or b"0"))


def _field_or_empty(fields: list[bytes], number: int) -> bytes:
    return fields[number] if 0 < number < len(fields) else b""


def _nmea_checksum(body: bytes) -> int:
    check = 0
    for byte in body:
        check ^= byte
    return check
