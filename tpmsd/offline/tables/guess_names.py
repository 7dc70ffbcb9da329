"""Meaning of a column's name: its words, its unit, and the roles it may have.

In: the names of a table's columns. Out: name -> `ParsedName` (words and unit), and (role, weight) pairs.
Pure.
"""

from __future__ import annotations

import itertools
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from tpmsd.car.config.units import canonical_unit
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.tables.roles import SUFFIXES, TIME_UNITS

WHEEL = "wheel"
"""Kind of a column of one wheel, before its values tell angle, speed or count."""
_UNIT = re.compile(r"[\[({]\s*([^\[\](){}]*?)\s*[\])}]\s*$")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_POSITIONS = {
    "fl": ("fl", "lf", "vl"),
    "fr": ("fr", "rf", "vr"),
    "rl": ("rl", "lr", "hl", "bl"),
    "rr": ("rr", "hr", "br"),
}
"""Wheels as makers spell them, German ones too (vorn and hinten, links and rechts)."""
_FRONT, _REAR = {"front", "f", "v", "vorn", "vorne"}, {"rear", "r", "h", "hinten", "back"}
_LEFT, _RIGHT = {"left", "l", "links"}, {"right", "r", "rechts"}


def _word_set(text: str) -> frozenset[str]:
    """Return the set of the words in a text."""
    return frozenset(text.split())


_WHEEL_WORDS = _word_set(
    "wheel wheels whl wss abs speed spd v vel velocity omega w rpm count counts cnt pulse pulses tick ticks "
    "edge edges encoder enc angle ang rotation rad kmh kph"
)
_NO_WHEEL_MOTION = _word_set(
    "pressure press druck temp temperature torque brake slip height suspension damper load force status "
    "valid std sigma state error radius deviation change steering steer"
)
_RECEIVER = _word_set("gps gnss rtk ins receiver novatel ublox sat nmea")
_EXACT: tuple[tuple[str, frozenset[str], frozenset[str]], ...] = tuple(
    (role, _word_set(some), _word_set(none))
    for role, some, none in (
        ("gnss_latitude", "latitude lat breite", "acc accel acceleration ay std"),
        ("gnss_longitude", "longitude lon lng laenge", "acc accel acceleration ax std"),
        ("gnss_altitude", "altitude alt elevation height hoehe", "std ride"),
        ("gnss_hdop", "hdop", ""),
        ("gnss_quality", "quality fixq", "std"),
        ("gnss_position_std", "hacc epx eph sdn sde accuracy", "speed course"),
        ("gnss_utc", "utc unix", "hour minute"),
        ("gnss_course", "course cog track", "error std width"),
        ("gnss_heading", "heading hdg", "error std"),
        ("gnss_speed", "sog groundspeed", "std"),
        ("gnss_east", "east easting", "vel speed v std"),
        ("gnss_north", "north northing", "vel speed v std"),
        ("yaw_rate", "yawrate gyroz wz omegaz psidot gierrate", "std"),
        ("accel_long", "ax accx accelx along", "std"),
        ("accel_lat", "ay accy accely alat", "std"),
        ("steering_wheel_angle", "swa steering steer steeringangle lenkwinkel lw", "rate speed torque dot"),
        ("brake_pressure", "brakepressure pbrake bremsdruck mcp", ""),
        ("drive_torque", "torque drehmoment moment", "steering steer brake limit demand max min"),
        ("ambient_temp", "ambient outside oat aussentemperatur", ""),
    )
)
"""Role, words of which one is enough, words that speak against it."""
_PAIRS: tuple[tuple[str, frozenset[str], frozenset[str]], ...] = tuple(
    (role, _word_set(one), _word_set(other))
    for role, one, other in (
        ("yaw_rate", "yaw psi", "rate dot vel velocity speed"),
        ("yaw_rate", "gyro angular omega", "z yaw"),
        ("accel_long", "accel acc acceleration a", "x long longitudinal forward"),
        ("accel_lat", "accel acc acceleration a", "y lat lateral"),
        ("brake_pressure", "brake bremse", "pressure press druck"),
        ("gnss_position_std", "pos position horizontal h", "std sigma accuracy acc"),
        ("gnss_speed", "gps gnss rtk ins receiver nmea ground", "speed spd vel velocity v"),
        ("gnss_altitude", "gps gnss rtk ins", "h z"),
        ("gnss_quality", "fix", "quality type mode status"),
        ("ambient_temp", "ambient outside outdoor air", "temp temperature"),
    )
)
"""Role, and two sets of words of each of which one is needed."""


