"""Whole logs in blocks against the same logs frame by frame, as the daemon takes them: to the last bit."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.places import RECORDINGS
from tests.exact import exact
from tests.onboard.timeline.events import Samples
from tpmsd.car.config.load import load_config
from tpmsd.offline.drives.reading import FolderRecording, play
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.bus_layouts import BUS_KINDS
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.sources.ahead.decoded_block import Reason
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.timeline.block_source import BlockSource, _Playback
from tpmsd.onboard.timeline.tick_source import TickSource

REAL = sorted(path.parent.name for path in RECORDINGS.glob("*/vehicle.toml")) if RECORDINGS.is_dir() else []


def said(source: TickSource, stream_counts: Any, ticks: list[Any], seen: list[Any]) -> dict[str, Any]:
    """All that a pass over a drive tells."""
    return {
        "ticks": [exact(tick) for tick in ticks],
        "samples": seen,
        "decoder": dict(source.decoder.counts),
        "timeline": source.timeline.counts,
        "stream": dict(stream_counts),
    }


def one_by_one(folder: Path) -> dict[str, Any]:
    """As a live run is given its frames."""
    config = load_config(folder)
    stream, database = FolderRecording(folder).open(config)
    source = TickSource(config, database)
    seen: list[Any] = []
    source.timeline.observe_rotations(Samples(seen))
    ticks = []
    for item in stream:
        if isinstance(item, CanFrame):
            if not (item.is_error or item.is_remote):
                bus = stream.buses.get(item.channel, 0)
                ticks += source.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data, bus)
        else:
            ticks += source.on_sentence(item.time_s, item.line)
    ticks += source.finish()
    return said(source, stream.counts, ticks, seen)


class Counting(BlockSource):
    """Counts the frames that went one by one."""

    single = 0

    def _play_one_by_one(self, block: Any, stop: int) -> Iterator[Any]:
        self.single += stop - self._at
        yield from super()._play_one_by_one(block, stop)


def in_blocks(folder: Path) -> tuple[dict[str, Any], float]:
    """As replay and diagnosis read it; and the share of frames that were decoded at once."""
    config = load_config(folder)
    stream, database = FolderRecording(folder).open(config)
    source = TickSource(config, database)
    seen: list[Any] = []
    source.timeline.observe_rotations(Samples(seen))
    blocks = Counting(source)
    ticks = list(play(stream, blocks))
    return said(source, stream.counts, ticks, seen), 1.0 - blocks.single / source.decoder.counts["frames"]


def assert_same(folder: Path, min_share: float) -> None:
    """Both passes tell the same, and so much of the drive went in blocks."""
    (expected, (actual, share)) = one_by_one(folder), in_blocks(folder)
    for key, value in expected.items():
        assert value == actual[key], key
    assert share >= min_share


@pytest.mark.skipif(not REAL, reason="no recordings")
@pytest.mark.parametrize("name", [name for name in REAL if name in ("rav4-suburb-60s", "van-oval")])
def test_real_recordings(name: str) -> None:
    """A recording gives the same ticks, samples, faults and counts, and nearly all of it goes in blocks."""
    assert_same(RECORDINGS / name, 0.9)


@pytest.mark.parametrize("kind", BUS_KINDS)
def test_every_bus_of_the_simulator(kind: str, tmp_path: Path) -> None:
    """Counters of 8 and 16 bits, either byte order, wheel speeds: the same, on a road with stops."""
    write_drive(tmp_path / "drive", simulate_drive(DriveSpec("city", 90.0, seed=5, bus=BusSpec(kind))))
    assert_same(tmp_path / "drive", 0.3)


@pytest.mark.parametrize("kind", BUS_KINDS)
def test_faulty_buses(kind: str, tmp_path: Path) -> None:
    """With frames lost and repeated and counters that restart the same faults are told at the same ticks."""
    bus = BusSpec(kind, lost_fraction=0.002, repeated_fraction=0.002, resets_s=(20.0,))
    write_drive(tmp_path / "drive", simulate_drive(DriveSpec("motorway", 40.0, seed=6, bus=bus)))
    assert_same(tmp_path / "drive", 0.1)


@cache
def lines() -> tuple[tuple[str, ...], dict[str, bytes]]:
    """The CAN log of a short drive at speed, and the other files."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "drive"
        write_drive(folder, simulate_drive(DriveSpec("motorway", 22.0, seed=7)))
        others = {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "can.log"}
        return tuple((folder / "can.log").read_text("ascii").splitlines()), others


