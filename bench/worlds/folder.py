"""Writes a `Drive` as a drive folder, in the public formats alone.

In: `Drive`, a folder. Out: vehicle.toml, bus.dbc, can.log, gnss.nmea, as another program's recording of that
bus would be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.signal import lfilter

from bench.worlds import causes
from bench.worlds.instruments import STEERING_RATIO, Array, Drive
from bench.worlds.latch import latched_at
from bench.worlds.spec import FINE_TEETH, Spec

LATITUDE, LONGITUDE, HEIGHT = 48.7, 9.1, 380.0
WHEELS = ("fl", "fr", "rl", "rr")
HALF_WINDOW_S = 0.01
"""A control unit makes its speed from the edges of twice this time."""
INERTIAL = (
    ("yaw_rate", "YAW", 1e-4, "rad/s"),
    ("accel_long", "AX", 1e-3, "m/s2"),
    ("accel_lat", "AY", 1e-3, "m/s2"),
    ("steering_wheel_angle", "STEER", 1e-3, "rad"),
)


@dataclass(frozen=True)
class Message:
    """One frame's layout and its frames; signals lie one behind the other, little-endian."""

    identifier: int
    name: str
    bits: int
    signed: bool
    signals: tuple[tuple[str, str, float, str], ...]
    """role, name, factor, unit"""
    time_s: Array
    raw: NDArray[np.int64]
    """(n, signals)"""

    def dbc(self) -> str:
        """Its definition."""
        sign = "-" if self.signed else "+"
        size = (self.bits * len(self.signals) + 7) // 8
        lines = [f"BO_ {self.identifier} {self.name}: {size} CAR"]
        for k, (_, name, factor, unit) in enumerate(self.signals):
            lines.append(
                f' SG_ {name} : {k * self.bits}|{self.bits}@1{sign} ({factor:g},0) [0|0] "{unit}" CAR'
            )
        return "\n".join(lines) + "\n\n"

    def payloads(self) -> list[str]:
        """Each frame's data in hexadecimal."""
        size = (self.bits * len(self.signals) + 7) // 8
        mask = (1 << self.bits) - 1
        packed = np.zeros(len(self.raw), dtype=np.uint64)
        for k in range(len(self.signals)):
            part = (self.raw[:, k] & mask).astype(np.uint64)
            packed |= part << np.uint64(k * self.bits)
        return [data.hex().upper()[: 2 * size] for data in (row.tobytes() for row in packed.astype("<u8"))]


def write_folder(drive: Drive, folder: Path) -> None:
    """Write the drive as another program's recording would be."""
    folder.mkdir(parents=True, exist_ok=True)
    messages = [*wheel_messages(drive), *inertial_messages(drive), *weather_messages(drive)]
    dbc = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: CAR\n\n' + "".join(each.dbc() for each in messages)
    (folder / "bus.dbc").write_text(dbc, encoding="utf-8")
    (folder / "vehicle.toml").write_text(_vehicle(drive.spec, messages), encoding="utf-8")
    (folder / "can.log").write_text(_can_log(drive, messages), encoding="ascii")
    (folder / "gnss.nmea").write_text("".join(_sentences(drive)), encoding="ascii")


def _vehicle(spec: Spec, messages: list[Message]) -> str:
    roles = [f'{role} = "{each.name}.{name}"' for each in messages for role, name, _, _ in each.signals]
    return f"""[vehicle]
wheel_radius_m = {spec.configured_radius_m!r}
track_front_m = {spec.track_front_m!r}
track_rear_m = {spec.track_rear_m!r}
wheelbase_m = {spec.wheelbase_m!r}
driven_axle = "{spec.driven}"
steering_ratio = {STEERING_RATIO}
teeth_per_rev = {spec.configured_teeth or spec.teeth:g}

[can]
interface = "socketcan"
channel = "can0"
dbc = "bus.dbc"

[can.signals]
{chr(10).join(roles)}

[gnss]
device = "/dev/ttyACM0"
baud = 115200
antenna_forward_m = {spec.antenna_forward_m!r}
antenna_left_m = {spec.antenna_left_m!r}
"""


