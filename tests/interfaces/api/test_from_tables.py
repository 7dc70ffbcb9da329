"""Drives from arrays and data frames: exact where the arrays are, and told where they make no sense."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tpmsd
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.tables.encode import encode
from tpmsd.offline.tables.gather import geodetic_from_plane
from tpmsd.offline.tables.signals import Fixes, SignalReadings, Signals
from tpmsd.onboard.timeline.local_plane import LocalPlane

CAR = {
    "wheel_radius_m": 0.316,
    "track_front_m": 1.53,
    "track_rear_m": 1.52,
    "wheelbase_m": 2.63,
    "teeth_per_rev": 48,
}
RADII_M = np.array([0.3170, 0.3160, 0.3150, 0.3165])
SPEED_MPS = 20.0
Arrays = dict[str, Any]


def straight(duration_s: float = 60.0) -> tuple[Arrays, Arrays]:
    """Wheels of known radii at a constant 20 m/s on a straight road to the east, and exact fixes at 5 Hz."""
    time_s, fix_s = np.arange(0.0, duration_s, 0.02), np.arange(0.0, duration_s, 0.2)
    wheels = {"time_s": time_s}
    for wheel, radius in zip(WHEELS, RADII_M, strict=True):
        wheels[f"wheel_angle_{wheel}_rad"] = SPEED_MPS * time_s / radius
    gnss = {
        "time_s": fix_s,
        "east_m": SPEED_MPS * fix_s,
        "north_m": np.zeros(len(fix_s)),
        "speed_mps": np.full(len(fix_s), SPEED_MPS),
        "heading_rad": np.zeros(len(fix_s)),
        "position_std_m": np.full(len(fix_s), 0.5),
    }
    return wheels, gnss


def converted(wheels: Arrays, how: str) -> Arrays:
    """The same wheels told in another way."""
    out: Arrays = {"time_s": wheels["time_s"]}
    for wheel, radius in zip(WHEELS, RADII_M, strict=True):
        if how == "speed_kmh":
            # A sender's road speed is by the nominal radius.
            out[f"wheel_speed_{wheel}_kmh"] = np.full(len(out["time_s"]), 3.6 * SPEED_MPS * 0.316 / radius)
        else:
            out[f"wheel_count_{wheel}"] = (
                np.floor(wheels[f"wheel_angle_{wheel}_rad"] * 48 / (2 * np.pi)) % 1001
            )
    return out


@pytest.mark.parametrize("how", ["angle", "speed_kmh", "count"])
def test_radii_come_out_of_arrays(how: str) -> None:
    """Wheels of known radii, as angles, road speeds or counts of modulus 1001: each radius within 0.2 mm."""
    wheels, gnss = straight()
    if how != "angle":
        wheels = converted(wheels, how)
    drive = tpmsd.Drive.from_tables(wheels, gnss, vehicle=CAR, modulus=1001 if how == "count" else None)
    replay = tpmsd.replay(drive)

    found_m = np.array([0.316 + replay.wheels[wheel].deviation_m for wheel in WHEELS])
    np.testing.assert_allclose(found_m, RADII_M, atol=2e-4)
    assert () == replay.alarms


def test_a_saved_drive_is_the_same_drive(tmp_path: Path) -> None:
    """Written as a folder and read again, a drive from arrays replays to the very same numbers."""
    wheels, gnss = straight(40.0)
    drive = tpmsd.Drive.from_tables(wheels, gnss, vehicle=CAR)
    folder = drive.save(tmp_path / "made")

    in_memory, from_folder = tpmsd.replay(drive), tpmsd.replay(folder)
    np.testing.assert_array_equal(in_memory.result.deviation_m, from_folder.result.deviation_m)
    with pytest.raises(tpmsd.ConfigError, match="is stored at"):
        tpmsd.load(folder).save(tmp_path / "again")


def test_a_tick_table_replays_to_the_same_alarms(folder: Path, replay: tpmsd.Replay) -> None:
    """A replay's own table, taken as a drive, gives the alarms within 5 s and radii within 0.05 mm."""
    frame = replay.to_pandas()
    again = tpmsd.replay(
        tpmsd.Drive.from_tables(frame, frame, frame, vehicle=tpmsd.load(folder).config), table=False
    )

    assert [(a.kind, a.wheel, a.state) for a in replay.alarms] == [
        (a.kind, a.wheel, a.state) for a in again.alarms
    ]
    for one, other in zip(replay.alarms, again.alarms, strict=True):
        assert abs(one.time_s - other.time_s) < 5.0
    for wheel in WHEELS:
        difference_m = replay.wheels[wheel].deviation_m - again.wheels[wheel].deviation_m
        assert abs(difference_m) < 5e-5
        assert again.wheels[wheel].std_m == pytest.approx(replay.wheels[wheel].std_m, rel=0.1)


