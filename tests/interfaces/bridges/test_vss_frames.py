"""Values of the Vehicle Signal Specification as frames: what is sent, and what the daemon makes of it."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pynmea2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.config.load import load_config
from tpmsd.interfaces.bridges.vss_frames import (
    LATE_S,
    WINDOW_S,
    Delays,
    NotSent,
    VssFrame,
    VssFrames,
    vss_dbc,
)
from tpmsd.interfaces.bridges.vss_names import FIX_TYPE, GNSS_TIME, is_wheel
from tpmsd.interfaces.cli.drive_reading import read_ticks
from tpmsd.interfaces.cli.main import main

FL = "Vehicle.Chassis.Axle.Row1.Wheel.Left.Speed"
LATITUDE, LONGITUDE = "Vehicle.CurrentLocation.Latitude", "Vehicle.CurrentLocation.Longitude"
ABS = "Vehicle.ADAS.ABS.IsEngaged"
WHEELS = {
    "fl": "Row1.Wheel.Left",
    "fr": "Row1.Wheel.Right",
    "rl": "Row2.Wheel.Left",
    "rr": "Row2.Wheel.Right",
}
RADIUS_M = 0.316
DATABASE: Any = cantools.database.load_string(vss_dbc(), "dbc")
FRAMES = VssFrames()


def test_paths_are_those_of_the_specification() -> None:
    """Both speeds of four wheels, row 1 in front, and the position; no path twice, identifiers in a row."""
    paths = FRAMES.paths
    wheels = [
        f"Vehicle.Chassis.Axle.{at}.{kind}" for kind in ("Speed", "AngularSpeed") for at in WHEELS.values()
    ]

    assert wheels == [path for path in paths if is_wheel(path)]
    assert {LATITUDE, LONGITUDE, GNSS_TIME, FIX_TYPE} <= set(paths)
    assert len(paths) == len(set(paths))


@pytest.mark.parametrize(
    ("path", "value", "identifier", "data"),
    [
        (FL, 100.5, 0x6C0, struct.pack("<i", 1_005_000)),
        (FL.replace("Speed", "AngularSpeed"), -90, 0x6C4, struct.pack("<i", -90_000)),
        (LONGITUDE, -179.9999999, 0x6C9, struct.pack("<i", -1_799_999_999)),
        (GNSS_TIME, "2024-07-01T08:00:00.2Z", 0x6CC, struct.pack("<Q", 1_719_820_800_200)[:6]),
        (GNSS_TIME, "2024-07-01T10:00:00+02:00", 0x6CC, struct.pack("<Q", 1_719_820_800_000)[:6]),
        (GNSS_TIME, "2024-07-01T08:00:00", 0x6CC, struct.pack("<Q", 1_719_820_800_000)[:6]),
        (FIX_TYPE, "NONE", 0x6CD, b"\0"),
        (FIX_TYPE, "THREE_D_SATELLITE_BASED_AUGMENTATION", 0x6CD, b"\1"),
        (ABS, True, 0x6D3, b"\1"),
    ],
)
def test_a_value_and_its_frame(path: str, value: object, identifier: int, data: bytes) -> None:
    """Little endian, in the steps that the DBC states; times are Unix milliseconds."""
    assert VssFrame(identifier, data) == VssFrames().to_frame(path, 5.0, value, 5.0)


@pytest.mark.parametrize(
    ("path", "value", "why"),
    [
        (FL, None, NotSent.NO_VALUE),
        (FL, math.nan, NotSent.OUT_OF_RANGE),
        (FL, math.inf, NotSent.OUT_OF_RANGE),
        (FL, 500.1, NotSent.OUT_OF_RANGE),
        (FL, "100", NotSent.MALFORMED),
        (FL, True, NotSent.MALFORMED),
        (FL, [100.0], NotSent.MALFORMED),
        (LATITUDE, 90.1, NotSent.OUT_OF_RANGE),
        (ABS, 1, NotSent.MALFORMED),
        (FIX_TYPE, 3, NotSent.MALFORMED),
        (FIX_TYPE, "RTK", NotSent.MALFORMED),
        (GNSS_TIME, 1_719_820_800, NotSent.MALFORMED),
        (GNSS_TIME, "2024-07-01", NotSent.MALFORMED),
        (GNSS_TIME, "yesterday", NotSent.MALFORMED),
        (GNSS_TIME, "0001-01-01T00:00:00Z", NotSent.OUT_OF_RANGE),
    ],
)
def test_values_that_are_not_sent(path: str, value: object, why: NotSent) -> None:
    """No value, no number, another type than the specification's, a number that cannot be."""
    assert why is VssFrames().to_frame(path, 5.0, value, 5.0)


