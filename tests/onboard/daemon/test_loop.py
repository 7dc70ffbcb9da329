"""The event loop as a whole, on a clock that runs fast: ticks, service manager, faults, steps of time."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cantools.database
import numpy as np
import pytest
from cantools.database.can import Database

from tests.conftest import REPO
from tests.onboard.daemon.fakes import DrivingBus, FakeBus, LeapingClock, ServiceManagerSocket, car, listening
from tpmsd.car.config.model import CanConfig, Config
from tpmsd.onboard.daemon.bus_link import BusInterface
from tpmsd.onboard.daemon.clock import Clock
from tpmsd.onboard.daemon.descriptors import Descriptors
from tpmsd.onboard.daemon.frame_stamps import TOLERANCE_S
from tpmsd.onboard.daemon.loop import Daemon
from tpmsd.onboard.daemon.state_keeper import fingerprint
from tpmsd.onboard.monitor.records import AlarmEvent
from tpmsd.onboard.pipeline import Pipeline, Step
from tpmsd.onboard.sinks.sd_notify import Notifier
from tpmsd.onboard.sinks.state_file import save_state
from tpmsd.onboard.sources.can.frame import CanFrame

SCALE = 40.0
GRACE_S = 0.05 * SCALE
LOG = logging.getLogger("tests.loop")
WELL = {"ok", "silent"}
"""At this pace a busy machine makes a silence of every pause."""


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[ServiceManagerSocket]:
    """A service manager that listens."""
    server = ServiceManagerSocket(tmp_path / "notify.sock")
    yield server
    server.close()


class Stalling(Pipeline):
    """A pipeline that makes no more ticks after so many."""

    def __init__(self, config: Config, database: Database, limit: int) -> None:
        super().__init__(config, database)
        self.left = limit

    def advance(self, time_s: float) -> list[Step]:
        return self._cut(super().advance(time_s))

    def on_frame(
        self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
    ) -> list[Step]:
        return self._cut(super().on_frame(time_s, arbitration_id, is_extended, data, bus))

    def _cut(self, steps: list[Step]) -> list[Step]:
        kept = steps[: self.left]
        self.left -= len(kept)
        return kept


def run(
    config: Config,
    database: Database,
    clock: Clock,
    bus: BusInterface,
    duration_s: float,
    *,
    notifier: Notifier | None = None,
    make_pipeline: Callable[[Config, Database], Pipeline] = Pipeline,
    on_step: Callable[[Step], None] | None = None,
    grace_s: float = GRACE_S,
    own_stamps: bool = False,
) -> Daemon:
    """A daemon's whole life; `own_stamps`: frames are stamped by the adapter, and not by the clock."""

    def open_bus(can: CanConfig, filters: list[dict[str, Any]] | None, channel: str) -> BusInterface:
        assert isinstance(bus, FakeBus)
        return bus.opener()(can, filters, channel)

    daemon = Daemon(
        config,
        database,
        clock,
        Notifier(None) if notifier is None else notifier,
        open_bus=open_bus,
        make_pipeline=make_pipeline,
        on_step=on_step,
        frame_time=None if own_stamps else lambda stamp_s: stamp_s,
        grace_s=grace_s,
        log=LOG,
    )
    daemon.run(duration_s)
    return daemon


def test_ticks_come_at_their_rate(tmp_path: Path) -> None:
    """Ten ticks to the second, but for what is held back at first; each 0.1 s after the one before."""
    config, database = car(tmp_path)
    clock = Clock(SCALE)
    start_s = clock.now()
    times: list[float] = []
    daemon = run(
        config,
        database,
        clock,
        DrivingBus(clock.now),
        60.0,
        on_step=lambda step: times.append(step.tick.time_s),
    )

    assert len(times) == daemon.ticks
    elapsed_s = clock.now() - start_s
    assert 10 * (60.0 - GRACE_S - 1.0) <= daemon.ticks <= 10 * (elapsed_s + GRACE_S + 0.45) + 1
    steps = [later - earlier for earlier, later in pairwise(times)]
    assert steps == pytest.approx([0.1] * len(steps), abs=1e-6)


