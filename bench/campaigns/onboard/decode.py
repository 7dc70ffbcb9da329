"""How many CAN frames are decoded per second.

In: nothing; the frames are made up here. Out: one line on standard output.

    python -m bench run decode
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import cantools.database

from tpmsd.car.config.model import CanConfig, Config, VehicleConfig
from tpmsd.onboard.sources.can_decoder import CanDecoder

RADIUS_M, TEETH = 0.316, 48

DBC = """VERSION ""
BO_ 176 WHEELS: 8 CAR
 SG_ FL : 0|16@1+ (1,0) [0|65535] "" CAR
 SG_ FR : 16|16@1+ (1,0) [0|65535] "" CAR
 SG_ RL : 32|16@1+ (1,0) [0|65535] "" CAR
 SG_ RR : 48|16@1+ (1,0) [0|65535] "" CAR
BO_ 36 MOTION: 8 CAR
 SG_ YAW : 7|16@0- (0.01,0) [0|0] "deg/s" CAR
 SG_ LONG : 23|16@0- (0.01,0) [0|0] "m/s2" CAR
"""


def frames_per_second(number: int = 120_000) -> float:
    """Frames decoded per second of CPU time, of which half hold four counters and half two readings."""
    vehicle = VehicleConfig((RADIUS_M,) * 4, 1.5, 1.5, 2.6, teeth_per_rev=TEETH)
    signals = {f"wheel_count_{wheel}": f"WHEELS.{wheel.upper()}" for wheel in ("fl", "fr", "rl", "rr")}
    signals |= {"yaw_rate": "MOTION.YAW", "accel_long": "MOTION.LONG"}
    database = cantools.database.load_string(DBC, "dbc")
    assert isinstance(database, cantools.database.can.Database)
    decoder = CanDecoder(Config(vehicle, CanConfig(signals, Path("bus.dbc"))), database)

    frames = []
    for step in range(number // 2):
        time_s = 0.01 * step
        way_m = 20.0 * time_s + 100.0 * (1.0 - math.cos(0.1 * time_s))
        counts = [int(way_m * skew / (2 * math.pi * RADIUS_M) * TEETH) for skew in (1.0, 1.001, 0.999, 1.002)]
        data = b"".join((count % 65536).to_bytes(2, "little") for count in counts)
        frames.append((time_s, 176, data))
        frames.append((time_s + 0.003, 36, bytes(8)))

    began = time.process_time()
    for time_s, identifier, data in frames:
        decoder.decode(time_s, identifier, False, data)
    spent_s = time.process_time() - began
    assert {"frames"} == set(decoder.counts)
    return len(frames) / spent_s


def options(parser: argparse.ArgumentParser) -> None:
    """None of its own."""


def main(args: argparse.Namespace) -> int:
    """Print the rate."""
    print(
        f"CAN decoding: {frames_per_second():,.0f} frames per second (half with four counters, half with two)"
    )
    return 0
