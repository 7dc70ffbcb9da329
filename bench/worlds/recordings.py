"""Reads the real recordings, apart from the program's reader: rear wheels' ways, fixes, and nothing else.

In: a drive folder with `can.log.gz` and `gnss.nmea`. Out: `Recorded`. Bytes are decoded by cantools alone.
"""

from __future__ import annotations

import gzip
import math
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

import cantools
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EARTH_M = 6378137.0
_FRAME = re.compile(r"\((\d+\.\d+)\) \S+ ([0-9A-Fa-f]+)#([0-9A-Fa-f]*)")


@dataclass(frozen=True)
class Recorded:
    """Rear wheels over host time and fixes over UTC; metres, seconds."""

    name: str
    time_s: Array
    distance_m: Array
    """(n, 2) of the rear wheels, by the configured radius."""
    fix_utc_s: Array
    """(m,) by the sentences, in seconds of the day's host time scale (the day is added)."""
    fix_m: Array
    """(m, 2) east and north of the first fix."""
    fix_speed_mps: Array
    """(m,) NaN where no sentence states it."""
    fix_course_rad: Array
    """(m,) mathematical angle, NaN where none is stated."""
    track_m: float
    antenna_left_m: float


def lines_of(folder: Path) -> list[str]:
    """The frames of a log as text."""
    plain = folder / "can.log"
    if plain.exists():
        return plain.read_text(encoding="ascii").splitlines()
    with gzip.open(folder / "can.log.gz", "rt", encoding="ascii") as file:
        return file.read().splitlines()


def read(folder: Path) -> Recorded:
    """Read a recording; ValueError without rear wheels."""
    setup = tomllib.loads((folder / "vehicle.toml").read_text(encoding="utf-8"))
    vehicle, signals = setup["vehicle"], setup["can"]["signals"]
    counts = "wheel_count_rl" in signals
    names = [signals[f"wheel_{'count' if counts else 'speed'}_{wheel}"] for wheel in ("rl", "rr")]
    database = cantools.database.load_file(folder / "bus.dbc")
    message = database.get_message_by_name(names[0].split(".")[0])
    keys = [name.split(".")[1] for name in names]
    times, values = [], []
    for line in lines_of(folder):
        match = _FRAME.match(line)
        if match and int(match[2], 16) == message.frame_id:
            decoded = message.decode(bytes.fromhex(match[3]))
            times.append(float(match[1]))
            values.append([float(decoded[key]) for key in keys])
    time_s, raw = np.array(times), np.array(values)
    if counts:
        step = np.diff(raw, axis=0)
        step = (step + 2.0**31) % 2.0**32 - 2.0**31
        step[np.abs(step) > 1e5] = 0.0  # the counters start again
        metres = 2 * math.pi * float(vehicle["wheel_radius_m"]) / float(vehicle["teeth_per_rev"])
        distance = np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)]) * metres
    else:
        distance = np.concatenate(
            [
                np.zeros((1, 2)),
                np.cumsum(0.5 * (raw[1:] + raw[:-1]) / 3.6 * np.diff(time_s)[:, None], axis=0),
            ]
        )
    utc, place, speed, course = _fixes(folder, time_s[0])
    return Recorded(
        name=folder.name,
        time_s=time_s,
        distance_m=distance,
        fix_utc_s=utc,
        fix_m=place,
        fix_speed_mps=speed,
        fix_course_rad=course,
        track_m=float(vehicle["track_rear_m"]),
        antenna_left_m=float(setup.get("gnss", {}).get("antenna_left_m", 0.0)),
    )


def _epochs(folder: Path) -> dict[float, dict[str, float]]:
    """Values of the receiver's epochs by UTC; sentences without a time belong to the epoch before them."""
    epochs: dict[float, dict[str, float]] = {}
    last = None
    for line in (folder / "gnss.nmea").read_text(encoding="ascii").splitlines():
        _, _, sentence = line.partition("$")
        parts = sentence.split("*")[0].split(",")
        kind = parts[0][2:]
        if kind in ("GGA", "RMC") and parts[1]:
            last = 3600 * int(parts[1][:2]) + 60 * int(parts[1][2:4]) + float(parts[1][4:])
            entry = epochs.setdefault(last, {})
            if kind == "GGA" and parts[2] and parts[6] != "0":
                entry["lat"], entry["lon"] = _angle(parts[2], parts[3]), _angle(parts[4], parts[5])
            elif kind == "RMC" and parts[7]:
                entry["speed"] = float(parts[7]) * 0.514444444
                if parts[8]:
                    entry["course"] = math.pi / 2 - math.radians(float(parts[8]))
        elif kind == "VTG" and last is not None and len(parts) > 5 and parts[5]:
            epochs[last]["speed"] = float(parts[5]) * 0.514444444
    return epochs


def _fixes(folder: Path, host_s: float) -> tuple[Array, Array, Array, Array]:
    """Fixes by their UTC: time, position, speed and course."""
    kept = [(utc, entry) for utc, entry in sorted(_epochs(folder).items()) if "lat" in entry]
    utc = np.array([each for each, _ in kept])
    lat, lon = (np.array([entry[key] for _, entry in kept]) for key in ("lat", "lon"))
    place = EARTH_M * np.stack([(lon - lon[0]) * math.cos(lat[0]), lat - lat[0]], axis=1)
    speed, course = (np.array([entry.get(key, math.nan) for _, entry in kept]) for key in ("speed", "course"))
    return utc + 86400.0 * math.floor(host_s / 86400.0), place, speed, course


def _angle(text: str, side: str) -> float:
    point = text.index(".") - 2
    value = math.radians(float(text[:point]) + float(text[point:]) / 60.0)
    return -value if side in "SW" else value
