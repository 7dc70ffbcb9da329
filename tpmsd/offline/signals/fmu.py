"""A functional mock-up unit (FMI 2 or 3, co-simulation) as a user's simulation: run on a recording's inputs.

In: the path of an `.fmu`, the recording's columns at the rows of a drive. Out: `SignalTable` with the FMU's
outputs that have the names of a table's columns. InputError in one line where the file is none, leads out of
its folder, lacks inputs or outputs, fails, or takes too long; ConfigError without the package fmpy.

An FMU is a program. It runs in a child with limits of processor time, memory and wall time, in a folder of
its own; that keeps a broken one from doing harm, not a malicious one.
"""

from __future__ import annotations

import json
import lzma
import resource
import stat
import struct
import tempfile
import threading
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from tpmsd.foundation.child_reader import ChildReader, ChildReadError, Send, installed
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.drive import DynamicsDrive, filled
from tpmsd.offline.signals.columns import OUTPUTS, ROAD_WHEEL, TIME
from tpmsd.offline.signals.read import SignalTable, read_signals

MAX_MEMBERS = 20_000
MAX_BYTES = 1 << 30
"""Size of an unpacked archive at most."""
MAX_DESCRIPTION_BYTES = 32 << 20
WALL_S = 300.0
"""An FMU that takes longer is ended."""
CPU_S = 300
MEMORY_BYTES = 8 << 30
FILE_BYTES = 1 << 30
"""Processor time, address space and largest file of the child."""
COMMUNICATION_S = 0.005
"""An FMU holds its inputs over a communication step, so that its outputs are late by up to one: 5 ms are
little against the delays of sensors (20 to 100 ms)."""
DESCRIPTION = "modelDescription.xml"
_DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(EOFError, NotImplementedError, RuntimeError, UnicodeDecodeError, OverflowError),
)
"""Exceptions of zipfile and its unpackers on a damaged, encrypted or unusual archive."""


def fmu_table(file: Path, recording: Path, drive: DynamicsDrive, wall_s: float = WALL_S) -> SignalTable:
    """Return the FMU's outputs at the rows of a drive; its inputs are the columns of the same names.

    `recording` is the drive's folder, whose columns the inputs are taken from.
    """
    if not installed("fmpy"):
        raise ConfigError("an FMU as --simulation needs the extra 'fmu' (pip install 'tpmsd[fmu]')")
    inputs = _fmu_inputs(recording, drive)
    with tempfile.TemporaryDirectory(prefix="tpmsd-fmu-") as where:
        folder = Path(where) / "fmu"
        unpack(file, folder)
        given = Path(where) / "inputs.npy"
        np.save(given, np.stack(list(inputs.values())))
        request = {"folder": str(folder), "inputs": str(given), "names": list(inputs)}
        names, values = _simulate_in_child(file, request, wall_s)
    time_s = drive.time_s + drive.start_s
    columns: dict[str, FloatArray] = {TIME: time_s}
    for k, name in enumerate(names[1:], start=1):
        columns[name] = np.interp(drive.time_s, values[0], values[k])
    return SignalTable(file, columns)


def _fmu_inputs(recording: Path, drive: DynamicsDrive) -> dict[str, FloatArray]:
    """Return every column that an FMU may ask for, at the rows of the drive; times from 0 on."""
    table = read_signals(recording)
    at = drive.time_s + drive.start_s
    known = {
        name: np.interp(at, table.time_s, filled(table.time_s, values))
        for name, values in table.columns.items()
        if name != TIME and np.isfinite(values).any()
    }
    given = drive.inputs
    own = {ROAD_WHEEL: given.steer_rad, OUTPUTS["speed"]: given.speed_mps}
    return {TIME: drive.time_s, **own, OUTPUTS["accel_long"]: given.accel_long_mps2, **known}


def unpack(file: Path, folder: Path) -> None:
    """Unpack an FMU into a folder; InputError for what is no FMU, leads out of the folder or is too large."""
    if not file.is_file():
        raise InputError(file, "not a file" if file.exists() else "no such file")
    try:
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            _check_members(file, members)
            for member in members:
                archive.extract(member, folder)
    except _DAMAGED as error:
        raise InputError(file, f"no FMU: {' '.join(str(error).split())[:120]}") from None
    except OSError as error:
        raise InputError(file, f"cannot be read: {error.strerror or error}") from None
    text = (folder / DESCRIPTION).read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise InputError(file, f"no FMU: {DESCRIPTION} declares a document type")


