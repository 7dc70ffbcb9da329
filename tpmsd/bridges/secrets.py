"""Secrets from files, as systemd's credentials and container runtimes hand them over.

In: a path, or the name of a credential. Out: the secret. Never from the command line, where every user of the
machine can read it, nor from the environment, which children and crash reports inherit.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tpmsd.errors import ConfigError

MAX_BYTES = 4096


def secret(file: Path | None, credential: str, environment: Mapping[str, str]) -> str | None:
    """The secret in `file`, else in the systemd credential of that name; None where there is neither.

    One line end at its end is taken off. Raises ConfigError.
    """
    if file is None:
        folder = environment.get("CREDENTIALS_DIRECTORY")
        file = Path(folder or "", credential)
        if not folder or not file.is_file():
            return None
    try:
        with file.open("rb") as source:
            data = source.read(MAX_BYTES + 1)
        text = data.decode("utf-8")
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{file}: a secret must be UTF-8 text") from None
    if len(data) > MAX_BYTES:
        raise ConfigError(f"{file}: longer than {MAX_BYTES} bytes")
    text = text.removesuffix("\n").removesuffix("\r")
    if not text or "\n" in text or "\0" in text:
        raise ConfigError(f"{file}: {'empty' if not text else 'more than one line'}")
    return text
