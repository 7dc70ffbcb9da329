"""A TOML file as data together with the line of each key.

In: the path of a file or of a drive folder. Out: `Document`, or `ConfigProblems` with the reason.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tpmsd.car.config.locate import KeyPath, PathStep, line_of, locate
from tpmsd.car.config.problems import ConfigProblems, Problem
from tpmsd.foundation.text_file import opened
from tpmsd.foundation.toml_text import parse_toml

VEHICLE_FILE = "vehicle.toml"
_LARGEST_BYTES = 1 << 20  # nobody writes a megabyte of settings: it is a log, or a device


@dataclass(frozen=True, slots=True)
class Document:
    """Data of a TOML file and the line of each key."""

    file: Path
    data: dict[str, Any]
    lines: dict[KeyPath, int]

    def line(self, *path: PathStep) -> int | None:
        """Return the line of a key, or of the innermost table around it."""
        return line_of(self.lines, path)


def read_document(path: Path) -> Document:
    """Return the file `path`, or the `vehicle.toml` of the folder `path`; ConfigProblems if it is no TOML."""
    file = Path(path)
    text = _decode(file, _read_bounded(file)) if not file.is_dir() else None
    if text is None:
        file = file / VEHICLE_FILE
        text = _decode(file, _read_bounded(file))
    try:
        data = parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        raise _syntax_error(file, text, error) from None
    except ValueError as error:
        raise _unreadable_error(file, str(error)) from None
    return Document(file, data, locate(text))


def _read_bounded(file: Path) -> bytes:
    try:
        with opened(file) as stream:
            content = stream.read(_LARGEST_BYTES + 1)
    except FileNotFoundError:
        if file.name == VEHICLE_FILE and file.parent.is_dir() and not file.is_symlink():
            raise _unreadable_error(file, f"no such file (a drive folder holds its {VEHICLE_FILE})") from None
        raise _unreadable_error(file, "no such file") from None
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise _unreadable_error(file, f"cannot be read: {reason}") from None
    if len(content) > _LARGEST_BYTES:
        raise _unreadable_error(file, f"longer than {_LARGEST_BYTES} bytes: this is no configuration")
    return content


def _decode(file: Path, content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        what = f"not UTF-8 text (byte 0x{content[error.start]:02X})"
        raise ConfigProblems([Problem(str(file), line, "", what)]) from None


def _syntax_error(file: Path, text: str, error: tomllib.TOMLDecodeError) -> ConfigProblems:
    reason, location, where = str(error).rpartition(" (at ")
    if not location:
        reason, where = str(error), ""
    if match := re.search(r"line (\d+), column (\d+)", where):
        return ConfigProblems(
            [Problem(str(file), int(match[1]), "", f"not valid TOML: {reason} (column {match[2]})")]
        )
    last = text.count("\n") + (not text.endswith("\n"))
    return ConfigProblems([Problem(str(file), last, "", f"not valid TOML: {reason} (end of file)")])


def _unreadable_error(file: Path, what: str) -> ConfigProblems:
    return ConfigProblems([Problem(str(file), None, "", what)])
