"""Check of the path of a status socket, for the daemon and for those who ask it.

In: a path. Out: a `ConfigError` if no socket can have it.
"""

from __future__ import annotations

import os
from pathlib import Path

from tpmsd.foundation.errors import ConfigError

MAX_PATH_BYTES = 107
"""Length of the path that `sockaddr_un` holds (unix(7)), less the final NUL."""


def check_socket_path(path: Path) -> None:
    """Raise ConfigError if the path is longer than the address of a Unix socket can be."""
    length = len(os.fsencode(path))
    if length > MAX_PATH_BYTES:
        raise ConfigError(
            f"the path of the status socket has {length} bytes, at most {MAX_PATH_BYTES} are possible: {path}"
        )
