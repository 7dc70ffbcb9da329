"""Writes a `Drive` of the kinematic world as a drive folder, in the public formats alone.

In: `Drive`, a folder. Out: vehicle.toml, bus.dbc, can.log, gnss.nmea.
"""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tests.worlds.kinematic import Drive

START_S = 1_719_820_800.0
LATITUDE, LONGITUDE, HEIGHT = 48.7, 9.1, 380.0
LEAP_TO_PLANE = 6378137.0

DBC = """VERSION ""

NS_ :

BS_:

BU_: CAR

BO_ 176 WHEELS: 8 CAR
 SG_ FL : 0|16@1+ (1,0) [0|65535] "" CAR
 SG_ FR : 16|16@1+ (1,0) [0|65535] "" CAR
 SG_ RL : 32|16@1+ (1,0) [0|65535] "" CAR
 SG_ RR : 48|16@1+ (1,0) [0|65535] "" CAR

BO_ 192 MOTION: 8 CAR
 SG_ YAW : 0|16@1- (0.0001,0) [-3.2768|3.2767] "rad/s" CAR
 SG_ AX : 16|16@1- (0.001,0) [-32.768|32.767] "m/s2" CAR
 SG_ AY : 32|16@1- (0.001,0) [-32.768|32.767] "m/s2" CAR
 SG_ STEER : 48|16@1- (0.001,0) [-32.768|32.767] "rad" CAR
"""


def write_folder(drive: Drive, folder: Path) -> None:
    """Write the drive as another program's recording would be."""
    folder.mkdir(parents=True, exist_ok=True)
    spec = drive.spec
    (folder / "bus.dbc").write_text(DBC, encoding="utf-8")
    (folder / "vehicle.toml").write_text(
        f"""[vehicle]
wheel_radius_m = {spec.radius_m!r}
track_front_m = {spec.track_front_m!r}
track_rear_m = {spec.track_rear_m!r}
wheelbase_m = {spec.wheelbase_m!r}
driven_axle = "{spec.driven}"
steering_ratio = 15.0
teeth_per_rev = {spec.teeth:g}

[can]
interface = "socketcan"
channel = "can0"
dbc = "bus.dbc"

[can.signals]
wheel_count_fl = "WHEELS.FL"
wheel_count_fr = "WHEELS.FR"
wheel_count_rl = "WHEELS.RL"
wheel_count_rr = "WHEELS.RR"
yaw_rate = "MOTION.YAW"
accel_long = "MOTION.AX"
accel_lat = "MOTION.AY"
steering_wheel_angle = "MOTION.STEER"

[gnss]
device = "/dev/ttyACM0"
baud = 115200
antenna_forward_m = {spec.antenna_forward_m!r}
antenna_left_m = {spec.antenna_left_m!r}
""",
        encoding="utf-8",
    )
    counts = (drive.counts() % 65536).astype("<u2")
    readings = np.stack(
        [drive.gyro / 1e-4, drive.accel_long / 1e-3, drive.accel_lat / 1e-3, drive.steering_wheel / 1e-3],
        axis=1,
    )
    motion = np.clip(np.round(readings), -32768, 32767).astype("<i2")
    with (folder / "can.log").open("w", encoding="ascii") as log:
        for k, t in enumerate(drive.time_s):
            stamp = START_S + t
            log.write(f"({stamp:.6f}) can0 0B0#{counts[k].tobytes().hex().upper()}\n")
            log.write(f"({stamp + 0.0004:.6f}) can0 0C0#{motion[k].tobytes().hex().upper()}\n")
    (folder / "gnss.nmea").write_text("".join(_sentences(drive)), encoding="ascii")


def _sentences(drive: Drive) -> list[str]:
    """RMC and GGA of each fix; the east and north of the world laid on the ellipsoid in small steps."""
    latitude, longitude = math.radians(LATITUDE), math.radians(LONGITUDE)
    out = []
    east0 = north0 = 0.0
    a, e2 = 6378137.0, 6.69437999014e-3
    for k, t in enumerate(drive.fix_true_s):
        de, dn = float(drive.fix_east[k]) - east0, float(drive.fix_north[k]) - north0
        east0, north0 = float(drive.fix_east[k]), float(drive.fix_north[k])
        w = math.sqrt(1 - e2 * math.sin(latitude) ** 2)
        meridian, prime = a * (1 - e2) / w**3 + HEIGHT, a / w + HEIGHT
        latitude += dn / meridian
        longitude += de / (prime * math.cos(latitude - 0.5 * dn / meridian))
        utc = START_S + float(t)
        when = datetime.fromtimestamp(utc, UTC)
        clock = when.strftime("%H%M%S.") + f"{when.microsecond // 10000:02d}"
        place = f"{_degrees(latitude, 2, 'N', 'S')},{_degrees(longitude, 3, 'E', 'W')}"
        knots = float(drive.fix_speed[k]) / 0.514444444
        course = float(drive.fix_course_math[k])
        degrees = "" if math.isnan(course) else f"{math.degrees(math.pi / 2 - course) % 360:.3f}"
        height = HEIGHT + float(drive.fix_up[k])
        arrival = utc + drive.fix_age_s
        for body in (
            f"GNRMC,{clock},A,{place},{knots:.4f},{degrees},{when.strftime('%d%m%y')},,,A",
            f"GNGGA,{clock},{place},1,12,0.8,{height:.2f},M,0.0,M,,",
        ):
            check = 0
            for char in body:
                check ^= ord(char)
            out.append(f"({arrival:.6f}) ${body}*{check:02X}\n")
            arrival += 0.002
    return out


def _degrees(angle: float, digits: int, plus: str, minus: str) -> str:
    degrees = abs(math.degrees(angle))
    whole = int(degrees)
    return f"{whole:0{digits}d}{(degrees - whole) * 60:011.8f},{plus if angle >= 0 else minus}"