def test_what_is_not_renewed_is_not_sent_again() -> None:
    """A stamp that was seen before, in the state at the start too, is no news; the same value again is."""
    frames = VssFrames()
    frames.note(FL, 1.0)

    assert NotSent.NOT_RENEWED is frames.to_frame(FL, 1.0, 50.0, 1.1)
    assert isinstance(frames.to_frame(FL, 2.0, 50.0, 2.1), VssFrame)
    assert NotSent.NOT_RENEWED is frames.to_frame(FL, 2.0, 50.0, 2.2)
    assert isinstance(frames.to_frame(FL, 3.0, 50.0, 3.1), VssFrame)


def test_what_was_held_up_is_not_sent() -> None:
    """After a stall of 3 s the values that waited are left out, the first that came in time is sent."""
    frames, sent = VssFrames(), []
    for k in range(500):
        stamp_s = 0.02 * k
        now_s = max(stamp_s, 5.0 if 2.0 < stamp_s < 5.0 else 0.0) + 0.005
        if isinstance(frames.to_frame(FL, stamp_s, 50.0, now_s), VssFrame):
            sent.append(stamp_s)

    assert [0.02 * k for k in range(500) if not 2.0 < 0.02 * k < 5.0 - LATE_S] == sent


def test_clocks_that_differ_and_clocks_that_are_set() -> None:
    """A databroker an hour ahead is as good as one in time; set back by 10 s it is so after two windows."""
    delays = Delays()
    assert not any(delays.late(3600.0 + t_s, t_s) for t_s in np.arange(0.0, 100.0, 0.5))
    late = [delays.late(3590.0 + t_s, t_s) for t_s in np.arange(100.0, 300.0, 0.5)]

    assert late[0] and not late[-1]
    assert sorted(late, reverse=True) == late
    assert WINDOW_S <= 0.5 * sum(late) <= 2.0 * WINDOW_S + 1.0


@settings(max_examples=200, deadline=None)
@given(
    path=st.sampled_from(FRAMES.paths),
    stamp_s=st.floats(0.0, 4e9),
    delay_s=st.sampled_from([0.0, 0.01, 1.0, 1e6]),
    value=st.one_of(
        st.none(), st.booleans(), st.integers(-(2**63), 2**64), st.floats(), st.text(max_size=40), st.binary()
    ),
)
def test_whatever_comes_is_a_frame_in_range_or_a_reason(
    path: str, stamp_s: float, delay_s: float, value: object
) -> None:
    """No value of any type raises; what is sent is what was said, within half a step."""
    made = FRAMES.to_frame(path, stamp_s, value, stamp_s + delay_s)
    if isinstance(made, NotSent):
        return
    (signal,) = DATABASE.get_message_by_frame_id(made.identifier).signals
    (read,) = DATABASE.decode_message(made.identifier, made.data).values()
    assert path == signal.comment
    if isinstance(value, int | float):
        assert abs(read - value) <= 0.5001 * signal.scale


@dataclass(frozen=True)
class Point:
    """A value that was written into a databroker."""

    time_s: float
    path: str
    value: object


