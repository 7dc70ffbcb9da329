"""The tick table as files: other programs read what was written, and a file becomes the same drive."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from pathlib import Path
from typing import Any

import duckdb
import h5py
import numpy as np
import pandas as pd
import polars as pl
import pytest
from mcap.reader import make_reader

import tpmsd
from tests.interfaces.api.test_from_tables import straight
from tools.make_layouts import foxglove, plotjuggler
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.tables.columns import COLUMNS, NUMBERS, TEXTS
from tpmsd.offline.tables.mcap_schemas import TOPICS

DOCS = Path(__file__).resolve().parents[3] / "docs"


@pytest.fixture(scope="module")
def files(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    out = tmp_path_factory.mktemp("tables")
    made = {kind: out / f"nail.{kind}" for kind in ("csv", "parquet", "mcap")}
    options = [word for kind, path in made.items() for word in (f"--{kind}", str(path))]
    assert 0 == main(["replay", str(folder), *options])
    return made


def test_programs_read_equal_numbers(files: dict[str, Path], replay: tpmsd.Replay) -> None:
    """pandas (CSV, Parquet), Polars and DuckDB read the very numbers of the replay, in documented columns."""
    table = replay.table
    assert table is not None
    frames = {
        "csv": pd.read_csv(files["csv"]),
        "parquet": pd.read_parquet(files["parquet"]),
        "polars": pl.read_parquet(files["parquet"]),
        "duckdb": duckdb.sql(f"select * from '{files['parquet']}'").df(),
    }
    for kind, frame in frames.items():
        assert [column.name for column in COLUMNS] == list(frame.columns), kind
        for name in NUMBERS:
            read = np.array([np.nan if value is None else value for value in frame[name]], dtype=float)
            np.testing.assert_array_equal(table[name], read, err_msg=f"{kind} {name}")
        for name in TEXTS:
            texts = ["" if value is None or value != value else str(value) for value in frame[name]]
            assert list(table.texts[name]) == texts, (kind, name)


def test_parquet_tells_units(files: dict[str, Path]) -> None:
    """Each field of the Parquet file has its unit and meaning as metadata."""
    import pyarrow.parquet as parquet

    schema = parquet.read_schema(files["parquet"])
    reported = [(f.metadata[b"unit"].decode(), f.metadata[b"meaning"].decode()) for f in schema]

    assert [(column.unit, column.meaning) for column in COLUMNS] == reported


def mcap_messages(path: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert "jsonschema" == schema.encoding
            assert json.loads(schema.data) == TOPICS[channel.topic]
            found[channel.topic].append((message.log_time, json.loads(message.data)))
    return found


def test_mcap_holds_the_replay(files: dict[str, Path], replay: tpmsd.Replay) -> None:
    """The package mcap reads radii with bands, fixes and alarms back, each with its schema and time."""
    found, table = mcap_messages(files["mcap"]), replay.table
    assert table is not None
    assert set(TOPICS) == set(found)
    for wheel in WHEELS:
        shown = [content for _, content in found[f"/wheel/{wheel}"] if "deviation_mm" in content]
        known = np.isfinite(table[f"deviation_{wheel}_m"])
        np.testing.assert_allclose(
            [one["deviation_mm"] for one in shown], 1e3 * table[f"deviation_{wheel}_m"][known], rtol=1e-12
        )
        bands = [one["upper_mm"] - one["lower_mm"] for one in shown]
        np.testing.assert_allclose(bands, 4e3 * table[f"deviation_std_{wheel}_m"][known], rtol=1e-9)
    latitudes = table["gnss_latitude_deg"]
    assert latitudes[np.isfinite(latitudes)].tolist() == [one["latitude"] for _, one in found["/gnss/fix"]]
    said = [(stamp, one["level"], one["name"]) for stamp, one in found["/alarms"]]
    assert [(round(a.time_s * 1e9), 4, str(a.kind)) for a in replay.alarms] == said
    track = json.loads(found["/map"][0][1]["geojson"])
    assert ["LineString", *["Point"] * len(replay.alarms)] == [
        f["geometry"]["type"] for f in track["features"]
    ]


def test_messages_obey_their_schemas(files: dict[str, Path]) -> None:
    """Every field of every message is one that its registered schema names."""
    for topic, reported in mcap_messages(files["mcap"]).items():
        names = {name for _, content in reported for name in content}
        assert set() == names - set(TOPICS[topic]["properties"])


def test_layouts_show_what_is_there() -> None:
    """Both layouts are those that the tool writes, and every curve in them is a field of a topic."""
    assert foxglove() == json.loads((DOCS / "layouts" / "foxglove.json").read_text())
    assert plotjuggler() == (DOCS / "layouts" / "plotjuggler.xml").read_text()
    fields = {f"{topic}.{name}" for topic, schema in TOPICS.items() for name in schema["properties"]}
    panels = foxglove()["configById"]
    shown = {path["value"] for panel in panels.values() for path in panel.get("paths", [])}
    curves = {str(curve.get("name")) for curve in ElementTree.fromstring(plotjuggler()).iter("curve")}

    assert set() == shown - fields
    assert curves == {"/".join(value.rsplit(".", 1)) for value in shown}
    assert panels["RosOut!1"]["topicToRender"] in TOPICS


def test_an_imported_export_replays_to_the_same_alarms(
    files: dict[str, Path], replay: tpmsd.Replay, folder: Path, tmp_path: Path
) -> None:
    """`import` of what `replay --parquet` (no map) and `--csv` (a map) wrote gives the same alarms."""
    (tmp_path / "map.toml").write_text(f'vehicle = "{folder / "vehicle.toml"}"\n')
    assert 0 == main(["import", str(files["parquet"]), str(tmp_path / "a")])
    assert 0 == main(["import", str(files["csv"]), "--map", str(tmp_path / "map.toml"), str(tmp_path / "b")])

    for name in ("can.log", "gnss.nmea", "bus.dbc"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    again = tpmsd.replay(tmp_path / "a", table=False)
    expected = [(a.kind, a.wheel, a.state) for a in replay.alarms]
    assert expected == [(a.kind, a.wheel, a.state) for a in again.alarms]
    assert all(
        abs(one.time_s - two.time_s) < 5.0 for one, two in zip(replay.alarms, again.alarms, strict=True)
    )


def frame_of(wheels: dict[str, Any], gnss: dict[str, Any]) -> pd.DataFrame:
    """One table as a user's logger has it: own names, own units, all at one rate."""
    frame = pd.DataFrame({"t_ms": 1e3 * wheels["time_s"]})
    for wheel in WHEELS:
        frame[f"n_{wheel}"] = np.gradient(wheels[f"wheel_angle_{wheel}_rad"], wheels["time_s"]) * 30 / np.pi
    fixes = pd.DataFrame(gnss).set_index(1e3 * gnss["time_s"]).drop(columns="time_s")
    return frame.join(fixes.reindex(frame["t_ms"].round(6).to_numpy()).reset_index(drop=True))


