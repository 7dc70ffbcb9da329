"""A reset reaches the pipeline as an input among the others: live, recorded and replayed alike."""

from __future__ import annotations

import dataclasses
import logging
import os
import time
from pathlib import Path

import pytest

from tests.onboard.daemon.fakes import DrivingBus, FakeBus, car, listening
from tpmsd.car.config.model import AlarmsConfig
from tpmsd.onboard.daemon.bus_link import reset_filters
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.recorder import DriveRecorder
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sinks.reset_request import ResetRequest, to_frame, to_sentence
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import FolderStream

SCALE = 20.0
LOG = logging.getLogger("tests.reset")


def test_a_reset_is_recorded_and_its_replay_resets_at_the_same_tick(tmp_path: Path) -> None:
    """Asked after ten seconds: the tick that takes it live is the tick that takes it in the replay."""
    config, database = car(tmp_path / "car")
    clock = Clock(SCALE)
    recorder = DriveRecorder(tmp_path / "drive", config)
    live: list[Step] = []
    answers: list[str] = []

    def watch(step: Step) -> None:
        live.append(step)
        if len(live) == 100:
            answers.append(daemon.reset("winter"))
            answers.append(daemon.reset("No name"))

    daemon = listening(
        config,
        database,
        clock,
        DrivingBus(clock.now).opener(),
        watch,
        recorder=recorder,
        grace_s=0.05 * SCALE,
    )
    daemon.run(30.0)
    assert ["", True] == [answers[0], "no name of a set" in answers[1]]

    pipeline = Pipeline(config, database)
    steps: list[Step] = []
    for item in FolderStream(recorder.folder):
        if isinstance(item, CanFrame):
            steps += pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
        else:
            steps += pipeline.on_sentence(item.time_s, item.line)
    steps += pipeline.finish()
    was, again = _tyres(live), _tyres(steps)
    common = was.keys() & again.keys()
    assert len(common) > 100
    assert {time_s: was[time_s] for time_s in common} == {time_s: again[time_s] for time_s in common}
    assert {("default", 0), ("winter", 1)} == {again[time_s] for time_s in common}


def _tyres(steps: list[Step]) -> dict[float, tuple[str, int]]:
    """Set of tyres and number of resets by the tick's time in whole milliseconds: where the first tick is
    another, the last bits of a time are."""
    reports = {round(step.tick.time_s, 3): step.report.learning for step in steps}
    return {time_s: (one.tyres, one.resets) for time_s, one in reports.items() if one is not None}


def test_the_bus_may_ask_only_where_that_is_configured(tmp_path: Path) -> None:
    """With an identifier configured a right frame resets, a wrong one does not; repetitions are one request;
    without, nothing does."""
    config, database = car(tmp_path)
    assert [] == reset_filters(config.alarms)
    pipeline = Pipeline(config, database)
    pipeline.on_frame(1000.0, 0x6F2, False, to_frame(2))
    assert "default" == pipeline.monitor.learning().tyres

    config = dataclasses.replace(config, alarms=AlarmsConfig(reset_id=0x6F2))
    assert [{"can_id": 0x6F2, "can_mask": 0x7FF, "extended": False}] == reset_filters(config.alarms)
    pipeline = Pipeline(config, database)
    pipeline.on_frame(1000.0, 0x6F2, False, b"\0" + to_frame(2)[1:])
    pipeline.on_frame(1000.5, 0x6F2, True, to_frame(2))
    assert 0 == pipeline.monitor.learning().resets
    for k in range(5):
        pipeline.on_frame(1001.0 + 0.1 * k, 0x6F2, False, to_frame(2))
    assert ("set2", 1) == (pipeline.monitor.learning().tyres, pipeline.monitor.learning().resets)
    pipeline.on_frame(1010.0, 0x6F2, False, to_frame())
    assert ("set2", 2) == (pipeline.monitor.learning().tyres, pipeline.monitor.learning().resets)


def test_a_sentence_with_a_wrong_checksum_resets_nothing(tmp_path: Path) -> None:
    """A torn line of a recording is none."""
    config, database = car(tmp_path)
    pipeline = Pipeline(config, database)
    right = to_sentence(ResetRequest("winter"))
    pipeline.on_sentence(1000.0, right[:-1] + b"!")
    assert 0 == pipeline.monitor.learning().resets
    pipeline.on_sentence(1000.0, right)
    assert 1 == pipeline.monitor.learning().resets


class LyingReceiver:
    """A receiver's line that carries the daemon's own kind of sentence again and again."""

    def __init__(self) -> None:
        self._ends = os.pipe()
        os.write(self._ends[1], b"x")

    def open(self) -> None:
        """Nothing to open."""

    def fileno(self) -> int:
        return self._ends[0]

    def read(self) -> bytes:
        time.sleep(0.01)
        return to_sentence(ResetRequest("winter")) + b"\r\n"

    def close(self) -> None:
        """Close both ends."""
        for end in self._ends:
            os.close(end)


def test_a_receiver_cannot_ask_for_a_reset(tmp_path: Path) -> None:
    """A sentence of the daemon's own kind of a receiver is left out; the request over the socket is taken."""
    config, database = car(tmp_path, '[gnss]\nsource = "serial:/dev/lying"\n')
    clock = Clock(SCALE)
    resets: list[int] = []

    def watch(step: Step) -> None:
        assert step.report.learning is not None
        resets.append(step.report.learning.resets)
        if len(resets) == 100:
            daemon.reset(None)

    more = {"open_receiver": lambda _: LyingReceiver(), "grace_s": 0.05 * SCALE}
    daemon = listening(config, database, clock, DrivingBus(clock.now).opener(), watch, **more)
    daemon.run(30.0)

    assert 0 == max(resets[:100])
    assert 1 == resets[-1]


class HandClock(Clock):
    """A clock that stands until a test moves it."""

    at_s = 1000.0

    def monotonic(self) -> float:
        return self.at_s


def test_the_socket_may_ask_again_after_five_seconds(tmp_path: Path) -> None:
    """A second request within 5 s is refused with the reason, one after them is taken."""
    config, database = car(tmp_path)
    clock = HandClock()
    daemon = listening(config, database, clock, FakeBus().opener(), lambda _: None)
    refused = []
    for at_s in (1000.0, 1004.9, 1005.0, 1009.0, 1010.1):
        clock.at_s = at_s
        refused.append(daemon.reset(None))

    moment = "a reset was asked for a moment ago"
    assert ["", moment, "", moment, ""] == refused


def test_the_log_names_the_set_that_is_learned_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A request that names a set of tyres is logged with its name, one without is not."""
    config, database = car(tmp_path)
    clock = HandClock()
    daemon = listening(config, database, clock, FakeBus().opener(), lambda _: None, log=LOG)
    caplog.set_level(logging.INFO)
    daemon.reset("winter")
    clock.at_s += 6.0
    daemon.reset(None)
    reported = [text for text in caplog.messages if text.startswith("asked to learn")]
    assert ["asked to learn the tyres again (winter)", "asked to learn the tyres again"] == reported
