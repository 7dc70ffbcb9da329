"""Keeps the truth apart from the process that diagnoses.

In: a made drive, its truth, where the program lies. Out: the diagnosis's document and model, and what it
cost. The drive folder and the sealed folder (mode 0700) have names of their own at random; the diagnosing
process starts in the drive folder with an environment of a few variables, and is told of no other place but
the one it writes to. The scorer reads the sealed file only when that process has ended.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.campaigns.offline.diagnosis.truth import Truth
from bench.worlds.folder import write_folder
from bench.worlds.instruments import Drive

TIME_LIMIT_S = 900.0


@dataclass(frozen=True)
class Answer:
    """What the diagnosis said."""

    document: dict[str, Any]
    model: dict[str, Any]
    """The model file."""
    cpu_s: float
    wall_s: float
    error: str = ""
    alarms: tuple[int, int] | None = None
    """Alarms of `tpmsd replay` without and with the model, where that was asked for."""


def diagnosed(drive: Drive, truth: Truth, program: Path, replay: bool = False) -> tuple[Answer, Truth]:
    """Write the drive, seal the truth, let another process diagnose, and open the seal."""
    folder = Path(tempfile.mkdtemp(prefix="drive-"))
    sealed = Path(tempfile.mkdtemp(prefix="sealed-"))
    report = Path(tempfile.mkdtemp(prefix="report-"))
    try:
        write_folder(drive, folder)
        (sealed / "truth.json").write_text(json.dumps(truth.plain()), encoding="utf-8")
        answer = _ask(folder, report, program, replay)
        opened = Truth.of(json.loads((sealed / "truth.json").read_text(encoding="utf-8")))
    finally:
        for each in (folder, sealed, report):
            shutil.rmtree(each, ignore_errors=True)
    return answer, opened


def asked(folder: Path, program: Path, *options: str) -> Answer:
    """What the program says of a drive folder, by a process of its own."""
    report = Path(tempfile.mkdtemp(prefix="report-"))
    try:
        return _ask(folder, report, program, False, options)
    finally:
        shutil.rmtree(report, ignore_errors=True)


def _ask(folder: Path, report: Path, program: Path, replay: bool, options: tuple[str, ...] = ()) -> Answer:
    document, model = report / "diagnosis.json", report / "model.toml"
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    wanted = ["diagnose", str(folder), "--json", str(document), "--model-out", str(model), *options]
    error = _run(wanted, folder, program)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - begun
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    said = json.loads(document.read_text(encoding="utf-8")) if document.exists() else {}
    if said.get("verdict") == "insufficient_data":
        error = ""  # an answer, though the command's exit code tells of unusable input
    found = tomllib.loads(model.read_text(encoding="utf-8")) if model.exists() else {}
    alarms = None
    if replay and not error and model.exists():
        alarms = (_alarms(folder, report, program, None), _alarms(folder, report, program, model))
    return Answer(said, found, cpu, wall, error, alarms)


def _alarms(folder: Path, report: Path, program: Path, model: Path | None) -> int:
    target = report / "replay.json"
    wanted = ["replay", str(folder), "--json", str(target)]
    if _run([*wanted, *(["--model", str(model)] if model is not None else [])], folder, program):
        return -1
    said = json.loads(target.read_text(encoding="utf-8"))
    return sum(alarm["state"] == "raised" for alarm in said["alarms"])


def _run(wanted: list[str], folder: Path, program: Path) -> str:
    environment = {"PATH": os.environ.get("PATH", ""), "LANG": "C.UTF-8", "PYTHONPATH": str(program)}
    environment |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            [sys.executable, "-m", "tpmsd", *wanted],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=TIME_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"not done within {TIME_LIMIT_S:.0f} s"
    if done.returncode != 0:
        return (done.stderr.strip().splitlines() or ["no message"])[-1][:300]
    return ""
