"""A drive in memory as a drive folder.

In: frames and sentences in the order of their stamps, the DBC, the configuration's text. Out: `vehicle.toml`,
`bus.dbc`, `can.log` and `gnss.nmea`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tpmsd.foundation.errors import TpmsdError
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import Sentence


def write_folder(folder: Path, items: Sequence[CanFrame | Sentence], dbc: str, vehicle_toml: str) -> Path:
    """Write the folder, creating it where needed; TpmsdError if the disk cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "vehicle.toml").write_text(vehicle_toml, encoding="utf-8")
        (folder / "bus.dbc").write_text(dbc, encoding="utf-8")
        with (
            (folder / "can.log").open("w", encoding="ascii", newline="\n") as frames,
            (folder / "gnss.nmea").open("wb") as sentences,
        ):
            for item in items:
                if isinstance(item, CanFrame):
                    data = item.data.hex().upper()
                    frames.write(f"({item.time_s:.6f}) {item.channel} {item.arbitration_id:03X}#{data}\n")
                else:
                    sentences.write(b"(%.6f) %s\n" % (item.time_s, item.line))
    except OSError as error:
        raise TpmsdError(f"{error.filename or folder}: cannot be written: {error.strerror}") from None
    if not any(isinstance(item, Sentence) for item in items):
        (folder / "gnss.nmea").unlink()  # a drive without a receiver has no such file
    return folder