def _check_members(file: Path, members: list[zipfile.ZipInfo]) -> None:
    """Raise InputError unless all members stay in the folder and are of a size that can be unpacked."""
    for member in members:
        path = PurePosixPath(member.filename)
        link = stat.S_ISLNK(member.external_attr >> 16)
        if (
            not path.name
            or link
            or path.is_absolute()
            or ".." in path.parts
            or any(c in member.filename for c in "\\:\0")
        ):
            raise InputError(file, f"a member leads out of the archive: {member.filename[:80]!r}")
    if len(members) > MAX_MEMBERS or sum(member.file_size for member in members) > MAX_BYTES:
        raise InputError(file, f"larger than {MAX_BYTES >> 30} GB or {MAX_MEMBERS} members")
    described = [member for member in members if member.filename == DESCRIPTION]
    if not described:
        raise InputError(file, f"no FMU: it has no {DESCRIPTION}")
    if described[0].file_size > MAX_DESCRIPTION_BYTES:
        raise InputError(file, f"{DESCRIPTION} is larger than {MAX_DESCRIPTION_BYTES >> 20} MB")


def _simulate_in_child(file: Path, request: Mapping[str, Any], wall_s: float) -> tuple[list[str], FloatArray]:
    """Return the names of the outputs, time first, and their values (k, n), by a child process."""
    late = threading.Event()
    with ChildReader("tpmsd.offline.signals.fmu:run_fmu", file) as child:

        def end() -> None:
            late.set()
            child.close()

        timer = threading.Timer(wall_s, end)
        timer.start()
        try:
            child.ask(json.dumps(request))
            names = child.receive()
            values = child.receive()
        except (ChildReadError, ValueError, OSError) as error:
            why = f"takes longer than {wall_s:g} s" if late.is_set() else str(error)
            raise InputError(file, f"the simulation failed: {why}") from None
        finally:
            timer.cancel()
    if names is None or values is None:
        raise InputError(file, "the simulation failed: no outputs")
    found: list[str] = json.loads(names)
    table = np.frombuffer(values, dtype=np.float64).reshape(len(found), -1)
    if not np.isfinite(table).all():
        raise InputError(file, "the simulation failed: its outputs are not finite")
    return found, table


def run_fmu(path: Path, requests: Iterator[str], send: Send) -> None:
    """Simulate in the child: sends the names of the outputs, then their values, time first."""
    import fmpy

    _limit_resources()
    request = json.loads(next(requests))
    inputs = dict(zip(request["names"], np.load(request["inputs"]), strict=True))
    description = fmpy.read_model_description(request["folder"], validate=False)
    if not str(description.fmiVersion).startswith(("2", "3")):
        raise ValueError(f"FMI {description.fmiVersion}: FMI 2 and 3 can be run")
    if description.coSimulation is None:
        raise ValueError("it has no co-simulation")
    by_kind: dict[str, list[str]] = {"input": [], "output": []}
    for variable in description.modelVariables:
        by_kind.setdefault(variable.causality, []).append(variable.name)
    wanted = [name for name in by_kind["input"] if name in inputs]
    if missing := [name for name in by_kind["input"] if name not in inputs]:
        raise ValueError(f"the recording has no {' '.join(missing)[:150]}, an input of the FMU")
    outputs = [name for name in by_kind["output"] if name in OUTPUTS.values()]
    if not outputs:
        raise ValueError(f"none of its outputs is one of {' '.join(OUTPUTS.values())}")
    time_s = inputs[TIME]
    rows = np.zeros(len(time_s), dtype=[("time", "f8"), *((name, "f8") for name in wanted)])
    rows["time"] = time_s
    for name in wanted:
        rows[name] = inputs[name]
    result = fmpy.simulate_fmu(
        request["folder"],
        validate=False,
        start_time=0.0,
        stop_time=float(time_s[-1]),
        output_interval=_communication_s(time_s, description.defaultExperiment),
        fmi_type="CoSimulation",
        input=rows if wanted else None,
        output=outputs,
    )
    send(json.dumps([TIME, *outputs]).encode())
    table = np.stack([np.asarray(result[name], dtype=np.float64) for name in ("time", *outputs)])
    send(np.ascontiguousarray(table).tobytes())


def _limit_resources() -> None:
    """Bound processor time, memory and files of this process."""
    for what, most in (
        (resource.RLIMIT_CPU, CPU_S),
        (resource.RLIMIT_AS, MEMORY_BYTES),
        (resource.RLIMIT_FSIZE, FILE_BYTES),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(what)[1]
        resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _communication_s(time_s: FloatArray, experiment: Any) -> float:
    """Return the communication step: the FMU's own where it is finer than the rows, else a whole part of the
    rows' step of at most `COMMUNICATION_S`."""
    rows_s = float(np.median(np.diff(time_s)))
    own_s = float(getattr(experiment, "stepSize", None) or 0.0)
    if 0.0 < own_s <= rows_s:
        return own_s
    return rows_s / float(np.ceil(rows_s / COMMUNICATION_S - 1e-9))
