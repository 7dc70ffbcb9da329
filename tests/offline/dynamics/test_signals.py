"""Tables of signals: formats, gaps, faults."""

from __future__ import annotations

import gzip
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.offline.dynamics.drives import folder, loaded
from tpmsd.car.config.dynamics import load_car
from tpmsd.car.config.problems import ConfigProblems
from tpmsd.foundation.errors import InputError
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.signals import read
from tpmsd.offline.signals.columns import OUTPUTS
from tpmsd.offline.signals.drive import make_drive
from tpmsd.offline.signals.read import SignalTable, read_signals
from tpmsd.offline.signals.write import signals_text

HEAD = "time_s,road_wheel_angle_rad,yaw_rate_radps,speed_mps\n"


def test_csv_gzip_and_parquet_hold_the_same(tmp_path: Path) -> None:
    """The three formats of one table are read alike."""
    pq = pytest.importorskip("pyarrow.parquet")
    import pyarrow as pa

    text = HEAD + "0,0.01,0.1,20\n0.02,0.02,,20.1\n0.04,0.03,0.12,20.2\n"
    (tmp_path / "signals.csv").write_text(text)
    (tmp_path / "signals.csv.gz").write_bytes(gzip.compress(text.encode()))
    plain = read_signals(tmp_path / "signals.csv")
    table = {name: pa.array(np.where(np.isnan(v), None, v)) for name, v in plain.columns.items()}
    pq.write_table(pa.table(table), tmp_path / "signals.parquet")

    for name in ("signals.csv.gz", "signals.parquet"):
        other = read_signals(tmp_path / name)
        for column, values in plain.columns.items():
            assert np.array_equal(other.columns[column], values, equal_nan=True)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"PAR1 and no more", "not a Parquet file"),
        (None, "yaw_rate_radps"),
    ],
)
def test_a_parquet_file_that_is_none_is_one_line(tmp_path: Path, content: bytes | None, reason: str) -> None:
    """It is read by a process of its own, as every native reader's file; text is no reading."""
    pq = pytest.importorskip("pyarrow.parquet")
    import pyarrow as pa

    file = tmp_path / "signals.parquet"
    if content is None:
        pq.write_table(
            pa.table({"time_s": [0.0, 1.0], "yaw_rate_radps": ["a", "b"], "note": ["c", "d"]}), file
        )
    else:
        file.write_bytes(content)
    with pytest.raises(InputError, match=reason):
        read_signals(tmp_path)

    assert "pyarrow" not in Path(read.__file__).read_text("utf-8")


