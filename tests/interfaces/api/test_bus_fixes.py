"""Fixes of a receiver on the bus, gathered from a log."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tpmsd.car.config.load import load_config
from tpmsd.foundation.errors import InputError
from tpmsd.offline.drives.bus_fixes import BusFixes, is_on_bus
from tpmsd.offline.drives.raw_drive import read_drive
from tpmsd.onboard.sources.can.databases import load_databases

DBC = """VERSION ""

BU_: A

BO_ 768 POS: 8 A
 SG_ LAT : 0|32@1- (1E-07,0) [-90|90] "deg" A
 SG_ LON : 32|32@1- (1E-07,0) [-180|180] "deg" A

BO_ 769 VEL: 8 A
 SG_ SPD : 0|16@1+ (0.01,0) [0|300] "m/s" A
 SG_ CRS : 16|16@1+ (0.01,0) [0|360] "deg" A

BO_ 770 RECEIVER: 1 A
 SG_ READY : 0|1@1+ (1,0) [0|1] "" A

BO_ 257 WHEELS: 4 A
 SG_ RL : 0|16@1+ (1,0) [0|65535] "" A
 SG_ RR : 16|16@1+ (1,0) [0|65535] "" A
"""
VEHICLE = """[vehicle]
wheel_radius_m = 0.31
track_front_m = 1.5
track_rear_m = 1.5
wheelbase_m = 2.6
teeth_per_rev = 48
[can]
interface = "socketcan"
channel = "can0"
dbc = "bus.dbc"
[can.buses.chassis]
channel = "can1"
dbc = "bus.dbc"
[can.signals]
wheel_count_rl = "WHEELS.RL"
wheel_count_rr = "WHEELS.RR"
gnss_latitude = { signal = "POS.LAT", bus = "chassis" }
gnss_longitude = { signal = "POS.LON", bus = "chassis" }
gnss_speed = { signal = "VEL.SPD", bus = "chassis" }
gnss_course = { signal = "VEL.CRS", bus = "chassis" }
[gnss]
source = "can"
"""


def drive(folder: Path, fixes: int) -> None:
    """Eastward at 20 m/s on the second bus, five fixes a second, the receiver ready from the tenth on; on the
    first bus the same identifiers hold other numbers."""
    (folder / "bus.dbc").write_text(DBC)
    (folder / "vehicle.toml").write_text(VEHICLE)
    lines = []
    for k in range(fixes):
        at = 1e9 + 0.2 * k
        longitude = 9.0 + math.degrees(4.0 * k / (6_378_137.0 * math.cos(math.radians(48.0))))
        place = np.array([48.0 * 1e7, longitude * 1e7]).round().astype("<i4").tobytes()
        motion = np.array([2000, 9000], dtype="<u2").tobytes()
        lines.append(f"({at - 1e-3:.6f}) can1 302#{int(k >= 10):02X}")
        lines += [f"({at:.6f}) can1 300#{place.hex()}", f"({at + 1e-3:.6f}) can1 301#{motion.hex()}"]
        lines += [
            f"({at + 2e-3:.6f}) can0 300#{bytes(8).hex()}",
            f"({at + 3e-3:.6f}) can0 101#{bytes(4).hex()}",
        ]
    (folder / "can.log").write_text("\n".join(lines) + "\n")


def test_fixes_of_the_bus_they_are_on(tmp_path: Path) -> None:
    """Each burst of two messages is a fix with place, speed and course; no sentence is needed."""
    drive(tmp_path, 40)
    config = load_config(tmp_path / "vehicle.toml")
    raw = read_drive([tmp_path], on_bus=BusFixes(config, load_databases(config)))

    assert is_on_bus(config)
    assert 40 == len(raw.fixes)
    assert {48.0} == {round(fix.latitude_deg, 6) for fix in raw.fixes}
    assert [20.0] * 40 == pytest.approx([fix.speed_mps for fix in raw.fixes])
    assert [math.pi / 2] * 40 == pytest.approx([fix.course_rad for fix in raw.fixes])
    assert np.diff([fix.arrival_s for fix in raw.fixes]) == pytest.approx(0.2, abs=1e-6)


def test_fixes_that_another_message_calls_valid(tmp_path: Path) -> None:
    """`valid_when` names a signal of a message that holds no fix: it is read all the same."""
    drive(tmp_path, 40)
    file = tmp_path / "vehicle.toml"
    named = file.read_text().replace('LAT", bus', 'LAT", valid_when = "RECEIVER.READY == 1", bus')
    file.write_text(named)
    config = load_config(file)
    raw = read_drive([tmp_path], on_bus=BusFixes(config, load_databases(config)))

    assert 30 == sum(math.isfinite(fix.latitude_deg) for fix in raw.fixes)


def test_a_folder_without_sentences_needs_a_receiver_on_the_bus(tmp_path: Path) -> None:
    """What reads no configuration says what is missing."""
    drive(tmp_path, 4)
    with pytest.raises(InputError, match=r"no gnss\.nmea"):
        read_drive([tmp_path])