MAP = """[table]
time = "t_ms"
time_unit = "ms"

[columns]
wheel_speed_fl = { column = "n_fl", unit = "rpm" }
wheel_speed_fr = { column = "n_fr", unit = "rpm" }
wheel_speed_rl = { column = "n_rl", unit = "rpm" }
wheel_speed_rr = { column = "n_rr", unit = "rpm" }
gnss_east = "east_m"
gnss_north = "north_m"
gnss_speed = { column = "speed_mps", unit = "m/s" }
gnss_heading = "heading_rad"
gnss_position_std = "position_std_m"

[vehicle]
wheel_radius_m = 0.316
track_front_m = 1.53
track_rear_m = 1.52
wheelbase_m = 2.63
"""


def mf4(frame: pd.DataFrame, path: Path) -> None:
    from asammdf import MDF, Signal

    times = frame["t_ms"].to_numpy() / 1e3
    with MDF(version="4.10") as file:
        for name in frame.columns[1:]:
            known = np.isfinite(frame[name].to_numpy())
            file.append(Signal(frame[name].to_numpy()[known], times[known], name=name, unit=""))
        file.save(path, overwrite=True)


def hdf5(frame: pd.DataFrame, path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name in frame.columns:
            file[name] = frame[name].to_numpy()[np.newaxis, :]  # as MATLAB keeps a column


@pytest.mark.parametrize("kind", ["csv", "semicolon", "parquet", "mf4", "mat"])
def test_a_loggers_table_becomes_a_drive(kind: str, tmp_path: Path) -> None:
    """The same table in each format, mapped, gives a drive whose radii are the true ones within 0.2 mm."""
    from tests.interfaces.api.test_from_tables import RADII_M

    frame = frame_of(*straight(40.0))
    table = tmp_path / f"log.{'csv' if kind == 'semicolon' else kind}"
    if kind == "csv":
        frame.to_csv(table, index=False)
    elif kind == "semicolon":
        frame.to_csv(table, index=False, sep=";", decimal=",")
    elif kind == "parquet":
        frame.to_parquet(table)
    elif kind == "mf4":
        mf4(frame, table)
    else:
        hdf5(frame, table)
    (tmp_path / "map.toml").write_text(MAP)
    assert 0 == main(["import", str(table), "--map", str(tmp_path / "map.toml"), str(tmp_path / "drive")])

    wheels = tpmsd.replay(tmp_path / "drive", table=False).wheels
    np.testing.assert_allclose([0.316 + wheels[w].deviation_m for w in WHEELS], RADII_M, atol=2e-4)


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ('"rpm" }', '"furlong" }', "map.toml:6: [columns] wheel_speed_fl.unit"),
        (
            'column = "n_rl"',
            'column = "n_lr"',
            "map.toml:8: [columns] wheel_speed_rl: the table has no column",
        ),
        ("gnss_east", "gnss_easting", "did you mean gnss_east?"),
        ('time = "t_ms"', 'time = "t_s"', "map.toml:2: [table] time: the table has no column"),
        ('"ms"', '"hour"', "map.toml:3: [table] time_unit: no unit of time"),
        ("[vehicle]", "[vehicles]", "did you mean vehicle?"),
        ("wheel_radius_m = 0.316", "wheel_radius_m = 316", "[vehicle] wheel_radius_m"),
        ('gnss_east = "east_m"', 'gnss_east = { column = "east_m", gain = 2 }', "map.toml:10: [columns]"),
        ('gnss_east = "east_m"', 'gnss_east = { column = "east_m", modulus = 8 }', "only counts have one"),
    ],
)
def test_a_wrong_map_is_reported_with_its_line(
    old: str, new: str, where: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each mistake in a map ends with exit code 2 and a line that names file, line and key."""
    frame_of(*straight(20.0)).to_csv(tmp_path / "log.csv", index=False)
    assert old in MAP
    (tmp_path / "map.toml").write_text(MAP.replace(old, new, 1))

    assert 2 == main(
        ["import", str(tmp_path / "log.csv"), "--map", str(tmp_path / "map.toml"), str(tmp_path / "d")]
    )
    assert where in capsys.readouterr().err
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("log.csv", None, "no such file"),
        ("log.xyz", b"", "not a known kind of table"),
        ("log.csv", b"", "log.csv:1: no header"),
        ("log.csv", b"t_ms,n_fl,n_fr,n_rl,n_rr\n0,1,1,1,x\n", "log.csv:2: n_rr: not a number: 'x'"),
        ("log.csv", b"t_ms,n_fl,n_fr,n_rl,n_rr\n0,1,1,1\n", "log.csv:2: 4 fields, the header has 5"),
        (
            "log.csv",
            b"t_ms,n_fl,n_fr,n_rl,n_rr\n5,1,1,1,1\n4,1,1,1,1\n",
            "log.csv:3: wheel_speed_fl: time",
        ),
        ("log.parquet", b"PAR1 and no more", "not a Parquet file"),
        ("log.mf4", b"MDF and no more", "not an MF4 file"),
        ("log.mat", b"MATLAB 5.0 MAT-file", "not an HDF5 file"),
    ],
)
def test_an_unusable_table_is_reported(
    name: str, content: bytes | None, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table that cannot be used ends with exit code 3 and one line with file and reason."""
    if content is not None:
        (tmp_path / name).write_bytes(content)
    wheels = MAP[: MAP.index("gnss_east")] + MAP[MAP.index("[vehicle]") :]
    (tmp_path / "map.toml").write_text(wheels)

    assert 3 == main(
        ["import", str(tmp_path / name), "--map", str(tmp_path / "map.toml"), str(tmp_path / "d")]
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert reason in line


def test_targets_are_checked_before_the_work(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A table that cannot be written is refused at once, with exit code 1."""
    for option in ("--csv", "--parquet", "--mcap"):
        assert 1 == main(["replay", str(folder), option, str(tmp_path / "no" / "such.file")])
        assert "there is no folder" in capsys.readouterr().err
