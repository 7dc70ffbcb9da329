"""`tpmsd replay --vehicle-state`: drives with a bus, tables of signals, every table, what is missing."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from tests.offline.dynamics.drives import folder as signals_folder
from tpmsd.car.config.load import load_config
from tpmsd.car.vehicle_state.record import VehicleState
from tpmsd.foundation.schemas import schema_of
from tpmsd.interfaces.cli.main import main
from tpmsd.offline.report.vehicle_state_summary import MAX_ROWS, StateSummary
from tpmsd.offline.signals.read import read_signals
from tpmsd.offline.signals.write import signals_text
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sinks.status_document import state_entry
from tpmsd.onboard.sources.can.decoder import load_database

FILTERS = ("ekf", "ukf", "upf", "arupf")
DYNAMICS = """
[dynamics]
mass_kg = 1500.0
yaw_inertia_kgm2 = 2500.0
cg_to_front_m = 1.2
cg_to_rear_m = 1.5
cornering_stiffness_front_n_per_rad = 110000.0
cornering_stiffness_rear_n_per_rad = 130000.0
"""


@pytest.fixture(scope="module")
def on_bus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated drive whose bus has steering, yaw rate and accelerations, with `[dynamics]`."""
    where = tmp_path_factory.mktemp("bus") / "drive"
    write_drive(where, simulate_drive(DriveSpec(duration_s=40.0, seed=2, bus=BusSpec())))
    file = where / "vehicle.toml"
    file.write_text(file.read_text(encoding="utf-8") + DYNAMICS, encoding="utf-8")
    return where


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


def numbers(rows: list[dict[str, str]], name: str) -> np.ndarray:
    return np.array([float(row[name] or "nan") for row in rows])


@pytest.mark.parametrize("method", FILTERS)
def test_the_table_of_a_bus_has_the_state(on_bus: Path, tmp_path: Path, method: str) -> None:
    """Eight columns more; speed and yaw rate agree with the radius filter's, the deviations are positive."""
    file, reported = tmp_path / "t.csv", tmp_path / "t.json"
    assert 0 == main(
        ["replay", str(on_bus), "--vehicle-state", method, "--csv", str(file), "--json", str(reported)]
    )
    rows = rows_of(file)
    assert tuple(rows[0])[-8:] == VehicleState._fields
    known = np.isfinite(numbers(rows, "velocity_lat_mps"))
    moving = numbers(rows, "speed_mps") > 3.0
    assert known[moving].mean() > 0.9
    both = known & moving
    assert np.abs((numbers(rows, "velocity_long_mps") - numbers(rows, "speed_mps"))[both]).mean() < 0.2
    turn = numbers(rows, "yaw_rate_estimate_radps") - numbers(rows, "yaw_rate_radps")
    assert np.abs(turn[both]).mean() < 0.02
    for name in VehicleState._fields[1::2]:
        assert (numbers(rows, name)[known] > 0.0).all()
    document = json.loads(reported.read_text(encoding="utf-8"))
    assert document["vehicle_state"]["method"] == method
    assert document["vehicle_state"]["known_s"] == pytest.approx(0.1 * known.sum(), abs=0.11)
    assert set(document) <= set(schema_of("tpmsd.replay/2")["properties"])


def test_parquet_and_mcap_hold_what_the_csv_holds(on_bus: Path, tmp_path: Path) -> None:
    """All three tables have the same numbers; the topic of MCAP is `/vehicle_state`."""
    parquet = pytest.importorskip("pyarrow.parquet")
    reader = pytest.importorskip("mcap.reader")
    files = {kind: tmp_path / f"t.{kind}" for kind in ("csv", "parquet", "mcap")}
    options = [word for kind, file in files.items() for word in (f"--{kind}", str(file))]
    assert 0 == main(["replay", str(on_bus), "--vehicle-state", "ukf", *options])
    rows = rows_of(files["csv"])
    column = parquet.read_table(files["parquet"]).column("side_slip_rad").to_numpy(zero_copy_only=False)
    assert np.array_equal(numbers(rows, "side_slip_rad"), column.astype(float), equal_nan=True)
    with files["mcap"].open("rb") as file:
        messages = reader.make_reader(file).iter_messages(topics=["/vehicle_state"])
        found = [json.loads(message.data)["side_slip_rad"] for _, _, message in messages]
    assert found == column[np.isfinite(column.astype(float))].tolist()


def test_the_page_draws_the_state(on_bus: Path, tmp_path: Path) -> None:
    """`--html` has a chart of side slip and one of lateral speed, with the option alone."""
    pytest.importorskip("jinja2")
    pages = []
    for options in (["--vehicle-state", "ukf"], []):
        file = tmp_path / f"{len(pages)}.html"
        assert 0 == main(["replay", str(on_bus), *options, "--html", str(file)])
        pages.append(file.read_text(encoding="utf-8"))

    assert ["Side slip (ukf)" in page for page in pages] == [True, False]
    assert ["Lateral speed (ukf)" in page for page in pages] == [True, False]


def test_what_is_drawn_is_bounded_and_at_its_time() -> None:
    """A drive of many ticks keeps rows at their own times, no more than MAX_ROWS + 1."""
    summary = StateSummary("ekf")
    state = VehicleState(*np.arange(8.0).tolist())
    for k in range(3 * MAX_ROWS):
        summary.add(0.1, state if k % 2 == 0 else None, 0.1 * k)
    rows = summary.series()

    assert MAX_ROWS / 2 <= len(rows) <= MAX_ROWS + 1
    assert rows[:, 0] == pytest.approx(0.1 * 4 * np.arange(len(rows)))
    assert rows[0, 1:].tolist() == [2.0, 3.0, 4.0, 5.0]


