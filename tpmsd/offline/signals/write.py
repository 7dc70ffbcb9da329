"""A table of signals as `signals.csv` in a drive folder, with the `vehicle.toml` that it belongs to.

In: columns, a folder. Out: the folder; TpmsdError with one line where it cannot be written.
"""

from __future__ import annotations

import io
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tpmsd.foundation.errors import ConfigError, TpmsdError
from tpmsd.foundation.wheels import FloatArray


def check_signals_folder(folder: Path, force: bool) -> None:
    """Raise ConfigError if a folder is not empty and must not be replaced."""
    if folder.exists() and not folder.is_dir():
        raise ConfigError(f"{folder}: not a folder")
    if folder.is_dir() and any(folder.iterdir()) and not (force and (folder / "signals.csv").is_file()):
        raise ConfigError(f"{folder}: not empty (--force replaces a folder of signals)")


def signals_text(columns: Mapping[str, FloatArray]) -> str:
    """Return the table as CSV, missing values as empty cells, six significant figures, times to 0.1 ms."""
    names = list(columns)
    formats = [_number_format(name) for name in names]
    out = io.StringIO()
    np.savetxt(
        out,
        np.stack([columns[name] for name in names], axis=1),
        formats,
        ",",
        header=",".join(names),
        comments="",
    )
    return out.getvalue().replace("nan", "")


def _number_format(name: str) -> str:
    """Return the format of a column's numbers: times to 0.1 ms, angles on the globe to 0.1 mm."""
    if name == "time_s" or name.endswith("_utc_s"):
        return "%.4f"
    return "%.9f" if name.endswith("_deg") else "%.7g"


def write_signals_folder(folder: Path, columns: Mapping[str, FloatArray], vehicle: Path) -> None:
    """Write the table, and the car's file beside it."""
    text = signals_text(columns)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "signals.csv").write_text(text, encoding="utf-8")
        if vehicle.resolve() != (folder / "vehicle.toml").resolve():
            shutil.copyfile(vehicle, folder / "vehicle.toml")
    except OSError as error:
        raise TpmsdError(f"{folder}: cannot be written: {error.strerror}") from None


def write_signals_text(folder: Path, columns: Mapping[str, FloatArray], vehicle_toml: str) -> None:
    """Write the table with the text of the car's file beside it."""
    text = signals_text(columns)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "signals.csv").write_text(text, encoding="utf-8")
        (folder / "vehicle.toml").write_text(vehicle_toml, encoding="utf-8")
    except OSError as error:
        raise TpmsdError(f"{folder}: cannot be written: {error.strerror}") from None