@dataclass(frozen=True)
class ParsedName:
    """A column's name taken apart."""

    words: tuple[str, ...]
    unit: str | None = None
    """Unit that the name has: `km/h` of `v [km/h]` and of `v_kmh`."""


def parse_name(name: str) -> ParsedName:
    """Return the words of a name in lower case, and the unit in brackets or as its last part; None where it
    has none.
    """
    unit = None
    bracket = _UNIT.search(name)
    if bracket is not None and _known_unit(bracket[1]) is not None:
        unit, name = _known_unit(bracket[1]), name[: bracket.start()]
    words = [word.lower() for word in _WORD.findall(name)]
    for size in (2, 1):
        suffix = "".join(words[-size:])
        if unit is None and len(words) > size and suffix in SUFFIXES and len(suffix) > 1:
            unit, words = SUFFIXES[suffix], words[:-size]
    if unit is None and len(words) > 1 and name.endswith(("_s", "_m", "_g", "_k")):
        unit, words = SUFFIXES[words[-1]], words[:-1]
    return ParsedName(tuple(words), unit)


def _known_unit(text: str) -> str | None:
    """Return the canonical name of a unit; None for an unknown one."""
    return text if text in (*TIME_UNITS, "kn") else canonical_unit(text)


def time_weight(one: ParsedName) -> int:
    """Return how well a name fits a table's time: 3 if it is the word alone, 2 if the word is among others, 0
    if not at all.
    """
    times = {"time", "t", "timestamp", "timestamps", "zeit", "ts", "stamp"}
    if not times & set(one.words):
        return 0
    return 3 if len(one.words) == 1 else 1 if _RECEIVER & set(one.words) else 2


def roles_by_name(names: Sequence[str]) -> dict[str, list[tuple[str, float]]]:
    """Return, by column, the roles that its name fits, the best first, with a weight from 0 to 1; a wheel's
    is `wheel_fl` etc.
    """
    taken = {name: parse_name(name) for name in names}
    numbered = _wheels_by_number(names)
    found: dict[str, list[tuple[str, float]]] = {}
    for name, one in taken.items():
        words = set(one.words)
        said = [
            (role, 1.0 if len(words) == 1 or words & _RECEIVER else 0.8)
            for role, some, none in _EXACT
            if (words & some or "".join(one.words) in some) and not words & none
        ]
        said += [
            (role, 0.9)
            for role, first, second in _PAIRS
            if words & first and words & second and role not in dict(said)
        ]
        wheel = numbered.get(name) or _wheel_of_name(one)
        if wheel is not None and not words & _RECEIVER:
            said.append((f"{WHEEL}_{wheel}", 0.85))
        found[name] = sorted(said, key=lambda entry: -entry[1])
    return found


def _wheel_of_name(one: ParsedName) -> str | None:
    """Return the wheel that a name states by letters or words; None if it states none."""
    words = list(one.words)
    if set(words) & _NO_WHEEL_MOTION:
        return None
    for wheel, letters in _POSITIONS.items():
        for word in set(words) - _WHEEL_WORDS:  # `whl` ends like `hl`, rear left
            stems = [word[: -len(end)] for end in letters if word.endswith(end)]
            of_wheel = (len(words) == 1 and word == wheel) or _WHEEL_WORDS & (set(words) - {word})
            if any(stem in _WHEEL_WORDS or (not stem and of_wheel) for stem in stems):
                return wheel
    return _wheel_of_words(words)


def _wheel_of_words(words: Sequence[str]) -> str | None:
    """Return the wheel of two neighbouring words, such as `front left` or `links vorn`; None if there are
    none.
    """
    for pair in itertools.pairwise(words):
        for front, side in (pair, pair[::-1]) if max(map(len, pair)) > 1 else ():
            axle = "f" if front in _FRONT else "r" if front in _REAR else ""
            where = "l" if side in _LEFT else "r" if side in _RIGHT else ""
            if axle and where and front != side:
                return axle + where
    return None


def _wheels_by_number(names: Sequence[str]) -> dict[str, str]:
    """Return the wheels of four columns that differ by a number alone: front left, front right, rear left,
    rear right.
    """
    groups: dict[str, list[tuple[int, str]]] = defaultdict(list)
    for name in names:
        number = re.search(r"\[?(\d)\]?(?=\D*$)", name)
        if number is not None and _WHEEL_WORDS & set(parse_name(name[: number.start()]).words):
            groups[name[: number.start()] + "#" + name[number.end() :]].append((int(number[1]), name))
    found = {}
    for group in groups.values():
        if [number for number, _ in sorted(group)] in ([0, 1, 2, 3], [1, 2, 3, 4]):
            found.update({name: wheel for (_, name), wheel in zip(sorted(group), WHEELS, strict=True)})
    return found
