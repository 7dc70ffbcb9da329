"""Small text files that users write, bounded before they are read.

In: a path and how long the file may be. Out: its text, or a ConfigError of one line that names the file.
"""

from __future__ import annotations

import errno
import os
import re
import select
import stat
from pathlib import Path
from typing import BinaryIO

from tpmsd.foundation.errors import ConfigError

_TABLES = re.compile(rb"^\s*\[(vehicle|can|can\.signals|gnss)\]", re.MULTILINE)
_LOOK_BYTES = 1 << 16
PIPE_PATIENCE_S = 2.0
"""A shell's `<(...)` begins to write within this time."""


def names_configuration(path: Path) -> bool:
    """Return whether a file is a car's configuration by one of its tables; False where it cannot be read."""
    try:
        with path.open("rb") as file:
            return _TABLES.search(file.read(_LOOK_BYTES)) is not None
    except OSError:
        return False


def opened(path: Path) -> BinaryIO:
    """Return a file to read; OSError where it cannot be opened, and for a pipe into which nobody writes."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    file = os.fdopen(descriptor, "rb")
    if stat.S_ISFIFO(os.fstat(descriptor).st_mode) and not select.select([file], [], [], PIPE_PATIENCE_S)[0]:
        file.close()
        raise OSError(errno.ETIMEDOUT, "a pipe into which nobody writes")
    os.set_blocking(descriptor, True)
    return file


def read_text(path: Path, most_bytes: int, what: str) -> str:
    """Return the text of a file in UTF-8; ConfigError where it cannot be read, is longer, or is no text.

    `what` it should be stands in the reason, `a model` for one.
    """
    try:
        with opened(path) as file:
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
