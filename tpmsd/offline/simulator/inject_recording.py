"""A drive folder with effects injected into a recording.

In: a recorded drive, what it reads as, an `ExtendedModel`. Out: a folder of the same files in which wheels,
gyro and receiver read what the effects make of them. Byte for byte the same is everything on which no effect
acts: other frames, other bytes of these frames, stamps, sentences, configuration and DBC.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tpmsd.car.config.model import Config
from tpmsd.car.physics.forward import RECEIVER_READ, affected_channels
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.errors import ConfigError, InputError, TpmsdError
from tpmsd.foundation.wheels import RL, RR
from tpmsd.offline.inference.recording import Recording, record
from tpmsd.offline.simulator.drive_writer import MAKER, TRUTH
from tpmsd.offline.simulator.inject_can import CanRewriter, copy_file
from tpmsd.offline.simulator.inject_nmea import NmeaRewriter
from tpmsd.offline.simulator.injection import Injection
from tpmsd.offline.simulator.sealed import SEALED
from tpmsd.onboard.sources.can.databases import load_databases
from tpmsd.onboard.sources.can.log import READERS
from tpmsd.onboard.sources.can.signal_plan import compile_plans
from tpmsd.onboard.sources.drive import FolderStream
from tpmsd.onboard.timeline.tick import Tick

CLOCK_STEP_S = 1e-3
"""Change of the host's clock against the drive's own time that is a step, s: stamps are resolved to that."""


@dataclass(frozen=True)
class InjectionTarget:
    """A recorded drive that effects are injected into."""

    drive: FolderStream
    """Opened, with its clocks aligned; it is not iterated."""
    config: Config
    recording: Recording

    @classmethod
    def of(cls, drive: FolderStream, config: Config, ticks: Sequence[Tick]) -> InjectionTarget:
        """Return the drive with its recording; InputError where its clock steps or the rear wheels were not
        both read.
        """
        steps = [tick.host_time_s - tick.time_s for tick in ticks]
        if steps and max(steps) - min(steps) > CLOCK_STEP_S:
            raise InputError(drive.folder, "the host's clock steps within the drive: cut it there")
        try:
            recording = record(ticks, config, drive.folder.resolve().name)
        except ValueError as error:
            raise InputError(drive.folder, str(error)) from None
        if not {RL, RR} <= set(recording.wheels):
            raise InputError(drive.folder, "the rear wheels are not both read, by which the motion is known")
        return cls(drive, config, recording)


def check_target(out: Path, onto: Path, force: bool) -> None:
    """Raise ConfigError for a folder that must not be written to, before the work starts.

    A folder that holds anything is written to only with `force`, and only if effects were injected there
    before: its `truth.json` or `truth.sealed` says so.
    """
    if out.resolve() == onto.resolve():
        raise ConfigError(f"{out}: is the recording itself, which is never changed; name another folder")
    if not out.exists():
        return
    if not out.is_dir():
        raise ConfigError(f"{out}: not a folder")
    try:
        names = sorted(entry.name for entry in out.iterdir())
    except OSError as error:
        raise ConfigError(f"{out}: cannot be read: {error.strerror}") from None
    if not names:
        return
    if not _is_injected(out):
        raise ConfigError(f"{out}: holds files that no --onto wrote; name another folder")
    if not force:
        raise ConfigError(f"{out}: holds a recording with effects already; --force replaces it")


def inject(onto: InjectionTarget, model: ExtendedModel, out: Path, latency_s: float = 0.0) -> list[str]:
    """Write a drive folder with the effects; return the names of the files in which something changed.

    `latency_s` is the recording's GNSS latency beyond the configured one.

    Raises:
        ConfigError: an effect cannot be injected into this recording.
        InputError: a log cannot be read.
        TpmsdError: the disk does not take it.
    """
    injection = Injection(onto.recording, onto.config, model, latency_s)
    if onto.config.gnss.source == "can":
        for effect in model:
            if RECEIVER_READ in affected_channels(effect):
                raise ConfigError(f"{effect.name} cannot be injected: this receiver is on the bus")
    drive, config = onto.drive, onto.config
    logs = [drive.can_log, *([] if drive.nmea_log is None else [drive.nmea_log])]
    changed: list[str] = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in (TRUTH, SEALED):
            (out / name).unlink(missing_ok=True)
        for entry in sorted(drive.folder.iterdir()):
            if entry.is_file() and entry not in logs and entry.name not in (TRUTH, SEALED):
                copy_file(entry, out / entry.name)
        plans = compile_plans(config, load_databases(config))
        can = CanRewriter(plans, injection, config.vehicle.teeth_per_rev, drive.channel, drive.buses)
        for stale in READERS:  # of another format, which an earlier run left
            (out / f"can{stale}").unlink(missing_ok=True)
        if name := can.rewrite(drive.can_log, out):
            changed.append(name)
        if drive.nmea_log is not None:
            nmea = NmeaRewriter(injection, drive.gnss_offset_s)
            if nmea.rewrite(drive.nmea_log, out / drive.nmea_log.name):
                changed.append(drive.nmea_log.name)
    except OSError as error:
        raise TpmsdError(f"{error.filename or out}: cannot be written: {error.strerror}") from None
    return changed


def write_truth(out: Path, onto: InjectionTarget, model: ExtendedModel) -> None:
    """Write `truth.json`: the recording's name and what was injected."""
    document = {
        "program": MAKER,
        "onto": onto.drive.folder.resolve().name,
        "effects": effects_document(model),
    }
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in document.items()]
    try:
        (out / TRUTH).write_text("{" + ",\n ".join(lines) + "}\n", encoding="utf-8")
    except OSError as error:
        raise TpmsdError(f"{out / TRUTH}: cannot be written: {error.strerror}") from None


def effects_document(model: ExtendedModel) -> list[dict[str, Any]]:
    """Return names and parameters of the effects as in `truth.json`."""
    return [{"name": effect.name, "parameters": effect.values()} for effect in model]


def _is_injected(out: Path) -> bool:
    """Return whether the folder was written by an injection."""
    if (out / SEALED).is_file():
        return True
    try:
        text = (out / TRUTH).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    return text.startswith(f'{{"program": "{MAKER}"') and '"onto"' in text[:200]
