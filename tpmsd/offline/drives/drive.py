"""A drive, from a folder or from arrays.

In: a path, or wheels, fixes and inertial signals as dicts of arrays or data frames. Out: `Drive`, which the
other functions take; the recording itself is read by them, each time again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.drives.reading import DriveReader, FolderRecording, MemoryRecording
from tpmsd.offline.report.card import card, one_line
from tpmsd.onboard.sources.can.frame import CanFrame

if TYPE_CHECKING:
    from tpmsd.offline.tables.car_file import Table
    from tpmsd.offline.tables.encode import Encoded
    from tpmsd.offline.tables.from_columns import InMemoryTable
    from tpmsd.offline.tables.signals import SignalReadings

KINDS = ("wheel_count", "wheel_speed")
ANTENNA = ("antenna_forward_m", "antenna_left_m", "latency_s")


@dataclass(frozen=True)
class Drive:
    """A recorded or simulated drive with the configuration of its car."""

    name: str
    config: Config = field(repr=False)
    recording: DriveReader
    vehicle_toml: str | None = None
    """The configuration as text, where the drive has no folder."""

    def __repr__(self) -> str:
        """Return name, place or size, and wheels."""
        signals = self.config.can.signals
        wheels = [
            wheel for wheel in WHEELS if any(role == f"{kind}_{wheel}" for role in signals for kind in KINDS)
        ]
        return one_line("Drive", repr(self.name), self._size_text(), f"wheels {' '.join(wheels)}")

    def _repr_html_(self) -> str:
        """Return path or size, car and signals as a card for a notebook."""
        vehicle = self.config.vehicle
        radii = [1e3 * radius for radius in vehicle.wheel_radius_m]
        rows = [("recording", self._size_text())]
        rows += [("wheel radii", " ".join(f"{w} {r:g} mm" for w, r in zip(WHEELS, radii, strict=True)))]
        signals = list(self.config.can.signals.items())
        return card(f"Drive {self.name}", (("", ""), rows), (("role", "signal"), signals))

    def _size_text(self) -> str:
        if not isinstance(self.recording, MemoryRecording):
            return f"in {self.folder}"
        items = self.recording.items
        frames = sum(isinstance(item, CanFrame) for item in items)
        span_s = items[-1].time_s - items[0].time_s if items else 0.0
        return f"{span_s:.0f} s in memory, {frames:,} frames, {len(items) - frames:,} sentences"

    @property
    def folder(self) -> Path | None:
        """Folder that holds it; None for a drive in memory."""
        return self.recording.folder if isinstance(self.recording, FolderRecording) else None

    @classmethod
    def from_tables(
        cls,
        wheels: InMemoryTable,
        gnss: InMemoryTable | None = None,
        inertial: InMemoryTable | None = None,
        *,
        vehicle: Mapping[str, Any] | str | Path | Config,
        antenna_forward_m: float | None = None,
        antenna_left_m: float | None = None,
        modulus: int | None = None,
        settings: Mapping[str, Table] | None = None,
        name: str = "tables",
    ) -> Drive:
        """Return a drive from dicts of arrays or data frames, without a file.

        Each table has a column `time_s`; all three share one clock, but not their rows. The name of any other
        column is a role with its unit, as in the tick table:

        - `wheels`: `wheel_angle_fl_rad`, or `wheel_speed_fl_radps` (`_mps`, `_kmh`, `_rpm`), or
          `wheel_count_fl`; of all four wheels, or of the rear pair. `modulus`: where counts begin again.
        - `gnss`: `latitude_deg` and `longitude_deg` (or a simulator's `east_m` and `north_m`), `altitude_m`,
          `speed_mps`, `course_rad` (clockwise from north; or `heading_rad`, counter-clockwise from east),
          `position_std_m` or `hdop`, `quality`, and `arrival_s` and `utc_s` where they differ from `time_s`.
        - `inertial`: `yaw_rate_radps`, `accel_long_mps2`, `accel_lat_mps2`, `steering_wheel_angle_rad`, ...

        `vehicle` is the table [vehicle] of a vehicle.toml as a dict, or a file or folder with a vehicle.toml,
        or a `Config`, of which antenna, [filter], [monitor] and [tyre] hold, too. `settings` are further
        tables of it, such as `{"filter": {"seed": 2}}`. Unknown readings are NaN; a wheel or a signal
        without any reading is left out.

        ConfigError with one line where columns or values make no sense.

        >>> import numpy as np
        >>> t = np.arange(0.0, 30.0, 0.02)
        >>> wheels = {"time_s": t, "wheel_angle_rl_rad": 60.0 * t, "wheel_angle_rr_rad": 60.1 * t}
        >>> car = {"wheel_radius_m": 0.316, "track_rear_m": 1.52}
        >>> Drive.from_tables(wheels, vehicle=car).config.can.signals
        {'wheel_count_rl': 'WHEEL_RL.COUNT', 'wheel_count_rr': 'WHEEL_RR.COUNT'}
        """
        # Imported where it is used: a drive in a folder does without.
        from tpmsd.offline.tables.encode import encode
        from tpmsd.offline.tables.from_columns import series_of
        from tpmsd.offline.tables.gather import signals_from, split_empty

        tables, radii = _car_settings_and_radii(vehicle)
        antenna = {"antenna_forward_m": antenna_forward_m, "antenna_left_m": antenna_left_m}
        placed = {key: value for key, value in antenna.items() if value is not None}
        tables = {**tables, "gnss": {**tables.get("gnss", {}), **placed}, **(settings or {})}
        series = series_of(wheels, "wheels", radii)
        if inertial is not None:
            series = _merge_series(series, series_of(inertial, "inertial", radii))
        if gnss is not None:
            series = _merge_series(series, series_of(gnss, "gnss", radii, "gnss_"))
        moduli = {} if modulus is None else {f"wheel_count_{wheel}": modulus for wheel in WHEELS}
        read, _ = split_empty(series)
        return drive_from_encoded(encode(signals_from(read, moduli)), tables, name)

    def save(self, folder: str | Path) -> Path:
        """Write a drive that was made from tables as a drive folder, and return its path.

        ConfigError for a drive that has a folder already; TpmsdError if the disk does not take it.
        """
        from tpmsd.offline.tables.drive_folder import write_folder

        if not isinstance(self.recording, MemoryRecording) or self.vehicle_toml is None:
            raise ConfigError(f"{self.name}: is stored at {self.folder}")
        return write_folder(Path(folder), self.recording.items, self.recording.dbc, self.vehicle_toml)


def load(path: str | Path, config: str | Path | None = None) -> Drive:
    """Return the drive in a folder, with the configuration of its `vehicle.toml` or of another file.

    InputError if there is no such folder; ConfigError if the configuration cannot be used.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise InputError(folder, "not a folder" if folder.exists() else "no such drive folder")
    loaded = load_config(folder if config is None else Path(config))
    return Drive(folder.resolve().name, loaded, FolderRecording(folder))


def drive_from_encoded(encoded: Encoded, tables: Mapping[str, Table], name: str) -> Drive:
    """Return the drive of encoded signals, with these tables as its configuration."""
    from tpmsd.offline.tables.car_file import car_tables, config_of, toml_text

    text = toml_text(car_tables(encoded, tables))
    config = config_of(text)
    return Drive(name, config, MemoryRecording(name, encoded.items, encoded.dbc), text)


def as_drive(drive: Drive | str | Path) -> Drive:
    """Return a drive, loaded if it is given as the path of its folder."""
    return drive if isinstance(drive, Drive) else load(drive)


def _merge_series(
    one: dict[str, SignalReadings], other: dict[str, SignalReadings]
) -> dict[str, SignalReadings]:
    """Return the series of both; of a role in both (one data frame given for several tables) the first."""
    return {**other, **one}


def car_settings(config: Config) -> dict[str, Table]:
    """Return the tables of a configuration that describe car, antenna and filter, not bus and files."""
    tables: dict[str, Table] = {}
    for name in ("vehicle", "gnss", "filter", "monitor", "tyre"):
        record = getattr(config, name)
        values = {
            field.name: (getattr(record, field.name), field.default) for field in dataclasses.fields(record)
        }
        tables[name] = {
            key: str(value) if isinstance(value, Path) else value
            for key, (value, usual) in values.items()
            if value not in (None, usual, ())
        }
    radii = dict(zip(WHEELS, config.vehicle.wheel_radius_m, strict=True))
    tables["vehicle"] = {**tables["vehicle"], "wheel_radius_m": radii}
    tables["gnss"] = {key: tables["gnss"][key] for key in ANTENNA if key in tables["gnss"]}
    return tables


def _car_settings_and_radii(
    vehicle: Mapping[str, Any] | str | Path | Config,
) -> tuple[dict[str, Table], np.ndarray]:
    """Return the tables that describe a car, and its nominal radii (4,), m."""
    if isinstance(vehicle, str | Path):
        vehicle = load_config(Path(vehicle))
    if isinstance(vehicle, Config):
        car = vehicle.vehicle
        return car_settings(vehicle), np.array(car.wheel_radius_m)
    radius = vehicle.get("wheel_radius_m")
    try:
        if isinstance(radius, Mapping):
            radii = np.array([float(radius.get(wheel, np.nan)) for wheel in WHEELS])
        else:
            radii = np.full(4, np.nan if radius is None else float(radius))
    except (TypeError, ValueError):
        radii = np.full(4, np.nan)  # what is wrong with it is reported with the rest of the configuration
    return {"vehicle": dict(vehicle)}, np.where(np.isfinite(radii) & (radii > 0.0), radii, 0.3)
