"""Racelogic VBO files: units and signs against the motion that made them, and files that are none."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.car.config.dynamics import load_car
from tpmsd.car.config.problems import ConfigProblems
from tpmsd.foundation.errors import InputError
from tpmsd.foundation.schemas import schema_of
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.signals.read import read_signals
from tpmsd.offline.signals.vbo import MAX_COLUMNS, read_vbo

HEADER = """File created on 01/07/2024 at 10:00:00

[header]
satellites
time
latitude
longitude
velocity kmh
heading
height
YawRate
LatAcc
LongAcc
Steering_Angle
Oil_Temp

[channel units]
deg/s
g
g
deg
C

[comments]
made for a test

[column names]
sats time lat long velocity heading height YawRate LatAcc LongAcc Steering_Angle Oil_Temp

[data]
"""
WORDS = ["nan", "inf", "1e308", "-1e308", "120000.0", "x", "", "[data]", "[", "\u00e9"]
CAR = """[vehicle]
steering_ratio = 15.0
[dynamics]
mass_kg = 1500.0
yaw_inertia_kgm2 = 2500.0
cg_to_front_m = 1.2
cg_to_rear_m = 1.5
cornering_stiffness_front_n_per_rad = 110000.0
cornering_stiffness_rear_n_per_rad = 130000.0
"""


def motion(count: int = 600) -> dict[str, np.ndarray]:
    """Weaving with a changing speed at 20 Hz, from just before midnight on."""
    t = np.arange(count) * 0.05
    speed = 20.0 + 3.0 * np.sin(0.4 * t)
    yaw = 0.2 * np.sin(0.7 * t)
    heading = np.cumsum(yaw) * 0.05  # ISO 8855, counter-clockwise
    return {"t": t, "speed": speed, "yaw": yaw, "heading": heading, "ahead": 1.2 * np.cos(0.4 * t)}


def clock(day_s: float) -> str:
    hours, rest = divmod(day_s % 86_400.0, 3600.0)
    minutes, seconds = divmod(rest, 60.0)
    return f"{int(hours):02d}{int(minutes):02d}{seconds:05.2f}"


def vbo(where: Path, turned: float = 1.0, start_s: float = 86_390.0) -> Path:
    """A file of the motion; `turned` -1: a logger whose y axis and turns point right."""
    m = motion()
    rows = []
    for k, t in enumerate(m["t"]):
        course = math.degrees(-m["heading"][k]) % 360.0
        lateral = m["speed"][k] * m["yaw"][k] / 9.80665
        rows.append(
            f"{9 + 64 * (k % 2):03d} {clock(start_s + t)} +{3119.0 + 0.001 * k:010.5f} -{58.5:011.5f} "
            f"{3.6 * m['speed'][k]:07.3f} {course:06.2f} +{100.0:08.2f} "
            f"{turned * math.degrees(m['yaw'][k]):+.5E} {turned * lateral:+.5E} "
            f"{m['ahead'][k] / 9.80665:+.5E} "
            f"{turned * math.degrees(15.0 * 0.05 * m['yaw'][k]):+.4f} 90.0"
        )
    where.write_text(HEADER + "\n".join(rows) + "\n", encoding="latin-1")
    return where


@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_units_and_signs_are_those_of_the_motion(tmp_path: Path, turned: float) -> None:
    """Minutes with west positive, km/h, degrees and g become SI units; either sign of a logger becomes ISO
    8855; the day goes on at midnight."""
    m = motion()
    notes: list[str] = []
    table = read_vbo(vbo(tmp_path / "a.vbo", turned), notes.append).columns
    began = datetime(2024, 7, 1, tzinfo=UTC).timestamp() + 86_390.0
    assert table["time_s"] == pytest.approx(began + m["t"], abs=0.0051)
    assert table["gnss_latitude_deg"] == pytest.approx((3119.0 + 0.001 * np.arange(600)) / 60.0)
    assert table["gnss_longitude_deg"] == pytest.approx(np.full(600, 58.5 / 60.0))
    assert table["gnss_speed_mps"] == pytest.approx(m["speed"], abs=2e-4)
    assert np.unwrap(table["gnss_course_rad"]) - np.unwrap(table["gnss_course_rad"])[0] == pytest.approx(
        -(m["heading"] - m["heading"][0]), abs=2e-4
    )
    assert table["yaw_rate_radps"] == pytest.approx(m["yaw"], abs=1e-5)
    assert table["accel_lat_mps2"] == pytest.approx(m["speed"] * m["yaw"], abs=1e-4)
    assert table["accel_long_mps2"] == pytest.approx(m["ahead"], abs=1e-4)
    assert table["steering_wheel_angle_rad"] == pytest.approx(0.75 * m["yaw"], abs=1e-5)
    assert (table["gnss_quality"] == 1.0).all()
    assert len(notes) == (0 if turned > 0.0 else 3)


def test_the_folder_is_one_of_signals(tmp_path: Path) -> None:
    """`tpmsd import FILE.vbo DRIVE` writes a table that the other commands take, with the car beside it."""
    car = tmp_path / "car.toml"
    car.write_text(CAR)
    drive, reported = tmp_path / "drive", tmp_path / "said.json"
    line = [
        "import",
        str(vbo(tmp_path / "a.VBO")),
        str(drive),
        "--vehicle",
        str(car),
        "--json",
        str(reported),
    ]
    assert 0 == main(line)
    table = read_signals(drive)
    assert table.unknown == ()
    assert table.columns["gnss_latitude_deg"][1] == pytest.approx(3119.001 / 60.0, abs=1e-9)
    assert table.columns["gnss_utc_s"][0] == pytest.approx(1719878390.0, abs=0.01)
    document = json.loads(reported.read_text())
    assert set(schema_of("tpmsd.import/1")["required"]) <= set(document)
    assert document["signals"]["yaw_rate_radps"] == "YawRate"
    assert 0 == main(["replay", str(drive), "--vehicle-state", "ekf", "--csv", str(tmp_path / "t.csv")])
    assert 2 == main(line)  # the folder is there already


def test_a_car_that_is_not_known_is_asked_for(tmp_path: Path) -> None:
    """Without --vehicle the file beside the table says what to fill in, and is no car until then."""
    assert 0 == main(["import", str(vbo(tmp_path / "a.vbo")), str(tmp_path / "drive")])
    with pytest.raises(ConfigProblems, match="mass_kg"):
        load_car(tmp_path / "drive")


def test_only_the_header_s_long_names(tmp_path: Path) -> None:
    """A file without [column names] is read by its [header], knots and all."""
    file = tmp_path / "a.vbo"
    file.write_text("[header]\nsatellites\ntime\nvelocity knots\n[data]\n8 120000.0 10.0\n8 120000.1 20.0\n")
    table = read_vbo(file, lambda _: None).columns
    assert table["gnss_speed_mps"] == pytest.approx([10.0 * 1852 / 3600, 20.0 * 1852 / 3600])
    assert table["time_s"] == pytest.approx([43_200.0, 43_200.1])


def test_a_channel_that_does_not_follow_the_course_is_left_out(tmp_path: Path) -> None:
    """Its sign cannot be told; the note names it."""
    file = vbo(tmp_path / "a.vbo")
    head, _, body = file.read_text(encoding="latin-1").partition("[data]\n")
    rng = np.random.default_rng(1)
    rows = [row.split() for row in body.splitlines()]
    for row in rows:
        row[7] = f"{rng.standard_normal():.3f}"
    file.write_text(head + "[data]\n" + "\n".join(map(" ".join, rows)))
    notes: list[str] = []
    assert "yaw_rate_radps" not in read_vbo(file, notes.append).columns
    assert "YawRate is left out" in notes[0]


def test_without_satellites_there_is_no_position(tmp_path: Path) -> None:
    """Rows before the first fix have no place; a torn line is counted and left out."""
    file = tmp_path / "a.vbo"
    head = "[column names]\nsats time lat long velocity heading\n[data]\n"
    rows = "000 120000.0 0 0 0 0\n004 120000.1 +3119.0 +58.0 36 0\n004 120000.2 +31\n"
    file.write_text(head + rows + "005 120000.3 +3119.0 -58.0 36 0\n")
    notes: list[str] = []
    table = read_vbo(file, notes.append).columns
    assert np.isnan(table["gnss_latitude_deg"]).tolist() == [True, False, False]
    assert table["gnss_longitude_deg"][1:] == pytest.approx([-58.0 / 60.0, 58.0 / 60.0])
    assert len(notes) == 1 and "1 bad line" in notes[0] and ":6:" in notes[0]


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "no section [data]"),
        (b"[header]\ntime\n", "no section [data]"),
        (b"[column names]\nsats lat\n[data]\n1 2\n", "no column time"),
        (b"[column names]\ntime\n[data]\n", "no row"),
        (b"[column names]\ntime\n[data]\nnoon\n", "no row"),
        (b"[column names]\ntime\n[data]\n999999\n996060\n", "fewer than two rows"),
        (b"\x00" * 5000, "no text"),
        (b"x" * 100_000, "no text"),
        (b"[column names]\ntime " + b"a " * (MAX_COLUMNS + 1) + b"\n[data]\n1\n", "columns"),
        (b"[a]\nb\n" * 20_000, "no section [data]"),
        (b"PK\x03\x04" + bytes(range(1, 256)) * 40, "[data]"),
    ],
    ids=lambda value: str(value[:20]),
)
def test_what_is_no_vbo_file_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes, what: str
) -> None:
    """Exit code 3, file and reason; no folder is left behind."""
    file = tmp_path / "a.vbo"
    file.write_bytes(content)
    assert 3 == main(["import", str(file), str(tmp_path / "drive")])
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert what in said[0]
    assert not (tmp_path / "drive").exists()


def test_a_missing_file_and_a_map_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No file: exit code 3; `--map` does not belong to VBO files: exit code 2."""
    assert 3 == main(["import", str(tmp_path / "a.vbo"), str(tmp_path / "drive")])
    assert 2 == main(["import", str(vbo(tmp_path / "b.vbo")), str(tmp_path / "drive"), "--map", "m.toml"])
    assert 2 == len(capsys.readouterr().err.strip().splitlines())


@settings(derandomize=True, deadline=None, max_examples=150)
@given(
    st.lists(
        st.sampled_from(["nan", "inf", "1e308", "-1e308", "120000.0", "x", "", "[data]", "[", "\u00e9"]),
        max_size=30,
    )
)
def test_no_row_makes_it_raise_anything_else(words: list[str]) -> None:
    """Whatever stands in the rows: a table of the columns, or InputError."""
    import tempfile

    with tempfile.TemporaryDirectory() as where:
        file = Path(where) / "a.vbo"
        rows = "\n".join(" ".join(words[k : k + 3]) for k in range(0, len(words), 3))
        file.write_text("[column names]\ntime lat long\n[data]\n" + rows, encoding="latin-1")
        try:
            table = read_vbo(file, lambda _: None)
        except InputError:
            return
        assert {len(values) for values in table.columns.values()} == {len(table.columns["time_s"])}
        assert np.isfinite(table.columns["time_s"]).all()
