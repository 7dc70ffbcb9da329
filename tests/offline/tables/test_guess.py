"""Guessed maps against a drive in closed form: names as loggers write them, units and signs by the values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tpmsd
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.interfaces.api.import_table import guess_map
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.tables.guess import Guess
from tpmsd.offline.tables.guess import guess as guessed
from tpmsd.offline.tables.guess_names import parse_name, roles_by_name
from tpmsd.offline.tables.guess_values import (
    kind_of_wheel,
    modulus_of,
    road_unit,
    rotation_unit,
    time_unit,
)
from tpmsd.offline.tables.map_file import load_map
from tpmsd.offline.tables.read_table import read_table

RADIUS_M, TRACK_M = 0.31, 1.52
RPM = 30.0 / np.pi
Columns = dict[str, FloatArray]


def motion(duration_s: float = 200.0) -> Columns:
    """A car in bends at 10 to 20 m/s: wheels (m/s) differ by track times yaw rate; a path by integrals."""
    time_s = np.arange(0.0, duration_s, 0.02)
    speed, yaw_rate = 15.0 + 5.0 * np.sin(0.05 * time_s), 0.15 * np.sin(0.11 * time_s)
    heading = np.cumsum(yaw_rate) * 0.02 + 0.7
    east, north = (np.cumsum(speed * f(heading)) * 0.02 for f in (np.cos, np.sin))
    wheels = {
        wheel: speed + side * 0.5 * TRACK_M * yaw_rate
        for wheel, side in zip(WHEELS, (-1, 1, -1, 1), strict=True)
    }
    return {
        "time": time_s,
        "speed": speed,
        "yaw_rate": yaw_rate,
        "heading": heading,
        "east": east,
        "north": north,
        **wheels,
    }


def written(folder: Path, columns: Columns, thinned: tuple[str, ...] = ()) -> Path:
    """A CSV; of the `thinned` columns every tenth row alone, as a receiver tells them."""
    path = folder / "log.csv"
    rows = [",".join(columns)]
    for k in range(len(next(iter(columns.values())))):
        cells = (f"{v[k]:.9g}" if name not in thinned or k % 10 == 0 else "" for name, v in columns.items())
        rows.append(",".join(cells))
    path.write_text("\n".join(rows) + "\n")
    return path


def logged(made: Columns) -> Columns:
    """As one logger writes it: rpm, degrees, km/h, a yaw rate positive to the right, no unit in a name."""
    lat = 50.0 + np.degrees(made["north"] / 6.365e6)
    lon = 8.0 + np.degrees(made["east"] / (6.378e6 * np.cos(np.radians(50.0))))
    wheels = {f"WheelSpeed{wheel.upper()}": made[wheel] / RADIUS_M * RPM for wheel in WHEELS}
    return {
        "Timestamp": made["time"] * 1e3,
        **wheels,
        "GyroZ": -np.degrees(made["yaw_rate"]),
        "GPS Latitude": lat,
        "GPS Longitude": lon,
        "GPS_Speed": 3.6 * made["speed"],
        "GPS Heading": np.degrees(0.5 * np.pi - made["heading"]) % 360.0,
        "Engine RPM": np.full(len(lat), 2000.0),
    }


def of(path: Path) -> Guess:
    return guessed(read_table(path))


def test_units_signs_and_measures_are_identified_by_the_values(tmp_path: Path) -> None:
    """Rotation in rpm, its rolling radius and the tracks; a yaw rate in deg/s to the right; km/h; ms."""
    found = of(written(tmp_path, logged(motion())))

    assert ("Timestamp", "ms") == (found.time, found.time_unit)
    for wheel in WHEELS:
        one = found.columns[f"wheel_speed_{wheel}"]
        assert (f"WheelSpeed{wheel.upper()}", "rpm") == (one.name, one.unit)
    assert ("deg/s", -1.0) == (found.columns["yaw_rate"].unit, found.columns["yaw_rate"].scale)
    assert "km/h" == found.columns["gnss_speed"].unit
    assert "deg" == found.columns["gnss_course"].unit
    assert RADIUS_M == pytest.approx(found.measures["wheel_radius_m"][0], rel=0.005)
    assert TRACK_M == pytest.approx(found.measures["track_rear_m"][0], rel=0.01)
    assert ("Engine RPM",) == found.unused
    assert [] == found.doubts


@pytest.mark.parametrize(
    ("name", "unit", "doubt"),
    [
        ("GyroZ_dps", "deg/s", "GyroZ_dps: sign not determined, for the course turns too little"),
        (
            "GyroZ",
            None,
            "GyroZ: unit and sign not determined, for the course turns too little;"
            " without a unit it is rad/s",
        ),
    ],
)
def test_a_gyro_that_the_course_cannot_judge_keeps_its_names_unit(
    tmp_path: Path, name: str, unit: str | None, doubt: str
) -> None:
    """Noise in place of the yaw rate; the doubt names what the import would assume."""
    columns = logged(motion())
    noise = np.random.default_rng(1).standard_normal(len(columns.pop("GyroZ")))
    found = of(written(tmp_path, {**columns, name: noise}))
    assert unit == found.columns["yaw_rate"].unit
    assert [doubt] == found.doubts


def test_a_guessed_map_makes_a_drive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--guess > map.toml` and `--map map.toml` in a row: the drive's wheels turn as the car drove."""
    made = motion()
    table = written(tmp_path, logged(made), ("GPS Latitude", "GPS Longitude", "GPS_Speed", "GPS Heading"))
    assert 0 == main(["import", str(table), "--guess"])
    map_file = tmp_path / "map.toml"
    map_file.write_text(capsys.readouterr().out)

    assert 0 == main(["import", str(table), "--map", str(map_file), str(tmp_path / "drive")])
    ticks = tpmsd.replay(tmp_path / "drive").table
    assert ticks is not None
    expected = np.interp(ticks["drive_time_s"], made["time"], made["speed"])
    settled = ticks["drive_time_s"] > 20.0
    np.testing.assert_allclose(ticks["speed_mps"][settled], expected[settled], rtol=0.03)