def test_blocks_of_a_file_are_one_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wherever a block of the text ends: with numbers alone, with empty cells and lines, and an error's
    line."""
    lines = [f"{k},{0.1 * k:.1f}" if k % 7 else f"\n{k}," for k in range(60)]
    (tmp_path / "signals.csv").write_text("time_s,yaw_rate_radps\n" + "\n".join(lines))
    whole = read_signals(tmp_path).columns
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "signals.csv").write_text("time_s,yaw_rate_radps\n" + "\n".join([*lines, "60,1e13"]))
    for size in (0, 1, 5, 17, 100):
        monkeypatch.setattr(read, "_BLOCK_CHARS", size)
        for name, values in read_signals(tmp_path).columns.items():
            assert np.array_equal(values, whole[name], equal_nan=True)
        with pytest.raises(InputError, match="is beyond") as caught:
            read_signals(tmp_path / "bad")
        assert caught.value.line == 71
    assert np.array_equal(np.flatnonzero(np.isnan(whole["yaw_rate_radps"])), np.arange(0, 60, 7))
    monkeypatch.setattr(read, "MAX_VALUES", 100)
    with pytest.raises(InputError, match="more than 100 values"):
        read_signals(tmp_path)


def test_columns_that_are_not_known_take_no_memory(tmp_path: Path) -> None:
    """A Parquet file states rows of 0 and columns without a value in next to no bytes."""
    pq = pytest.importorskip("pyarrow.parquet")
    import pyarrow as pa

    rows = 100_000
    empty = dict.fromkeys((f"c{k}" for k in range(100)), pa.nulls(rows, pa.float64()))
    pq.write_table(pa.table({"time_s": np.arange(rows) * 0.01, **empty}), tmp_path / "signals.parquet")
    tracemalloc.start()
    try:
        assert read_signals(tmp_path).columns.keys() == {"time_s"}
        assert tracemalloc.get_traced_memory()[1] < 30e6
    finally:
        tracemalloc.stop()


def test_rows_within_a_moment_are_no_drive(tmp_path: Path) -> None:
    """Steps of 10 ns are thinned out without a search, and the span is named."""
    where = folder(tmp_path / "d", duration_s=10.0)
    table = read_signals(where)
    table.columns["time_s"][:] = 1e-8 * np.arange(len(table.time_s))
    table.columns["time_s"][-1] = 0.05

    with pytest.raises(InputError, match=r"span 0.05 s: 0.095 s are needed"):
        make_drive(table, load_car(where), "single-track", "moment")


def test_a_car_that_cannot_be_driven_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], recwarn: pytest.WarningsRecorder
) -> None:
    """50 kg with all its weight at the rear axle: what overflows is refused, without numpy's warnings."""
    where = folder(tmp_path / "d", duration_s=12.0)
    text = (where / "vehicle.toml").read_text()
    hostile = {"mass_kg": 50.0, "yaw_inertia_kgm2": 5.0, "cg_to_rear_m": 0.1, "friction": 0.05}
    for key, value in {**hostile, "cornering_stiffness_front_n_per_rad": 2e6}.items():
        text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", text)
    (where / "vehicle.toml").write_text(text)

    assert main(["diagnose", str(where), "--baseline", "single-track"]) == 3
    assert capsys.readouterr().err.count("\n") == 1
    assert not recwarn.list


