"""How many CAN frames are decoded per second, and how many of a log as arrays.

In: nothing; frames and a drive are made up here, and real recordings are read where there are any. Out: the
rate, then one line per log: the fraction of its frames decoded as arrays, and how often each reason ended a
range of them.

    python -m bench run decode
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import cantools.database

from bench.places import RECORDINGS
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import CanConfig, Config, VehicleConfig
from tpmsd.offline.drives.reading import FolderRecording, play
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.sources.can.block import FrameBlock
from tpmsd.onboard.sources.can.decoder import CanDecoder
from tpmsd.onboard.timeline.block_source import BlockSource
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.tick_source import TickSource

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
        distance_m = 20.0 * time_s + 100.0 * (1.0 - math.cos(0.1 * time_s))
        counts = [
            int(distance_m * skew / (2 * math.pi * RADIUS_M) * TEETH) for skew in (1.0, 1.001, 0.999, 1.002)
        ]
        data = b"".join((count % 65536).to_bytes(2, "little") for count in counts)
        frames.append((time_s, 176, data))
        frames.append((time_s + 0.003, 36, bytes(8)))

    began = time.process_time()
    for time_s, identifier, data in frames:
        decoder.decode(time_s, identifier, False, data)
    spent_s = time.process_time() - began
    assert {"frames"} == set(decoder.counts)
    return len(frames) / spent_s


class _CountingSource(BlockSource):
    """A block source that counts the frames which go through the decoder one by one."""

    def __init__(self, source: TickSource) -> None:
        super().__init__(source)
        self.single = 0

    def _play_one_by_one(self, block: FrameBlock, stop: int) -> Iterator[Tick]:
        self.single += stop - self._at
        yield from super()._play_one_by_one(block, stop)


def array_fraction(folder: Path) -> tuple[float, Counter[str]]:
    """Return the fraction of a drive's frames decoded as arrays, and how often each reason ended a range."""
    config = load_config(folder)
    stream, database = FolderRecording(folder).open(config)
    source = _CountingSource(TickSource(config, database))
    for _ in play(stream, source):
        pass
    return 1.0 - source.single / source.decoder.counts["frames"], source.ended


def options(parser: argparse.ArgumentParser) -> None:
    """None of its own."""


def main(args: argparse.Namespace) -> int:
    """Print the rate, and what ends the ranges of regular frames in each log."""
    print(
        f"CAN decoding: {frames_per_second():,.0f} frames per second (half with four counters, half with two)"
    )
    with tempfile.TemporaryDirectory() as name:
        simulated = Path(name) / "0.1 % lost, 0.1 % repeated"
        bus = BusSpec(lost_fraction=0.001, repeated_fraction=0.001)
        write_drive(simulated, simulate_drive(DriveSpec(duration_s=600.0, seed=1, bus=bus)))
        recorded = [path.parent for path in RECORDINGS.glob("*/vehicle.toml")] if RECORDINGS.is_dir() else []
        for folder in (simulated, *sorted(recorded)):
            fraction, ended = array_fraction(folder)
            reasons = ", ".join(f"{count} x {reason}" for reason, count in ended.most_common())
            print(f"{folder.name}: {fraction:.2%} of the frames as arrays; ended by {reasons or 'nothing'}")
    return 0
