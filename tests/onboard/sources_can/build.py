"""Small DBC files, configurations and wheels that the tests of the CAN input share."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import cantools.database
from cantools.database.can import Database

from tpmsd.car.config.model import CanConfig, Config, VehicleConfig
from tpmsd.onboard.sources.can.decoder import CanDecoder
from tpmsd.onboard.sources.events import Event, RotationSample, SourceFault

RADIUS_M = 0.3
TEETH = 48.0

COUNTERS_DBC = """VERSION ""
NS_ :
BS_:
BU_: CAR
BO_ 176 WHEELS: 8 CAR
 SG_ FL : 0|16@1+ (1,0) [0|65535] "" CAR
 SG_ FR : 16|16@1+ (1,0) [0|65535] "" CAR
 SG_ RL : 32|16@1+ (1,0) [0|65535] "" CAR
 SG_ RR : 48|16@1+ (1,0) [0|65535] "" CAR
BO_ 177 OTHER: 8 CAR
 SG_ X : 0|8@1+ (1,0) [0|255] "" CAR
"""

SPEEDS_DBC = """VERSION ""
NS_ :
BS_:
BU_: CAR
BO_ 176 WHEELS: 8 CAR
 SG_ FL : 7|16@0+ (0.01,0) [0|300] "km/h" CAR
 SG_ FR : 23|16@0+ (0.01,0) [0|300] "km/h" CAR
 SG_ RL : 39|16@0+ (0.01,0) [0|300] "km/h" CAR
 SG_ RR : 55|16@0+ (0.01,0) [0|300] "km/h" CAR
BO_ 36 MOTION: 8 CAR
 SG_ YAW : 0|16@1- (0.01,0) [-320|320] "deg/s" CAR
"""


def config(signals: dict[str, str], radius_m: float = RADIUS_M, teeth: float = TEETH) -> Config:
    vehicle = VehicleConfig((radius_m,) * 4, 1.5, 1.5, 2.6, teeth_per_rev=teeth)
    return Config(vehicle, CanConfig(signals, Path("bus.dbc")))


def database(text: str) -> Database:
    loaded = cantools.database.load_string(text, "dbc", strict=False)
    assert isinstance(loaded, Database)
    return loaded


def four(kind: str, message: str = "WHEELS") -> dict[str, str]:
    return {f"wheel_{kind}_{wheel}": f"{message}.{wheel.upper()}" for wheel in ("fl", "fr", "rl", "rr")}


def counter_decoder() -> CanDecoder:
    return CanDecoder(config(four("count")), database(COUNTERS_DBC))


def speed_decoder(**more: str) -> CanDecoder:
    return CanDecoder(config(four("speed") | more), database(SPEEDS_DBC))


def counts_frame(*counts: int) -> bytes:
    return b"".join((count % 65536).to_bytes(2, "little") for count in counts)


def speeds_frame(*speeds_kmh: float) -> bytes:
    return b"".join(round(speed * 100).to_bytes(2, "big") for speed in speeds_kmh)


def counts_at(speed_mps: float, time_s: float) -> int:
    """Whole counts of a wheel of RADIUS_M and TEETH that rolls at a constant speed."""
    return math.floor(speed_mps * time_s / (2 * math.pi * RADIUS_M) * TEETH)


def rotations(events: Iterable[Event], wheel: int | None = None) -> list[RotationSample]:
    return [e for e in events if isinstance(e, RotationSample) and wheel in (None, e.wheel)]


def faults(events: Iterable[Event]) -> list[SourceFault]:
    return [e for e in events if isinstance(e, SourceFault)]