def test_the_service_manager_receives_the_whole_life(tmp_path: Path, manager: ServiceManagerSocket) -> None:
    """READY with the first tick, then status and watchdog, and STOPPING at the end."""
    config, database = car(tmp_path)
    clock = Clock(SCALE)
    notifier = Notifier(str(manager.path), 100_000)
    heard_before_ticks: list[str] = []
    received: list[str] = []

    class Watched(Pipeline):
        def advance(self, time_s: float) -> list[Step]:
            steps = super().advance(time_s)
            if self.timeline.counts["ticks"] == 0:
                heard_before_ticks.extend(manager.received())
            return steps

    run(
        config,
        database,
        clock,
        DrivingBus(clock.now),
        40.0,
        notifier=notifier,
        make_pipeline=Watched,
        on_step=lambda step: received.extend(manager.received()),  # the socket holds but a few messages
    )
    received += manager.received()

    assert [] == heard_before_ticks
    assert "READY=1" == received[0]
    assert 1 == received.count("READY=1")
    assert received[1].startswith("STATUS=")
    # 40 s are one real second; the watchdog is fed every 50 ms of it, less often on a busy machine.
    assert 4 <= received.count("WATCHDOG=1") <= 21
    assert ["STOPPING=1", "STATUS=stopping: 40 s are over"] == received[-2:]


def test_without_ticks_the_daemon_is_not_ready(tmp_path: Path, manager: ServiceManagerSocket) -> None:
    """A loop that turns without ever making a tick is neither ready nor alive for the service manager."""
    config, database = car(tmp_path)
    clock = Clock(SCALE)
    run(
        config,
        database,
        clock,
        DrivingBus(clock.now),
        20.0,
        notifier=Notifier(str(manager.path), 20_000),
        make_pipeline=lambda c, d: Stalling(c, d, 0),
    )

    assert ["STOPPING=1", "STATUS=stopping: 20 s are over"] == manager.received()


def test_the_watchdog_starves_when_ticks_stop(tmp_path: Path, manager: ServiceManagerSocket) -> None:
    """The loop goes on turning, but once its ticks stop, so do the messages that keep it alive."""
    config, database = car(tmp_path)
    clock = Clock(SCALE)
    alive: list[str] = []

    daemon = run(
        config,
        database,
        clock,
        DrivingBus(clock.now),
        40.0,
        notifier=Notifier(str(manager.path), 20_000),
        make_pipeline=lambda c, d: Stalling(c, d, 150),
        on_step=lambda step: alive.extend(manager.received()),
    )
    dead = manager.received()

    assert 150 <= daemon.ticks <= 160  # the end completes what it can
    assert alive.count("WATCHDOG=1") + dead.count("WATCHDOG=1") >= 4
    assert dead.count("WATCHDOG=1") <= 2


