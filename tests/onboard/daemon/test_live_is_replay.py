"""A live run and the replay of its recording are the same; and why that is so."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.interfaces.cli.demo_play import watch_live
from tpmsd.interfaces.cli.replay import replay
from tpmsd.offline.simulator.drive import DriveSpec, SimulatedDrive, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault
from tpmsd.offline.simulator.receiver import ReceiverSpec
from tpmsd.onboard.monitor.records import AlarmEvent
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import FolderStream, Sentence


@pytest.fixture(scope="module")
def sparse_drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Config, list[CanFrame | Sentence]]:
    """A short drive whose frames are so few that time between them matters."""
    folder = tmp_path_factory.mktemp("sparse")
    receiver = ReceiverSpec(rate_hz=2.0, jitter_s=0.3, sentences=("RMC", "GGA", "VTG"), baud=9600)
    write_drive(folder, simulate_drive(DriveSpec(duration_s=30.0, seed=2, receiver=receiver)))
    config = load_config(folder)
    config = dataclasses.replace(config, filter=dataclasses.replace(config.filter, particles=10))
    kept = (
        item
        for index, item in enumerate(FolderStream(folder))
        if isinstance(item, Sentence) or index % 40 == 0
    )
    return config, list(kept)


def fed(config: Config, items: list[CanFrame | Sentence], reminders: list[float]) -> list[Step]:
    """Steps of a pipeline that is also told the time at `reminders`, seconds after the first item."""
    pipeline = Pipeline(config, load_database(config.can.dbc))
    start_s = items[0].time_s
    waiting = sorted(start_s + reminder for reminder in reminders)
    steps: list[Step] = []
    for item in items:
        while waiting and waiting[0] < item.time_s:
            steps += pipeline.advance(waiting.pop(0))
        if isinstance(item, CanFrame):
            steps += pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
        else:
            steps += pipeline.on_sentence(item.time_s, item.line)
    return steps + pipeline.finish()


def same(one: Step, other: Step) -> bool:
    """Whether two steps hold the very same numbers (faults apart, which are found when time is told)."""
    return (
        one.tick.time_s == other.tick.time_s
        and one.tick.gap_s == other.tick.gap_s
        and one.tick.fixes == other.tick.fixes
        and np.array_equal(one.tick.rotation_rad, other.tick.rotation_rad, equal_nan=True)
        and np.array_equal(one.estimate.deviation_m, other.estimate.deviation_m, equal_nan=True)
        and np.array_equal(one.estimate.covariance_m2, other.estimate.covariance_m2, equal_nan=True)
        and one.report.events == other.report.events
    )


@settings(derandomize=True, deadline=None, max_examples=25)
@example(reminders=[0.01 * k for k in range(3000)])
@given(reminders=st.lists(st.floats(0.0, 30.0), max_size=300))
def test_updating_the_time_changes_nothing(
    sparse_drive: tuple[Config, list[CanFrame | Sentence]], reminders: list[float]
) -> None:
    """However often the daemon says how late it is between two inputs, ticks and estimates are the same."""
    config, items = sparse_drive
    replayed, live = fed(config, items, []), fed(config, items, reminders)

    assert len(replayed) == len(live)
    assert [] == [index for index, pair in enumerate(zip(replayed, live, strict=True)) if not same(*pair)]


def punctured() -> SimulatedDrive:
    """Some minutes with a puncture, an outage of the receiver, and 15 s in which nothing is sent at all."""
    fault = Fault("puncture", 2.0, "percent", "rl", 110.0, 15.0)
    receiver = ReceiverSpec(outages=((60.0, 68.0),))
    drive = simulate_drive(DriveSpec(duration_s=160.0, seed=4, faults=(fault,), receiver=receiver))
    start_s = float(drive.truth()["start_host_s"])
    begin_s, end_s = start_s + 20.0, start_s + 35.0
    received = (drive.frames.time_s < begin_s) | (drive.frames.time_s > end_s)
    frames = dataclasses.replace(
        drive.frames,
        time_s=drive.frames.time_s[received],
        frame_id=drive.frames.frame_id[received],
        data=drive.frames.data[received],
    )
    lines = [line for line in drive.nmea if not begin_s < line.time_s < end_s]
    return dataclasses.replace(drive, frames=frames, nmea=lines)


def test_a_live_run_and_its_replay_are_the_same(tmp_path: Path) -> None:
    """A drive played live and recorded replays to the same ticks, radii to the last bit, and alarms."""
    drive = tmp_path / "drive"
    for speed_up in (30.0, 12.0, 5.0):
        # On a machine too busy for the speed, inputs come too late for their ticks, and the daemon says so.
        # That is not what is to be shown here.
        live: list[Step] = []
        shutil.rmtree(drive, ignore_errors=True)
        daemon = watch_live(
            punctured(),
            tmp_path / f"run-{speed_up:g}",
            speed_up=speed_up,
            channel="live-is-replay",
            record=drive,
            on_step=live.append,
            grace_real_s=0.4,
        )
        if not {"too_late", "bad_stamp"} & set(daemon.document()["can"]["faults"]):
            break
    config = load_config(drive)
    result = replay(drive, config)
    replayed = fed(config, list(FolderStream(drive)), [])

    assert 0 == daemon.document()["can"]["faults"].get("too_late", 0)
    alarms: list[AlarmEvent] = [event for step in live for event in step.report.events]
    assert ("deflation", "rl", "raised") in [(str(a.kind), a.wheel, a.state) for a in alarms]
    assert alarms == list(result.alarms)
    assert len(live) == len(replayed)
    assert [] == [index for index, pair in enumerate(zip(live, replayed, strict=True)) if not same(*pair)]
    for wheel, value_m in zip(result.wheels, live[-1].estimate.deviation_m, strict=True):
        assert value_m == wheel.deviation_m
