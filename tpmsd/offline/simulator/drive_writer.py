"""Write a simulated drive as a drive folder (docs/reference/formats.md).

In: a `SimulatedDrive`. Out: a folder with vehicle.toml, bus.dbc, can.log, gnss.nmea, and truth.json.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.offline.simulator.bus import FrameLog
from tpmsd.offline.simulator.drive import SimulatedDrive
from tpmsd.offline.simulator.receiver import NmeaLine

_CHUNK = 20_000
TRUTH = "truth.json"
MAKER = "tpmsd simulate"
"""Program named in truth.json; the mark by which a folder is known as ours."""
FILES = ("vehicle.toml", "bus.dbc", "gnss.nmea", "can.log", TRUTH)


def check_drive_folder(folder: Path, force: bool) -> None:
    """Raise ConfigError for a folder that must not be written to, before the simulation starts.

    A folder that holds anything is written to only with `force`, only if `write_drive` made it, and only if
    nothing stands beside its files: a recording is never touched.

    ConfigError with one line otherwise.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise ConfigError(f"{folder}: not a folder")
    try:
        names = sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be read: {error.strerror}") from None
    if not names:
        return
    foreign = [name for name in names if name not in FILES]
    if not _is_simulated(folder / TRUTH):
        raise ConfigError(f"{folder}: holds files that tpmsd simulate did not write; name another folder")
    if foreign:
        raise ConfigError(f"{folder}: holds {foreign[0]} beside a simulated drive; name another folder")
    if not force:
        raise ConfigError(f"{folder}: holds a simulated drive already; --force replaces it")


def _is_simulated(truth: Path) -> bool:
    """Return whether the truth file is one of `write_drive`: its first line says so."""
    try:
        with truth.open(encoding="utf-8") as file:
            return file.readline(200).startswith(f'{{"program": "{MAKER}"')
    except (OSError, UnicodeDecodeError):
        return False


def write_start(folder: str | Path, vehicle_toml: str, dbc: str) -> None:
    """Write the configuration and the DBC of a drive that is yet to be simulated, for a daemon to start with.

    TpmsdError if the disk does not take it.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
        # First of all, so that a run that was cut short leaves a folder that --force may replace.
        (path / TRUTH).write_text(_json_line_per_key({"program": MAKER}), encoding="utf-8")
        (path / "bus.dbc").write_text(dbc, encoding="utf-8")
        (path / "vehicle.toml").write_text(vehicle_toml, encoding="utf-8")
    except OSError as error:
        raise TpmsdError(f"{error.filename or path}: cannot be written: {error.strerror}") from None


def write_drive(
    folder: str | Path,
    drive: SimulatedDrive,
    progress: Callable[[float], None] | None = None,
    vehicle_toml: str | None = None,
) -> Path:
    """Write the drive, making the folder if need be, and return its path.

    `vehicle_toml` takes the place of the drive's own (see `SimulatedDrive.configuration`).

    `progress` is called with the seconds of drive that are written. TpmsdError if the disk does not take it.
    """
    path = Path(folder)
    try:
        path.mkdir(parents=True, exist_ok=True)
        # First of all, so that a run that was cut short leaves a folder that --force may replace.
        truth = {"program": MAKER, **drive.truth()}
        (path / TRUTH).write_text(_json_line_per_key(truth), encoding="utf-8")
        (path / "vehicle.toml").write_text(vehicle_toml or drive.vehicle_toml, encoding="utf-8")
        (path / "bus.dbc").write_text(drive.dbc, encoding="utf-8")
        (path / "gnss.nmea").write_text("".join(map(nmea_log_line, drive.nmea)), encoding="ascii", newline="")
        with (path / "can.log").open("w", encoding="ascii", newline="\n") as log:
            first = float(drive.frames.time_s[0]) if len(drive.frames) else 0.0
            for text, until in candump_chunks(drive.frames):
                log.write(text)
                if progress is not None:
                    progress(until - first)
    except OSError as error:
        raise TpmsdError(f"{error.filename or path}: cannot be written: {error.strerror}") from None
    return path


def nmea_log_line(line: NmeaLine) -> str:
    """Return a sentence with its arrival time in front: `(1719820800.112233) $GNRMC,...*hh`."""
    return f"({line.time_s:.6f}) {line.text}\n"


def _json_line_per_key(document: dict[str, Any]) -> str:
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in document.items()]
    return "{" + ",\n ".join(lines) + "}\n"


def candump_chunks(frames: FrameLog, channel: str = "can0") -> Iterator[tuple[str, float]]:
    """Yield the log as `candump -L` writes it, in pieces: (text, host time of the piece's last frame)."""
    for begin in range(0, len(frames), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        times = frames.time_s[part].tolist()
        ids = [f"{i:03X}" if i < 0x800 else f"{i:08X}" for i in frames.frame_id[part].tolist()]
        text = np.ascontiguousarray(frames.data[part]).tobytes().hex().upper()
        width = 2 * frames.data.shape[1]
        lines = [
            f"({t:.6f}) {channel} {i}#{text[width * k : width * (k + 1)]}\n"
            for k, (t, i) in enumerate(zip(times, ids, strict=True))
        ]
        yield "".join(lines), times[-1]
