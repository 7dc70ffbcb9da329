"""A store whose files were damaged or made by somebody else: one line each, and the rest goes on."""

from __future__ import annotations

import copy
import json
import random
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from tpmsd.interfaces.cli.main import main
from tpmsd.offline.fleet.store import DriveEntry, Store
from tpmsd.offline.fleet.tables import parquet_of, rows_of

KEYS = ("a1" * 20, "b2" * 20)
NAMES = ["radius_fl", "radius_fr", "radius_rl", "radius_rr"]
RESULT: dict[str, Any] = {
    "schema": "tpmsd.fleet.drive/1",
    "program": "tpmsd 1",
    "status": "done",
    "reason": "",
    "stages": ["replay", "calibrate", "diagnose"],
    "replay": {
        "start_time": 1.7e9,
        "duration_s": 900.0,
        "distance_m": 9e3,
        "wheels": {"fl": {"state": "ok", "deviation_mm": 0.1, "std_mm": 0.2}},
        "alarms": [{"time": 1.7e9, "kind": "deflation", "wheel": "fl", "state": "raised", "reason": "x"}],
    },
    "calibrate": {
        "reason": "",
        "statistics": {
            "names": NAMES,
            "information": [1e6, 0.0, 1e6, 0.0, 0.0, 1e6, 0.0, 0.0, 0.0, 1e6],
            "vector": [1.0, 2.0, 3.0, 4.0],
        },
    },
    "diagnose": {
        "verdict": "finding",
        "reason": "",
        "findings": [
            {
                "effect": "wear",
                "confidence": 0.9,
                "p_value": None,
                "parameters": {"rate": {"value": 1.0, "std": 0.1, "unit": "m"}},
            }
        ],
    },
}
OTHERS: list[Any] = [None, True, -1, 1e308, 10**400, "", "../../evil", "\ud800", [], {}, [[]], {"a": None}]


def store_of(path: Path, result: object = RESULT) -> Store:
    store = Store.create(path)
    for key in KEYS:
        store.add(DriveEntry(key, "/drive", "van", "vans"))
        store.write_result(key, RESULT)
    (store.results / f"{KEYS[0]}.json").write_text(json.dumps(result))
    return store


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Containers with each key or index in them, all the way down."""
    for key in value if isinstance(value, dict) else range(len(value)):
        yield value, key
        if isinstance(value[key], dict | list):
            yield from places(value[key])


def mutations(count: int) -> Iterator[Any]:
    rng = random.Random(6)
    for _ in range(count):
        made = copy.deepcopy(RESULT)
        container, key = rng.choice(list(places(made)))
        if isinstance(container, dict) and rng.random() < 0.3:
            del container[key]
        else:
            container[key] = copy.deepcopy(rng.choice(OTHERS))
        yield made


def test_a_key_cannot_lead_out_of_the_store(tmp_path: Path) -> None:
    """An entry whose key is not its file's name, in hexadecimal, is left out with one line; others stay."""
    store = store_of(tmp_path / "store")
    entry = DriveEntry("../../evil", "/drive", "van", "vans")
    (store.drives / "evil.json").write_text(json.dumps(asdict(entry)))
    (store.drives / f"{'c3' * 20}.json").write_text(json.dumps(asdict(entry)))

    assert list(KEYS) == [one.key for one in store.entries()]
    assert {"evil.json", f"{'c3' * 20}.json"} == {path.name for path in store.damaged}
    assert all("its key is not the file's name" in line for line in store.damaged.values())


def test_a_damaged_result_is_nothing_and_the_rest_goes_on(tmp_path: Path) -> None:
    """Of 400 results with one value changed or gone none raises, and the other drive has all its rows."""
    store = store_of(tmp_path / "store")
    file = store.results / f"{KEYS[0]}.json"
    noted = 0
    for result in mutations(400):
        file.write_text(json.dumps(result))
        store.damaged.clear()
        rows = rows_of(store)
        assert all(parquet_of(name, made) for name, made in rows.items())
        (kept,) = [row for row in rows["drives"] if row["key"] == KEYS[1]]
        assert "done" == kept["status"]
        noted += len(store.damaged)

    assert 200 < noted < 400


def test_a_link_in_a_store_is_replaced_and_not_written_through(tmp_path: Path) -> None:
    """A result that is a link to a file elsewhere is replaced by the new result; the other file stays as it
    was. A try that is a link there is not written through either."""
    store = store_of(tmp_path / "store")
    other = tmp_path / "other.json"
    other.write_text("mine")
    for link in (store.results / f"{KEYS[0]}.json", store.tries / f"{KEYS[0]}.run.1"):
        link.unlink(missing_ok=True)
        link.symlink_to(other)

    store.write_result(KEYS[0], RESULT)
    assert 2 == store.begin_try(KEYS[0], "run")
    assert ("mine", False) == (other.read_text(), (store.results / f"{KEYS[0]}.json").is_symlink())
    assert RESULT == store.result(KEYS[0])


@pytest.mark.parametrize("text", ["", "{", "[]", "NaN", '{"status": NaN}', "[" * 100_000, "\xff"])
def test_what_is_no_json_is_nothing(text: str, tmp_path: Path) -> None:
    """A result that is no JSON object counts as missing, and is noted."""
    store = store_of(tmp_path / "store")
    (store.results / f"{KEYS[0]}.json").write_bytes(text.encode("latin-1"))

    assert store.result(KEYS[0]) is None
    (line,) = store.damaged.values()
    assert "damaged: " in line


def test_status_says_what_is_damaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`fleet status` has a line for each damaged file, and counts the drive as missing."""
    store_of(tmp_path / "store", {"status": "done"})

    assert 0 == main(["fleet", "status", str(tmp_path / "store"), "--json"])
    said = capsys.readouterr()
    assert (1, 1) == tuple(json.loads(said.out)[name] for name in ("done", "missing"))
    (line,) = said.err.splitlines()
    assert line.endswith(f"{KEYS[0]}.json: damaged: reason: no text")


@pytest.mark.parametrize("asked", ["status", "report"])
def test_no_name_in_a_store_steers_a_terminal(
    asked: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Folders and reasons with control characters are shown with escapes, on one line each."""
    store = Store.create(tmp_path / "store")
    store.add(DriveEntry(KEYS[0], "/d\x1b[2J\x07", "van\x9b", "vans"))
    store.write_result(KEYS[0], {**RESULT, "status": "failed", "reason": "bad \x1b]0;title\x07"})
    assert 0 == main(["fleet", asked, str(store.path)])
    said = capsys.readouterr()
    assert "/d\\x1b[2J\\x07" in said.out
    assert [] == [line for line in (said.out + said.err).splitlines() if not line.isprintable()]
