"""Logs with stamps of any kind, read in blocks and frame by frame: the same to the last bit."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from cantools.database import Database
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.exact import exact
from tests.onboard.timeline.events import Samples
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.drives.reading import FolderRecording
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.sources.can.block import FrameBlock
from tpmsd.onboard.sources.drive import FrameSlice, Sentence
from tpmsd.onboard.timeline.block_source import BlockSource
from tpmsd.onboard.timeline.tick_source import TickSource

BUS = np.zeros(1, dtype=np.intp)


class Log(NamedTuple):
    """A short drive in memory."""

    config: Config
    database: Database
    block: FrameBlock
    sentences: tuple[Sentence, ...]


@cache
def log(kind: str, route: str) -> Log:
    """Twelve seconds from the start, in which the car sets off or rolls."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "drive"
        write_drive(folder, simulate_drive(DriveSpec(route, 12.0, seed=7, bus=BusSpec(kind))))
        config = load_config(folder)
        stream, database = FolderRecording(folder).open(config)
        items = list(stream.parts())
    frames = [
        item.block.select(slice(item.start, item.stop)) for item in items if isinstance(item, FrameSlice)
    ]
    fields = [field.name for field in dataclasses.fields(FrameBlock) if field.name != "channels"]
    columns = [np.concatenate([getattr(block, name) for block in frames]) for name in fields]
    block = FrameBlock(*columns, frames[0].channels)
    return Log(config, database, block, tuple(item for item in items if isinstance(item, Sentence)))


class Change(NamedTuple):
    """What happens to the stamps, or to the frames, of one stretch of a log."""

    kind: str
    share: float
    """Where in the log it begins."""
    frames: int
    """How many frames it concerns."""
    seconds: float


def _shift(change: Change, at_s: FloatArray, here: Any) -> FloatArray:
    return np.where(here, at_s + change.seconds, at_s)


