"""Small text files that users write, bounded before they are read.

In: a path and how long the file may be. Out: its text, or a ConfigError of one line that names the file.
"""

from __future__ import annotations

import re
from pathlib import Path

from tpmsd.errors import ConfigError

_TABLES = re.compile(rb"^\s*\[(vehicle|can|can\.signals|gnss)\]", re.MULTILINE)
_LOOK_BYTES = 1 << 16


def names_configuration(path: Path) -> bool:
    """Whether a file is a car's configuration by one of its tables; False where it cannot be read."""
    try:
        with path.open("rb") as file:
            return _TABLES.search(file.read(_LOOK_BYTES)) is not None
    except OSError:
        return False


def is_pipe(path: Path) -> bool:
    """Whether it is a named pipe: reading it would wait for ever. A shell's `<(...)` has no name."""
    try:
        return path.resolve().is_fifo()
    except (OSError, ValueError, RuntimeError):  # what is wrong with it, opening says
        return False


def read_text(path: Path, most_bytes: int, what: str) -> str:
    """The text of a file in UTF-8; ConfigError where it cannot be read, is longer, or is no text.

    `what` it should be stands in the reason, `a model` for one.
    """
    if is_pipe(path):
        raise ConfigError(f"{path}: a pipe, not a file")
    try:
        with path.open("rb") as file:
            content = file.read(most_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL byte in the path
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"{path}: cannot be read: {reason}") from None
    if len(content) > most_bytes:
        raise ConfigError(f"{path}: longer than {most_bytes} bytes: this is not {what}")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text") from None
