"""Small text files that users write, bounded before they are read.

In: a path and how long the file may be. Out: its text, or a ConfigError of one line that names the file.
"""

from __future__ import annotations

from pathlib import Path

from tpmsd.errors import ConfigError


def read_text(path: Path, most_bytes: int, what: str) -> str:
    """The text of a file in UTF-8; ConfigError where it cannot be read, is longer, or is no text.

    `what` it should be stands in the reason, `a model` for one.
    """
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
