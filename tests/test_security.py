"""What SECURITY.md promises, as far as a test can see it."""

from __future__ import annotations

import ast
import dataclasses
import re

import numpy as np

from tests.conftest import REPO
from tests.faults.drives import drive
from tpmsd.onboard.daemon import input_queue
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sinks import state_file, status_server
from tpmsd.onboard.sinks.can_frames import CanReporter
from tpmsd.onboard.sources.can import log_candump, log_lines
from tpmsd.onboard.sources.can.decoder import can_filters, load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.gnss import nmea_framer, nmea_log

FORBIDDEN_MODULES = {
    *("pickle", "cPickle", "dill", "cloudpickle", "shelve", "marshal", "joblib", "yaml", "code", "codeop"),
    *(
        "subprocess",
        "multiprocessing",
        "pty",
        "ctypes",
        "imp",
        "http",
        "urllib",
        "ftplib",
        "xmlrpc",
        "telnetlib",
    ),
    *("zipfile", "zipimport", "tarfile"),
}
ALLOWED_MODULES = {
    ("tpmsd/offline/simulator/live.py", "pty"),
    ("tpmsd/onboard/daemon/notify.py", "subprocess"),
    ("tpmsd/foundation/child_reader.py", "subprocess"),
    ("tpmsd/foundation/startup.py", "ctypes"),
    ("tpmsd/offline/signals/fmu.py", "zipfile"),
}
"""The simulator's receiver is a pseudo terminal; `[notify] command` is the one foreign program that is
ever run, beside this one itself as the reader of a native format and an FMU that the user names, which is an
archive whose members are checked before they are unpacked (`tests/offline/signals/test_fmu.py`); the
C library's `mallopt` is called with two constants, by `tpmsd diagnose` alone."""
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "breakpoint"}
FORBIDDEN_METHODS = {
    *("system", "popen", "execv", "execve", "execvp", "spawnl", "spawnv", "fork", "forkpty"),
    *("unpack_archive", "extractall"),
}


def findings(name: str, source: str) -> list[str]:
    """Code from data, shells and child processes in a module."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            for module in imported_modules(node):
                root = module.split(".")[0]
                if root in FORBIDDEN_MODULES and (name, root) not in ALLOWED_MODULES:
                    found.append(f"{name}:{node.lineno}: imports {module}")
        elif isinstance(node, ast.Call):
            found += [f"{name}:{node.lineno}: {words}" for words in dangers_of(node)]
    return found


def imported_modules(node: ast.Import | ast.ImportFrom) -> list[str]:
    """The modules that a statement imports, or imports from."""
    return [node.module or ""] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]


def dangers_of(call: ast.Call) -> list[str]:
    """The forbidden function, method and arguments of a call, a few words each."""
    found = []
    if isinstance(call.func, ast.Name) and call.func.id in FORBIDDEN_CALLS:
        found.append(f"calls {call.func.id}")
    if isinstance(call.func, ast.Attribute) and call.func.attr in FORBIDDEN_METHODS:
        found.append(f"calls .{call.func.attr}")
    for keyword in call.keywords:
        true = isinstance(keyword.value, ast.Constant) and keyword.value.value is True
        if keyword.arg in ("shell", "allow_pickle") and true:
            found.append(f"{keyword.arg}=True")
    return found


def test_no_code_comes_from_data() -> None:
    """No module of the package unpickles, evaluates, starts a shell or another process, or unpacks an archive
    of files."""
    assert [] == [
        line
        for path in sorted((REPO / "tpmsd").rglob("*.py"))
        for line in findings(path.relative_to(REPO).as_posix(), path.read_text("utf-8"))
    ]


def test_the_search_finds_what_it_looks_for() -> None:
    """Each forbidden thing is found where it is."""
    source = """
import pickle
from subprocess import run
eval("1")
import os
os.system("ls")
run("ls", shell=True)
import numpy as np
np.load("x", allow_pickle=True)
import zipfile
zipfile.ZipFile("x").extractall()
import shutil
shutil.unpack_archive("x")
"""
    assert 9 == len(findings("example.py", source))


def test_frames_of_the_bus_are_readings_and_no_commands() -> None:
    """Frames on the daemon's own identifiers, and on all others, change no tick, no estimate and no alarm."""
    config, items = drive()
    rng = np.random.default_rng(3)
    needed = {entry["can_id"] for entry in can_filters(config, load_database(config.can.dbc))}
    plain, pestered = (Pipeline(config, load_database(config.can.dbc)) for _ in range(2))
    steps: list[list[tuple[object, ...]]] = [[], []]
    for item in items[:3000]:
        for pipeline, kept, disturb in ((plain, steps[0], False), (pestered, steps[1], True)):
            made: list[Step] = []
            if disturb and isinstance(item, CanFrame):
                for number in (config.alarms.status_id, config.alarms.alarm_id, int(rng.integers(0, 0x7FF))):
                    if number not in needed:
                        made += pipeline.on_frame(item.time_s, number, False, rng.bytes(8))
                        made += pipeline.on_frame(item.time_s, number, True, rng.bytes(8))
            if isinstance(item, CanFrame):
                made += pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
            else:
                made += pipeline.on_sentence(item.time_s, item.line)
            kept += [
                (s.tick.time_s, s.estimate.deviation_m.tobytes(), s.report.learning_fraction) for s in made
            ]

    assert len(steps[0]) > 100
    assert steps[0] == steps[1]


def test_nothing_is_sent_unless_configured() -> None:
    """With [alarms] can = false no frame leaves, whatever the monitor says."""
    config, items = drive()
    silent = CanReporter(dataclasses.replace(config.alarms, can=False))
    talking = CanReporter(config.alarms)
    pipeline = Pipeline(config, load_database(config.can.dbc))
    sent: list[int] = []
    for item in items[:1500]:
        if isinstance(item, CanFrame):
            for step in pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data):
                assert [] == silent.frames(step.tick.time_s, step.report)
                sent += [out.arbitration_id for out in talking.frames(step.tick.time_s, step.report)]

    assert {config.alarms.status_id} == set(sent)


def test_the_bounds_are_those_that_are_promised() -> None:
    """SECURITY.md states the bounds that the code has."""
    text = re.sub(r"\s+", " ", (REPO / "SECURITY.md").read_text("utf-8"))
    assert f"{nmea_framer.MAX_LINE_BYTES} bytes of a sentence" in text
    assert {log_candump.MAX_LINE_CHARS, log_lines.MAX_LINE_CHARS, nmea_log.MAX_LINE_CHARS} == {4096}
    assert "4096 characters of a line in a log" in text
    assert f"{status_server.MAX_REQUEST_BYTES} bytes of a request" in text
    assert f"{status_server.MAX_CLIENTS} clients" in text
    assert f"{status_server.MAX_PENDING_BYTES // 1024} kB that wait for a client" in text
    assert 1 << 20 == state_file.MAX_BYTES
    assert f"{input_queue.CAPACITY // 1000} 000 inputs in the queue" in text
