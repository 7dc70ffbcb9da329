"""The recording knows of time that passes without inputs, so that its replay sees the same pauses."""

from __future__ import annotations

from pathlib import Path

from tests.onboard.daemon.fakes import car, wheels_frame
from tpmsd.onboard.daemon.feeder import Feeder
from tpmsd.onboard.daemon.input_queue import InputQueue
from tpmsd.onboard.daemon.recorder import DriveRecorder
from tpmsd.onboard.pipeline import Pipeline

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
