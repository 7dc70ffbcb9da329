"""Secrets from files, as systemd's credentials and container runtimes hand them over.

In: a path, or the name of a credential. Out: the secret. Never from the command line, where every user of the
machine can read it, nor from the environment, which children and crash reports inherit.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.text_file import read_text

MAX_BYTES = 4096


def read_secret(file: Path | None, credential: str, environment: Mapping[str, str]) -> str | None:
    """Return the secret in `file`, else in the systemd credential of that name; None where there is neither.

    One line end at its end is taken off. Raises ConfigError.
    """
    if file is None:
        folder = environment.get("CREDENTIALS_DIRECTORY")
        file = Path(folder or "", credential)
        if not folder or not file.is_file():
            return None
    text = read_text(file, MAX_BYTES, "a secret").removesuffix("\n").removesuffix("\r")
    if not text or "\n" in text or "\0" in text:
        raise ConfigError(f"{file}: {'empty' if not text else 'more than one line'}")
    return text