def test_a_bus_that_goes_away_is_a_malfunction_that_ends(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A bus down for long is reported as malfunction, on the bus too once it is back, and then cleared."""
    config, database = car(tmp_path, "[monitor]\nmalfunction_s = 8.0\n")
    clock = LeapingClock()
    bus = DrivingBus(clock.now)
    start_s = clock.now()
    events: list[AlarmEvent] = []

    def watch(step: Step) -> None:
        bus.is_up = not 10.0 < clock.now() - start_s < 30.0
        events.extend(step.report.events)

    daemon = run(config, database, clock, bus, 60.0, on_step=watch)

    assert [("malfunction", None, "raised"), ("malfunction", None, "cleared")] == [
        (str(event.kind), event.wheel, event.state) for event in events
    ]
    assert 17.0 < events[0].time_s - start_s < 23.0
    assert 30.0 < events[1].time_s - start_s < 45.0
    assert 2 == bus.opened
    assert "ok" == daemon.document()["can"]["state"]
    assert 1 == daemon.document()["can"]["faults"]["down"]
    warnings = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert ["CAN fake: Network is down; trying again until it is back"] == warnings
    reported = [(r.levelname, r.getMessage()) for r in caplog.records if "malfunction" in r.getMessage()]
    assert [("ERROR", f"ALARM malfunction raised: {events[0].reason}")] == reported
    alarms = [tpmsd_database().decode_message(i, data) for i, data in bus.sent if i == 0x6F1]
    assert {"raised", "cleared"} == {str(alarm["AlarmRaised"]) for alarm in alarms}
    assert {"malfunction"} == {str(alarm["AlarmKind"]) for alarm in alarms}


def tpmsd_database() -> Any:
    return cantools.database.load_file(str(REPO / "dbc" / "tpmsd.dbc"))


def test_a_bus_that_is_missing_from_the_start_does_not_stop_the_ticks(tmp_path: Path) -> None:
    """With neither bus nor receiver the daemon runs, says so, and takes the bus when it comes."""
    config, database = car(tmp_path, '[gnss]\ndevice = "not-there"\n')
    clock = Clock(SCALE)
    bus = DrivingBus(clock.now)
    bus.is_up = False
    start_s = clock.now()
    documents: list[dict[str, Any]] = []

    def watch(step: Step) -> None:
        documents.append(daemon.document())
        bus.is_up = clock.now() - start_s > 15.0

    daemon = listening(config, database, clock, bus.opener(), watch, grace_s=GRACE_S, log=LOG)
    daemon.run(30.0)

    assert ("down", "Network is down") == (documents[0]["can"]["state"], documents[0]["can"]["detail"])
    assert ("down", "no such device") == (documents[0]["gnss"]["state"], documents[0]["gnss"]["detail"])
    assert documents[-1]["can"]["state"] in WELL
    assert "down" == documents[-1]["gnss"]["state"]
    assert len(documents) >= 250


def test_alarms_go_to_a_bus_of_their_own(tmp_path: Path) -> None:
    """With [alarms] channel the frames go there and nowhere else, and that bus may come and go by itself."""
    config, database = car(tmp_path, '[alarms]\nchannel = "other"\n')
    clock = Clock(SCALE)
    buses = {"fake": DrivingBus(clock.now), "other": FakeBus()}
    buses["other"].is_up = False
    start_s = clock.now()

    def watch(step: Step) -> None:
        buses["other"].is_up = clock.now() - start_s > 10.0

    daemon = listening(
        config,
        database,
        clock,
        lambda can, filters, channel: buses[channel].opener()(can, filters, channel),
        watch,
        grace_s=GRACE_S,
        log=LOG,
    )
    daemon.run(30.0)

    assert [] == buses["fake"].sent
    assert len(buses["other"].sent) >= 3 * 10
    assert {0x6F0} == {identifier for identifier, _ in buses["other"].sent}


def test_an_alarm_outlives_a_restart(tmp_path: Path) -> None:
    """A tyre alarm that stood when the daemon stopped is on the bus again with the first ticks."""
    config, database = car(tmp_path)
    assert config.state.file is not None
    snapshot = Pipeline(config, database).snapshot()
    snapshot["monitor"]["sets"]["baseline"]["ready"] = True
    snapshot["monitor"]["alarms"] = [
        {"kind": "deflation", "wheel": "rl", "time_s": 1.0, "probability": 0.99, "reason": "lost 2 mm"}
    ]
    save_state(config.state.file, {"fingerprint": fingerprint(config), "pipeline": snapshot})
    clock = Clock(SCALE)
    bus = DrivingBus(clock.now)
    daemon = run(config, database, clock, bus, 10.0)

    first = tpmsd_database().decode_message(*bus.sent[0])
    assert 0x6F1 == bus.sent[0][0]
    assert ("deflation", "rl", "raised") == tuple(
        str(first[name]) for name in ("AlarmKind", "AlarmWheel", "AlarmRaised")
    )
    assert ["deflation"] == [alarm["kind"] for alarm in daemon.document()["alarms"]]


class HeldUpBus(DrivingBus):
    """A process that is held up for 1 s at every twentieth look at the bus, before or after it has read."""

    def __init__(self, clock: LeapingClock, before: bool) -> None:
        super().__init__(clock.now)
        self.looks = 0
        self._clock = clock
        self._before = before

    def read(self, limit: int = 1000) -> list[CanFrame]:
        self.looks += 1
        held_up = self.looks % 20 == 0
        if held_up and self._before:
            self._clock.leapt_s += 1.0
        frames = super().read(limit)
        if held_up and not self._before:
            self._clock.leapt_s += 1.0
        return frames


@pytest.mark.parametrize("before", [False, True])
@pytest.mark.parametrize("own_stamps", [False, True])
def test_a_process_that_is_held_up_loses_no_frame(tmp_path: Path, own_stamps: bool, before: bool) -> None:
    """A second at every twentieth look makes no frame too late, and moves none in time."""
    config, database = car(tmp_path)
    taken: list[float] = []

    class Counting(Pipeline):
        def on_frame(
            self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
        ) -> list[Step]:
            taken.append(time_s)
            return super().on_frame(time_s, arbitration_id, is_extended, data, bus)

    clock = LeapingClock()
    bus = HeldUpBus(clock, before)
    daemon = run(
        config, database, clock, bus, 20.0, make_pipeline=Counting, grace_s=0.06, own_stamps=own_stamps
    )

    assert bus.looks > 40
    assert 0 == daemon.document()["can"]["faults"].get("too_late", 0)
    assert len(taken) >= 900
    offsets_s = np.array(taken) - 0.02 * np.arange(len(taken))
    off_s = np.abs(offsets_s - np.median(offsets_s))
    # An adapter's own clock is brought onto the host's to within what reading may take; its very first frames
    # are placed before a quick reading has been seen.
    assert np.all(off_s <= 1e-3) if not own_stamps else np.mean(off_s > 0.06) <= 0.01


class AdapterBus(DrivingBus):
    """An adapter that stamps frames with the time since it was plugged in."""

    def __init__(self, clock: LeapingClock, channel: str = "fake", later_s: float = 0.0) -> None:
        super().__init__(clock.now)
        self.began_s = clock.now()
        self._channel, self._plugged_s = channel, self.began_s + later_s

    def read(self, limit: int = 1000) -> list[CanFrame]:
        return [
            frame._replace(time_s=frame.time_s - self._plugged_s, channel=self._channel)
            for frame in super().read(limit)
        ]


def test_stamps_of_an_adapters_own_clock_are_brought_onto_the_hosts(tmp_path: Path) -> None:
    """Frames every 20 ms by an adapter that counts from its start come to the pipeline 20 ms apart, at the
    host's time to within what is tolerated."""
    config, database = car(tmp_path)
    clock, taken = LeapingClock(), list[float]()
    bus = AdapterBus(clock)

    class Taking(Pipeline):
        def on_frame(
            self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
        ) -> list[Step]:
            taken.append(time_s - 0.02 * len(taken))
            return super().on_frame(time_s, arbitration_id, is_extended, data, bus)

    daemon = run(config, database, clock, bus, 5.0, make_pipeline=Taking, grace_s=0.06, own_stamps=True)

    assert len(taken) >= 240
    assert abs(np.median(taken) - bus.began_s) <= TOLERANCE_S + 1e-3
    assert np.ptp(taken[len(taken) // 2 :]) <= 1e-3
    assert 0 == daemon.document()["can"]["faults"].get("bad_stamp", 0)


def test_each_adapter_has_a_clock_of_its_own(tmp_path: Path) -> None:
    """Of two adapters the second was plugged in 20 s later; both buses' frames come at the host's time."""
    config, database = car(tmp_path, '[can.buses]\nbody = "second"\n')
    clock, off_s = LeapingClock(), {0: list[float](), 1: list[float]()}
    buses = {"fake": AdapterBus(clock), "second": AdapterBus(clock, "second", 20.0)}

    class Taking(Pipeline):
        def on_frame(
            self, time_s: float, arbitration_id: int, is_extended: bool, data: bytes, bus: int = 0
        ) -> list[Step]:
            off_s[bus].append(time_s - 0.02 * len(off_s[bus]) - buses["fake"].began_s)
            return super().on_frame(time_s, arbitration_id, is_extended, data, bus)

    daemon = Daemon(
        config,
        database,
        clock,
        Notifier(None),
        open_bus=lambda can, filters, channel: buses[channel].opener()(can, filters, channel),
        make_pipeline=Taking,
        grace_s=0.06,
        log=LOG,
    )
    daemon.run(5.0)

    for of_bus in off_s.values():
        assert len(of_bus) >= 240
        assert abs(np.median(of_bus)) <= TOLERANCE_S + 1e-3


def test_a_bus_without_a_descriptor_is_polled_every_few_milliseconds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop sleeps 4 ms at most between looks at such a bus, and does sleep."""
    waits: list[float] = []

    def wait(_: Descriptors, seconds: float) -> list[Any]:
        waits.append(seconds)
        return []

    monkeypatch.setattr(Descriptors, "wait", wait)
    now_s = iter(np.arange(1000.0, 1002.0, 1e-3).tolist())
    clock = Clock(wall=lambda: 1.7e9, monotonic=lambda: next(now_s))
    config, database = car(tmp_path)
    run(config, database, clock, FakeBus(), 0.5)

    assert len(waits) > 50
    assert 0.0 <= min(waits)
    assert 0.004 == max(waits)


HELD_UP_S = 0.05
"""Of real time between two looks at the clock: longer, and the machine did something else. If the clock is
set just then, tick time runs ahead by a second or two."""


def set_back_or_forward(folder: Path, step_s: float) -> tuple[Daemon, list[tuple[float, float, bool]], float]:
    """The daemon through a step of its host's clock, its ticks, and how long at most it was held up."""
    folder.mkdir()
    config, database = car(folder)
    shift_s, began_s, looked_s, held_up_s = 0.0, time.monotonic(), time.monotonic(), 0.0

    def monotonic() -> float:
        nonlocal looked_s, held_up_s
        now_s = time.monotonic()
        held_up_s, looked_s = max(held_up_s, now_s - looked_s), now_s
        return 4.0 * (now_s - began_s)

    clock = Clock(wall=lambda: 1.7e9 + monotonic() + shift_s, monotonic=monotonic)
    bus = DrivingBus(clock.now)
    ticks: list[tuple[float, float, bool]] = []

    def watch(step: Step) -> None:
        nonlocal shift_s
        ticks.append((monotonic(), step.tick.time_s, bool(step.tick.rotation_rad[2] > 0.0)))
        shift_s = step_s if monotonic() > 4.0 else 0.0

    daemon = run(config, database, clock, bus, 10.0, on_step=watch, grace_s=0.2)
    return daemon, ticks, held_up_s


@pytest.mark.parametrize("step_s", [-3600.0, -2.0, 3600.0])
def test_the_loop_goes_on_when_the_hosts_clock_is_set(
    tmp_path: Path, step_s: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Set back or forward during a run, the clock stops neither ticks nor frames; it is said once."""
    for attempt in range(5):
        caplog.clear()
        daemon, ticks, held_up_s = set_back_or_forward(tmp_path / str(attempt), step_s)
        if held_up_s < HELD_UP_S:
            break

    times = [time_s for _, time_s, _ in ticks]
    assert sorted(times) == times
    assert 75 <= len(ticks) <= 105
    assert max(later[0] - earlier[0] for earlier, later in pairwise(ticks)) < 1.7
    # Frames out of order are taken for late ones for a second, until a step is the better explanation.
    assert all(turning for at_s, _, turning in ticks if 2.0 < at_s < 4.0 or at_s > 7.0)
    assert ["the host's clock has stepped"] == [
        r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING
    ]
    assert 0 == daemon.document()["can"]["faults"].get("too_late", 0)


def test_a_second_daemon_on_the_same_socket_does_not_start(tmp_path: Path) -> None:
    """Two daemons would both speak on the bus: the second ends with one line, the first is not disturbed."""
    from tpmsd.onboard.sinks.status_server import StatusServer, StatusSocketError

    config, database = car(tmp_path)
    first = StatusServer(config.status.socket, dict)
    first.open()
    try:
        with pytest.raises(StatusSocketError, match="another tpmsd is answering"):
            run(config, database, Clock(SCALE), FakeBus(), 1.0)
        assert config.status.socket.is_socket()
    finally:
        first.close()


def test_a_socket_that_cannot_be_made_is_no_reason_to_stop(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Without its status socket the daemon still watches the tyres, and says what is missing."""
    config, database = car(tmp_path)
    (tmp_path / "file").write_text("")
    config = replace(config, status=replace(config.status, socket=tmp_path / "file" / "status.sock"))
    clock = Clock(SCALE)

    assert run(config, database, clock, DrivingBus(clock.now), 10.0).ticks > 50
    assert any("tpmsd status will not find this daemon" in message for message in caplog.messages)