def wheel_messages(drive: Drive) -> list[Message]:
    """The frames of the wheels, none lost."""
    spec = drive.spec
    fine = spec.teeth >= FINE_TEETH and spec.wheel_signal == "counts"
    groups = ((0, 1), (2, 3)) if spec.split_wheels or fine else ((0, 1, 2, 3),)
    out = []
    for number, wheels in enumerate(groups):
        period = 1.0 / spec.wheel_hz
        begin = drive.time_s[0] + 0.5 * period * number
        time_s = np.arange(begin, drive.time_s[-1] - period, period)
        if spec.wheel_signal == "speeds":
            raw, bits = _speeds(drive, time_s, wheels), 16
            signals = tuple((f"wheel_speed_{WHEELS[w]}", WHEELS[w].upper()) for w in wheels)
            factor, unit = spec.speed_step_kmh, "km/h"
        else:
            taken = [latched_at(time_s, spec, drive.seed, w) for w in wheels]
            angles = [
                np.interp(at, drive.time_s, drive.shown_rad[:, w])
                for at, w in zip(taken, wheels, strict=True)
            ]
            shown = np.stack(angles, axis=1)
            raw, bits = drive.counted(shown), 32 if fine else spec.count_bits
            signals = tuple((f"wheel_count_{WHEELS[w]}", WHEELS[w].upper()) for w in wheels)
            factor, unit = 1.0, ""
        out.append(
            Message(
                identifier=176 + number,
                name=f"WHEELS{number}" if len(groups) > 1 else "WHEELS",
                bits=bits,
                signed=False,
                signals=tuple((role, name, factor, unit) for role, name in signals),
                time_s=time_s,
                raw=raw,
            )
        )
    return out


def _speeds(drive: Drive, time_s: Array, wheels: tuple[int, ...]) -> NDArray[np.int64]:
    """What a control unit makes of the edges around each instant."""
    spec, rng = drive.spec, np.random.default_rng([drive.seed, 3])
    window = spec.speed_window_s or 2 * HALF_WINDOW_S
    sides = (-window, 0.0) if spec.speed_window_s else (-HALF_WINDOW_S, HALF_WINDOW_S)
    out = []
    for w in wheels:
        shown = drive.shown_rad[:, w]
        if spec.speed_filter_s:
            shown = _low_passed(shown, drive.time_s, spec.speed_filter_s)
        # Straight lines between the samples would make a mean over one up to 2 ms older than the next.
        angle = PchipInterpolator(drive.time_s, shown, extrapolate=True)
        ends = [angle(time_s + side) + rng.normal(0.0, spec.edge_noise_rad, len(time_s)) for side in sides]
        speed = (ends[1] - ends[0]) / window * spec.configured_radius_m
        out.append(np.round(np.maximum(speed, 0.0) * 3.6 / spec.speed_step_kmh))
    return np.stack(out, axis=1).astype(np.int64)


def _low_passed(shown: Array, time_s: Array, filter_s: float) -> Array:
    """Angles behind a first-order low-pass, exact for angles that are straight between the samples."""
    step = float(time_s[1] - time_s[0])
    keep = math.exp(-step / filter_s)
    moved = np.diff(shown, prepend=shown[0])
    # y' = (x - y)/T and x straight over the step: the lag x - y decays and is fed by the step
    lag = lfilter([filter_s / step * (1.0 - keep)], [1.0, -keep], moved)
    return np.asarray(shown - lag)


def inertial_messages(drive: Drive) -> list[Message]:
    """The frames of gyro, accelerometers and steering wheel; none where the bus has no such signal."""
    spec = drive.spec
    there = (spec.with_gyro, spec.with_accel, spec.with_accel, spec.with_steering)
    values = (drive.gyro, drive.accel_long, drive.accel_lat, drive.steering_wheel)
    kept = [k for k in range(4) if there[k]]
    if not kept:
        return []
    if spec.inertial_hz == 50.0:
        time_s = drive.time_s
    else:
        time_s = np.arange(drive.time_s[0], drive.time_s[-1], 1.0 / spec.inertial_hz)
    raw = [np.round(np.interp(time_s, drive.time_s, values[k]) / INERTIAL[k][2]) for k in kept]
    return [
        Message(
            identifier=192,
            name="MOTION",
            bits=16,
            signed=True,
            signals=tuple(INERTIAL[k] for k in kept),
            time_s=time_s + 0.0004,
            raw=np.clip(np.stack(raw, axis=1), -32768, 32767).astype(np.int64),
        )
    ]


