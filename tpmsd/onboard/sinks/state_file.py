"""Keeps the learned state over restarts and power cuts: one JSON file, replaced as a whole.

In: a dictionary. Out: the same dictionary after a restart, or None.

File: `{"format": "tpmsd-state", "payload": {...}, "sha256": "<hex>", "version": 1}`; the digest is over the
payload as canonical JSON (sorted keys, no spaces, ASCII). Numbers that are not finite keep the spellings of
Python's json module (NaN, Infinity).

Saving writes a temporary file beside it, syncs it, renames it over the old one and syncs the folder. After a
power cut between any two of these steps the file holds either the old payload or the new one. A file that
is damaged all the same (a failing card, an editor) is set aside and reported: never trusted, nor in the way.
One process writes a file: the daemon holds a lock beside it (`onboard/daemon/state_lock.py`).
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import stat
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import TpmsdError

FORMAT = "tpmsd-state"
VERSION = 1
MAX_BYTES = 1 << 20
"""Size of a state file, at most; a greater file is not ours and must not fill the memory."""
KEPT_DAMAGED = 3

_log = logging.getLogger(__name__)


class StateError(TpmsdError):
    """The state cannot be written or read (disk full, read-only, no permission); a later try may succeed."""


@dataclass(frozen=True, slots=True)
class StateDamaged:
    """A state file that could not be used."""

    file: Path
    reason: str
    set_aside: Path | None
    """Path of the file now; None if it could not be moved."""

    def __str__(self) -> str:
        moved = f"set aside as {self.set_aside.name}" if self.set_aside else "could not be set aside"
        return f"{self.file}: {self.reason}; {moved}, starting without it"


@dataclass(frozen=True, slots=True)
class FileSystem:
    """The calls that saving makes, in one place, so that a test can cut the power between them."""

    open: Callable[[str, int, int], int] = os.open
    write: Callable[[int, bytes], int] = os.write
    fsync: Callable[[int], None] = os.fsync
    close: Callable[[int], None] = os.close
    replace: Callable[[str, str], None] = os.replace
    unlink: Callable[[str], None] = os.unlink


def save_state(path: Path, payload: dict[str, Any], *, files: FileSystem | None = None) -> None:
    """Replace the state by `payload`; when this returns it is on the disk.

    Raises StateError if it cannot be written or is no JSON; what can be loaded is then still whole.
    """
    write_state(path, encode_state(path, payload), files=files)


def write_state(path: Path, content: bytes, *, files: FileSystem | None = None) -> None:
    """Replace the file by `content`, as `encode_state` made it. Raises StateError."""
    files = files or FileSystem()
    temporary = path.with_name(f".{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            _write_synced(files, str(temporary), content)
            files.replace(str(temporary), str(path))
        except OSError:
            with contextlib.suppress(OSError):
                files.unlink(str(temporary))
            raise
        folder = files.open(str(path.parent), os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC, 0)
        try:
            files.fsync(folder)
        finally:
            files.close(folder)
    except OSError as error:
        raise StateError(f"{path}: cannot save the state: {error.strerror or error}") from error


def load_state(
    path: Path, *, on_damaged: Callable[[StateDamaged], None] | None = None
) -> dict[str, Any] | None:
    """Return the payload last saved; None if there is none, or if it is damaged.

    A damaged file is set aside as `<name>.damaged-<n>` (the last few are kept) and given to `on_damaged`, or
    logged as a warning. Raises StateError only if the file cannot be read at all.
    """
    try:
        content = _read_bounded(path)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise StateError(f"{path}: cannot read the state: {error.strerror or error}") from error
    try:
        return _decode(content)
    except ValueError as error:
        damaged = StateDamaged(path, str(error), _set_aside(path))
    if on_damaged is not None:
        on_damaged(damaged)
    else:
        _log.warning("%s", damaged)
    return None


def _canonical(payload: dict[str, Any]) -> str:
    """Return the payload as JSON text that does not depend on the order of its keys."""
    return json.dumps(payload, sort_keys=True, separators=(",", ":"))


def _digest(payload: dict[str, Any]) -> str:
    return hashlib.sha256(_canonical(payload).encode("ascii")).hexdigest()


def encode_state(path: Path, payload: dict[str, Any]) -> bytes:
    """Return the content of the file; `path` is for the message. Raises StateError where the payload is no
    JSON."""
    try:
        # Once there and back, so that the digest is over what a reader will see (keys become strings).
        plain = json.loads(json.dumps(payload))
        record = {"format": FORMAT, "payload": plain, "sha256": _digest(plain), "version": VERSION}
        # No newline at the end: so every truncation shows.
        content = _canonical(record).encode("ascii")
    except (TypeError, ValueError, RecursionError) as error:
        raise StateError(f"{path}: cannot save the state: it is no JSON ({error})") from error
    if len(content) > MAX_BYTES:
        raise StateError(f"{path}: cannot save the state: {len(content)} bytes, at most {MAX_BYTES} allowed")
    return content


def _decode(content: bytes) -> dict[str, Any]:
    """Return the payload; ValueError says what is wrong."""
    if len(content) > MAX_BYTES:
        raise ValueError(f"more than {MAX_BYTES} bytes")
    if not content:
        raise ValueError("empty")
    try:
        record = json.loads(content.decode("ascii"))
    except (ValueError, RecursionError) as error:
        raise ValueError("not JSON") from error
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        raise ValueError("not a state file of tpmsd")
    version = record.get("version")
    if type(version) is not int or version != VERSION:
        raise ValueError(f"version {version!r:.40} instead of {VERSION}")
    payload = record.get("payload")
    if not isinstance(payload, dict):
        raise ValueError("no payload")
    if record.get("sha256") != _digest(payload):
        raise ValueError("wrong checksum")
    return payload


def _read_bounded(path: Path) -> bytes:
    """Return the content, at most one byte more than `MAX_BYTES`; OSError if it is no regular file."""
    # Not blocking: a FIFO of that name must not hang the daemon's start.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError("not a regular file")
        content = b""
        while len(content) <= MAX_BYTES and (chunk := os.read(descriptor, MAX_BYTES + 1 - len(content))):
            content += chunk
        return content
    finally:
        os.close(descriptor)


def _write_synced(files: FileSystem, name: str, content: bytes) -> None:
    """Write a new file and force it onto the disk."""
    # Whatever has that name (a FIFO, a link, what a power cut left) goes first: opening a FIFO would wait
    # for a reader for ever. O_EXCL then opens nothing but a new file, and follows no link.
    with contextlib.suppress(FileNotFoundError):
        files.unlink(name)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NONBLOCK | os.O_CLOEXEC
    descriptor = files.open(name, flags, 0o640)
    try:
        rest = memoryview(content)
        while rest:
            rest = rest[files.write(descriptor, bytes(rest)) :]
        files.fsync(descriptor)
    finally:
        files.close(descriptor)


def _set_aside(path: Path) -> Path | None:
    """Rename a damaged file and delete the oldest such ones; return its new path, None if that failed."""
    prefix = f"{path.name}.damaged-"
    try:
        numbers = sorted(
            int(suffix)
            for entry in path.parent.iterdir()
            if entry.name.startswith(prefix) and (suffix := entry.name.removeprefix(prefix)).isdecimal()
        )
        target = path.with_name(f"{prefix}{numbers[-1] + 1 if numbers else 1}")
        path.replace(target)
    except OSError:
        return None
    for number in numbers[: len(numbers) + 1 - KEPT_DAMAGED]:
        with contextlib.suppress(OSError):
            path.with_name(f"{prefix}{number}").unlink()
    return target