def test_a_packed_table_is_bounded_as_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No more is unpacked than a table may have; damage within is one line, too."""
    monkeypatch.setattr(read, "LARGEST_BYTES", 1000)
    packed = gzip.compress(HEAD.encode() + b"0,0,0,0\n" * 1000)
    (tmp_path / "signals.csv.gz").write_bytes(packed)
    with pytest.raises(InputError, match="more than 1000 characters, unpacked"):
        read_signals(tmp_path)
    (tmp_path / "signals.csv.gz").write_bytes(packed[:20] + b"\xff" * 20)
    with pytest.raises(InputError, match="cannot be read"):
        read_signals(tmp_path)


def test_unknown_columns_are_named_and_left_out(tmp_path: Path) -> None:
    """A column of no known name is no column of the table."""
    header = "time_s,yaw_rate_radps,oil_temp,gnss_\x1b[31m\n"
    (tmp_path / "signals.csv").write_text(header + "0,0.1,cold,0\n0.1,0.2,91,1\n")
    table = read_signals(tmp_path)

    assert table.unknown == ("oil_temp", "gnss_\\x1b[31m")
    assert set(table.columns) == {"time_s", "yaw_rate_radps"}


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("a,b\n1,2\n", 1, "no column time_s"),
        ("time_s,speed_mps\n0,1\n0.1,fast\n", 3, "not a number"),
        ("time_s,speed_mps\n0,1\n0.1\n", 3, "1 cells"),
        ("time_s,speed_mps,speed_mps\n0,1,1\n", 1, "stands twice"),
        ("time_s,speed_mps\n", None, "no rows"),
        ("time_s,speed_mps\n0,1\n0.1\r,2\n", 3, "1 cells"),
        ("time_s,speed_mps\n0,1\n\n0.1," + 200_000 * "x", 4, "field larger than field limit"),
        ("time_s,speed_mps\n0,1\n0.1," + (6 << 20) * "0", 3, "a line of more than"),
        ("time_s" + 10_000 * ",a" + "\n", 1, "10001 columns; at most 10000"),
        ("time_s\n0\n  \n\n1e13\n", 5, "time_s is beyond 1e.*: milliseconds or less since 1970"),
    ],
)
def test_what_is_no_table_is_one_line(tmp_path: Path, text: str, line: int | None, reason: str) -> None:
    """File, line and reason."""
    (tmp_path / "signals.csv").write_text(text)
    with pytest.raises(InputError, match=reason) as caught:
        read_signals(tmp_path)

    assert caught.value.line == line


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 50), st.floats(-5, 5)), min_size=3, max_size=30))
def test_rows_of_one_time_become_one(rows: list[tuple[int, float]]) -> None:
    """However often a time stands, the last of its values is kept."""
    import tempfile

    rows.sort(key=lambda row: row[0])
    with tempfile.TemporaryDirectory() as where:
        text = "time_s,yaw_rate_radps\n" + "".join(f"{t / 10},{v!r}\n" for t, v in rows)
        (Path(where) / "signals.csv").write_text(text)
        table = read_signals(Path(where))

    last = dict(rows)
    assert table.time_s == pytest.approx(np.array(sorted(last)) / 10.0)
    assert table.columns["yaw_rate_radps"] == pytest.approx([last[t] for t in sorted(last)])


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("time_s,speed_mps\n0,1\n\n0.2,2\n0.1,3\n0.3,4\n", 5),
        ("time_s,speed_mps\n0,1\n0.2,\n0.1,3\n0.05,4\n0.04,4\n", 5),
        ("time_s,yaw_rate_radps,speed_mps\n0,1,\n0.1,1,\n0,,2\n0.1,,2\n0.05,1,\n", 6),
        (b"\xef\xbb\xbftime_s,speed_mps\r\n1,1\r\n0,2\r\n2,3\r\n".decode(), 3),
    ],
)
def test_times_that_descend_are_refused_with_the_line(tmp_path: Path, text: str, line: int) -> None:
    """Readings of one column out of order are no recording: the first descent is named."""
    (tmp_path / "signals.csv").write_bytes(text.encode())
    with pytest.raises(InputError, match="descends from") as caught:
        read_signals(tmp_path)

    assert caught.value.line == line


def test_columns_may_stand_below_one_another(tmp_path: Path) -> None:
    """Sensors that a logger wrote one after the other share the rows of equal times."""
    text = "time_s,yaw_rate_radps,speed_mps\n0,0.1,\n0.1,0.2,\n0,,20\n0.1,,21\n"
    (tmp_path / "signals.csv").write_text(text)
    table = read_signals(tmp_path)

    assert table.time_s.tolist() == [0.0, 0.1]
    assert table.columns["yaw_rate_radps"].tolist() == [0.1, 0.2]
    assert table.columns["speed_mps"].tolist() == [20.0, 21.0]


def test_outputs_may_have_rates_of_their_own(tmp_path: Path) -> None:
    """Inputs are interpolated onto every row, an output counts where it has a value."""
    where = folder(tmp_path / "d", duration_s=20.0)
    table = read_signals(where)
    columns = {name: values.copy() for name, values in table.columns.items()}
    columns["velocity_lat_mps"][1::2] = np.nan
    columns["steering_wheel_angle_rad"][3::5] = np.nan
    (where / "signals.csv").write_text(signals_text(columns))
    _, drive = loaded(where, "single-track")

    assert np.isnan(drive.outputs["velocity_lat"][1::2]).all()
    assert np.all(np.isfinite(drive.inputs.steer_rad))


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("mass_kg = 1480.0\n", "", "mass_kg"),
        ("mass_kg = 1480.0", 'mass_kg = "heavy"', "not a number"),
        ("friction = 1.0", "frction = 1.0", "friction"),
        ("cg_height_m = 0.54", "cg_height_m = 540", "0.05 to 3"),
        ("wheel_radius_m = 0.316", "wheel_radius_m = " + 400 * "9", "wheel_radius_m"),
        ("wheel_radius_m = 0.316", "wheel_radius_m = { fl = 0.3, rl = inf }", "wheel_radius_m"),
    ],
)
def test_mistakes_of_the_car_s_table_name_the_key(tmp_path: Path, old: str, new: str, what: str) -> None:
    """A missing, wrong or misspelt key of [dynamics] is a line with the file."""
    where = folder(tmp_path / "d", duration_s=10.0)
    file = where / "vehicle.toml"
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(ConfigProblems, match=what):
        load_car(where)


def test_a_drive_without_speed_or_steering_is_refused(tmp_path: Path) -> None:
    """The message names the columns that are wanted."""
    where = folder(tmp_path / "d", duration_s=10.0)
    table = read_signals(where)
    for missing in ("speed_mps", "steering_wheel_angle_rad"):
        columns = {name: values for name, values in table.columns.items() if name != missing}
        (where / "signals.csv").write_text(signals_text(columns))
        with pytest.raises(InputError, match=missing):
            loaded(where, "single-track")


@pytest.mark.parametrize("missing", ["drive_force_n", "brake_force_n"])
def test_one_force_without_the_other_leaves_speed_an_input(tmp_path: Path, missing: str) -> None:
    """With both speed is an output; with one the other is unknown, not zero, and that is said."""
    whole = folder(tmp_path / "both", duration_s=10.0, model="three-dof", forces=True)
    table = read_signals(whole)
    part = tmp_path / "one"
    part.mkdir()
    kept = {name: values for name, values in table.columns.items() if name != missing}
    (part / "signals.csv").write_text(signals_text(kept), encoding="utf-8")
    (part / "vehicle.toml").write_text((whole / "vehicle.toml").read_text(), encoding="utf-8")
    both, of_both = loaded(whole, "three-dof")
    one, of_one = loaded(part, "three-dof")

    assert both.forces
    assert of_both.notes == ()
    assert not one.forces
    assert "speed" not in of_one.outputs
    assert f"without {missing.split('_')[0]} forces" in of_one.notes[0]


@pytest.mark.parametrize(
    ("column", "factor", "said"),
    [
        ("steering_wheel_angle_rad", 180.0 / np.pi, "in degrees"),
        ("steering_wheel_angle_rad", -1.0, "the other sign"),
        ("yaw_rate_radps", -1.0, "the other sign"),
        ("yaw_rate_radps", 180.0 / np.pi, "yaw rate is .* in deg/s"),
        ("speed_mps", 3.6, "speed in km/h"),
        ("accel_lat_mps2", 1.0 / 9.80665, "acceleration in g"),
    ],
)
def test_a_wrong_unit_or_sign_is_refused(tmp_path: Path, column: str, factor: float, said: str) -> None:
    """A drive whose yaw rate turns against the steering is no drive that agrees with the model."""
    where = folder(tmp_path, duration_s=20.0)
    table = read_signals(where)
    table.columns[column] *= factor

    with pytest.raises(InputError, match=said):
        make_drive(table, load_car(where), "single-track", "turned")


@pytest.mark.parametrize(
    ("column", "values", "said"),
    [
        ("yaw_rate_radps", np.nan, "yaw_rate_radps has no values: nothing is read from it"),
        ("velocity_lat_mps", 0.0, "velocity_lat_mps is 0 throughout: nothing is read from it"),
        ("accel_long_mps2", 0.0, "accel_long_mps2 is 0 throughout: nothing is read from it"),
    ],
)
def test_a_column_that_tells_nothing_is_named(
    tmp_path: Path, column: str, values: float, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is left out and the answer says so; loggers write 0 for what they do not have."""
    where = folder(tmp_path, duration_s=20.0)
    table = read_signals(where)
    table.columns[column][:] = values
    (where / "signals.csv").write_text(signals_text(dict(table.columns)), encoding="utf-8")
    _, drive = loaded(where, "single-track")

    assert drive.notes == (said,)
    assert column not in {OUTPUTS[name] for name in drive.outputs}
    assert np.ptp(drive.inputs.accel_long_mps2) > 0.0
    assert main(["diagnose", str(where), "--baseline", "single-track"]) == 0
    assert f"Note: {said}." in capsys.readouterr().out


