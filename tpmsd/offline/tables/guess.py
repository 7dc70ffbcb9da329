"""A map for a table that nobody has described: roles by names, units and signs by values, measures of a car.

In: an open table. Out: `Guess`: roles with columns and reasons, the car's measures, and as the text of a
map.toml, in which each line says what it was taken from and what is still to be checked. Pure.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.tables import guess_values as by_value
from tpmsd.offline.tables.guess_names import WHEEL, parse_name, roles_by_name, time_weight
from tpmsd.offline.tables.read_table import InputTable
from tpmsd.offline.tables.roles import TIME_UNITS, scale_of

TYPICAL_RADIUS_M, TYPICAL_TRACK_M, TYPICAL_WHEELBASE_M = 0.315, 1.55, 2.7
"""Measures of a middle-class passenger car (205/55 R16), where the table has none."""
_MIN_CORRELATION = 0.7
"""Least correlation of a yaw rate or a wheel difference with the course's rate; below it no slope."""
_POSITIONS = (("gnss_latitude", "gnss_longitude"), ("gnss_east", "gnss_north"))


@dataclass
class GuessedColumn:
    """Column of a table that a role is probably read from, with unit, scale and the reason."""

    name: str
    why: str
    unit: str | None = None
    scale: float = 1.0
    modulus: int | None = None
    alternatives: tuple[str, ...] = ()


@dataclass
class Guess:
    """Guessed meaning of a table."""

    time: str | None = None
    time_unit: str = "s"
    columns: dict[str, GuessedColumn] = field(default_factory=dict)
    measures: dict[str, tuple[float, str]] = field(default_factory=dict)
    """Key of [vehicle] -> value and reason."""
    unused: tuple[str, ...] = ()
    doubts: list[str] = field(default_factory=list)
    """Points to be checked, a sentence each."""

    @property
    def has_wheels(self) -> bool:
        """True if the rear pair has columns, and the front pair both or neither."""
        found = {role[-2:] for role in self.columns if role.startswith("wheel_")}
        return {"rl", "rr"} <= found and ("fl" in found) == ("fr" in found)

    def text(self, table: str) -> str:
        """Return the map as TOML, for the table of this file name."""
        lines = [f"# Guessed from {table} by names, units and values. Check each line."]
        lines += [f"# to check: {one}" for one in self.doubts]
        lines += ["", "[vehicle]"]
        lines += [f"{key} = {value:.6g}   # {why}" for key, (value, why) in self.measures.items()]
        lines += ['driven_axle = "front"   # a usual value: front, rear or all', "", "[table]"]
        if self.time is not None:
            lines += [f"time = {_quote(self.time)}", f"time_unit = {_quote(self.time_unit)}"]
        lines += ["", "[columns]"]
        for role, one in self.columns.items():
            parts = [f"column = {_quote(one.name)}"]
            parts += [f"unit = {_quote(one.unit)}"] if one.unit is not None else []
            parts += [f"scale = {one.scale:g}"] if one.scale != 1.0 else []
            parts += [f"modulus = {one.modulus}"] if one.modulus is not None else []
            alternatives = f"; or {', '.join(map(_printable, one.alternatives))}" if one.alternatives else ""
            lines.append(f"{role} = {{ {', '.join(parts)} }}   # {one.why}{alternatives}")
        if self.unused:
            lines += ["", f"# not used: {', '.join(map(_printable, self.unused))}"]
        return "\n".join(lines) + "\n"


def guess(table: InputTable) -> Guess:
    """Guess the roles, units and signs of a table's columns, and measures of its car.

    Returns:
        Columns by role; of each the unit by name or, where the name has none, by values; without wheels where
        no column's name tells a wheel.

    Raises:
        InputError: A column cannot be read.
    """
    return _Guesser(table).guess_map()