def _every_other(change: Change, at_s: FloatArray, here: Any) -> FloatArray:
    return at_s + change.seconds * ((at_s - at_s[0]) // 5.0 % 2.0)


def _equal(change: Change, at_s: FloatArray, here: Any) -> FloatArray:
    return np.where(here, at_s[here][0], at_s)


def _burst(change: Change, at_s: FloatArray, here: Any) -> FloatArray:
    """All that came within a while is handed over at its end."""
    while_s = max(abs(change.seconds), 0.01)
    return np.where(here, np.ceil(at_s / while_s) * while_s, at_s)


def _rounded(change: Change, at_s: FloatArray, here: Any) -> FloatArray:
    step_s = min(max(abs(change.seconds), 0.001), 0.1)
    return np.asarray(np.floor(at_s / step_s) * step_s)


def _reversed(change: Change, at_s: FloatArray, here: Any) -> FloatArray:
    turned = at_s.copy()
    turned[here] = at_s[here][::-1]
    return turned


def _jitter(change: Change, at_s: FloatArray, here: Any) -> FloatArray:
    rng = np.random.default_rng(round(1e6 * change.share))
    return np.where(here, at_s + change.seconds * rng.random(len(at_s)), at_s)


STAMPS: dict[str, Callable[[Change, FloatArray, Any], FloatArray]] = {
    "shift": _shift,
    "every other 5 s": _every_other,
    "equal": _equal,
    "burst": _burst,
    "rounded": _rounded,
    "reversed": _reversed,
    "jitter": _jitter,
}
FRAMES = ("gap", "twice", "message shifted", "message away", "foreign")
FOREIGN_ID = 0x7A0
"""Carries nothing that is needed."""


def changed(block: FrameBlock, change: Change) -> FrameBlock:
    """The frames behind a change."""
    count = len(block)
    places = np.arange(count)
    start = min(int(change.share * count), count - 1)
    here = (places >= start) & (places < start + change.frames)
    if change.kind in STAMPS:
        return dataclasses.replace(block, time_s=STAMPS[change.kind](change, block.time_s, here))
    if change.kind == "gap":
        return block.select(~here) if not here.all() else block
    if change.kind == "twice":
        return block.select(np.sort(np.concatenate([places, places[here]])))
    if change.kind == "foreign":
        both = np.sort(np.concatenate([places, places[here]]))
        new = np.append(both[1:] == both[:-1], False)
        block = block.select(both)
        at_s = np.where(new, block.time_s + change.seconds, block.time_s)
        key = np.where(new, np.uint32(FOREIGN_ID), block.identifier)
        return dataclasses.replace(block, time_s=at_s, identifier=key)
    mine = block.identifier == block.identifier[start]
    if change.kind == "message away":
        return block.select(~(mine & here)) if not (mine & here).all() else block
    return dataclasses.replace(block, time_s=np.where(mine, block.time_s + change.seconds, block.time_s))


def in_order(block: FrameBlock, sentences: tuple[Sentence, ...]) -> list[FrameSlice | Sentence]:
    """A sentence stands before the first frame by which time has passed its own stamp."""
    latest_s = np.maximum.accumulate(block.time_s)
    items: list[FrameSlice | Sentence] = []
    at = 0
    for sentence, place in zip(
        sentences,
        latest_s.searchsorted([one.time_s for one in sentences], side="right").tolist(),
        strict=True,
    ):
        if place > at:
            items.append(FrameSlice(block, at, place))
            at = place
        items.append(sentence)
    return [*items, FrameSlice(block, at, len(block))] if at < len(block) else items


def reported(drive: Log, items: list[FrameSlice | Sentence], in_blocks: bool) -> dict[str, Any]:
    """All that a pass over a log tells: ticks with their faults, samples, counts."""
    source = TickSource(drive.config, drive.database)
    samples: list[Any] = []
    source.timeline.observe_rotations(Samples(samples))
    blocks, ticks = BlockSource(source), []
    for item in items:
        if isinstance(item, Sentence):
            ticks += source.on_sentence(item.time_s, item.line)
        elif in_blocks:
            ticks += list(blocks.on_frames(item.block, item.start, item.stop, BUS))
        else:
            for frame in item.block.frames(item.start, item.stop):
                ticks += source.on_frame(frame.time_s, frame.arbitration_id, frame.is_extended, frame.data)
    ticks += source.finish()
    return {
        "ticks": [exact(tick) for tick in ticks],
        "samples": samples,
        "decoder": +source.decoder.counts,
        "timeline": source.timeline.counts,
    }


KINDS = ("counts16", "counts8", "split", "speeds")
SECONDS = (1e-6, 0.001, 0.01, 0.03, 0.1, 0.2, 0.3, 0.45, 0.4999, 0.6, 1.0, 3.0, 6.0)
CHANGES = st.builds(
    Change,
    st.sampled_from([*STAMPS, *FRAMES]),
    st.floats(0.0, 1.0),
    st.sampled_from([1, 2, 5, 20, 100, 500, 5000]),
    st.sampled_from([*SECONDS, *(-seconds for seconds in SECONDS)]),
)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(
    st.sampled_from(KINDS), st.sampled_from(["motorway", "city"]), st.lists(CHANGES, min_size=1, max_size=4)
)
@example("counts8", "city", [Change("every other 5 s", 0.0, 1, 0.3)])
@example("split", "motorway", [Change("every other 5 s", 0.0, 1, -3.0)])
@example("counts8", "city", [Change("reversed", 0.9, 500, 1.0)])
@example("counts16", "motorway", [Change("message shifted", 0.95, 1, 0.4999)])
@example("counts16", "city", [Change("message shifted", 0.0, 1, 0.3), Change("message away", 0.3, 500, 0.0)])
@example("counts16", "motorway", [Change("foreign", 0.6, 1, -0.6)])
@example("speeds", "motorway", [Change("foreign", 0.6, 1, 5.5)])
def test_any_stamps(kind: str, route: str, changes: list[Change]) -> None:
    """Whatever stamps a log has, looking ahead in blocks tells what the frames tell one by one."""
    drive = log(kind, route)
    block = drive.block
    for change in changes:
        block = changed(block, change)
    items = in_order(block, drive.sentences)
    expected, actual = reported(drive, items, in_blocks=False), reported(drive, items, in_blocks=True)
    for key, value in expected.items():
        assert value == actual[key], key