def test_a_straight_drive_may_have_outputs_that_stand_still(tmp_path: Path) -> None:
    """Coasting down of a simulated car has yaw rate and steering of 0; a bend without steering has not."""
    where = folder(tmp_path, duration_s=20.0)
    table = read_signals(where)
    table.columns["steering_wheel_angle_rad"][:] = 0.0
    with pytest.raises(InputError, match="while the steering stands still"):
        make_drive(table, load_car(where), "single-track", "bends")
    table.columns["yaw_rate_radps"][:] = 0.0
    _, drive = make_drive(table, load_car(where), "single-track", "straight")

    assert "yaw_rate" in drive.outputs
    assert drive.notes == ()


def test_a_handful_of_rows_is_no_drive(tmp_path: Path) -> None:
    """The number of rows is said, not a column that would be missing."""
    where = folder(tmp_path, duration_s=20.0)
    table = read_signals(where)
    five = SignalTable(table.file, {name: values[:5] for name, values in table.columns.items()})
    with pytest.raises(InputError, match="5 rows: 10 are needed"):
        make_drive(five, load_car(where), "single-track", "short")


def test_an_infinite_value_is_refused_with_its_line(tmp_path: Path) -> None:
    """No reading is infinite: a division by zero of whoever wrote the file."""
    where = folder(tmp_path, duration_s=20.0)
    lines = (where / "signals.csv").read_text(encoding="utf-8").splitlines()
    cells = lines[7].split(",")
    cells[1] = "inf"
    lines[7] = ",".join(cells)
    (where / "signals.csv").write_text("\n".join(lines), encoding="utf-8")

    with pytest.raises(InputError, match="is infinite") as error:
        read_signals(where)
    assert error.value.line == 8


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_a_reading_that_no_instrument_gives_is_refused(kind: str, tmp_path: Path) -> None:
    """1e300 is no reading: its square would be infinite, and what follows without a meaning."""
    columns = {"time_s": np.arange(5.0), "yaw_rate_radps": np.array([0.0, 0.1, 1e300, 0.1, 0.0])}
    file = tmp_path / f"signals.{kind}"
    frame = pytest.importorskip("pandas").DataFrame(columns)
    frame.to_csv(file, index=False) if kind == "csv" else frame.to_parquet(file)
    with pytest.raises(InputError, match="yaw_rate_radps is beyond 1e\\+12"):
        read_signals(file)


def test_columns_that_are_not_known_steer_no_terminal(tmp_path: Path) -> None:
    """Control characters of their names are shown as escapes."""
    file = tmp_path / "signals.csv"
    file.write_text("time_s,yaw_rate_radps,evil\x1b[2J\n0,0,0\n1,0,0\n")
    assert ("evil\\x1b[2J",) == read_signals(file).unknown


def test_signals_that_determine_no_path_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the matrix of a path cannot be solved the recording is named, with exit code 3."""

    def fail(*_: object) -> None:
        raise np.linalg.LinAlgError("not positive definite")

    monkeypatch.setattr("tpmsd.offline.dynamics.diagnose.diagnose_dynamics", fail)
    where = folder(tmp_path, duration_s=20.0)
    assert 3 == main(["diagnose", str(where), "--baseline", "single-track"])
    line = f"tpmsd: {where}: no path of a car is determined by its signals (not positive definite)"
    assert [line] == capsys.readouterr().err.splitlines()
