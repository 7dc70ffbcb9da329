"""Every JSON document that the program writes is as its schema says, and the schema knows every key of it."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from tests.offline.fleet.test_report import fleet_tables
from tests.onboard.daemon.fakes import DrivingBus, car
from tests.onboard.daemon.test_loop import SCALE
from tests.onboard.daemon.test_loop import run as run_daemon
from tpmsd.car.config.model import VEHICLE_STATE_METHODS
from tpmsd.foundation.schemas import NAMES, schema_of
from tpmsd.interfaces.bridges.mqtt_messages import Announcer, Topics, state_document
from tpmsd.interfaces.bridges.summary import Alarm, DaemonSummary, summarise
from tpmsd.interfaces.cli.main import main
from tpmsd.interfaces.cli.output import json_text
from tpmsd.offline.fleet.report import report_document
from tpmsd.offline.fleet.work import make_result
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.sealed import seal
from tpmsd.onboard.daemon.clock import Clock

PACKAGE = Path(__file__).resolve().parents[2] / "tpmsd"
OWN_TABLES = {"tpmsd.ticks/1", "tpmsd.vehicle/1", "tpmsd.fleet/1"}
"""Names that are no JSON document: tables, a configuration, a store."""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """One document of each kind, of a drive of 125 s and of a daemon."""
    here = tmp_path_factory.mktemp("schemas")
    drive, table = str(here / "drive"), str(here / "ticks.parquet")
    late, said = str(here / "late"), str(here / "late.json")
    lines = (
        ["simulate", drive, "--duration", "125", "--seed", "2"],
        ["replay", drive, "--parquet", table],
        ["check", drive, "--drive", drive],
        ["explain", drive],
        ["calibrate", drive],
        ["diagnose", drive, "--certify", "0", "--alarms"],
        ["discover", drive, "--dbc", f"{drive}/bus.dbc"],
        ["import", table, str(here / "imported")],
        ["plan", "lateral_slip"],
        ["simulate", late, "--onto", drive, "--effect", "gnss_latency:latency_s=0.3"],
    )
    found = {}
    for number, line in enumerate(lines):
        file = here / f"{number}.json"
        assert main([*line, "--json", str(file)]) in (0, 4), line
        document = json.loads(file.read_text(encoding="utf-8"))
        found[document["schema"]] = document
    found |= written_by_fleet(here)
    found["tpmsd.unseal/1"] = unsealed(here, Path(said), found["tpmsd.diagnosis/2"])
    config, database = car(here / "car")
    clock = Clock(SCALE)
    daemon = run_daemon(config, database, clock, DrivingBus(clock.now), 10.0)
    status = json.loads(json_text(daemon.document()))
    head = {key: status[key] for key in ("program", "input")}
    found["tpmsd.status/2"] = status
    found["tpmsd.mqtt/1"] = state_document(summarise(status))
    found["tpmsd.reset/2"] = {"schema": "tpmsd.reset/2", **head, "baseline": status["baseline"]}
    return found


def unsealed(here: Path, report: Path, diagnosis: dict[str, Any]) -> dict[str, Any]:
    """The score of a diagnosis against a truth of one effect."""
    report.write_text(json.dumps(diagnosis), encoding="utf-8")
    effects = [{"name": "gnss_latency", "parameters": {"latency_s": 0.3}}]
    seal(here / "truth.sealed", {"onto": "drive", "seed": 1, "effects": effects}, bytes(16))
    out = here / "unsealed.json"
    assert 0 == main(["unseal", str(here), "--with", str(report), "--json", str(out)])
    document: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return document


def written_by_fleet(here: Path) -> dict[str, dict[str, Any]]:
    """Of a store with one drive, which cannot be read: what is made of it is a row with its reason."""
    drive, store = here / "van" / "monday", here / "store"
    write_drive(drive, simulate_drive(DriveSpec(duration_s=10.0)))
    (drive / "can.log").unlink()
    found = {"tpmsd.fleet.drive/1": make_result(str(drive))}
    for action, *words in (
        ["add", str(drive)],
        ["run", "--jobs", "1"],
        ["status"],
        ["report"],
        ["sql", "select 1 as n"],
    ):
        file = here / f"fleet-{action}.json"
        assert 0 == main(["fleet", action, str(store), *words, "--json", str(file)])
        document = json.loads(file.read_text(encoding="utf-8"))
        found[document["schema"]] = document
    report = found["tpmsd.fleet.report/1"]
    found["tpmsd.fleet.report/1"] = report | report_document(fleet_tables())
    return found


@pytest.mark.parametrize("name", NAMES)
def test_a_document_is_as_its_schema_says(name: str, written: dict[str, dict[str, Any]]) -> None:
    """It is valid, and each of its keys is in the schema: a new key takes a line there."""
    schema = schema_of(name)
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(written[name], schema)

    assert set() == written[name].keys() - schema["properties"].keys()


@pytest.mark.parametrize("name", NAMES)
def test_what_is_not_so_is_not_valid(name: str, written: dict[str, dict[str, Any]]) -> None:
    """A missing key, another name and another type are found."""
    schema = schema_of(name)
    document = written[name]
    for wrong in (
        {key: value for key, value in document.items() if key != schema["required"][-1]},
        {**document, "schema": "tpmsd.other/2"},
        {**document, schema["required"][1]: 7},
    ):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(wrong, schema)


@pytest.mark.parametrize("state", ["raised", "cleared"])
def test_an_event_of_mqtt_is_as_its_schema_says(state: str) -> None:
    """An alarm with its state; `event` in the schema of the state's message."""
    announcer = Announcer(Topics("car"), 10.0)
    announcer.recall(None)
    alarm = Alarm("deflation", "rl", 1.0, -2.0, "soft")
    quiet = DaemonSummary("1", True, (), (), False, "ok", "ok")
    announcer.update(replace(quiet, alarms=(alarm,)))
    announcer.update(quiet)
    event = json.loads(announcer.events[["raised", "cleared"].index(state)].payload)
    schema = schema_of("tpmsd.mqtt/1")
    validator = jsonschema.Draft202012Validator({**schema["$defs"]["event"], "$defs": schema["$defs"]})

    assert state == event["state"]
    validator.validate(event)
    assert not validator.is_valid({key: value for key, value in event.items() if key != "state"})
    assert not validator.is_valid(event | {"time": "now"})


def test_every_name_in_the_code_has_its_schema() -> None:
    """No document is written under a name without a schema; the documents of the fleet are its tables."""
    text = "\n".join(path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    named = set(re.findall(r'"(tpmsd\.[a-z.]+/\d+)"', text))

    assert set(NAMES) == named - OWN_TABLES


@pytest.mark.parametrize("name", ["tpmsd.status/2", "tpmsd.replay/2"])
def test_every_filter_of_the_vehicle_state_is_in_the_schema(name: str) -> None:
    """The configuration, the filters and the documents know the same names."""
    found = re.findall(r'"method": {"enum": (\[[^]]*\])', json.dumps(schema_of(name)))

    assert list(VEHICLE_STATE_METHODS) in [json.loads(one) for one in found]