def shifted(line: str, by_s: float) -> str:
    """A line with another stamp."""
    stamp, rest = line[1:].split(")", 1)
    return f"({float(stamp) + by_s:.6f}){rest}"


Change = Callable[[list[str], int], None]


def damage(place: int, text: str) -> Change:
    """Characters of one line are others."""

    def change(log: list[str], at: int) -> None:
        log[at] = log[at][:place] + text + log[at][place + len(text) :]

    return change


def turn_one_wheel(log: list[str], at: int) -> None:
    """The counter of one wheel goes on by itself for a while, also where the car stands."""
    for k, place in enumerate([place for place, line in enumerate(log) if place >= at and " 0B0#" in line]):
        if k < 150:
            damage(32, f"{k:02X}")(log, place)


CHANGES: list[Change] = [
    turn_one_wheel,
    lambda log, at: log.pop(at),
    lambda log, at: log.insert(at, log[at]),
    lambda log, at: log.__setitem__(at, shifted(log[at], -0.03)),
    lambda log, at: log.__setitem__(at, shifted(log[at], 0.7)),
    lambda log, at: log.__setitem__(slice(at, None), [shifted(line, 3.0) for line in log[at:]]),
    lambda log, at: log.__setitem__(slice(at, None), [shifted(line, -4.0) for line in log[at:]]),
    lambda log, at: log.__setitem__(slice(at, at + 200), []),
    lambda log, at: log.__setitem__(slice(at, at + 60), [x for x in log[at : at + 60] if " 0B0#" not in x]),
    lambda log, at: log.insert(at, f"{log[at].split(' ')[0]} can0 20000080#0000000000000000"),
    lambda log, at: log.insert(at, f"{log[at].split(' ')[0]} can0 0B0#R"),
    lambda log, at: log.__setitem__(at, log[at][:-4]),
    damage(2, "9"),
    damage(32, "FFFF"),
    damage(32, "0000"),
]


@settings(derandomize=True, deadline=None, max_examples=20)
@given(st.lists(st.tuples(st.sampled_from(CHANGES), st.floats(0.0, 1.0)), max_size=6))
def test_faulty_lines(changes: list[tuple[Change, float]]) -> None:
    """Whatever is lost, repeated, damaged, late, or stepped in the log: what is told is the same."""
    log, others = lines()
    changed = list(log)
    for change, share in changes:
        change(changed, round(share * (len(changed) - 210)))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, content in others.items():
            (folder / file).write_bytes(content)
        (folder / "can.log").write_text("\n".join(changed) + "\n", "ascii")
        assert_same(folder, 0.0)


def test_a_healthy_drive_goes_in_blocks(tmp_path: Path) -> None:
    """Once the car is known to stand or rolls, and nothing is odd, all frames are decoded at once."""
    log, others = lines()
    for file, content in others.items():
        (tmp_path / file).write_bytes(content)
    (tmp_path / "can.log").write_text("\n".join(log) + "\n", "ascii")
    assert_same(tmp_path, 0.93)


def test_a_standing_car_on_a_full_bus(tmp_path: Path) -> None:
    """Frames that nobody needs pass together while the car stands, too: errors among them are no frames."""
    log, others = lines()
    for file, content in others.items():
        (tmp_path / file).write_bytes(content)
    full = []
    for number, line in enumerate(log):
        stamp = line.split(" ")[0]
        full += [line, *(f"{stamp} can0 7A{k:X}#{number:016X}" for k in range(9))]
        if number % 50 == 7:
            full.append(f"{stamp} can0 20000080#0000000000000000")
    (tmp_path / "can.log").write_text("\n".join(full) + "\n", "ascii")
    assert_same(tmp_path, 0.93)


def no_wheels(log: list[str]) -> list[str]:
    """The lines of other messages than that of the wheels."""
    return [line for line in log if " 0B0#" not in line]


