"""What the event loop logs, what ends it, and which bus is which, on a clock that leaps."""

from __future__ import annotations

import logging
import os
import re
import signal
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tests.onboard.daemon.fakes import DrivingBus, FakeBus, LeapingClock, car, listening
from tests.onboard.daemon.test_loop import LOG, run
from tests.onboard.daemon.test_obd import may_ask
from tpmsd.car.config.load import load_config
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sinks.reset_request import ResetRequest, to_sentence
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame


def test_the_first_tick_is_logged_once_and_the_state_every_five_seconds(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Of the line that the service manager is given: the first tick for everybody, the rest for who wants
    details."""
    caplog.set_level(logging.DEBUG, LOG.name)
    config, database = car(tmp_path)
    clock = LeapingClock()
    came: list[tuple[int, str, float]] = []

    class Kept(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            came.append((record.levelno, record.getMessage(), clock.leapt_s))

    handler = Kept()
    LOG.addHandler(handler)
    try:
        run(config, database, clock, DrivingBus(clock.now), 22.0, grace_s=0.06)
    finally:
        LOG.removeHandler(handler)

    lines = [one for one in came if "ticks, " in one[1]]
    first = [text for level, text, _ in lines if level == logging.INFO]
    assert [True] == [
        bool(re.fullmatch(r"first tick: .*; receiver off; 1 ticks, \d late", one)) for one in first
    ]
    times = [at_s for level, _, at_s in lines if level == logging.DEBUG]
    assert (5, 0) == (len(times), int(times[0]))
    assert all(4.95 <= later - earlier < 5.25 for earlier, later in pairwise(times))
    assert f"tpmsd watches CAN {config.can.channel}, receiver none" == came[0][1]
    assert "stopping: 22 s are over" == next(text for _, text, _ in came if text.startswith("stopping"))


def test_a_signal_stops_it_by_name_and_the_first_reason_counts(tmp_path: Path) -> None:
    """What is asked for after that changes nothing, and the ticks until then are made."""
    config, database = car(tmp_path)
    clock, before = LeapingClock(), signal.signal(signal.SIGHUP, signal.SIG_DFL)
    seen: list[float] = []

    def watch(step: Step) -> None:
        seen.append(clock.leapt_s)
        if len(seen) == 20:
            assert "" == daemon.stopped_by
            signal.raise_signal(signal.SIGHUP)
        elif daemon.stopped_by:
            daemon.stop("later")

    daemon = listening(config, database, clock, DrivingBus(clock.now).opener(), watch, grace_s=0.06, log=LOG)
    try:
        daemon.run(600.0)
    finally:
        signal.signal(signal.SIGHUP, before)

    assert "SIGHUP" == daemon.stopped_by
    assert 20 < len(seen) == daemon.ticks < 30


class RealTime(LeapingClock):
    """Leaps over waits alone, which are never longer than a tick: a longer time is a lateness to be said."""

    def to_real(self, seconds: float) -> float:
        return seconds if seconds > 0.5 else super().to_real(seconds)


class LateBus(DrivingBus):
    """A process that is held up every five seconds while it looks at the bus."""

    def __init__(self, clock: LeapingClock, held_up_s: float) -> None:
        super().__init__(clock.now)
        self._clock, self._held_up_s, self._due_s = clock, held_up_s, 5.0

    def read(self, limit: int = 1000) -> list[CanFrame]:
        if self._clock.leapt_s >= self._due_s:
            self._due_s += 5.0
            self._clock.leapt_s += self._held_up_s
        return super().read(limit)


@pytest.mark.parametrize(("held_up_s", "said"), [(0.8, 0), (1.3, 3)])
def test_a_loop_that_is_a_second_late_says_so_once_a_minute(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, held_up_s: float, said: int
) -> None:
    """Held up every five seconds for 130 s: with the first, and then behind each minute."""
    config, database = car(tmp_path)
    clock = RealTime()
    daemon = run(config, database, clock, LateBus(clock, held_up_s), 130.0, grace_s=0.06)

    lines = [text for text in caplog.messages if text.startswith("the loop was ")]
    assert said == len(lines)
    late = [re.fullmatch(r"the loop was 1\.[234] s late \((\d+) deadlines missed so far\)", x) for x in lines]
    missed = [int(one[1]) for one in late if one is not None]
    assert said == len(missed)
    if said:
        assert 11 <= missed[0] <= 14
        assert all(later - earlier > 100 for earlier, later in pairwise(missed))
    assert daemon.missed_deadlines >= 25 * 7


def test_a_second_bus_is_opened_read_and_asked_by_its_own_number(tmp_path: Path) -> None:
    """The car answers on the bus of [can.buses] that [obd] names; the bus of [can] is only heard."""
    car(tmp_path, '[can.buses]\nbody = "second"\ngate = "third"\n')
    config = load_config(may_ask(tmp_path, 'speed = true\nbus = "gate"'))
    clock = LeapingClock()
    buses: dict[str, FakeBus] = {
        "fake": DrivingBus(clock.now),
        "second": FakeBus(),
        "third": FakeBus(),
    }
    opened: list[tuple[str, str]] = []

    def open_bus(can: Any, filters: list[dict[str, Any]] | None, channel: str) -> FakeBus:
        opened.append((can.channel, channel))
        passed = {0x7E8 & one["can_mask"] == one["can_id"] & one["can_mask"] for one in filters or []}
        assert (channel == "third") == (True in passed)
        return buses[channel]

    def say(name: str, identifier: int, data: str) -> None:
        frame = CanFrame(clock.now(), name, identifier, False, False, False, False, bytes.fromhex(data))
        buses[name].waiting.append(frame)

    def watch(step: Step) -> None:
        say("third", 0x100, "00")  # somebody is awake
        if len(buses["third"].sent) == 1:
            say("second", 0x7E8, "03410d30aaaaaaaa")
            say("third", 0x7E8, "03410d48aaaaaaaa")
            say("fake", 0x7E8, "03410d31aaaaaaaa")

    numbers: set[tuple[int, int]] = set()

    class Taking(Pipeline):
        def on_frame(
            self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
        ) -> list[Step]:
            numbers.add((arbitration_id, bus))
            return super().on_frame(time_s, arbitration_id, is_extended, data, bus)

    daemon = listening(
        *(config, load_database(config.can.dbc), clock, open_bus, watch),
        make_pipeline=Taking,
        grace_s=0.06,
        log=LOG,
    )
    daemon.run(4.8)

    assert [("fake", "fake"), ("second", "second"), ("third", "third")] == opened
    assert {0x7DF} == {number for number, _ in buses["third"].sent}
    assert [] == buses["second"].sent
    assert {0x6F0} == {number for number, _ in buses["fake"].sent}
    assert 72 == daemon.document()["obd"]["speed_kmh"]
    assert {(0xB0, 0), (0x7E8, 0), (0x7E8, 1), (0x7E8, 2), (0x100, 2)} == numbers
    assert [1, 1, 1] == [bus.closed for bus in buses.values()]


def test_a_further_bus_that_is_down_is_a_fault_of_its_own(tmp_path: Path) -> None:
    """Each bus that is down is said with every tick, the others are not."""
    config, database = car(tmp_path, '[can.buses]\nbody = "second"\n[gnss]\ndevice = "not-there"\n')
    clock = LeapingClock()
    buses: dict[str, FakeBus] = {"fake": DrivingBus(clock.now), "second": FakeBus()}
    buses["second"].is_up = False
    seen: list[set[tuple[str, str, str]]] = []

    def watch(step: Step) -> None:
        seen.append({(one.source, one.kind, one.detail) for one in step.tick.faults})

    daemon = listening(
        config,
        database,
        clock,
        lambda can, filters, channel: buses[channel].opener()(can, filters, channel),
        watch,
        grace_s=0.06,
        log=LOG,
    )
    daemon.run(5.0)
    down, unplugged = ("can", "down", "Network is down"), ("gnss", "unplugged", "no such device")
    assert len(seen) > 30
    assert all({down, unplugged} <= faults for faults in seen[5:-10])


def test_a_bus_that_falls_silent_is_said_to_be(tmp_path: Path) -> None:
    """Open, with frames until a moment ago it is well; two seconds without any it is silent."""
    config, database = car(tmp_path)
    clock, states = LeapingClock(), dict[str, list[float]]()

    class FallsSilent(DrivingBus):
        def read(self, limit: int = 1000) -> list[CanFrame]:
            return super().read(limit) if clock.leapt_s < 10.0 else []

    def watch(step: Step) -> None:
        states.setdefault(daemon.document()["can"]["state"], []).append(clock.leapt_s)

    daemon = listening(config, database, clock, FallsSilent(clock.now).opener(), watch, grace_s=0.06, log=LOG)
    daemon.run(16.0)
    assert ["ok", "silent"] == list(states)
    assert (12.0, 12.0) == pytest.approx((states["ok"][-1], states["silent"][0]), abs=0.15)


class Talking:
    """A receiver that says a sentence each second of the given clock, and what was asked of it."""

    def __init__(self, clock: LeapingClock, reader: int) -> None:
        self._clock, self._reader, self._due_s = clock, reader, 0.0
        self.did: list[str] = []

    def open(self) -> None:
        self.did.append("opened")

    def fileno(self) -> int:
        return self._reader

    def read(self) -> bytes:
        if self._clock.leapt_s < self._due_s:
            return b""
        self._due_s += 1.0
        return to_sentence(ResetRequest("winter")) + b"\r\n$GNTXT,01,01,02,hello\r\n"

    def close(self) -> None:
        self.did.append("closed")


def test_sentences_of_the_receiver_come_to_the_pipeline_and_resets_of_its_do_not(tmp_path: Path) -> None:
    """Each with its stamp, in its turn; the sentence of a reset is the daemon's own alone."""
    config, database = car(tmp_path, '[gnss]\ndevice = "fake"\n')
    clock, taken = LeapingClock(), list[tuple[float, bytes]]()

    class Taking(Pipeline):
        def on_sentence(self, time_s: float, line: bytes) -> list[Step]:
            taken.append((time_s, line))
            return super().on_sentence(time_s, line)

    ends = os.pipe()
    receiver = Talking(clock, ends[0])
    bus, began_s = DrivingBus(clock.now), clock.now()
    daemon = listening(
        *(config, database, clock, bus.opener(), lambda step: None),
        open_receiver=lambda _: receiver,
        make_pipeline=Taking,
        grace_s=0.06,
        log=LOG,
    )
    daemon.run(5.5)
    for end in ends:
        os.close(end)

    assert [b"$GNTXT,01,01,02,hello"] * 6 == [line for _, line in taken]
    assert [float(k) for k in range(6)] == pytest.approx([at_s - began_s for at_s, _ in taken], abs=0.1)
    assert ["opened", "closed"] == receiver.did
