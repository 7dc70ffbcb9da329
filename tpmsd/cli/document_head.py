"""The head of a JSON document: its schema, the program, what went in.

In: names and paths. Out: a dictionary with `schema`, `program`, `input`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tpmsd import __version__

_CHUNK = 1 << 20


def document_head(schema: str, paths: Sequence[Path], configuration: Path | None = None) -> dict[str, Any]:
    """`schema` is a name and version, `paths` the recordings, `configuration` the file that speaks of
    them."""
    return {
        "schema": schema,
        "program": {"name": "tpmsd", "version": __version__},
        "input": {
            "paths": [str(path) for path in paths],
            "sha256": [sha256(path) for path in paths],
            "configuration": None if configuration is None else str(configuration),
            "configuration_sha256": None if configuration is None else sha256(configuration),
        },
    }


def sha256(path: Path) -> str | None:
    """Digest of a file; None if it cannot be read."""
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while chunk := file.read(_CHUNK):
                digest.update(chunk)
    except OSError:
        return None
    return digest.hexdigest()
