"""The store: keyed by content, written whole, and a worker's death is counted."""

from __future__ import annotations

import json
import shutil
import stat
from pathlib import Path

import pyarrow.parquet
import pytest

from tpmsd.interfaces.cli.main import main
from tpmsd.offline.fleet.find_drives import find_drives
from tpmsd.offline.fleet.settings import SETTINGS
from tpmsd.offline.fleet.store import Store, write_atomic
from tpmsd.offline.fleet.tables import COLUMNS, write_tables
from tpmsd.offline.fleet.work import STAGES, is_missing, make_result, program, work_on_drive
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive


@pytest.fixture(scope="module")
def van(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A car's folder with two drives of 15 s."""
    folder = tmp_path_factory.mktemp("fleet") / "van-7"
    for seed in (1, 2):
        write_drive(folder / f"drive-{seed}", simulate_drive(DriveSpec(duration_s=15.0, seed=seed)))
    return folder


def test_adding_twice_does_nothing(van: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Folders, globs and URLs of the same drives, and copies of them, are in the store once."""
    store = str(tmp_path / "store")
    copy = shutil.copytree(van / "drive-1", tmp_path / "elsewhere" / "copy")
    names = [str(van), f"{van}/*", f"file://{van}/drive-2", str(copy)]
    counts = []
    for name in names:
        assert 0 == main(["fleet", "add", store, name, "--json"])
        reported = json.loads(capsys.readouterr().out)
        counts.append((reported["added"], reported["known"]))

    assert [(2, 0), (0, 2), (0, 1), (0, 1)] == counts
    entries = Store.open(Path(store)).entries()
    assert {"van-7"} == {entry.car for entry in entries}
    assert 1 == len({entry.model for entry in entries})


def test_a_link_keeps_its_name(van: Path, tmp_path: Path) -> None:
    """Drives that are linked into a folder for each car belong to the car of that folder."""
    (tmp_path / "van-8").mkdir()
    (tmp_path / "van-8" / "monday").symlink_to(van / "drive-1")
    (entry,) = find_drives([str(tmp_path / "van-8" / "monday")])

    assert ("van-8", str(tmp_path / "van-8" / "monday")) == (entry.car, entry.path)


@pytest.mark.parametrize("pattern", ["**", "**/drive", "[ab]**", "*/**", "[ab]***/**"])
def test_a_pattern_finds_each_drive_once(pattern: str, van: Path, tmp_path: Path) -> None:
    """A link that leads upwards is not followed by `**`, which within a longer part is one asterisk."""
    cars = tmp_path / "cars"
    for car in ("a", "b"):
        shutil.copytree(van / "drive-1", cars / car / "drive")
    (cars / "a" / "up").symlink_to("..")

    found = [entry.path for entry in find_drives([str(cars / pattern)])]

    assert [str(cars / "a" / "drive"), str(cars / "b" / "drive")] == sorted(found)


def test_another_byte_is_another_drive(van: Path, tmp_path: Path) -> None:
    """A drive in which a byte differs has another key."""
    copy = shutil.copytree(van / "drive-1", tmp_path / "copy")
    with (copy / "gnss.nmea").open("ab") as log:
        log.write(b"\n")
    keys = {entry.key for entry in find_drives([str(van / "drive-1"), str(copy)])}

    assert 2 == len(keys)


def test_files_are_whole_or_absent(tmp_path: Path) -> None:
    """A write that fails leaves the old file and nothing beside it; a new file is readable by others."""
    file = tmp_path / "result.json"
    write_atomic(file, "old")
    with pytest.raises(UnicodeEncodeError):
        write_atomic(file, "\udc80")

    assert ["result.json"] == [path.name for path in tmp_path.iterdir()]
    assert "old" == file.read_text()
    plain = tmp_path / "plain"
    plain.touch()
    assert stat.S_IMODE(plain.stat().st_mode) == stat.S_IMODE(file.stat().st_mode)


def test_a_drive_that_fails_is_a_row(van: Path, tmp_path: Path) -> None:
    """A drive without a log fails with its reason, in which no place is named; the others are done."""
    broken = shutil.copytree(van / "drive-1", tmp_path / "broken")
    (broken / "can.log").write_text("nothing\n")
    store = Store.create(tmp_path / "store")
    for entry in find_drives([str(van), str(broken)]):
        store.add(entry)
        work_on_drive(str(store.path), entry.key, ("replay",), "run")
    counts = write_tables(store)

    import pyarrow.parquet as parquet

    assert set(COLUMNS) == set(counts)
    assert {"drives": 3, "wheels": 8} == {name: counts[name] for name in ("drives", "wheels")}
    rows = parquet.read_table(store.tables / "drives.parquet").to_pylist()
    assert ["done", "done", "failed"] == sorted(row["status"] for row in rows)
    (reason,) = [row["reason"] for row in rows if row["status"] == "failed"]
    assert reason.startswith("DRIVE/can.log:1: ")


def test_a_poison_drive_is_set_aside(van: Path, tmp_path: Path) -> None:
    """After two starts in one run that never ended, or four in all, a drive is set aside with the reason."""
    store = Store.create(tmp_path / "store")
    (entry,) = find_drives([str(van / "drive-1")])
    store.add(entry)
    for number in range(1, SETTINGS.tries + 1):
        assert number == store.begin_try(entry.key, "run")

    assert "set_aside" == work_on_drive(str(store.path), entry.key, STAGES, "run")
    result = store.result(entry.key)
    assert result is not None
    assert "its worker died 2 times" == result["reason"]
    assert 0 == store.tries_of(entry.key)
    assert not is_missing(result, STAGES, recompute=True)
    for number in range(SETTINGS.tries_in_all):
        store.begin_try(entry.key, f"run-{number}")
    assert "set_aside" == work_on_drive(str(store.path), entry.key, STAGES, "another")


def test_other_versions_are_recomputed_on_demand(van: Path) -> None:
    """A result of another version counts unless new ones are asked for; one that lacks a stage does not."""
    result = make_result(str(van / "drive-1"), ("replay",))
    older = {**result, "program": "tpmsd 0.0.9"}

    assert program() == result["program"]
    assert [False, False] == [is_missing(one, ("replay",), recompute=False) for one in (result, older)]
    assert [False, True] == [is_missing(one, ("replay",), recompute=True) for one in (result, older)]
    assert is_missing(result, STAGES, recompute=False)
    assert is_missing(None, (), recompute=False)


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        (["status", "nowhere"], 2, "no store of tpmsd fleet"),
        (["add", "store", "nowhere"], 3, "no drive folder"),
        (["run", "store", "--jobs", "0"], 2, "--jobs 0: 1 to 1024"),
        (["sql", "store", "select 1"], 2, "no tables yet"),
        (["add", "full", "nowhere"], 2, "a folder with other things in it"),
    ],
)
def test_wrong_use_is_reported(
    arguments: list[str], code: int, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each mistake ends with its exit code and one line."""
    Store.create(tmp_path / "store")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thing").touch()
    action, store, *rest = arguments

    assert code == main(["fleet", action, str(tmp_path / store), *rest])
    (line,) = capsys.readouterr().err.splitlines()
    assert reason in line


def test_queries_open_nothing(van: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """SQL answers from the tables as text and JSON, reads no other file, and wrong SQL is one line."""
    store = Store.create(tmp_path / "store")
    for entry in find_drives([str(van)]):
        store.add(entry)
    write_tables(store)
    ask = ["fleet", "sql", str(store.path)]

    assert 0 == main([*ask, "select car, count(*) as n, min(status) as status from drives group by car"])
    assert ["car    n  status", "van-7  2  missing"] == capsys.readouterr().out.splitlines()
    assert 0 == main([*ask, "select count(*) as n from findings", "--json"])
    assert [{"n": 0}] == json.loads(capsys.readouterr().out)["rows"]
    start = "select repeat('0123456789', 4) as key, 1719820800.5 :: double as start"
    files = {kind: tmp_path / f"answer.{kind}" for kind in ("csv", "parquet")}
    assert 0 == main([*ask, start, "--csv", str(files["csv"]), "--parquet", str(files["parquet"])])
    assert ["key         start", "0123456789  2024-07-01 08:00:00"] == capsys.readouterr().out.splitlines()
    assert f"key,start\n{'0123456789' * 4},1719820800.5\n" == files["csv"].read_text()
    table = pyarrow.parquet.read_table(files["parquet"])
    assert {"key": ["0123456789" * 4], "start": [1719820800.5]} == table.to_pydict()
    for query in (f"select * from read_csv('{van}/drive-1/can.log')", "selekt 1"):
        assert 2 == main([*ask, query])
        assert 1 == len(capsys.readouterr().err.splitlines())
