"""Drives into the program's core, and what it said.

In: legs as they were driven, and what was learned before. Out: `LegResult`: alarms by driving time, and what
is learned now. Each leg is a start of the daemon: a new core that takes up the saved state.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.onboard.alarms.cache import RememberedEstimator, key_of
from bench.campaigns.onboard.alarms.cases import Law
from bench.campaigns.onboard.alarms.ticks import ticks_of
from bench.worlds.folder import write_folder
from bench.worlds.magic_tyre import Array
from bench.worlds.surfaces import FRAMES_NEEDED
from bench.worlds.trips import ENGINE_BRAKE_MPS2, Driven
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.interfaces.cli.drive_reading import open_drive, play
from tpmsd.onboard.monitor.records import AlarmEvent
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.timeline.tick import Tick

PROBABILITIES_EVERY_S = 10.0
FAST_MPS = 40.0 / 3.6
"""From here driving counts for the time to detect."""
State = dict[str, Any]


@dataclass(frozen=True)
class Said:
    """One alarm, raised or cleared."""

    time_s: float
    """Since the leg's start."""
    kind: str
    wheel: str | None
    state: str
    reason: str


@dataclass
class LegResult:
    """What the core said on a leg."""

    said: list[Said] = field(default_factory=list)
    state: State = field(default_factory=dict)
    """What is learned at the end, or where it was broken off."""
    learned: bool = False
    """Whether there is a baseline at the end."""
    learned_at_s: float = math.nan
    """When the baseline was frozen, if it was on this leg."""
    played_s: float = 0.0
    change: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Change against the baseline and its standard deviation in m at the end, by wheel."""
    probabilities: list[tuple[float, tuple[float, ...]]] = field(default_factory=list)
    """Every `PROBABILITIES_EVERY_S` of judged driving: seconds since the start, each wheel's P(deflation)."""
    standing: list[str] = field(default_factory=list)
    """`kind wheel` of the alarms that stand at the end."""

    def raised(self, kind: str) -> list[Said]:
        """Alarms of a kind that were raised."""
        return [said for said in self.said if said.kind == kind and said.state == "raised"]


def config_of(driven: Driven, folder: Path) -> Config:
    """The configuration that goes with the leg; the folder then holds the whole drive."""
    write_folder(driven.drive, folder)
    return load_config(folder)


def with_method(config: Config, method: str | None) -> Config:
    """The configuration with this estimator; None: as it is."""
    return config if method is None else replace(config, filter=replace(config.filter, method=method))


def replay_leg(
    driven: Driven,
    before: State | None = None,
    stop: Callable[[LegResult], float | None] | None = None,
    frames: bool | None = None,
    memory: Path | None = None,
    method: str | None = None,
    silent: tuple[int, float] | None = None,
) -> LegResult:
    """Play a leg. `stop` may say, after an alarm, at which time since the start enough was heard.

    `frames`: through the decoder instead of by ticks; None: where the leg needs it. `memory`: a folder that
    keeps what the estimator made of it. `method`: an estimator instead of the default. `silent`: a wheel
    whose signal is missing, and from when on (ticks alone).
    """
    if frames is None:
        frames = any(tag in FRAMES_NEEDED for tag in driven.leg.tags)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        if frames:
            config = with_method(config_of(driven, folder), method)
            drive, database = open_drive(folder, config)
        else:
            short = beginning(driven)
            config = with_method(config_of(short, folder), method)
            drive, database = None, load_database(config.can.dbc)
        pipeline = Pipeline(config, database)
        remembered = None
        if memory is not None:
            key = key_of(driven.drive, config, pipeline.estimator.inner, frames)
            remembered = pipeline.estimator.inner = RememberedEstimator(pipeline.estimator.inner, memory, key)
        if before:
            pipeline.restore(json.loads(json.dumps(before)))
        steps: Iterator[Step]
        if drive is not None:
            steps = play(drive, pipeline, "leg")
        else:
            ticks = ticks_of(driven.drive)
            if silent is not None:
                ticks = [_without(tick, silent[0], driven.leg.start_s + silent[1]) for tick in ticks]
            steps = (pipeline.on_tick(tick) for tick in ticks)
        outcome = _listen(driven, pipeline, steps, stop)
        if remembered is not None:
            remembered.keep()
        return outcome