def weather_messages(drive: Drive) -> list[Message]:
    """The frames of the thermometer outside, once a second; none where the bus has none."""
    if not drive.spec.with_temperature:
        return []
    time_s = np.arange(drive.time_s[0], drive.time_s[-1], 1.0)
    celsius = np.interp(time_s, drive.time_s, drive.temperature_k) - 273.15
    return [
        Message(
            identifier=208,
            name="WEATHER",
            bits=16,
            signed=True,
            signals=(("ambient_temp", "OUTSIDE", 0.1, "degC"),),
            time_s=time_s + 0.0007,
            raw=np.round(celsius / 0.1).astype(np.int64)[:, None],
        )
    ]


def _can_log(drive: Drive, messages: list[Message]) -> str:
    spec, rng = drive.spec, np.random.default_rng([drive.seed, 4])
    lines: list[tuple[float, str]] = []
    for each in messages:
        lost = rng.random(len(each.time_s)) < spec.lost_share
        twice = rng.random(len(each.time_s)) < spec.repeated_share
        drifts = causes.clock_error_s(each.time_s, spec).tolist()
        sent = zip(each.time_s.tolist(), drifts, each.payloads(), strict=True)
        for k, (t, drift, data) in enumerate(sent):
            stamp = drive.start_s + spec.host_offset_s + t + drift
            line = f"({stamp:.6f}) can0 {each.identifier:03X}#{data}\n"
            if not lost[k]:
                lines.append((stamp, line))
            if twice[k]:
                late = stamp + 1e-4
                lines.append((late, f"({late:.6f}) can0 {each.identifier:03X}#{data}\n"))
    lines.sort()
    return "".join(line for _, line in lines)


def _sentences(drive: Drive) -> list[str]:
    """RMC and GGA of each fix; the east and north of the world laid on the ellipsoid in small steps."""
    spec = drive.spec
    latitude, longitude = math.radians(LATITUDE), math.radians(LONGITUDE)
    out = []
    east0 = north0 = 0.0
    a, e2 = 6378137.0, 6.69437999014e-3
    lag = drive.fix_lag_s if len(drive.fix_lag_s) else np.zeros(len(drive.fix_true_s))
    drift = causes.clock_error_s(drive.fix_true_s, spec)
    for k, t in enumerate(drive.fix_true_s):
        de, dn = float(drive.fix_east[k]) - east0, float(drive.fix_north[k]) - north0
        east0, north0 = float(drive.fix_east[k]), float(drive.fix_north[k])
        w = math.sqrt(1 - e2 * math.sin(latitude) ** 2)
        meridian, prime = a * (1 - e2) / w**3 + HEIGHT, a / w + HEIGHT
        latitude += dn / meridian
        longitude += de / (prime * math.cos(latitude - 0.5 * dn / meridian))
        utc = drive.start_s + float(t)
        when = datetime.fromtimestamp(utc, UTC)
        clock = when.strftime("%H%M%S.") + f"{when.microsecond // 10000:02d}"
        place = f"{_degrees(latitude, 2, spec, 'N', 'S')},{_degrees(longitude, 3, spec, 'E', 'W')}"
        knots = float(drive.fix_speed[k]) / 0.514444444
        course = float(drive.fix_course_math[k])
        turned = math.degrees(math.pi / 2 - course) % 360
        degrees = "" if math.isnan(course) else f"{turned:.{spec.course_digits}f}"
        height = HEIGHT + float(drive.fix_up[k])
        arrival = utc + drive.fix_age_s + float(lag[k]) + spec.host_offset_s + float(drift[k])
        speed = f"{knots:.{spec.speed_digits}f}"
        for body in (
            f"GNRMC,{clock},A,{place},{speed},{degrees},{when.strftime('%d%m%y')},,,A",
            f"GNGGA,{clock},{place},1,12,0.8,{height:.2f},M,0.0,M,,",
        ):
            check = 0
            for char in body:
                check ^= ord(char)
            out.append(f"({arrival:.6f}) ${body}*{check:02X}\n")
            arrival += 0.002
    return out


def _degrees(angle: float, digits: int, spec: Spec, plus: str, minus: str) -> str:
    ten = 10**spec.place_digits
    units = round(abs(math.degrees(angle)) * 60 * ten)
    whole, rest = divmod(units, 60 * ten)
    width = 3 + spec.place_digits
    return f"{whole:0{digits}d}{rest / ten:0{width}.{spec.place_digits}f},{plus if angle >= 0 else minus}"
