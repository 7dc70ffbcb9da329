"""A drive through the core: replayed, explained, or as the arrays of diagnosis and calibration.

In: a `Drive`. Out: records; each note on the recording is handed on at once. The Python face, the commands
and the workers of a fleet share these functions.
"""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tpmsd.foundation.errors import ConfigError, InputError, TpmsdError
from tpmsd.offline.drives.drive import Drive
from tpmsd.offline.drives.reading import (
    DESK_RATE_HZ,
    Note,
    Progress,
    ignore_note,
    ignore_progress,
    play,
    read_ticks,
)
from tpmsd.offline.report.replay_recorder import ReplayRecorder
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.resonance.watch import ResonanceWatch

if TYPE_CHECKING:
    from tpmsd.car.physics.model import ExtendedModel
    from tpmsd.offline.inference.recording import Recording
    from tpmsd.offline.report.vehicle_state_summary import StateSummary
    from tpmsd.offline.tables.tick_table import TickTable, TickTableRecorder
    from tpmsd.onboard.timeline.tick import Tick

REPORTED_LATE_S = 1.0
"""Delay of what only the end of a replay asks for, s: it is done for many samples at once."""


def replay_drive(
    drive: Drive,
    model: ExtendedModel | None = None,
    table: bool = False,
    progress: Progress = ignore_progress,
    note: Note = ignore_note,
    collected: list[Tick] | None = None,
) -> tuple[ReplayResult, TickTable | None]:
    """Return the result of a replay, and its tick table if `table`; each note is passed on at once. The ticks
    as the timeline made them are appended to `collected`.
    """
    config = drive.config
    stream, database = drive.recording.open(config, note)
    recorder = ReplayRecorder(drive.name, config.vehicle, config.monitor)
    method = config.vehicle_state.method
    ticks = _table_recorder(method is not None) if table else None
    states = None if method is None else _state_summary(method)
    begun = time.perf_counter()
    pipeline = Pipeline(config, database, model)
    if ticks is not None:
        pipeline.timeline.observe_fixes(ticks.observe_fix)
    if collected is not None:
        pipeline.observe_ticks(collected.append)
    watch = pipeline.resonance
    if watch is None:  # a report all the same
        watch = ResonanceWatch(config.vehicle.wheel_radius_m)
        pipeline.timeline.observe_rotations(watch, REPORTED_LATE_S)
    for step in play(stream, pipeline, progress, note):
        recorder.add(step.tick, step.estimate, step.report)
        if states is not None:
            states.add(step.tick.dt_s, step.vehicle_state, step.tick.time_s)
        if ticks is not None:
            ticks.add(step)
    result = recorder.result(0.0)
    elapsed_s = max(time.perf_counter() - begun, 1e-9)
    result = dataclasses.replace(
        result,
        realtime_factor=result.duration_s / elapsed_s,
        resonance=watch.status(),
        vehicle_state=states,
    )
    return result, None if ticks is None else ticks.table()


# Imported where they are used: most replays do without, and their modules take longer than a minute's drive.


def _table_recorder(states: bool) -> TickTableRecorder:
    from tpmsd.offline.tables.tick_table import TickTableRecorder

    return TickTableRecorder(states)


def _state_summary(method: str) -> StateSummary:
    from tpmsd.offline.report.vehicle_state_summary import StateSummary

    return StateSummary(method)


def explain_drive(
    drive: Drive,
    model: ExtendedModel | None = None,
    progress: Progress = ignore_progress,
    note: Note = ignore_note,
) -> dict[str, Any]:
    """Return the document of `tpmsd explain`: why each alarm of a drive was raised, and why there was none.

    `model`: effects beyond rolling that are compensated, those of `[filter] model` unless given.
    """
    config = drive.config
    stream, database = drive.recording.open(config, note)
    pipeline = Pipeline(config, database, known_effects([drive], model))
    start_s = None
    for step in play(stream, pipeline, progress, note):
        start_s = step.report.time_s if start_s is None else start_s
    return {"drive": drive.name, "start_time": start_s, **pipeline.explain()}


def replays_at_desk_rate(drive: Drive) -> bool:
    """Return whether a replay of the drive has the tick rate of diagnosis and calibration."""
    return drive.config.filter.rate_hz == DESK_RATE_HZ


def recording_of(drive: Drive, name: str | None = None, collected: list[Tick] | None = None) -> Recording:
    """Return a drive as the arrays of diagnosis and calibration; InputError where there is nothing usable in
    it.

    `collected`: its ticks, if a replay has made them already (`replays_at_desk_rate`); else it is read.
    """
    from tpmsd.offline.inference.recording import record  # SciPy, which a replay does not need

    try:
        ticks = read_ticks(drive.recording, drive.config, DESK_RATE_HZ) if collected is None else collected
        return record(ticks, drive.config, name or drive.name)
    except TpmsdError:
        raise
    except ValueError as error:
        raise InputError(drive.name, str(error)) from None


def known_effects(
    drives: list[Drive], model: ExtendedModel | str | Path | None = None
) -> ExtendedModel | None:
    """Return the effects of the baseline model; ConfigError where configurations name different models."""
    if model is None:
        named = {drive.config.filter.model for drive in drives}
        if len(named) > 1:
            raise ConfigError("the drives' configurations name different models: give one as model=")
        model = named.pop()
    if not isinstance(model, str | Path):
        return model
    from tpmsd.car.physics.model_file import load_model

    return load_model(model)