@pytest.mark.parametrize(("unit", "factor"), [("km/h", 3.6), ("m/s", 1.0), ("mph", 1.0 / 0.44704)])
def test_road_speeds_without_a_unit(tmp_path: Path, unit: str, factor: float) -> None:
    """Numbered columns are front left, front right, rear left, rear right; the positions tell their unit."""
    made = motion()
    table = {"t": made["time"], "east": made["east"], "north": made["north"]}
    found = of(
        written(tmp_path, {**table, **{f"whl_spd[{k}]": factor * made[w] for k, w in enumerate(WHEELS)}})
    )

    assert {unit} == {found.columns[f"wheel_speed_{wheel}"].unit for wheel in WHEELS}
    assert "whl_spd[2]" == found.columns["wheel_speed_rl"].name
    assert "a usual value: not measured" == found.measures["wheel_radius_m"][1]


def test_counts_that_roll_over(tmp_path: Path) -> None:
    """Counts of 96 teeth modulo 4096: the modulus, and teeth that go with the radius beside them."""
    made = motion()
    turned = {wheel: np.cumsum(made[wheel]) * 0.02 / (2 * np.pi * RADIUS_M) for wheel in WHEELS}
    table = {"time_s": made["time"], "east": made["east"], "north": made["north"]}
    counts = {f"cnt_{wheel}": np.floor(96 * turned[wheel]) % 4096 for wheel in WHEELS}
    found = of(written(tmp_path, {**table, **counts}))

    assert {4096} == {found.columns[f"wheel_count_{wheel}"].modulus for wheel in WHEELS}
    per_metre = found.measures["teeth_per_rev"][0] / (2 * np.pi * found.measures["wheel_radius_m"][0])
    assert 96 / (2 * np.pi * RADIUS_M) == pytest.approx(per_metre, rel=0.01)


def test_names_against_values_and_swapped_sides_are_reported(tmp_path: Path) -> None:
    """A name that says km/h above metres per second, and a left wheel that is the faster one to the left."""
    made = motion()
    table = {"t": made["time"], "east": made["east"], "north": made["north"]}
    names = {"fl": made["fr"], "fr": made["fl"], "rl": made["rl"], "rr": made["rr"]}
    found = of(written(tmp_path, {**table, **{f"v_{w}_kmh": v for w, v in names.items()}}))

    assert any("names say km/h, their values m/s" in one for one in found.doubts)
    assert any("the front wheels: left and right are swapped" in one for one in found.doubts)