def _without(tick: Tick, wheel: int, from_s: float) -> Tick:
    """The tick without the signal of a wheel."""
    if tick.time_s < from_s:
        return tick
    rotation, std = tick.rotation_rad.copy(), tick.rotation_std_rad.copy()
    rotation[wheel] = std[wheel] = math.nan
    return replace(tick, rotation_rad=rotation, rotation_std_rad=std)


def beginning(driven: Driven) -> Driven:
    """Just enough of a leg to write a configuration."""
    drive = driven.drive
    few, none = slice(0, 50), slice(0, 0)
    cut: dict[str, Any] = {
        name: value[none if name.startswith("fix") else few]
        for name, value in vars(drive).items()
        if isinstance(value, np.ndarray) and name != "radius_m"
    }
    return replace(driven, drive=replace(drive, **cut))


def _listen(
    driven: Driven,
    pipeline: Pipeline,
    steps: Iterator[Step],
    stop: Callable[[LegResult], float | None] | None,
) -> LegResult:
    outcome = LegResult()
    start_s = driven.leg.start_s
    end_s = math.inf
    report = None
    learned = False
    for step in steps:
        report = step.report
        now = step.tick.host_time_s - start_s
        if report.learning_fraction >= 1.0 and not learned:
            learned = True
            outcome.learned_at_s = now
        if report.losses is not None and (
            not outcome.probabilities or now - outcome.probabilities[-1][0] >= PROBABILITIES_EVERY_S
        ):
            outcome.probabilities.append((now, tuple(wheel.deflation_probability for wheel in report.wheels)))
        if report.events:
            outcome.said += [_plain(event, now) for event in report.events]
            if stop is not None:
                wanted = stop(outcome)
                end_s = math.inf if wanted is None else max(wanted, now)
        if now >= end_s:
            break
    outcome.state = json.loads(json.dumps(pipeline.snapshot()))
    if report is not None:
        outcome.played_s = report.time_s - start_s
        outcome.learned = report.learning_fraction >= 1.0
        outcome.change = {each.wheel: (each.change_m, each.change_std_m) for each in report.wheels}
        outcome.standing = sorted(f"{alarm.kind} {alarm.wheel}" for alarm in report.active)
    return outcome


def _plain(event: AlarmEvent, now_s: float) -> Said:
    return Said(now_s, str(event.kind), event.wheel, event.state, event.reason)


def fast_seconds(driven: Driven, from_s: float, to_s: float) -> float:
    """Driving above 40 km/h between two instants."""
    time_s: Array = driven.drive.time_s
    fast = (np.abs(driven.drive.speed) > FAST_MPS) & (time_s >= from_s) & (time_s < to_s)
    return float(np.count_nonzero(fast)) * float(time_s[1] - time_s[0])


def law_seconds(driven: Driven, law: Law, from_s: float, to_s: float) -> float:
    """Driving that a regulation counts between two instants: within its speeds, and not under the service
    brake (slower than the engine alone makes the car)."""
    time_s: Array = driven.drive.time_s
    speed = np.asarray(driven.drive.speed)
    step_s = float(time_s[1] - time_s[0])
    low, high = (kmh / 3.6 for kmh in law.speeds_kmh)
    braked = np.gradient(np.abs(speed), step_s) < -ENGINE_BRAKE_MPS2
    counted = (np.abs(speed) >= low) & (np.abs(speed) <= high) & ~braked
    return float(np.count_nonzero(counted & (time_s >= from_s) & (time_s < to_s))) * step_s
