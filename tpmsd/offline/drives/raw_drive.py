"""Reads a drive without a configuration: all frames, all fixes.

In: a folder with a CAN log and gnss.nmea, or the two files. Out: `BusLog` and `GnssFix`es; what was skipped
goes to a callback, a line each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tpmsd.foundation.english import counted
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.offline.discovery.frames import BusLog
from tpmsd.offline.drives.bus_fixes import BusFixes
from tpmsd.offline.drives.reading import Note, ignore_note
from tpmsd.onboard.sources.can.log import SUFFIXES, find_can_log, read_can_blocks
from tpmsd.onboard.sources.drive import find_nmea_log
from tpmsd.onboard.sources.events import GnssFix
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler
from tpmsd.onboard.sources.gnss.nmea_log import bears_host_times, read_nmea_log

_WANTED = "a drive is one folder, or two files, its CAN log and its NMEA log"


@dataclass(frozen=True)
class RawDrive:
    """Frames and fixes of a drive as recorded, before a configuration says what they mean."""

    can_log: Path
    nmea_log: Path
    """The CAN log where the receiver is on the bus."""
    log: BusLog
    fixes: list[GnssFix]
    host_times: bool
    """True if the sentences bear the host's clock."""


def drive_files(paths: Sequence[Path]) -> tuple[Path, Path]:
    """Return the CAN log and the receiver's log of a folder, or of two files in either order."""
    if len(paths) == 1:
        folder = _checked_folder(paths[0])
        nmea = find_nmea_log(folder)
        if nmea is None:
            raise InputError(folder, "no gnss.nmea: without a receiver's log nothing can be identified")
        return find_can_log(folder), nmea
    if len(paths) != 2:
        raise ConfigError(f"{_WANTED}, not {len(paths)} paths")
    for path in paths:
        _check_file(path)
    nmea_like = [p for p in paths if ".nmea" in p.name.lower() or ".ubx" in p.name.lower()]
    can_like = [p for p in paths if p not in nmea_like and any(p.name.lower().endswith(s) for s in SUFFIXES)]
    if len(can_like) == 2:  # two logs by their names: the one with sentences is the receiver's
        nmea_like = [p for p in can_like if _has_sentences(p)]
        can_like = [p for p in can_like if p not in nmea_like]
    if len(nmea_like) != 1 or len(can_like) != 1:
        raise ConfigError("of the two files one must be a CAN log and one an NMEA log (gnss.nmea)")
    return can_like[0], nmea_like[0]


def _check_file(path: Path) -> None:
    """Raise ConfigError for a folder and InputError for a missing file."""
    if path.is_dir():
        raise ConfigError(f"{path}: a folder; {_WANTED}: one drive at a time")
    if not path.is_file():
        raise InputError(path, f"no such file; {_WANTED}")


def _has_sentences(path: Path) -> bool:
    with path.open("rb") as file:
        return b"$G" in file.read(4096)


def read_drive(paths: Sequence[Path], tell: Note = ignore_note, on_bus: BusFixes | None = None) -> RawDrive:
    """Return all frames and fixes of a drive; InputError where there is nothing usable.

    `on_bus`: gathers the fixes of a receiver on the bus; then no sentences are read.
    """
    can_log, nmea_log = (
        drive_files(paths) if on_bus is None else (find_can_log(_checked_folder(paths[0])),) * 2
    )
    bad: dict[Path, tuple[int, str]] = {}

    def note(path: Path, line: int, reason: str) -> None:
        count, first = bad.get(path, (0, f"{path}:{line}: {reason}"))
        bad[path] = count + 1, first

    log = BusLog()
    for block in read_can_blocks(can_log, lambda line, reason: note(can_log, line, reason)):
        log.add(block)
        if on_bus is not None:
            on_bus.decode_block(block)
    fixes = _fixes_of_log(nmea_log, note) if on_bus is None else on_bus.finish()
    host_times = on_bus is not None or bears_host_times(nmea_log)
    for count, first in bad.values():
        tell(f"{counted(count, 'bad line')} skipped, first {first}")
    if log.left_out:
        tell(f"{can_log}: {log.left_out} frames of too many identifiers left out")
    return RawDrive(can_log, nmea_log, log, fixes, host_times)


def _checked_folder(path: Path) -> Path:
    if not path.is_dir():
        raise InputError(path, "not a folder" if path.exists() else "no such drive folder")
    return path


def _fixes_of_log(nmea_log: Path, note: Callable[[Path, int, str], None]) -> list[GnssFix]:
    """Return the fixes of a receiver's log."""
    assembler = NmeaAssembler()
    fixes: list[GnssFix] = []
    for time_s, line, _ in read_nmea_log(nmea_log, lambda line, reason: note(nmea_log, line, reason)):
        fixes += [event for event in assembler.feed(time_s, line) if isinstance(event, GnssFix)]
    return fixes + [event for event in assembler.flush() if isinstance(event, GnssFix)]
