"""A right configuration, its DBC, and how to bend them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

GOOD_TOML = """\
[vehicle]
wheel_radius_m = 0.316
track_front_m = 1.53
track_rear_m = 1.52
wheelbase_m = 2.63
driven_axle = "front"
steering_ratio = 15.3
teeth_per_rev = 48

[can]
interface = "socketcan"
channel = "can0"
dbc = "bus.dbc"

[can.signals]
wheel_count_fl = "WHEELS.CNT_FL"
wheel_count_fr = "WHEELS.CNT_FR"
wheel_count_rl = "WHEELS.CNT_RL"
wheel_count_rr = "WHEELS.CNT_RR"
yaw_rate = "ESP.YAW"

[gnss]
device = "/dev/ttyACM0"
baud = 115200
antenna_forward_m = 0.0
antenna_left_m = 0.0
"""

GOOD_DBC = """\
VERSION ""

NS_ :

BS_:

BU_: CAR

BO_ 176 WHEELS: 8 CAR
 SG_ CNT_FL : 0|16@1+ (1,0) [0|65535] "" CAR
 SG_ CNT_FR : 16|16@1+ (1,0) [0|65535] "" CAR
 SG_ CNT_RL : 32|16@1+ (1,0) [0|65535] "" CAR
 SG_ CNT_RR : 48|16@1+ (1,0) [0|65535] "" CAR

BO_ 180 ESP: 8 CAR
 SG_ YAW : 0|16@1- (0.01,0) [-300|300] "deg/s" CAR
 SG_ AY : 16|16@1- (0.01,0) [-30|30] "m/s2" CAR

BO_ 2566844926 SPEEDS: 8 CAR
 SG_ V_FL : 7|16@0+ (0.01,0) [0|300] "km/h" CAR
 SG_ V_FR : 23|16@0+ (0.01,0) [0|300] "km/h" CAR
 SG_ V_RL : 39|16@0+ (0.01,0) [0|300] "rpm" CAR
 SG_ V_RR : 55|16@0+ (0.01,0) [0|300] "" CAR

BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 176 20;
"""

Make = Callable[..., Path]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """Write a drive folder's two files, with some text replaced, and give the path of its TOML file."""

    def write(*toml: tuple[str, str], dbc: tuple[tuple[str, str], ...] = (), text: str = GOOD_TOML) -> Path:
        bus = GOOD_DBC
        for old, new in toml:
            assert old in text
            text = text.replace(old, new)
        for old, new in dbc:
            assert old in bus
            bus = bus.replace(old, new)
        (tmp_path / "bus.dbc").write_text(bus, encoding="cp1252")
        file = tmp_path / "vehicle.toml"
        file.write_text(text, encoding="utf-8")
        return file

    return write
