"""A longer drive for attackers: simulated once, its ticks and frames changed, played through the core."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.faults.drives import Item, Outcome, with_method
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can_decoder import load_database
from tpmsd.onboard.sources.can_frame import CanFrame
from tpmsd.onboard.sources.drive import Drive, Sentence
from tpmsd.onboard.sources.signal_plan import compile_plans
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.tick_source import TickSource

DURATION_S = 420.0
SEED = 11
ROUTE = "rural"


@functools.cache
def attacked() -> tuple[Config, tuple[Item, ...], tuple[Tick, ...]]:
    """Configuration, items and ticks of the drive; the tyres are sound, the bus has wheels alone."""
    folder = Path(tempfile.mkdtemp(prefix="tpmsd-attacks-"))
    spec = DriveSpec(ROUTE, DURATION_S, SEED, bus=BusSpec(kind="counts16"))
    write_drive(folder, simulate_drive(spec))
    config = load_config(folder)
    signals = {role: name for role, name in config.can.signals.items() if role.startswith("wheel_")}
    config = replace(
        config, can=replace(config.can, signals=signals), filter=replace(config.filter, particles=10)
    )
    database = load_database(config.can.dbc)
    keys = compile_plans(config, database)
    items = tuple(i for i in Drive(folder) if isinstance(i, Sentence) or i.arbitration_id in keys)
    source = TickSource(config, database)
    ticks: list[Tick] = []
    for item in items:
        ticks += fed(source, item)
    return config, items, (*ticks, *source.finish())


def fed(source: TickSource, item: Item) -> list[Tick]:
    if isinstance(item, CanFrame):
        return source.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
    return source.on_sentence(item.time_s, item.line)


def played_ticks(change: Callable[[list[Tick], float], Iterable[Tick]], source: str = "ticks") -> Outcome:
    """Play the ticks as changed."""
    config, _, ticks = attacked()
    start_s = ticks[0].time_s
    outcome = Outcome(start_s)
    outcome.pipeline = Pipeline(with_method(config), load_database(config.can.dbc))
    for tick in change(list(ticks), start_s):
        outcome.steps.append(outcome.pipeline.on_tick(tick))
    return outcome


def played_items(change: Callable[[list[Item], float], Iterable[Item]]) -> Outcome:
    """Play the frames and sentences as changed, from the decoder on."""
    config, items, _ = attacked()
    start_s = items[0].time_s
    outcome = Outcome(start_s)
    pipeline = outcome.pipeline = Pipeline(with_method(config), load_database(config.can.dbc))
    for item in change(list(items), start_s):
        if isinstance(item, CanFrame):
            outcome.steps += pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
        else:
            outcome.steps += pipeline.on_sentence(item.time_s, item.line)
    outcome.steps += pipeline.finish()
    return outcome


def turned(tick: Tick, factors: list[float]) -> Tick:
    """The tick with wheels that turn by these factors more."""
    return replace(tick, rotation_rad=tick.rotation_rad * np.array(factors))
