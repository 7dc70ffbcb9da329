"""The core from stamped inputs to alarms: simulated drives, live against replay, and what survives."""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import DEFAULT_METHOD, Config
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.replay import replay
from tpmsd.offline.report.replay_result import ReplayResult
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, SimulatedDrive, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault
from tpmsd.offline.simulator.receiver import ReceiverSpec
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sources.can.decoder import load_database

ONSET_S = 110.0
BUSES = {
    "counts16": (BusSpec(kind="counts16"), ReceiverSpec()),
    "speeds": (BusSpec(kind="speeds"), ReceiverSpec()),
    "counts16, 1 Hz receiver": (BusSpec(kind="counts16"), ReceiverSpec(rate_hz=1.0)),
}


def drive(bus: str, wheel: str | None, duration_s: float = 180.0, route: str = "mixed") -> SimulatedDrive:
    """The same drive of one seed, with a puncture of 2 % within 30 s or without."""
    faults = () if wheel is None else (Fault("puncture", 2.0, wheel=wheel, onset_s=ONSET_S),)
    spec, receiver = BUSES[bus]
    return simulate_drive(
        DriveSpec(route=route, duration_s=duration_s, seed=3, bus=spec, receiver=receiver, faults=faults)
    )


BOTH = pytest.mark.parametrize("method", ["gaussian-sum", "mpf-pn"])
"""The filters that are held to the same bars."""


def configured(folder: Path, method: str) -> Config:
    """The configuration of a drive with one of the filters."""
    config = load_config(folder)
    return replace(config, filter=replace(config.filter, method=method))


def replayed(folder: Path, simulated: SimulatedDrive, method: str = DEFAULT_METHOD) -> ReplayResult:
    write_drive(folder, simulated)
    return replay(folder, configured(folder, method))


@pytest.mark.parametrize("wheel", WHEELS)
@pytest.mark.parametrize(
    ("bus", "method"), [*((bus, "gaussian-sum") for bus in BUSES), ("counts16", "mpf-pn")]
)
def test_a_puncture_is_announced_on_its_wheel(tmp_path: Path, bus: str, wheel: str, method: str) -> None:
    """-2 % within 30 s: deflation of that very wheel within 60 s of the onset, and no alarm of another."""
    result = replayed(tmp_path, drive(bus, wheel), method)
    assert {wheel} == {alarm.wheel for alarm in result.alarms}
    assert {"raised"} == {alarm.state for alarm in result.alarms}
    deflations = [alarm for alarm in result.alarms if alarm.kind == "deflation"]
    assert 1 == len(deflations)
    after_s = deflations[0].time_s - result.start_s - ONSET_S
    assert 0.0 < after_s < 60.0
    # By the end the change has the size it has.
    change = float(result.change_m[-1, WHEELS.index(wheel)])
    assert -0.02 * 0.316 == pytest.approx(change, rel=0.15)


@pytest.mark.parametrize("bus", BUSES)
def test_the_same_drive_without_a_fault_is_quiet(tmp_path: Path, bus: str) -> None:
    """Without the puncture, the drive of that seed has no alarm, and its radii are those of the truth."""
    simulated = drive(bus, None)
    result = replayed(tmp_path, simulated)
    assert () == tuple(result.alarms)
    truth = simulated.truth()["deviation_m"]
    for k, wheel in enumerate(WHEELS):
        assert truth[wheel][-1] == pytest.approx(float(result.deviation_m[-1, k]), abs=1.2e-3)


def test_two_wheels_on_the_bus_are_enough_for_the_rear(tmp_path: Path) -> None:
    """With the rear pair alone a soft rear tyre is announced too."""
    simulated = simulate_drive(
        DriveSpec(
            duration_s=180.0,
            seed=3,
            bus=BusSpec(wheels=2),
            faults=(Fault("puncture", 2.0, wheel="rl", onset_s=ONSET_S),),
        )
    )
    result = replayed(tmp_path, simulated)
    first = result.alarms[0]
    assert ("deflation", "rl") == (first.kind, first.wheel)
    assert first.time_s - result.start_s - ONSET_S < 60.0
    assert {"rl"} == {alarm.wheel for alarm in result.alarms}


# -- live is replay -----------------------------------------------------------------------------------------

Input = tuple[float, int, bytes]
"""(host time, identifier or -1 for a sentence, payload)."""


def inputs(simulated: SimulatedDrive) -> Iterator[Input]:
    log = simulated.frames
    frames = (
        (float(t), int(i), bytes(data)) for t, i, data in zip(log.time_s, log.frame_id, log.data, strict=True)
    )
    lines = ((line.time_s, -1, line.text.encode()) for line in simulated.nmea)
    return heapq.merge(frames, lines, key=lambda item: item[0])


def pipeline(folder: Path, method: str = DEFAULT_METHOD) -> Pipeline:
    config = configured(folder, method)
    return Pipeline(config, load_database(config.can.dbc))


def feed(core: Pipeline, item: Input) -> list[Step]:
    time_s, identifier, payload = item
    if identifier < 0:
        return core.on_sentence(time_s, payload)
    return core.on_frame(time_s, identifier, identifier >= 0x800, payload)