def written(drive: Path, angular: bool) -> Iterator[Point]:
    """What a car of which the databroker knows wheel speeds and position would have written on a drive."""
    database: Any = cantools.database.load_file(drive / "bus.dbc")
    for line in (drive / "can.log").read_text("ascii").splitlines():
        stamp, _, frame = line.split()
        if frame.startswith("0AA#"):
            for wheel, kmh in database.decode_message(0xAA, bytes.fromhex(frame[4:])).items():
                path = (
                    f"Vehicle.Chassis.Axle.{WHEELS[wheel.lower()]}.{'AngularSpeed' if angular else 'Speed'}"
                )
                value = math.degrees(kmh / 3.6 / RADIUS_M) if angular else kmh
                yield Point(float(stamp.strip("()")), path, float(np.float32(value)))
    for line in (drive / "gnss.nmea").read_text("ascii").splitlines():
        stamp, sentence = line.split()
        if "RMC" in sentence:
            said = pynmea2.parse(sentence)
            moment = datetime.combine(said.datestamp, said.timestamp.replace(tzinfo=None), tzinfo=UTC)
            for path, value in (
                (LATITUDE, said.latitude),
                (LONGITUDE, said.longitude),
                (GNSS_TIME, moment.isoformat()),
            ):
                yield Point(float(stamp.strip("()")), path, value)


def replayable(drive: Path, folder: Path, angular: bool) -> Path:
    """The drive as the bridge puts it on a bus, with the car's configuration."""
    folder.mkdir()
    frames, lines = VssFrames(), []
    for point in sorted(written(drive, angular), key=lambda one: one.time_s):
        made = frames.to_frame(point.path, point.time_s, point.value, point.time_s)
        assert isinstance(made, VssFrame)
        lines.append(f"({point.time_s:.6f}) vcan0 {made.identifier:03X}#{made.data.hex().upper()}")
    (folder / "can.log").write_text("\n".join(lines) + "\n", "ascii")
    (folder / "vss.dbc").write_text(vss_dbc(), "utf-8")
    kind = "ROTATION" if angular else "SPEED"
    roles = [f'wheel_speed_{wheel} = "VSS_{kind}_{wheel.upper()}.{kind}_{wheel.upper()}"' for wheel in WHEELS]
    roles += [
        f'gnss_{name} = "VSS_{name.upper()}.{name.upper()}"' for name in ("latitude", "longitude", "utc")
    ]
    car = (drive / "vehicle.toml").read_text("utf-8").partition("[can]")[0]
    (folder / "vehicle.toml").write_text(
        f'{car}[can]\nchannel = "vcan0"\ndbc = "vss.dbc"\n[can.signals]\n'
        + "\n".join(roles)
        + '\n[gnss]\nsource = "can"\nlatency_s = 0.06\n',
        "utf-8",
    )
    return folder


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """40 s of a simulated car whose bus carries wheel speeds in steps of 0.01 km/h."""
    folder = tmp_path_factory.mktemp("vss") / "drive"
    options = ["--bus", "speeds", "--route", "city", "--duration", "40", "--seed", "3"]
    assert 0 == main(["simulate", str(folder), *options])
    return folder


@pytest.mark.parametrize("angular", [False, True])
def test_the_daemon_reads_the_car_through_a_databroker(drive: Path, tmp_path: Path, angular: bool) -> None:
    """Wheels turn as they do on the car's own bus, to 0.01 mm of way in each tick and 1 mm in all; every fix
    comes, within 1 ms and the 2 cm of its resolution."""
    through = replayable(drive, tmp_path / "through", angular)
    own, other = (read_ticks(folder, load_config(folder)) for folder in (drive, through))
    turned = [np.array([tick.rotation_rad for tick in ticks]) for ticks in (own, other)]
    differ_m = RADIUS_M * (turned[1] - turned[0])[2:-1]  # while all wheels are heard
    fixes = [
        np.array([(fix.time_s, fix.east_m, fix.north_m) for tick in ticks for fix in tick.fixes])
        for ticks in (own, other)
    ]

    assert np.abs(differ_m).max() < 1e-5
    assert np.abs(differ_m.sum(axis=0)).max() < 1e-3
    assert len(fixes[0]) > 190
    assert (np.abs(fixes[1] - fixes[0]).max(axis=0) < (1e-3, 0.02, 0.02)).all()