@settings(derandomize=True, deadline=None, max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_a_plane_laid_on_the_earth_comes_back(seed: int) -> None:
    """A winding path of 20 km in a plane, laid on the ellipsoid, is the same in the timeline's plane."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(0.05 * rng.standard_normal(1000))
    steps = 20.0 * np.exp(1j * heading)
    path = np.concatenate([[0.0], np.cumsum(steps)])
    latitude, longitude, _ = geodetic_from_plane(path.real, path.imag, np.zeros(len(path)))
    back = LocalPlane().to_plane_array(latitude, longitude, np.zeros(len(path)))

    np.testing.assert_allclose(back[:, 0] + 1j * back[:, 1], path, atol=0.05)


def test_sentences_keep_what_they_are_given() -> None:
    """Position, speed and course of a fix come back from its sentences to 1e-9 degrees and 1e-6 m/s."""
    from tpmsd.onboard.sources.events import GnssFix
    from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler

    values = (-33.123456789, -70.987654321, 512.3456, 0.75, 13.987654, 6.2831)
    latitude, longitude, altitude, std, speed, course = (np.array([value]) for value in values)
    utc = np.array([1_720_000_059.9999996])
    fixes = Fixes(
        utc, utc, latitude, longitude, altitude, std, speed, course, np.array([4.0]), np.array([0.9])
    )
    wheel = SignalReadings(np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    encoded = encode(Signals({"rl": wheel, "rr": wheel}, fixes=fixes))
    assembler = NmeaAssembler()
    for item in encoded.items:
        if not hasattr(item, "arbitration_id"):
            assembler.feed(item.time_s, item.line)
    (fix,) = (event for event in assembler.flush() if isinstance(event, GnssFix))

    reported = (fix.latitude_deg, fix.longitude_deg, fix.altitude_m, fix.position_std_m, fix.speed_mps)
    np.testing.assert_allclose((*reported, fix.course_rad), values, atol=1e-6)
    np.testing.assert_allclose(reported[:2], values[:2], atol=1e-9)
    assert (4, 1_720_000_060.0) == (fix.quality, fix.utc_s)


def _without(table: Arrays, *names: str) -> Arrays:
    return {name: column for name, column in table.items() if name not in names}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda w, g: (_without(w, "time_s"), g), "wheels: no column time_s"),
        (lambda w, g: (_without(w, "wheel_angle_rl_rad"), g), "no wheel_*_rl: all four wheels are needed"),
        (lambda w, g: ({**w, "wheel_angel_rl_rad": w["time_s"]}, g), "did you mean wheel_angle_rl?"),
        (lambda w, g: ({**w, "wheel_speed_rl_mps": w["time_s"]}, g), "one of them, please"),
        (lambda w, g: ({**w, "time_s": w["time_s"][::-1]}, g), "time does not rise at"),
        (lambda w, g: ({**w, "time_s": w["time_s"][:5]}, g), "has 1000 rows, time_s 5"),
        (lambda w, g: (w, _without(g, "north_m")), "gnss_east and gnss_north go together"),
        (lambda w, g: (w, {**g, "speed_furlongs": g["time_s"]}), "is no role with a unit"),
        (lambda w, g: ({**w, "yaw_rate_radps": ["x"] * 1000}, g), "yaw_rate_radps: not numbers"),
        (lambda w, g: (3, g), "give a dict of arrays or a data frame, not int"),
    ],
)
def test_tables_that_make_no_sense_are_reported(change: Any, reason: str) -> None:
    """Each mistake in a table is a ConfigError of one line that names table and column."""
    wheels, gnss = change(*straight(20.0))
    with pytest.raises(tpmsd.ConfigError) as error:
        tpmsd.Drive.from_tables(wheels, gnss, vehicle=CAR)

    assert reason in str(error.value)
    assert 1 == len(str(error.value).splitlines())


def test_a_car_that_makes_no_sense_is_reported() -> None:
    """Wrong values of the car are told as of a vehicle.toml, each with its key."""
    wheels, gnss = straight(20.0)
    with pytest.raises(tpmsd.ConfigError, match=r"\[vehicle\] wheel_radius_m"):
        tpmsd.Drive.from_tables(wheels, gnss, vehicle={**CAR, "wheel_radius_m": 316})
    with pytest.raises(tpmsd.ConfigError, match="wheelbase_m"):
        tpmsd.Drive.from_tables(wheels, gnss, vehicle=_without(CAR, "wheelbase_m"))