class _Guesser:
    def __init__(self, table: InputTable) -> None:
        self._table = table
        self._found = Guess()
        self._values: dict[str, FloatArray] = {}

    def guess_map(self) -> Guess:
        found, names = self._found, self._table.names
        self._choose_time()
        chosen: dict[str, list[tuple[float, str]]] = {}
        for name, roles in roles_by_name([name for name in names if name != found.time]).items():
            for role, weight in roles[:1]:
                if np.isfinite(self._column_values(name)).any():
                    chosen.setdefault(role, []).append((weight, name))
        for role, entries in chosen.items():
            entries.sort(key=lambda entry: -entry[0])
            alternatives = tuple(name for _, name in entries[1:3])
            found.columns[role] = GuessedColumn(entries[0][1], "by its name", alternatives=alternatives)
        self._drop_incomplete_positions()
        motion = self._ground_motion()
        self._guess_wheels(motion)
        for role in [role for role in found.columns if not role.startswith("wheel_")]:
            self._guess_unit(role, found.columns[role], motion)
        self._guess_measures(motion)
        used = {one.name for one in found.columns.values()} | {found.time}
        found.unused = tuple(name for name in names if name not in used)
        if not found.has_wheels:
            found.doubts.append(
                "no column of each rear wheel was found: give wheel_speed_*, _angle_* or _count_*"
            )
        if motion is None:
            found.doubts.append("no positions: units of speeds are by names alone")
        order = {role: k for k, role in enumerate(found.columns)}
        wheels_first = sorted(order, key=lambda role: (not role.startswith("wheel_"), role[-2:], order[role]))
        found.columns = {role: found.columns[role] for role in wheels_first}
        return found

    def _choose_time(self) -> None:
        """Choose the column of the time by its name and because it rises; its unit by name or steps."""
        found = self._found
        ranked = sorted(self._table.names, key=lambda name: -time_weight(parse_name(name)))
        for name in ranked:
            if time_weight(parse_name(name)) == 0:
                break
            unit = by_value.time_unit(self._column_values(name))
            if unit is not None:
                said = parse_name(name).unit
                found.time, found.time_unit = name, said if said in TIME_UNITS else unit
                return
        if not any(self._table.own_time(name) is not None for name in self._table.names[:1]):
            found.doubts.append("no column of the time was found: give [table] time")

    def _column_values(self, name: str) -> FloatArray:
        if name not in self._values:
            self._values[name] = self._table.column(name)
        return self._values[name]

    def _column_times(self, name: str) -> FloatArray | None:
        """Return the time stamps of a column, its own or the table's, s; None where the table has none."""
        own = self._table.own_time(name)
        if own is not None:
            return own
        if self._found.time is None:
            return None
        return self._column_values(self._found.time) * TIME_UNITS[self._found.time_unit]

    def _si_values(self, role: str) -> FloatArray:
        """Return a role's values in SI units (degrees for latitude and longitude)."""
        one = self._found.columns[role]
        factor, offset = scale_of(role, one.unit)
        return factor * one.scale * self._column_values(one.name) + offset

    def _drop_incomplete_positions(self) -> None:
        """Remove one coordinate without the other, and plane coordinates where latitude and longitude are
        there.
        """
        columns = self._found.columns
        whole = [pair for pair in _POSITIONS if all(role in columns for role in pair)]
        for pair in _POSITIONS:
            if not whole or pair != whole[0]:
                for role in pair:
                    columns.pop(role, None)
        for role in whole[0] if whole else ():
            self._apply_named_unit(role, columns[role])

    def _ground_motion(self) -> by_value.GroundMotion | None:
        """Return the motion by the columns of positions; None without positions."""
        columns = self._found.columns
        for first, second in _POSITIONS:
            if first not in columns or second not in columns:
                continue
            time_s = self._column_times(columns[first].name)
            one, other = self._si_values(first), self._si_values(second)
            if time_s is None or len(time_s) != len(one) or len(one) != len(other):
                return None
            there = (one != 0.0) | (other != 0.0)
            one, other = np.where(there, one, np.nan), np.where(there, other, np.nan)
            if not np.isfinite(one).any():
                return None
            east, north = (one, other) if first == "gnss_east" else by_value.to_plane(one, other)
            return by_value.motion_of(time_s, east, north)
        return None

    def _apply_named_unit(self, role: str, one: GuessedColumn) -> bool:
        """Set the unit that the name states if the role can have it; return False without one."""
        said = parse_name(one.name).unit
        if said is None:
            return False
        try:
            scale_of(role, said)
        except ConfigError:
            self._found.doubts.append(f"{_printable(one.name)}: {role} cannot be in {said}")
            return False
        one.unit, one.why = said, "role and unit by its name"
        return True

    def _guess_unit(self, role: str, one: GuessedColumn, motion: by_value.GroundMotion | None) -> None:
        """Set the unit and sign of a role that is no wheel's, by its name and the positions."""
        named = self._apply_named_unit(role, one)
        time_s = self._column_times(one.name)
        if motion is None or time_s is None or len(time_s) != len(self._column_values(one.name)):
            return
        values = self._column_values(one.name)
        if role == "gnss_speed" and not named:
            per_mps = by_value.units_per_mps(time_s, values, motion)
            unit = None if per_mps is None else by_value.road_unit(per_mps)
            if unit in ("m/s", "km/h", "kn"):
                one.unit, one.why = unit, "by its name; the unit by the way between positions"
            elif per_mps is not None:
                self._found.doubts.append(f"{_printable(one.name)}: {per_mps:.3g} times the positions' m/s")
        elif role in ("gnss_course", "gnss_heading"):
            self._guess_direction(one, named, time_s, values, motion)
        elif role == "yaw_rate":
            self._guess_yaw_unit(one, named, time_s, values, motion)

    def _guess_direction(
        self,
        one: GuessedColumn,
        named: bool,
        time_s: FloatArray,
        values: FloatArray,
        motion: by_value.GroundMotion,
    ) -> None:
        """Decide by the positions between clockwise from north and counter-clockwise from east, in degrees or
        radians.
        """
        columns = self._found.columns
        role = next(name for name, other in columns.items() if other is one)
        units = [one.unit] if named and one.unit else ["deg", "rad"]
        at = np.isfinite(motion.course_rad)
        known = np.isfinite(values)
        if at.sum() < 10 or known.sum() < 10:
            return
        near = np.clip(np.searchsorted(time_s[known], motion.time_s[at]), 0, known.sum() - 1)
        misses = {}
        for unit in units:
            angle = values[known][near] * scale_of("gnss_course", unit)[0]
            for kind, course in (("gnss_course", angle), ("gnss_heading", 0.5 * np.pi - angle)):
                misses[kind, unit] = float(np.median(np.abs(_wrap_angle(course - motion.course_rad[at]))))
        (kind, unit), miss = min(misses.items(), key=lambda entry: entry[1])
        if miss > 0.2:
            self._found.doubts.append(f"{_printable(one.name)}: not the course of the positions; left out")
            del columns[role]
            return
        one.unit, one.why = unit, "by its name; direction and unit by the positions"
        if kind != role and kind not in columns:
            columns[kind] = columns.pop(role)

    def _guess_yaw_unit(
        self,
        one: GuessedColumn,
        named: bool,
        time_s: FloatArray,
        values: FloatArray,
        motion: by_value.GroundMotion,
    ) -> None:
        """Set the unit and sign of the yaw rate by its slope on the course's rate."""
        at_s, rate = motion.yaw_rate()
        slope, correlation = by_value.slope_and_correlation(time_s, values, at_s, rate)
        if abs(correlation) < _MIN_CORRELATION:
            untold = "sign" if named else "unit and sign"
            assumed = "" if named else "; without a unit it is rad/s"
            self._found.doubts.append(
                f"{_printable(one.name)}: {untold} not determined, for the course turns too little{assumed}"
            )
            return
        fit = by_value.yaw_unit(slope)
        if fit is None:
            self._found.doubts.append(f"{_printable(one.name)}: {slope:.3g} times the course's rate in rad/s")
            return
        unit, one.scale = fit
        if named and one.unit != unit:
            self._found.doubts.append(f"{_printable(one.name)}: its name says {one.unit}, its values {unit}")
        one.unit, one.why = unit, "by its name; unit and sign by the course"

    def _guess_wheels(self, motion: by_value.GroundMotion | None) -> None:
        """Set the roles of the wheels' columns, all angles, speeds or counts alike, and their unit."""
        columns = self._found.columns
        wheels = {wheel: columns.pop(f"{WHEEL}_{wheel}") for wheel in WHEELS if f"{WHEEL}_{wheel}" in columns}
        if not wheels:
            return
        kinds = [by_value.kind_of_wheel(self._column_values(one.name)) for one in wheels.values()]
        kind = max(sorted(set(kinds)), key=kinds.count)
        for wheel, one in wheels.items():
            role = f"wheel_{kind}_{wheel}"
            columns[role] = one
            one.why = f"wheel by its name, {kind} by its values"
            if kind == "count":
                one.modulus = by_value.modulus_of(self._column_values(one.name))
            elif kind == "angle":
                self._apply_named_unit(role, one)
        per_mps = self._wheel_units_per_mps(wheels, kind, motion)
        if kind == "speed":
            self._guess_speed_unit(wheels, per_mps)
        elif kind == "angle" and per_mps is not None:
            self._guess_angle_unit(wheels, per_mps)
        elif kind == "count" and per_mps is not None:
            teeth = per_mps * 2.0 * np.pi * TYPICAL_RADIUS_M
            why = f"by the way and a rolling radius of {TYPICAL_RADIUS_M} m: replace both"
            self._found.measures["teeth_per_rev"] = (float(np.round(teeth)), why)

    def _wheel_units_per_mps(
        self, wheels: Mapping[str, GuessedColumn], kind: str, motion: by_value.GroundMotion | None
    ) -> float | None:
        """Return the median of the wheels' units (per second, for angles and counts) per m/s of the receiver;
        None if unknown.
        """
        found = []
        for one in wheels.values():
            time_s = self._column_times(one.name)
            values = self._column_values(one.name)
            if motion is None or time_s is None or len(time_s) != len(values):
                return None
            rates = values if kind == "speed" else by_value.rate_of(time_s, values, one.modulus)
            if kind == "angle" and one.unit is not None:
                rates = rates * scale_of("wheel_angle_rl", one.unit)[0]
            per_mps = by_value.units_per_mps(time_s, rates, motion)
            if per_mps is not None:
                found.append(per_mps)
        return float(np.median(found)) if found else None

    def _guess_speed_unit(self, wheels: Mapping[str, GuessedColumn], per_mps: float | None) -> None:
        doubts = self._found.doubts
        named = {parse_name(one.name).unit for one in wheels.values()} - {None}
        for wheel, one in wheels.items():
            self._apply_named_unit(f"wheel_speed_{wheel}", one)
        if per_mps is None:
            if not named:
                doubts.append(
                    "wheel speeds: neither names nor positions tell their unit; without one it is rad/s"
                )
            return
        unit = by_value.road_unit(per_mps)
        turning = by_value.rotation_unit(per_mps)
        said = next(iter(named), None)
        if said in ("rad/s", "rpm", "deg/s"):
            self._set_rolling_radius(said, per_mps)
        elif unit is not None:
            if said is not None and said != unit:
                doubts.append(f"wheel speeds: their names say {said}, their values {unit}")
            for one in wheels.values():
                one.unit = unit if said is None else said
                one.why += ", unit by the way between positions" if said is None else ", unit by its name"
        elif turning is not None and said is None:
            for one in wheels.values():
                one.unit = turning[0]
                one.why += ", unit by the way between positions"
            self._set_rolling_radius(turning[0], per_mps)
        else:
            doubts.append(f"wheel speeds: {per_mps:.4g} times the positions' m/s, which is no unit")

    def _set_rolling_radius(self, unit: str, per_mps: float) -> None:
        """Set the rolling radius by the distance per revolution, if it is a car's."""
        radius = 1.0 / (per_mps * scale_of("wheel_speed_rl", unit)[0])
        if by_value.RADII_M[0] <= radius <= by_value.RADII_M[1]:
            self._found.measures["wheel_radius_m"] = (radius, "by the distance per wheel revolution")
        else:
            self._found.doubts.append(f"wheel speeds in {unit} need a rolling radius of {radius:.3g} m")

    def _guess_angle_unit(self, wheels: Mapping[str, GuessedColumn], per_mps: float) -> None:
        """Set the unit of wheel angles that gives the rolling radius of a car, and that radius."""
        unit = next(iter(wheels.values())).unit
        for name in ("rad", "deg") if unit is None else ("rad",):
            radius = 1.0 / (per_mps * scale_of("wheel_angle_rl", name)[0])
            if by_value.RADII_M[0] <= radius <= by_value.RADII_M[1]:
                for one in wheels.values():
                    one.unit = one.unit or name
                self._found.measures["wheel_radius_m"] = (
                    radius,
                    "by the distance per wheel revolution",
                )
                return
        self._found.doubts.append("wheel angles: no unit gives a rolling radius of a car")

    def _guess_measures(self, motion: by_value.GroundMotion | None) -> None:
        """Set radius and tracks; the tracks by the difference of an axle's wheels over the course's rate."""
        measures, columns = self._found.measures, self._found.columns
        radius = measures.get("wheel_radius_m", (TYPICAL_RADIUS_M, "a usual value: not measured"))
        teeth = measures.pop("teeth_per_rev", None)
        measures["wheel_radius_m"] = radius
        for axle, left, right in (("front", "fl", "fr"), ("rear", "rl", "rr")):
            value, why = TYPICAL_TRACK_M, "a usual value: not measured"
            roles = [f"wheel_speed_{wheel}" for wheel in (left, right)]
            if motion is not None and all(role in columns for role in roles):
                one, other = (self._road_speed(role, radius[0]) for role in roles)
                at_s, rate = motion.yaw_rate()
                time_s = self._column_times(columns[roles[0]].name)
                if time_s is not None and len(one) == len(other) == len(time_s):
                    track, correlation = by_value.slope_and_correlation(time_s, other - one, at_s, rate)
                    if correlation < -_MIN_CORRELATION:
                        self._found.doubts.append(f"the {axle} wheels: left and right are swapped")
                    elif correlation > _MIN_CORRELATION and 1.0 < track < 2.2:
                        value, why = round(track, 3), "by the wheels' difference in bends"
            measures[f"track_{axle}_m"] = (value, why)
        measures["wheelbase_m"] = (TYPICAL_WHEELBASE_M, "a usual value: not measured")
        if teeth is not None:
            measures["teeth_per_rev"] = teeth

    def _road_speed(self, role: str, radius_m: float) -> FloatArray:
        """Return a wheel's speed along the road, m/s."""
        unit = self._found.columns[role].unit
        return self._si_values(role) * (radius_m if unit in (None, "rad/s", "rpm", "deg/s") else 1.0)


def _wrap_angle(angle: FloatArray) -> FloatArray:
    """Return the angle within -pi to pi."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _quote(text: str) -> str:
    return json.dumps(text, ensure_ascii=True)


def _printable(name: str) -> str:
    """Return a name on one line of a comment."""
    return "".join(mark if mark.isprintable() else "\N{REPLACEMENT CHARACTER}" for mark in name)[:80]
