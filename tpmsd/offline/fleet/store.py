"""The store of a fleet: a folder of files, each written whole or not at all.

In: the store's path. Out: its drives and results. There is no log and no lock: what is done is what is there.

    fleet.json                 that this is a store, and its format
    drives/KEY.json            a drive that was added: where it is, of which car and model
    results/KEY.json           what was made of it
    tries/KEY.RUN.N            start N of a drive in a run; gone once it ended
    tables/NAME.parquet        the tables, made of the results
"""

from __future__ import annotations

import json
import os
import re
import stat
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.offline.fleet.result_check import check_result
from tpmsd.offline.fleet.settings import SETTINGS

FORMAT = "tpmsd.fleet/1"
_UMASK = os.umask(0)
os.umask(_UMASK)
_KEY = re.compile(r"[0-9a-f]{8,64}")
_PARTS = ("drives", "results", "tries", "tables")


@dataclass(frozen=True, slots=True)
class DriveEntry:
    """A drive of the fleet."""

    key: str
    """Hash of its content: the same drive under another path is the same drive."""
    path: str
    """Folder or URL."""
    car: str
    model: str


class Store:
    """A fleet's folder."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damaged: dict[Path, str] = {}
        """Files that were left out, with the reason."""
        self.drives, self.results, self.tries, self.tables = (path / part for part in _PARTS)

    @classmethod
    def create(cls, path: Path) -> Store:
        """Return the store at a path, created if there is none; ConfigError where something else is there."""
        mark = path / "fleet.json"
        if path.exists() and not path.is_dir():
            raise ConfigError(f"{path}: not a folder")
        if not mark.exists():
            if path.is_dir() and any(path.iterdir()):
                raise ConfigError(f"{path}: a folder with other things in it, and no store of tpmsd fleet")
            try:
                for part in _PARTS:
                    (path / part).mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise TpmsdError(f"{path}: cannot be made: {error.strerror}") from None
            write_atomic(mark, json.dumps({"format": FORMAT}) + "\n")
        return cls.open(path)

    @classmethod
    def open(cls, path: Path) -> Store:
        """Return the store at a path; ConfigError if there is none, or one of another format."""
        try:
            found = json.loads((path / "fleet.json").read_text(encoding="utf-8")).get("format")
        except FileNotFoundError:
            raise ConfigError(f"{path}: no store of tpmsd fleet (tpmsd fleet add makes one)") from None
        except (OSError, ValueError, AttributeError) as error:
            raise ConfigError(f"{path}: not a store of tpmsd fleet: {error}") from None
        if found != FORMAT:
            raise ConfigError(f"{path}: a store of format {found!r}, this program has {FORMAT!r}")
        return cls(path)

    def entries(self) -> list[DriveEntry]:
        """Return all drives, by key; those whose files are damaged are left out, and noted in `damaged`."""
        found = []
        for path in sorted(self.drives.glob("*.json")):
            try:
                found.append(self.entry(path.stem))
            except TpmsdError as error:
                self.damaged[path] = str(error)
        return found

    def entry(self, key: str) -> DriveEntry:
        """Return one drive; TpmsdError where its file is damaged."""
        file = self.drives / f"{key}.json"
        try:
            entry = DriveEntry(**_read_json(file))
            if not _KEY.fullmatch(key) or entry.key != key:
                raise ValueError("its key is not the file's name in hexadecimal")
            if not all(isinstance(value, str) for value in (entry.path, entry.car, entry.model)):
                raise ValueError("a field is no text")
        except (OSError, ValueError, TypeError, RecursionError) as error:
            raise TpmsdError(f"{file}: damaged: {' '.join(str(error).split())[:200]}") from None
        return entry

    def add(self, entry: DriveEntry) -> bool:
        """Add a drive; False if its content is there already."""
        file = self.drives / f"{entry.key}.json"
        if file.exists():
            return False
        write_atomic(file, json.dumps(asdict(entry), ensure_ascii=False) + "\n")
        return True

    def result(self, key: str) -> dict[str, Any] | None:
        """Return the result of a drive; None if there is none yet. A damaged file counts as nothing,
        and is noted in `damaged`."""
        file = self.results / f"{key}.json"
        try:
            return check_result(_read_json(file))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            self.damaged[file] = f"{file}: damaged: {' '.join(str(error).split())[:200]}"
            return None

    def write_result(self, key: str, result: dict[str, Any]) -> None:
        """Write the result of a drive."""
        text = json.dumps(result, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        write_atomic(self.results / f"{key}.json", text + "\n")

    def begin_try(self, key: str, run: str) -> int:
        """Record that a drive is started; return the number of its starts in this run, this one included."""
        number = 1
        while True:
            try:
                (self.tries / f"{key}.{run}.{number}").open("x").close()
                return number
            except FileExistsError:
                number += 1

    def tries_of(self, key: str) -> int:
        """Return the number of starts of a drive over all runs that never ended."""
        return sum(1 for _ in self.tries.glob(f"{key}.*"))

    def end_try(self, key: str) -> None:
        """Remove the records of a drive's starts: it ended, with a result or an error."""
        for mark in self.tries.glob(f"{key}.*"):
            mark.unlink(missing_ok=True)

    def bytes_per_result(self) -> Iterator[int]:
        """Yield the sizes of the result files, bytes."""
        return (file.stat().st_size for file in sorted(self.results.glob("*.json")))


def _read_json(file: Path) -> Any:
    """Return a file's JSON; ValueError where it is none, has NaN or infinite numbers, or is too large."""
    state = file.stat()
    if not stat.S_ISREG(state.st_mode):
        raise ValueError("not a file")
    if state.st_size > SETTINGS.result_bytes:
        raise ValueError(f"more than {SETTINGS.result_bytes >> 20} MB")
    with file.open("rb") as source:
        content = source.read(state.st_size)
    found = _DECODER.decode(content.decode("utf-8"))
    if b"\\u" in content:  # only an escape makes a lone surrogate, which is a ValueError
        json.dumps(found, ensure_ascii=False).encode("utf-8")
    return found


def _reject_constant(name: str) -> None:
    """Raise ValueError for the constants NaN and Infinity, which JSON does not have."""
    raise ValueError(f"{name} is no number")


_DECODER = json.JSONDecoder(parse_constant=_reject_constant)
"""Made once: a store has hundreds of thousands of small files."""


def write_atomic(file: Path, content: str | bytes) -> None:
    """Write to a temporary file and rename it, so that a reader sees the old content or the new one, whoever
    is killed.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    handle, temporary = tempfile.mkstemp(prefix=f".{file.name}.", dir=file.parent)
    try:
        with os.fdopen(handle, "wb") as out:
            # As other new files: the workers of a cluster may be other users.
            os.fchmod(handle, 0o666 & ~_UMASK)
            out.write(data)
            out.flush()
            os.fsync(out.fileno())
        Path(temporary).replace(file)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