def test_without_the_option_nothing_is_new(on_bus: Path, tmp_path: Path) -> None:
    """No column, no key."""
    file, reported = tmp_path / "t.csv", tmp_path / "t.json"
    assert 0 == main(["replay", str(on_bus), "--csv", str(file), "--json", str(reported)])
    assert not set(rows_of(file)[0]) & set(VehicleState._fields)
    assert "vehicle_state" not in json.loads(reported.read_text(encoding="utf-8"))


def test_the_configured_method_is_that_of_the_option(on_bus: Path, tmp_path: Path) -> None:
    """`[vehicle_state] method` runs in the core that the daemon runs, and is what the status tells."""
    text = (on_bus / "vehicle.toml").read_text(encoding="utf-8")
    other = on_bus / "with-state.toml"
    other.write_text(text + '[vehicle_state]\nmethod = "arupf"\nparticles = 50\n', encoding="utf-8")
    config = load_config(other)
    assert (config.vehicle_state.method, config.vehicle_state.particles) == ("arupf", 50)
    assert Pipeline(config, load_database(config.can.dbc)).vehicle_state is not None
    assert Pipeline(load_config(on_bus), load_database(config.can.dbc)).vehicle_state is None
    file = tmp_path / "t.csv"
    assert 0 == main(["replay", str(on_bus), "--config", str(other), "--csv", str(file)])
    assert np.isfinite(numbers(rows_of(file), "side_slip_rad")).sum() > 100


def test_the_status_tells_the_last_state() -> None:
    """Numbers by their names, null where nothing is known."""
    state = VehicleState(20.0, 0.1, 0.5, 0.05, 0.025, 0.003, 0.2, 0.01)
    assert state_entry("ekf", state) == {"method": "ekf", **state._asdict()}
    assert state_entry("ekf", None) == {"method": "ekf", **dict.fromkeys(VehicleState._fields)}


@pytest.mark.parametrize("method", FILTERS)
def test_a_table_of_signals_is_enough(tmp_path: Path, method: str) -> None:
    """No bus, no wheels: the lateral speed of an independent four-wheel car is followed to a third of its
    size, within three stated deviations nearly always."""
    where = signals_folder(tmp_path / "d", model="three-dof", duration_s=12.0, seed=3)
    file, reported = tmp_path / "t.csv", tmp_path / "t.json"
    line = ["replay", str(where), "--vehicle-state", method, "--csv", str(file), "--json", str(reported)]
    assert 0 == main(line)
    rows, truth = rows_of(file), read_signals(where)
    lateral = np.interp(numbers(rows, "time_s"), truth.time_s, truth.columns["velocity_lat_mps"])
    off = numbers(rows, "velocity_lat_mps") - lateral
    known = np.isfinite(off)
    assert known.mean() > 0.95
    assert np.sqrt(np.mean(off[known] ** 2)) < 0.35 * np.sqrt(np.mean(lateral**2))
    assert (np.abs(off[known]) < 3.0 * numbers(rows, "velocity_lat_std_mps")[known]).mean() > 0.97
    document = json.loads(reported.read_text(encoding="utf-8"))
    assert set(schema_of("tpmsd.replay/2")["required"]) <= set(document)


@pytest.mark.parametrize(
    ("old", "what"),
    [
        ("mass_kg = 1500.0\n", "[dynamics] mass_kg"),
        (DYNAMICS, "[dynamics] mass_kg yaw_inertia_kgm2"),
        ("steering_ratio", "[vehicle] steering_ratio"),
        ("steering_wheel_angle =", "[can.signals] steering_wheel_angle"),
        ("yaw_rate =", "[can.signals] yaw_rate"),
        ("accel_lat =", "[can.signals] accel_lat"),
    ],
)
def test_what_is_missing_is_one_line(
    on_bus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, what: str
) -> None:
    """Exit code 2 and the key's name; the same where the file asks for it."""
    text = (on_bus / "vehicle.toml").read_text(encoding="utf-8")
    if "\n" in old:
        text = text.replace(old, "")
    else:
        text = "\n".join(line for line in text.splitlines() if not line.startswith(old)) + "\n"
    for more, options in (("", ["--vehicle-state", "ekf"]), ('[vehicle_state]\nmethod = "ekf"\n', [])):
        file = on_bus / "less.toml"
        file.write_text(text + more, encoding="utf-8")
        capsys.readouterr()
        assert 2 == main(["replay", str(on_bus), "--config", str(file), *options])
        said = capsys.readouterr().err.strip().splitlines()
        assert len(said) == 1
        assert what in said[0]


@pytest.mark.parametrize("column", ["yaw_rate_radps", "accel_lat_mps2", "steering_wheel_angle_rad"])
def test_a_signal_that_a_table_lacks_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], column: str
) -> None:
    """Exit code 2 and the column's name."""
    where = signals_folder(tmp_path / "d", duration_s=10.0)
    kept = {name: values for name, values in read_signals(where).columns.items() if name != column}
    (where / "signals.csv").write_text(signals_text(kept))
    assert main(["replay", str(where), "--vehicle-state", "ekf"]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert column in said[0]


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ([], "--vehicle-state"),
        (["--vehicle-state", "ekf", "--method", "aug-ekf"], "--method"),
        (["--vehicle-state", "ekf", "--html", "x.html"], "--html"),
    ],
)
def test_a_table_of_signals_has_no_radii(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], what: str
) -> None:
    """Without the option there is nothing to replay, and options of the radius filter are refused."""
    where = signals_folder(tmp_path / "d", duration_s=10.0)
    assert 2 == main(["replay", str(where), *options])
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert what in said[0]
