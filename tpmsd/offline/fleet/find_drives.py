"""Finds drives: folders, globs and URLs to drives with the hash of their content, their car and its model.

In: what the user named. Out: `DriveEntry`s. Behind URLs (`s3://...`, with the package that fsspec asks for) a
drive is read once to be hashed, and once more by the worker that works on it.
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import json
import os
import re
import tempfile
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from tpmsd.foundation.errors import InputError
from tpmsd.foundation.provenance import content_hash
from tpmsd.offline.fleet.store import DriveEntry
from tpmsd.offline.tables.extras import import_extra

VEHICLE = "vehicle.toml"
_GEOMETRY = ("wheel_radius_m", "track_front_m", "track_rear_m", "wheelbase_m")
_MODEL_KEYS = (*_GEOMETRY, "driven_axle", "teeth_per_rev")


def find_drives(
    names: Iterable[str], car: str | None = None, model: str | None = None
) -> Iterator[DriveEntry]:
    """Yield the drives in a folder with a vehicle.toml, in all such folders below a folder, or behind a glob
    or URL.

    The car is `car`, or the name of the folder that holds the drive's; the model is `model`, or what the
    table [vehicle] says. InputError where a name leads to no drive.
    """
    for name in names:
        found = False
        for path in _drive_folders(name):
            found = True
            with local_copy(path) as folder:
                key = content_hash([folder]).removeprefix("sha256:")[:40]
                kind = model or car_model_name(folder / VEHICLE)
            yield DriveEntry(key, path, car or _parent_name(path), kind)
        if not found:
            raise InputError(name, "no drive folder (with a vehicle.toml) there or below")


def _drive_folders(name: str) -> Iterator[str]:
    """Yield each drive folder at or below a path, glob or URL, once."""
    if "://" in name:
        yield from _remote_drive_folders(name)
        return
    matches = [name]
    if glob.has_magic(name) and not Path(name).exists():
        matches = _glob_paths(name)
    met: set[str] = set()
    for match in matches:
        for here, below, files in os.walk(match):
            below.sort()
            if VEHICLE in files:
                below.clear()  # a drive holds no drives
                folder = os.path.abspath(here)  # noqa: PTH100 - a link keeps its name: the folder names the car
                if folder not in met:
                    met.add(folder)
                    yield folder


def _glob_paths(pattern: str) -> list[str]:
    """Return the paths that match a pattern, sorted.

    A part `**` follows no link (pathlib's way, unlike glob's): links that lead upwards would be followed in
    every order, without end. Within a longer part it is one asterisk, as it is for glob.
    """
    whole = Path(pattern)
    if "**" not in whole.parts:
        return sorted(glob.glob(pattern))  # noqa: PTH207 - absolute patterns, too
    parts = whole.relative_to(whole.anchor).parts
    single = [part if part == "**" else re.sub(r"\*+", "*", part) for part in parts]
    return sorted(map(str, Path(whole.anchor).glob("/".join(single))))


def _remote_drive_folders(url: str) -> Iterator[str]:
    fsspec = import_extra("fsspec", "fleet", "URLs")
    try:
        system, root = fsspec.core.url_to_fs(url)
        tops = system.glob(root) if glob.has_magic(root) else [root]
        for top in tops:
            for file in sorted(system.find(top)):
                if PurePosixPath(file).name == VEHICLE:
                    yield str(system.unstrip_protocol(str(PurePosixPath(file).parent)))
    except (OSError, ValueError, ImportError) as error:
        raise InputError(url, " ".join(str(error).split())[:200]) from None


@contextlib.contextmanager
def local_copy(path: str) -> Iterator[Path]:
    """Yield a drive as a folder of this machine; fetched for the time of use where it is behind a URL."""
    if "://" not in path:
        yield Path(path)
        return
    fsspec = import_extra("fsspec", "fleet", "URLs")
    with tempfile.TemporaryDirectory(prefix="tpmsd-drive-") as folder:
        try:
            system, root = fsspec.core.url_to_fs(path)
            for file in sorted(system.find(root, maxdepth=1)):
                system.get_file(file, str(Path(folder) / PurePosixPath(file).name))
        except (OSError, ValueError, ImportError) as error:
            raise InputError(path, " ".join(str(error).split())[:200]) from None
        yield Path(folder)


def car_model_name(vehicle_file: Path) -> str:
    """Return a name for all cars whose configured geometry is the same, such as `2.63m-front-1f3a`."""
    try:
        table: Any = tomllib.loads(vehicle_file.read_text(encoding="utf-8-sig")).get("vehicle", {})
        geometry = {key: table.get(key) for key in _MODEL_KEYS}
    except (OSError, ValueError, AttributeError, RecursionError):
        return "unknown"  # the worker says what is wrong with the file
    mark = hashlib.sha256(json.dumps(geometry, sort_keys=True, default=str).encode()).hexdigest()[:4]
    return f"{geometry['wheelbase_m']}m-{geometry['driven_axle'] or 'front'}-{mark}"


def _parent_name(path: str) -> str:
    """Return the name of the folder that holds a drive, which names the car; `unnamed` without one."""
    parent = PurePosixPath(path.partition("://")[2] or path).parent.name
    return parent or "unnamed"
