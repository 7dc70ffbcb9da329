"""The daemon needs the layers `onboard`, `car` and `foundation`, and nothing above them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import tpmsd
from tpmsd.interfaces.api.functions import replay
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault

IN_THE_CAR = ("onboard", "car", "foundation")
RUN = """
import importlib, json, pkgutil, sys
from pathlib import Path
import tpmsd, tpmsd.onboard
for module in pkgutil.walk_packages(tpmsd.onboard.__path__, "tpmsd.onboard."):
    importlib.import_module(module.name)
from tpmsd.car.config.load import load_config
from tpmsd.onboard.daemon.loop import Daemon
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.databases import load_database
from tpmsd.onboard.sources.drive import FolderStream
folder = Path(sys.argv[1])
config = load_config(folder)
pipeline = Pipeline(config, load_database(config.can.dbc))
alarms = []
for item in FolderStream(folder):
    if isinstance(item, CanFrame):
        steps = pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
    else:
        steps = pipeline.on_sentence(item.time_s, item.line)
    alarms += [event for step in steps for event in step.report.events]
alarms += [event for step in pipeline.finish() for event in step.report.events]
layers = sorted({name.split(".")[1] for name in sys.modules if name.startswith("tpmsd.")})
found = [[alarm.kind.value, alarm.wheel] for alarm in alarms]
print(json.dumps({"layers": layers, "alarms": found, "home": tpmsd.__file__}))
"""


def test_the_daemon_needs_three_layers(tmp_path: Path) -> None:
    """Without the layers of desk and interfaces every onboard module loads, and a loss is found."""
    box, drive = tmp_path / "box", tmp_path / "drive"
    source = Path(tpmsd.__file__).parent
    for layer in IN_THE_CAR:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(source / layer, box / "tpmsd" / layer, ignore=ignored)
    shutil.copy(source / "__init__.py", box / "tpmsd")
    fault = Fault("step", 1.0, wheel="rl", onset_s=120.0)
    write_drive(drive, simulate_drive(DriveSpec(duration_s=200.0, seed=5, route="motorway", faults=(fault,))))

    environment = {**os.environ, "PYTHONPATH": str(box)}
    done = subprocess.run(
        [sys.executable, "-P", "-c", RUN, str(drive)],
        capture_output=True,
        text=True,
        env=environment,
        cwd=tmp_path,
    )

    assert "" == done.stderr
    found = json.loads(done.stdout)
    assert str(box / "tpmsd" / "__init__.py") == found["home"]
    assert sorted(IN_THE_CAR) == found["layers"]
    there = [[alarm.kind.value, alarm.wheel] for alarm in replay(drive).alarms]
    assert ["deflation", "rl"] in there
    assert there == found["alarms"]
