"""Frames that carry nothing take a short way through `TickSource`; it makes no difference but in time."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.exact import exact
from tpmsd.car.config.load import load_config
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import FolderStream
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.tick_source import TickSource


class LongWay(TickSource):
    """Every frame goes through all stages."""

    def on_frame(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
    ) -> list[Tick]:
        ticks = self.advance(time_s)
        for event in self.decoder.decode(time_s, arbitration_id, is_extended, data, bus):
            ticks += self.timeline.add(event)
        return ticks


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pace")
    write_drive(path, simulate_drive(DriveSpec(duration_s=20.0, seed=3)))
    return path


@settings(derandomize=True, deadline=None, max_examples=15)
@given(
    st.lists(st.tuples(st.integers(0, 3000), st.floats(-3.0, 9.0)), max_size=60),
    st.lists(st.tuples(st.integers(0, 3000), st.floats(0.0, 8.0)), max_size=3),
)
def test_the_short_way_makes_the_same_ticks(
    folder: Path, strange: list[tuple[int, float]], steps: list[tuple[int, float]]
) -> None:
    """Ignored frames at odd times (late, early, far ahead) between those of a drive, whose clock steps:
    ticks, faults and counts are equal to the last bit."""
    config = load_config(folder)
    database = load_database(config.can.dbc)
    short, long = TickSource(config, database), LongWay(config, database)
    extra = dict(strange)
    jumps = dict(steps)
    shift = 0.0
    made: tuple[list[Tick], list[Tick]] = ([], [])
    for k, item in enumerate(FolderStream(folder)):
        shift -= jumps.get(k, 0.0)
        time_s = item.time_s + shift
        for source, ticks in zip((short, long), made, strict=True):
            if isinstance(item, CanFrame):
                ticks += source.on_frame(time_s, item.arbitration_id, item.is_extended, item.data)
            else:
                ticks += source.on_sentence(time_s, item.line)
            ticks += source.on_frame(time_s + 0.001, 0x7E1, False, b"\x00")
            if k in extra:
                ticks += source.on_frame(time_s + extra[k], 0x7E2, False, b"")
    for source, ticks in zip((short, long), made, strict=True):
        ticks += source.finish()
    assert len(made[0]) > 100
    assert exact(made[0]) == exact(made[1])
    assert short.decoder.counts == long.decoder.counts
    assert short.timeline.counts == long.timeline.counts


def test_frames_behind_one_that_meets_something_due_are_not_passed_by(folder: Path) -> None:
    """Also where their stamps are earlier: a clock that stepped back is for the long way."""
    config = load_config(folder)
    source = TickSource(config, load_database(config.can.dbc))
    items = [item for item in FolderStream(folder) if isinstance(item, CanFrame)][:400]
    for item in items:
        source.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
    now_s = items[-1].time_s

    assert 2 == source.pass_empty_frames([now_s, now_s + 1e-4, now_s + 30.0, now_s + 2e-4, now_s + 3e-4])
