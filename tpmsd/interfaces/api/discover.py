"""discover: which signals of an unknown car are its wheels.

In: a drive folder, a CAN log with an NMEA log, or a `Drive`; a DBC where there is one. Out: `Discovery`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.palette import STYLES
from tpmsd.foundation.plain import plain
from tpmsd.foundation.provenance import provenance
from tpmsd.interfaces.api.axes import given_or_new_axes
from tpmsd.interfaces.api.car_library import load_cars
from tpmsd.offline.discovery.discover import discover as discover_raw
from tpmsd.offline.discovery.frames import BusLog
from tpmsd.offline.discovery.result import BusDiscovery, FoundRole
from tpmsd.offline.discovery.result_files import vehicle_text
from tpmsd.offline.drives.drive import Drive
from tpmsd.offline.drives.raw_drive import read_drive
from tpmsd.offline.drives.reading import MemoryRecording
from tpmsd.offline.report.card import card, one_line
from tpmsd.offline.rings.tooth_count import tyre_radius_m
from tpmsd.offline.tables.extras import import_pandas
from tpmsd.onboard.sources.can.block import block_of
from tpmsd.onboard.sources.can.databases import load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.events import GnssFix
from tpmsd.onboard.sources.gnss.nmea_epoch import NmeaAssembler

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

DISCOVERY_SCHEMA = "tpmsd.discovery/2"


@dataclass(frozen=True)
class Discovery:
    """Signals of an unknown car by what they do, each with a probability."""

    result: BusDiscovery
    """The record that the command reports."""
    files: tuple[Path, ...] = ()
    dbc: Path | None = None
    notes: tuple[str, ...] = field(default=())
    """Notes on what was skipped in the recording, a line each."""

    @property
    def roles(self) -> dict[str, FoundRole]:
        """Return the signal found for each role."""
        return self.result.roles

    @property
    def wheels_decided(self) -> bool:
        """Return whether every wheel has its signal."""
        return self.result.wheels_decided

    def vehicle_toml(self, dbc: str = "bus.dbc") -> str:
        """Return the text of a configuration; `dbc` is the DBC's path as it is to stand in it."""
        return vehicle_text(self.result, dbc)

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `tpmsd discover --json`."""
        head = provenance(DISCOVERY_SCHEMA, self.files, self.dbc)
        made: dict[str, Any] = plain({**head, **self.result.document()})
        return made

    def to_pandas(self) -> pd.DataFrame:
        """Return a row per role: signal and probability."""
        rows = [
            {"role": role, "signal": one.field.signal, "probability": one.probability}
            for role, one in self.roles.items()
        ]
        frame: pd.DataFrame = import_pandas().DataFrame(rows, columns=["role", "signal", "probability"])
        return frame

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw a bar per role with the probability of its signal; return the axes."""
        axes = given_or_new_axes(ax)
        names = list(self.roles)[::-1]
        axes.barh(
            range(len(names)), [self.roles[name].probability for name in names], color=STYLES["after"].colour
        )
        axes.set_yticks(range(len(names)), names)
        axes.set(xlabel="probability", xlim=(0.0, 1.0))
        return axes

    def __repr__(self) -> str:
        """Return the signals of the wheels and whether they are decided."""
        decided = "wheels decided" if self.wheels_decided else "wheels not decided"
        found = [f"{role}={one.field.signal}" for role, one in self.roles.items()]
        return one_line("Discovery", decided, *found)

    def _repr_html_(self) -> str:
        """Return the roles as a card for a notebook."""
        rows = [(role, one.field.signal, f"{one.probability:.3f}") for role, one in self.roles.items()]
        decided = "every wheel has its signal" if self.wheels_decided else "not every wheel has its signal"
        return card(f"Discovery: {decided}", (("role", "signal", "probability"), rows))


def discover(
    drive: Drive | str | Path | Sequence[str | Path],
    *,
    dbc: str | Path | None = None,
    tyre: str | None = None,
) -> Discovery:
    """Find which signals are the wheels, and the car's measures; a vehicle.toml is not read.

    `drive`: a folder, a pair of CAN log and NMEA log, or a `Drive`; `dbc`: the bus's DBC, by default that in
    the folder where there is one; `tyre`: size of the tyres, such as 205/55R16.

    InputError where nothing usable is in the drive; ConfigError on a size that is none.
    """
    if tyre is not None and tyre_radius_m(tyre) is None:
        raise ConfigError(f"tyre {tyre}: not a tyre's size, such as 205/55R16")
    if isinstance(drive, Drive) and isinstance(drive.recording, MemoryRecording):
        return _discover_in_memory(drive.recording, None if dbc is None else Path(dbc), tyre)
    if isinstance(drive, Drive):
        assert drive.folder is not None
        drive = drive.folder
    paths = [Path(drive)] if isinstance(drive, str | Path) else [Path(path) for path in drive]
    folder = paths[0] if paths[0].is_dir() else paths[0].parent
    own_dbc = folder / "bus.dbc" if (folder / "bus.dbc").is_file() else None
    file = own_dbc if dbc is None else Path(dbc)
    notes: list[str] = []
    raw = read_drive(paths, notes.append)
    database = None if file is None else load_database(file)
    found = discover_raw(raw.log, raw.fixes, database, tyre, load_cars())
    return Discovery(found, (raw.can_log, raw.nmea_log), file, tuple(notes))


def _discover_in_memory(recording: MemoryRecording, dbc: Path | None, tyre: str | None) -> Discovery:
    log, assembler = BusLog(), NmeaAssembler()
    events: list[object] = []
    log.add(block_of([item for item in recording.items if isinstance(item, CanFrame)]))
    for item in recording.items:
        if not isinstance(item, CanFrame):
            events += assembler.feed(item.time_s, item.line)
    events += assembler.flush()
    fixes = [event for event in events if isinstance(event, GnssFix)]
    database = recording.database() if dbc is None else load_database(dbc)
    return Discovery(discover_raw(log, fixes, database, tyre, load_cars()), (), dbc)