def test_what_ends_a_range_is_counted(tmp_path: Path) -> None:
    """A lost frame ends one range more than the sound log has, a message that is silent or a wheel that jumps
    another, each by its name; values that are doubted behind the jump end one more."""

    def ended(name: str, change: Change) -> Counter[str]:
        log, others = lines()
        changed, folder = list(log), tmp_path / name
        change(changed, next(at for at, line in enumerate(log) if at > len(log) // 2 and " 0B0#" in line))
        folder.mkdir()
        for file, content in others.items():
            (folder / file).write_bytes(content)
        (folder / "can.log").write_text("\n".join(changed) + "\n", "ascii")
        config = load_config(folder)
        stream, database = FolderRecording(folder).open(config)
        blocks = BlockSource(TickSource(config, database))
        list(play(stream, blocks))
        return blocks.ended

    sound = ended("sound", lambda log, at: None)
    assert Counter({Reason.ARRIVAL: 1}) == ended("lost", lambda log, at: log.pop(at)) - sound
    silent = ended(
        "silent", lambda log, at: log.__setitem__(slice(at, at + 400), no_wheels(log[at : at + 400]))
    )
    assert 1 == (silent - sound)[Reason.SILENCE]
    assert Counter({Reason.READING: 1, Reason.UNUSABLE: 1}) == ended("jump", damage(32, "FFFF")) - sound


@pytest.mark.parametrize("planned", [True, False])
@pytest.mark.parametrize("needs", [True, False])
def test_samples_are_handed_on_where_a_tick_is_not_planned_or_an_observer_needs_them(
    planned: bool, needs: bool
) -> None:
    """Samples before a tick go to the timeline unless it was planned and nobody observes; none goes twice,
    and what was not handed on goes with the next."""
    taken: list[list[float]] = []
    tick = object()
    timeline = SimpleNamespace(
        shift_s=0.0,
        plan=lambda decoded: SimpleNamespace(tick=lambda *_: tick) if planned else None,
        observer_needs=lambda end_s, shown_s: needs,
        add_samples=lambda runs, readings, shift_s: taken.append(
            [one for _, _, values in readings for one in values]
        ),
    )
    times_s = np.array([0.0, 0.01, 0.02, 0.03])
    group = SimpleNamespace(indices=np.array([0, 1, 3]), time_s=times_s[[0, 1, 3]])
    yaw = SimpleNamespace(group=0, role="yaw_rate", value=np.array([1.0, 2.0, 3.0]))
    decoded = SimpleNamespace(start=0, stop=4, groups=[group], wheels=[], readings=[yaw])
    playback = _Playback(SimpleNamespace(time_s=times_s), decoded, timeline)  # type: ignore[arg-type]

    assert (playback.planned_tick(0, 0.015, 2) is tick) == planned
    assert taken == ([] if planned and not needs else [[1.0, 2.0]])
    playback.hand_on(4)
    assert [one for part in taken for one in part] == [1.0, 2.0, 3.0]


def test_ticks_of_a_healthy_drive_are_planned(tmp_path: Path) -> None:
    """Nine in ten are computed at once, before their frames are played. Each is asked for when it is
    due: also without a receiver, whose sentences let time pass, not several at one instant."""
    log, others = lines()
    for file, content in others.items():
        if file != "gnss.nmea":
            (tmp_path / file).write_bytes(content)
    (tmp_path / "can.log").write_text("\n".join(log) + "\n", "ascii")
    config = load_config(tmp_path)
    stream, database = FolderRecording(tmp_path).open(config)
    source = TickSource(config, database)
    planned: list[bool] = []
    made_s: list[float] = []

    class Planning(BlockSource):
        def planned_tick(self, index: int, end_s: float) -> Any:
            tick = super().planned_tick(index, end_s)
            planned.append(tick is not None)
            made_s.append(source.timeline._clock.latest_s)
            return tick

    ticks = list(play(stream, Planning(source)))
    assert len(planned) == len(ticks) >= 200
    assert sum(planned) >= 0.9 * len(planned)
    assert [0.1] * 100 == pytest.approx(np.diff(made_s[50:151]).tolist(), abs=0.05)


def test_readings_that_no_tick_needs_any_more_are_forgotten(tmp_path: Path) -> None:
    """At no tick of a drive of 22 s does a wheel keep those of more than 1.5 s, holdback included."""
    log, others = lines()
    for file, content in others.items():
        (tmp_path / file).write_bytes(content)
    (tmp_path / "can.log").write_text("\n".join(log) + "\n", "ascii")
    config = load_config(tmp_path)
    stream, database = FolderRecording(tmp_path).open(config)
    source, seen = TickSource(config, database), list[Any]()
    source.timeline.observe_rotations(Samples(seen))
    tracks = source.timeline._tracks
    kept = [max(len(track._times) for track in tracks) for _ in play(stream, BlockSource(source))]
    assert 200 <= len(kept) <= len(seen) / 4
    assert max(kept) <= 1.5 * len(seen) / 4 / 22.0
