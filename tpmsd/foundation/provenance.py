"""Origin of a document: the keys `schema`, `program` and `input` that every JSON document has.

In: the schema's name, the drives or files that were read, the configuration. Out: a dict of plain values.
The files are read once more to be hashed: this belongs to the shells (command line, API, daemon), not to the
core.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from tpmsd.foundation.kernels import kernel
from tpmsd.foundation.version import __version__

VEHICLE_FILE = "vehicle.toml"
_BLOCK = 1 << 20


def provenance(
    schema: str, paths: Sequence[str | Path] = (), configuration: str | Path | None = None
) -> dict[str, Any]:
    """Return the keys `schema`, `program` and `input`, with which every JSON document begins.

    Args:
        schema: name and version, such as `tpmsd.replay/2`.
        paths: drive folders or files that the document is about.
        configuration: the TOML file, or the drive folder whose `vehicle.toml` was read; None: none was.
    """
    sources = [Path(path) for path in paths]
    file = None if configuration is None else Path(configuration)
    if file is not None and file.is_dir():
        file = file / VEHICLE_FILE
    return {
        "schema": schema,
        "program": {"name": "tpmsd", "version": __version__, "commit": commit(), "kernel": kernel()},
        "input": {
            "paths": [str(path) for path in sources],
            "configuration": None if file is None else str(file),
            "configuration_hash": None if file is None else content_hash([file]),
            "hash": content_hash([*sources, *([] if file is None else [file])]),
        },
    }


def content_hash(paths: Iterable[Path]) -> str:
    """Return `sha256:<hex>` over files, and over folders as their files' names and contents, wherever they
    are.

    The same content gives the same hash under another path. What cannot be read counts as absent.
    """
    total = hashlib.sha256()
    for path in paths:
        files = sorted(entry for entry in path.iterdir() if entry.is_file()) if path.is_dir() else [path]
        for file in files:
            digest = _file_digest(file)
            name = file.name if path.is_dir() else ""
            total.update(f"{name}\0{digest}\n".encode("utf-8", "surrogateescape"))
        total.update(b"\n")
    return f"sha256:{total.hexdigest()}"


@cache
def commit() -> str | None:
    """Return the commit of the checkout that runs; None where the program is installed."""
    try:
        git = Path(__file__).resolve().parents[2] / ".git"
        if git.is_file():  # a linked worktree names its folder there
            git = Path(git.read_text(encoding="utf-8").removeprefix("gitdir:").strip())
        head = (git / "HEAD").read_text(encoding="utf-8").strip()
        if not head.startswith("ref: "):
            return head or None
        name = head.removeprefix("ref: ")
        common = (
            git / (git / "commondir").read_text(encoding="utf-8").strip() if _is_linked_worktree(git) else git
        )
        if (common / name).is_file():
            return (common / name).read_text(encoding="utf-8").strip()
        packed = (common / "packed-refs").read_text(encoding="utf-8")
        return next((line.split()[0] for line in packed.splitlines() if line.endswith(f" {name}")), None)
    except (OSError, UnicodeDecodeError):
        return None


def _is_linked_worktree(git: Path) -> bool:
    return (git / "commondir").is_file()


def _file_digest(file: Path) -> str:
    digest = hashlib.sha256()
    try:
        with file.open("rb") as stream:
            while block := stream.read(_BLOCK):
                digest.update(block)
    except OSError:
        return "absent"
    return digest.hexdigest()
