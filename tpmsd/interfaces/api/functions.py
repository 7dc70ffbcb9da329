"""replay, diagnose, calibrate, simulate: each a function of drives.

In: `Drive`s, or their folders. Out: `Replay`, `Diagnosis`, `Calibration`, and a new `Drive`. Nothing is
printed and nothing written; what was wrong with a recording is in the result's notes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.model_file import load_model
from tpmsd.foundation.errors import ConfigError, InputError
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.api.results import Calibration, Diagnosis, Replay, Source
from tpmsd.offline.drives.drive import Drive, as_drive
from tpmsd.offline.drives.playing import known_effects, recording_of, replay_drive
from tpmsd.offline.drives.reading import (
    MemoryRecording,
    Progress,
    ignore_progress,
)
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import Sentence
from tpmsd.onboard.timeline.compensation import uncompensated_effects

if TYPE_CHECKING:
    pass

DriveLike = Drive | str | Path
Model = ExtendedModel | str | Path


def replay(
    drive: DriveLike,
    *,
    model: Model | None = None,
    seed: int | None = None,
    method: str | None = None,
    table: bool = True,
    progress: Progress = ignore_progress,
) -> Replay:
    """Run a drive through the daemon's own core.

    `model`: effects beyond rolling (or their file) that are compensated, those of `[filter] model` unless
    given; what of them cannot be compensated is in the notes. `seed` and `method` take the place of the
    configured ones; `table`: keep a row per tick (0.6 kB each); `progress` gets the seconds of drive that
    are done.

    InputError if nothing usable is in the drive; ConfigError on wrong arguments.
    """
    one = as_drive(drive)
    config = one.config
    changes: dict[str, Any] = {}
    if seed is not None:
        if seed < 0:
            raise ConfigError(f"seed {seed}: a seed is 0 or more")
        changes["seed"] = seed
    if method is not None:
        changes["method"] = method
    if changes:
        config = dataclasses.replace(config, filter=dataclasses.replace(config.filter, **changes))
    notes: list[str] = []
    extended = known_effects([one], model)
    if extended is not None:
        notes += uncompensated_effects(config, extended)
    result, ticks = replay_drive(
        dataclasses.replace(one, config=config), extended, table, progress, notes.append
    )
    return Replay(result, ticks, tuple(notes), _source([one]))


def diagnose(
    drives: DriveLike | Iterable[DriveLike],
    *,
    simulation: DriveLike | None = None,
    model: ExtendedModel | str | Path | None = None,
    certify: int = 19,
    progress: Callable[[float], None] = ignore_progress,
) -> Diagnosis:
    """Say which physics the drives of one car hold that the rolling model (or your `simulation`) lacks.

    `model`: known effects (or their file) that belong to the baseline, else those of `[filter] model`.
    Findings get p-values from at most `certify` replicates of the drives; 0 skips that. `progress` gets
    the share that is done. ConfigError where the drives are of different cars, or the simulation of another
    road; InputError where nothing usable is in a drive.
    """
    from tpmsd.offline.diagnosis import diagnose as diagnosis

    wanted = _load_distinct(drives)
    recordings = [recording_of(drive) for drive in wanted]
    names = tuple(drive.name for drive in wanted)
    if simulation is None:
        certification = diagnosis.Certification(certify, np.random.default_rng(0))
        known = known_effects(wanted, model)
        found = diagnosis.diagnose(recordings, progress, certification, known=known)
        return Diagnosis(found, names, _source(wanted))
    if model is not None:
        raise ConfigError("the baseline is the simulation: a model does not go with it")
    if len(recordings) > 1:
        raise ConfigError("a simulation is compared with one drive, that of which it is a simulation")
    other = as_drive(simulation)
    simulated = recording_of(other, "your simulation")
    found = diagnosis.diagnose_against(recordings[0], simulated, progress)
    return Diagnosis(found, names, _source([*wanted, other]))


def calibrate(
    drives: DriveLike | Iterable[DriveLike],
    *,
    method: str = "joint",
    progress: Callable[[float], None] = ignore_progress,
) -> Calibration:
    """Learn the radii and tracks of a car from its drives.

    `method`: joint or paper; `progress` gets the share that is done. InputError where a calibration cannot
    be had from a drive (it says why); ConfigError on an unknown method, or drives of different cars.
    """
    from tpmsd.offline.calibration.calibrate import METHODS
    from tpmsd.offline.calibration.calibrate import calibrate as calibrate_recordings
    from tpmsd.offline.calibration.checks import RefusedError

    if method not in METHODS:
        raise ConfigError(f"no such method: {method!r} (methods: {' '.join(METHODS)})")
    wanted = _load_distinct(drives)
    for other in wanted[1:]:
        if other.config.vehicle != wanted[0].config.vehicle:
            raise ConfigError(f"{wanted[0].name} and {other.name}: their tables [vehicle] differ")
    recordings = [recording_of(drive) for drive in wanted]
    try:
        found, _ = calibrate_recordings(recordings, wanted[0].config.vehicle, method, progress)
    except RefusedError as refusal:
        at = refusal.drive
        where = wanted[at].name if at is not None else ", ".join(drive.name for drive in wanted)
        raise InputError(where, f"cannot be calibrated from: {refusal}") from None
    config = wanted[0].config
    radii = dict(zip(WHEELS, config.vehicle.wheel_radius_m, strict=True))
    return Calibration(found, _source(wanted), radii, config.bus_radii_m)


def simulate(**settings: Any) -> Drive:
    """Return a simulated drive in memory; the arguments are those of
    `tpmsd.offline.simulator.drive.DriveSpec`.

    `faults` are `tpmsd.Fault`s; `model` is an extended model or a model file. The same arguments give the
    same drive. ConfigError on what makes no sense.

    >>> drive = simulate(duration_s=20.0, seed=3)
    >>> drive.name, drive.config.vehicle.teeth_per_rev, drive.folder
    ('simulated-mixed-3', 48.0, None)
    """
    from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
    from tpmsd.offline.simulator.drive_writer import nmea_log_line
    from tpmsd.offline.tables.car_file import config_of

    if isinstance(settings.get("model"), str | Path):
        settings["model"] = load_model(settings["model"])
    try:
        spec = DriveSpec(**settings)
    except TypeError as error:
        known = ", ".join(field.name for field in dataclasses.fields(DriveSpec))
        raise ConfigError(f"simulate: {error} (arguments: {known})") from None
    made = simulate_drive(spec)
    frames = made.frames
    data = np.ascontiguousarray(frames.data)
    items: list[CanFrame | Sentence] = [
        CanFrame(round(time_s, 6), "can0", identifier, identifier > 0x7FF, False, False, False, row.tobytes())
        for time_s, identifier, row in zip(
            frames.time_s.tolist(), frames.frame_id.tolist(), data, strict=True
        )
    ]
    for number, line in enumerate(made.nmea, 1):
        stamp, _, text = nmea_log_line(line).partition(" ")
        items.append(Sentence(float(stamp[1:-1]), text.strip().encode("ascii"), number))
    items.sort(key=lambda item: item.time_s)
    name = f"simulated-{spec.route}-{spec.seed}"
    config = config_of(made.vehicle_toml)
    return Drive(name, config, MemoryRecording(name, tuple(items), made.dbc), made.vehicle_toml)


def _source(drives: list[Drive]) -> Source:
    """Return the folders and the configuration of the drives, which a document names as its input."""
    folders = tuple(drive.folder for drive in drives if drive.folder is not None)
    return Source(folders, drives[0].config.file if folders else None)


def _load_distinct(drives: DriveLike | Iterable[DriveLike]) -> list[Drive]:
    """Return all drives, loaded, with distinct names; ConfigError if there is none or one twice."""
    given = [drives] if isinstance(drives, Drive | str | Path) else list(drives)
    if not given:
        raise ConfigError("no drive")
    loaded = [as_drive(drive) for drive in given]
    folders = [drive.folder.resolve() for drive in loaded if drive.folder is not None]
    for k, folder in enumerate(folders):
        if folder in folders[:k]:
            raise ConfigError(f"{folder}: the drive is given twice")
    names = [drive.name for drive in loaded]
    return [
        drive
        if names.count(drive.name) == 1
        else dataclasses.replace(drive, name=str(drive.folder or f"{drive.name} {k + 1}"))
        for k, drive in enumerate(loaded)
    ]
