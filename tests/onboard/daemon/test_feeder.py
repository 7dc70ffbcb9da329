"""The recording knows of time that passes without inputs, so that its replay sees the same pauses."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.onboard.daemon.fakes import car, wheels_frame
from tpmsd.onboard.daemon.feeder import HOLD_S, Feeder
from tpmsd.onboard.daemon.input_queue import InputQueue
from tpmsd.onboard.daemon.recorder import DriveRecorder
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sources.drive import FolderStream, Sentence

GRACE_S = 0.25


def recorded(folder: Path, readings: list[tuple[float, float]]) -> list[float]:
    """Stamps of the marks in a recording of one frame at 1000 s; `readings`: wall clock and monotonic, s."""
    config, database = car(folder / "car")
    recorder = DriveRecorder(folder / "drive", config)
    queue = InputQueue()
    queue.put_frame(wheels_frame(1000.0), 1000.0, 1000.0)
    feeder = Feeder(Pipeline(config, database), queue, recorder, GRACE_S)
    for now_s, monotonic_s in readings:
        feeder.feed(now_s, monotonic_s, lambda _: [])
    feeder.finish()
    recorder.close()
    return [
        float(line[1:].partition(")")[0])
        for line in (folder / "drive/gnss.nmea").read_text("ascii").splitlines()
    ]


def test_silence_is_recorded_once_a_second(tmp_path: Path) -> None:
    """A second behind the last stamp, with the time known before it; at the end the last time of all."""
    readings = [(1000.25 + 0.25 * k, 0.25 * k) for k in range(11)]
    assert [1000.75, 1001.0, 1001.75, 1002.0, 1002.5] == recorded(tmp_path, readings)


def test_a_pause_of_the_process_is_recorded_with_both_its_ends(tmp_path: Path) -> None:
    """The last time known before it, and the time behind it."""
    assert [1000.25, 1030.0] == recorded(tmp_path, [(1000.25, 0.0), (1000.5, 0.25), (1030.25, 30.0)])


def test_a_replay_sees_every_mark_of_a_pause_at_the_start(tmp_path: Path) -> None:
    """The first mark stands alone, 30 s before those of the silence behind the pause."""
    readings = [(1000.25, 0.0), (1000.5, 0.25), *((1030.25 + k, 30.0 + k) for k in range(4))]
    marks = recorded(tmp_path, readings)

    assert [1000.25, 1030.0] == marks[:2]
    assert marks == [item.time_s for item in FolderStream(tmp_path / "drive") if isinstance(item, Sentence)]


@pytest.mark.parametrize(("step_s", "steps"), [(0.2, 0), (-0.2, 0), (0.3, 1), (-0.3, 1), (1.0, 1)])
def test_a_quarter_of_a_second_is_a_step_of_the_clock(step_s: float, steps: int, tmp_path: Path) -> None:
    """Less is slewing, either way."""
    config, database = car(tmp_path)
    feeder = Feeder(Pipeline(config, database), InputQueue(), None, GRACE_S)
    for now_s, monotonic_s in ((1000.0, 0.0), (1000.1 + step_s, 0.1), (1000.2 + step_s, 0.2)):
        feeder.feed(now_s, monotonic_s, lambda _: [])

    assert steps == feeder.clock_steps


@pytest.mark.parametrize("stamped", [False, True])
def test_behind_a_step_of_the_clock_a_stamp_is_waited_for(stamped: bool, tmp_path: Path) -> None:
    """A replay notices the step with the first stamp behind it: until then, or for a second, time stands."""
    config, database = car(tmp_path)
    moved_s: list[float] = []

    class Moved(Pipeline):
        def advance(self, time_s: float) -> list[Step]:
            moved_s.append(monotonic_s)
            return super().advance(time_s)

    queue = InputQueue()
    feeder = Feeder(Moved(config, database), queue, None, GRACE_S)
    for quarter in range(40):
        monotonic_s = 0.25 * quarter
        now_s = 1000.0 + monotonic_s + (3600.0 if monotonic_s >= 5.0 else 0.0)
        if stamped and monotonic_s == 5.5:
            queue.put_frame(wheels_frame(now_s - GRACE_S), now_s - GRACE_S, now_s)
        feeder.feed(now_s, monotonic_s, lambda _: [])
    held_s = [0.25 * k for k in range(20, 40) if 0.25 * k not in moved_s]

    assert [0.25 * k for k in range(20)] == [at_s for at_s in moved_s if at_s < 5.0][:20]
    assert [5.0 + 0.25 * k for k in range(2 if stamped else round(4.0 * HOLD_S))] == held_s
    assert 1.0 == HOLD_S
