"""Text files: small ones that users write, bounded before they are read, and logs of any size.

In: a path and how long the file may be. Out: its text, or a ConfigError of one line that names the file; of a
log the open file. The byte order mark that Windows tools write in front of UTF-8 is left out.
"""

from __future__ import annotations

import codecs
import errno
import gzip
import io
import os
import re
import select
import stat
import zlib
from pathlib import Path
from typing import BinaryIO, TextIO, cast

from tpmsd.foundation.errors import ConfigError

_TABLES = re.compile(rb"^\s*\[(vehicle|can|can\.signals|gnss)\]", re.MULTILINE)
_LOOK_BYTES = 1 << 16
PIPE_PATIENCE_S = 2.0
"""A shell's `<(...)` begins to write within this time."""


def names_configuration(path: Path) -> bool:
    """Return whether a file has a table of a car's configuration; False where it cannot be read."""
    try:
        with path.open("rb") as file:
            return _TABLES.search(file.read(_LOOK_BYTES).removeprefix(codecs.BOM_UTF8)) is not None
    except OSError:
        return False


def opened(path: Path) -> BinaryIO:
    """Return a file opened for reading; OSError where it cannot be opened, and for a pipe without a
    writer."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    file = os.fdopen(descriptor, "rb")
    if stat.S_ISFIFO(os.fstat(descriptor).st_mode) and not select.select([file], [], [], PIPE_PATIENCE_S)[0]:
        file.close()
        raise OSError(errno.ETIMEDOUT, "a pipe into which nobody writes")
    os.set_blocking(descriptor, True)
    return file


def read_text(path: Path, max_bytes: int, what: str) -> str:
    """Return the text of a file in UTF-8; ConfigError where it cannot be read, is longer, or is no text.

    `what` it should be stands in the reason, `a model` for one.
    """
    try:
        with opened(path) as file:
            content = file.read(max_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL byte in the path
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"{path}: cannot be read: {reason}") from None
    if len(content) > max_bytes:
        raise ConfigError(f"{path}: longer than {max_bytes} bytes: this is not {what}")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: is not UTF-8 text") from None


def open_log(path: Path) -> TextIO:
    """Return a log to read as text behind its byte order mark; OSError where it cannot be opened.

    A name that ends in `.gz` is unpacked. Latin-1 takes any byte, and universal newlines take all line ends,
    also mixed. Damage of compressed data is raised by the first read.
    """
    file = _open_unpacked(path)
    try:
        if file.peek(len(codecs.BOM_UTF8)).startswith(codecs.BOM_UTF8):
            file.read(len(codecs.BOM_UTF8))
    except (OSError, EOFError, zlib.error):
        file.close()
        file = _open_unpacked(path)  # what failed once would read as empty
    return io.TextIOWrapper(file, encoding="latin-1")


def _open_unpacked(path: Path) -> io.BufferedReader:
    packed = path.name.lower().endswith(".gz")
    return cast(io.BufferedReader, gzip.GzipFile(path, "rb")) if packed else path.open("rb")