def essence(steps: list[Step]) -> list[str]:
    return [repr((s.tick, s.estimate.deviation_m, s.estimate.east_m, s.report.events)) for s in steps]


def test_a_timer_changes_nothing(tmp_path: Path) -> None:
    """A daemon that lets time pass every few milliseconds makes the very steps of a replay."""
    simulated = drive("counts16", "rl", duration_s=60.0)
    write_drive(tmp_path, simulated)
    plain, timed = pipeline(tmp_path), pipeline(tmp_path)
    rng = np.random.default_rng(1)
    a: list[Step] = []
    b: list[Step] = []
    before: float | None = None
    for item in inputs(simulated):
        if before is not None and rng.random() < 0.3:
            b += timed.advance(before + float(rng.random()) * (item[0] - before))
        a += feed(plain, item)
        b += feed(timed, item)
        before = item[0]
    a += plain.finish()
    b += timed.finish()
    assert len(a) > 580
    assert essence(a) == essence(b)


@BOTH
def test_a_restart_goes_on_where_it_was(tmp_path: Path, method: str) -> None:
    """A pipeline that took up another's snapshot monitors at once, and finds a puncture on the next drive."""
    learn = drive("counts16", None, duration_s=120.0)
    write_drive(tmp_path, learn)
    first = pipeline(tmp_path, method)
    for item in inputs(learn):
        feed(first, item)
    saved = json.loads(json.dumps(first.snapshot(), allow_nan=False))
    second = pipeline(tmp_path, method)
    second.restore(saved)
    assert saved["monitor"] == second.snapshot()["monitor"]
    steps = [
        step for item in inputs(drive("counts16", "rr", duration_s=160.0)) for step in feed(second, item)
    ]
    assert 1.0 == steps[0].report.learning_fraction
    events = [event for step in steps for event in step.report.events]
    assert ("deflation", "rr", "raised") == (str(events[0].kind), events[0].wheel, events[0].state)
    assert {"rr"} == {event.wheel for event in events}


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder of a drive without a fault, and the snapshot after it, as JSON."""
    folder, learn = tmp_path_factory.mktemp("learned"), drive("counts16", None, duration_s=90.0)
    write_drive(folder, learn)
    first = pipeline(folder)
    for item in inputs(learn):
        feed(first, item)
    return folder, json.dumps(first.snapshot())


@pytest.mark.parametrize(
    "damage",
    [
        {"monitor": None},
        {"estimator": None},
        {"estimator": {}},
        {"monitor": {}},
        {"estimator": {"order": [2, 3, 0, 1]}},
    ],
    ids=str,
)
def test_half_a_snapshot_is_refused_whole(learned: tuple[Path, str], damage: dict[str, object]) -> None:
    """If one part does not fit, a ValueError, and neither part is restored."""
    folder, saved = learned[0], json.loads(learned[1])
    assert saved["monitor"]["sets"]["baseline"]["ready"] is True
    second = pipeline(folder)
    before = repr(second.snapshot())
    for broken in ({**saved, **damage}, {k: v for k, v in saved.items() if k not in damage}):
        with pytest.raises(ValueError):
            second.restore(broken)
        assert before == repr(second.snapshot())


def test_any_bytes_pass_through_the_core(tmp_path: Path) -> None:
    """Frames with any payload and any length, and lines of noise, never raise, and no radius becomes NaN."""
    simulated = drive("counts16", None, duration_s=30.0)
    write_drive(tmp_path, simulated)
    core = pipeline(tmp_path)
    rng = np.random.default_rng(2)
    steps: list[Step] = []
    for time_s, identifier, payload in inputs(simulated):
        if rng.random() < 0.05:
            payload = rng.bytes(int(rng.integers(0, 9)) if identifier >= 0 else int(rng.integers(0, 90)))
        steps += feed(core, (time_s, identifier, payload))
    steps += core.finish()
    assert len(steps) > 280
    assert all(math.isfinite(x) for step in steps for x in step.estimate.deviation_m)
    assert [] == [event for step in steps for event in step.report.events]


def test_what_is_stated_holds_a_receivers_scale(tmp_path: Path) -> None:
    """A standard deviation of a radius is that of the estimate and 0.1 % of the radius, in quadrature, for a
    wheel, an alarm that stands and one that is raised."""
    made = drive("counts16", "rl", duration_s=160.0)
    write_drive(tmp_path, made)
    steps = [step for core in [pipeline(tmp_path)] for item in inputs(made) for step in feed(core, item)]
    radius_m = load_config(tmp_path).vehicle.wheel_radius_m
    for step in steps:
        known_m2 = np.diag(step.estimate.covariance_m2) + (1e-3 * np.array(radius_m)) ** 2
        reported = [wheel.std_m for wheel in step.report.wheels if np.isfinite(wheel.std_m)]
        assert len(reported) in (0, 4)
        np.testing.assert_allclose(reported, np.sqrt(known_m2)[: len(reported)], rtol=1e-12)
        for event in step.report.events:
            assert event.wheel is not None
            assert event.std_m == step.report.wheels[WHEELS.index(event.wheel)].std_m
            assert event in step.report.active
    assert any(step.report.events for step in steps)