def test_without_wheels_the_exit_code_tells(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A table without wheels: the map says so, exit 4; a file that is none, exit 3."""
    path = tmp_path / "t.csv"
    path.write_text("t,temperature\n0,20\n1,20\n")

    assert 4 == main(["import", str(path), "--guess"])
    assert "give wheel_speed_*" in capsys.readouterr().out
    assert not guess_map(path)[1]
    assert 3 == main(["import", str(tmp_path / "nowhere.csv"), "--guess"])
    assert 2 == main(["import", str(path), "drive", "--guess"])


class Opened:
    """An open table of arrays."""

    vehicle_toml: str | None = None

    def __init__(self, columns: Columns) -> None:
        self.names, self._columns = tuple(columns), columns

    def column(self, name: str) -> FloatArray:
        return self._columns[name]

    def own_time(self, name: str) -> None:
        return None

    def close(self) -> None:
        return None


def test_a_name_cannot_write_into_the_map(tmp_path: Path) -> None:
    """Quotes and line ends of a column's name stay within its text."""
    made = motion()
    name = 'v_rl "x\n[can]'
    columns = {"t": made["time"], name: made["rl"], "v_rr": made["rr"], "other\n[gnss]": made["rl"]}
    text = guessed(Opened(columns)).text("log.parquet")

    assert [] == [line for line in text.splitlines() if line in ("[can]", "[gnss]")]
    (tmp_path / "map.toml").write_text(text)
    mapped = load_map(tmp_path / "map.toml").columns
    assert mapped is not None
    assert name == mapped["wheel_speed_rl"].column


def test_all_errors_of_a_map_come_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An unknown role, a wrong unit, columns that the table lacks and no time: each with its line."""
    table = tmp_path / "log.csv"
    table.write_text("stamp,v_rl,v_rr\n0,1,1\n1,1,1\n")
    (tmp_path / "map.toml").write_text(
        '[columns]\nwheel_sped_fl = "v_fl"\nwheel_speed_rl = { column = "v_r1", unit = "foo" }\n'
        'wheel_speed_rr = "v_rr"\n'
    )

    assert 2 == main(["import", str(table), "--map", str(tmp_path / "map.toml"), str(tmp_path / "drive")])
    reported = capsys.readouterr().err
    for expected in (
        "map.toml:2: [columns] wheel_sped_fl: unknown role; did you mean wheel_speed_fl?",
        "map.toml:2: [columns] wheel_sped_fl: the table has no column 'v_fl'",
        "map.toml:3: [columns] wheel_speed_rl.unit: unit 'foo'",
        "map.toml:3: [columns] wheel_speed_rl: the table has no column 'v_r1'",
        "[table] time: missing",
    ):
        assert expected in reported


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("ABS_vRR [km/h]", "wheel_rr"),
        ("Rad_hinten_links", "wheel_rl"),
        ("RL", "wheel_rl"),
        ("whl_rr", "wheel_rr"),
        ("whl_fl", "wheel_fl"),
        ("front left wheel speed", "wheel_fl"),
        ("accel_long", "accel_long"),
        ("Yaw Rate (deg/s)", "yaw_rate"),
        ("LongAcc", "accel_long"),
        ("GNSS.Lat", "gnss_latitude"),
        ("steering_angle", "steering_wheel_angle"),
        ("cog", "gnss_course"),
    ],
)
def test_names_of_loggers(name: str, role: str) -> None:
    """Spellings of loggers and of two languages."""
    assert role == roles_by_name([name])[name][0][0]


@pytest.mark.parametrize(
    "name",
    [
        "steering_rate",
        "engine_speed",
        "tyre_pressure_fl",
        "hr",
        "latacc_std",
        "fuel",
        "frame",
        "flag",
        "error",
    ],
)
def test_names_that_are_no_role(name: str) -> None:
    """Names that begin like one of a role."""
    assert [] == roles_by_name([name])[name]


def test_units_of_names_and_values() -> None:
    """Brackets and suffixes; steps of time; ratios to metres per second."""
    assert ["km/h", "m/s", "deg/s", None] == [
        parse_name(name).unit for name in ("v [km/h]", "speed_mps", "yaw_rate_degps", "v_rr")
    ]
    assert ["km/h", "deg/s"] == [parse_name(name).unit for name in ("WheelSpd_FL_kph", "yawRate_dps")]
    assert ["s", "ms", "us", "ns", None] == [
        time_unit(np.arange(50.0) * step) for step in (0.01, 10.0, 1e4, 1e7, -1.0)
    ]
    assert ("km/h", None) == (road_unit(3.55), road_unit(2.9))
    unit, radius_m = rotation_unit(1.0 / 0.3) or ("", 0.0)
    assert "rad/s" == unit
    assert 0.3 == pytest.approx(radius_m)
    rising = np.arange(0.0, 5000.0, 7.0)
    assert ("count", "angle", "speed") == (
        kind_of_wheel(rising % 1001),
        kind_of_wheel(rising * 0.11),
        kind_of_wheel(15.0 + np.sin(rising)),
    )
    assert (1001, 256, None) == (modulus_of(rising % 1001), modulus_of(rising % 256), modulus_of(rising))
