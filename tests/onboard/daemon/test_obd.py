"""The daemon asks the car for its speed: only where it may, and only while that makes sense."""

from __future__ import annotations

import logging
import math
import re
from itertools import pairwise
from pathlib import Path

import pytest

from tests.onboard.daemon.fakes import DrivingBus, LeapingClock, car
from tests.onboard.daemon.test_loop import run
from tpmsd import load, replay
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config, ObdConfig
from tpmsd.interfaces.cli.main import main
from tpmsd.interfaces.cli.status_table import render_status
from tpmsd.onboard.daemon.loop import Daemon
from tpmsd.onboard.daemon.obd_asker import AWAKE_S, LISTEN_S, RARELY_S, UNANSWERED, ObdAsker
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame

ANSWER = 0x7E8


def may_ask(folder: Path, obd: str = "speed = true", ids: str = "[0x7DF]") -> Path:
    """Let the car of a folder be asked; its configuration file."""
    file = folder / "vehicle.toml"
    text = file.read_text("utf-8").replace("[can]\n", f"[can]\noutput_ids = {ids}\n")
    file.write_text(f"{text}\n[obd]\n{obd}\n", "utf-8")
    return file


def asked_car(folder: Path) -> Config:
    car(folder)
    return load_config(may_ask(folder))


class AnsweringBus(DrivingBus):
    """A car at 20 m/s, one of whose control units answers at the functional address of ISO 15765-4."""

    def __init__(self, clock: LeapingClock, kmh: int | None) -> None:
        super().__init__(clock.now)
        self._clock, self._kmh = clock, kmh
        self._began_s = clock.now()
        self.asked_s: list[float] = []

    def send(self, arbitration_id: int, data: bytes, extended: bool = False) -> bool:
        if not 0x6F0 <= arbitration_id <= 0x6F1:
            assert (0x7DF, "02010d", 8, False) == (arbitration_id, data[:3].hex(), len(data), extended)
            self.asked_s.append(self._clock.now() - self._began_s)
            if self._kmh is not None:
                self.say(ANSWER, bytes([3, 0x41, 0x0D, self._kmh, 0xAA, 0xAA, 0xAA, 0xAA]))
        return super().send(arbitration_id, data, extended)

    def say(self, identifier: int, data: bytes) -> None:
        """A frame of the car, or of a tester."""
        stamp_s = self._clock.now()
        self.waiting.append(CanFrame(stamp_s, "fake", identifier, False, False, False, False, data))


def driven(folder: Path, kmh: int | None, duration_s: float) -> tuple[AnsweringBus, Daemon]:
    config, clock = asked_car(folder), LeapingClock()
    bus = AnsweringBus(clock, kmh)
    return bus, run(config, load_database(config.can.dbc), clock, bus, duration_s)


def test_a_car_that_answers_is_asked_every_second(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """After three seconds of listening, once a second; the answer is in the status, a warning in the log."""
    bus, daemon = driven(tmp_path, 72, 20.0)
    obd = daemon.document()["obd"]

    assert LISTEN_S <= bus.asked_s[0] <= LISTEN_S + 0.5
    assert all(0.99 <= later - earlier <= 1.2 for earlier, later in pairwise(bus.asked_s))
    assert len(bus.asked_s) >= 14
    assert {"speed_kmh": 72, "stopped": "", "wheels_agree": True, "receiver_agrees": None} == {
        key: obd[key] for key in ("speed_kmh", "stopped", "wheels_agree", "receiver_agrees")
    }
    assert 0 <= obd["asked"] - obd["answered"] <= 1
    assert "OBD speed 72 km/h\n" in render_status(daemon.document())
    warned = [r.getMessage() for r in caplog.records if r.levelno == logging.WARNING]
    assert ["[obd] the car is asked for its speed: 0x7DF every 1 s on its bus"] == warned


def test_a_speed_far_from_the_wheels_is_a_malfunction(tmp_path: Path) -> None:
    """Wheels at 72 km/h, the car at 120: a malfunction with that reason, and no tyre is accused."""
    _, daemon = driven(tmp_path, 120, 60.0)
    alarms = daemon.document()["alarms"]

    assert [("malfunction", "the wheels' speed is far from the car's own (OBD)")] == [
        (alarm["kind"], alarm["reason"]) for alarm in alarms
    ]
    assert "OBD speed 120 km/h, contradicts the wheels\n" in render_status(daemon.document())


def test_a_car_that_does_not_answer_is_asked_rarely(tmp_path: Path) -> None:
    """Ten requests in vain, then one a minute; the status knows no speed."""
    bus, daemon = driven(tmp_path, None, 90.0)
    pauses_s = [later - earlier for earlier, later in pairwise(bus.asked_s)]

    assert UNANSWERED - 1 == sum(pause < 1.5 for pause in pauses_s)
    assert all(pause >= RARELY_S for pause in pauses_s[UNANSWERED - 1 :])
    assert None is daemon.document()["obd"]["speed_kmh"]
    assert "OBD speed does not answer" in render_status(daemon.document())


def test_beside_a_tester_the_car_is_asked_no_more(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """One request of another node ends ours for good, and is told once; its answers are still heard."""
    config, clock = asked_car(tmp_path), LeapingClock()
    bus = AnsweringBus(clock, 72)

    def watch(step: object) -> None:
        if len(bus.asked_s) == 5:
            bus.say(0x7DF, bytes.fromhex("02010c5555555555"))
            bus.say(ANSWER, bytes.fromhex("03410d4655555555"))

    daemon = run(config, load_database(config.can.dbc), clock, bus, 30.0, on_step=watch)

    assert 5 == len(bus.asked_s)
    assert (70, "another node sends 0x7DF") == tuple(
        daemon.document()["obd"][key] for key in ("speed_kmh", "stopped")
    )
    assert 1 == sum("the car is asked no more" in text for text in caplog.messages)


def test_a_parked_car_is_left_alone() -> None:
    """Asking ends a minute after the last motion, and begins again when the bus wakes up: a gateway that is
    kept awake would drain the battery."""
    asker, asked = ObdAsker(ObdConfig(speed=True)), []
    for tenth in range(10 * 1200):
        now_s = 0.1 * tenth
        # Driven for 100 s; the bus talks on until 500 s, sleeps, and wakes up at 1000 s.
        if now_s < 500.0 or now_s >= 1000.0:
            asker.received(0x0B0, False, bytes(8), now_s)
        if asker.frames(now_s, now_s < 100.0):
            asked.append(now_s)
            asker.received(ANSWER, False, bytes([3, 0x41, 0x0D, 50 if now_s < 100.0 else 0]), now_s)

    assert (LISTEN_S, 100.0 + AWAKE_S) == pytest.approx(
        (asked[0], max(t for t in asked if t < 1000.0)), abs=1.1
    )
    assert 1000.0 + LISTEN_S == pytest.approx(min(t for t in asked if t >= 1000.0), abs=1.1)
    assert 1000.0 + AWAKE_S == pytest.approx(asked[-1], abs=1.1)


@pytest.mark.parametrize(("later_s", "asked"), [(AWAKE_S, 1), (math.nextafter(AWAKE_S, math.inf), 0)])
def test_the_minute_ends_with_its_last_instant(later_s: float, asked: int) -> None:
    """A minute after the bus woke up the car is asked for the last time."""
    asker = ObdAsker(ObdConfig(speed=True))
    asker.received(0x0B0, False, bytes(8), 0.0)
    assert asked == len(asker.frames(later_s, False))


@pytest.mark.parametrize("kmh", [1, 50, 255])
def test_a_car_whose_wheels_are_frozen_is_asked_on(kmh: int) -> None:
    """An answer above zero is motion too, so that wheels that stand do not end the asking."""
    asker, asked = ObdAsker(ObdConfig(speed=True)), 0
    for second in range(600):
        asker.received(0x0B0, False, bytes(8), float(second))
        if asker.frames(float(second), False):
            asked += 1
            asker.received(ANSWER, False, bytes([3, 0x41, 0x0D, kmh]), float(second))
    assert 597 == asked


def test_the_long_identifiers_are_those_of_the_standard() -> None:
    """29 bits: 0x18DB33F1 asks, 0x18DAF1xx answers; a short frame of the same number is none."""
    asker = ObdAsker(ObdConfig(speed=True, extended_ids=True))
    for extended in (False, True):
        asker.received(0x18DAF110, extended, bytes([3, 0x41, 0x0D, 50]), 0.0)
        assert (50 if extended else None) == asker.status()["speed_kmh"]
    (frame,) = asker.frames(5.0, True)
    assert (0x18DB33F1, True) == (frame.arbitration_id, frame.extended)


@pytest.mark.parametrize(
    ("obd", "ids", "reason"),
    [
        ("speed = true", "[]", "0x7DF, which asks the car, may not be sent"),
        ("speed = true\nextended_ids = true", "[0x7DF]", "0x18DB33F1, which asks the car, may not be sent"),
        ('speed = true\nbus = "x"', "[0x7DF]", "no such bus"),
        ("speed = true\nperiod_s = 0.01", "[0x7DF]", "period_s: out of range"),
        ("rpm = true", "[0x7DF]", "unknown key"),
    ],
)
def test_what_may_not_be_asked_is_refused(
    obd: str, ids: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`check` says what is missing before the car may be asked; exit code 2."""
    car(tmp_path)
    assert 2 == main(["check", str(may_ask(tmp_path, obd, ids))])
    assert reason in capsys.readouterr().err


def test_check_warns_that_the_bus_is_written_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A configuration that asks the car is right, with a warning; without `[obd]` nothing is asked."""
    _, database = car(tmp_path)
    silent = load_config(tmp_path)
    file = may_ask(tmp_path)
    assert 0 == main(["check", str(file)])
    received = capsys.readouterr()
    assert "tpmsd sends 0x7DF on the car's bus every 1 s while the car moves" in received.out + received.err
    clock = LeapingClock()
    bus = AnsweringBus(clock, 72)
    assert "obd" not in run(silent, database, clock, bus, 10.0).document()
    assert [] == bus.asked_s


def test_a_replay_receives_the_answers_of_a_recording(tmp_path: Path) -> None:
    """Answers in a log bear witness as on the road: wheels in a wrong scale, without a receiver."""
    assert 0 == main(["simulate", str(tmp_path), "--route", "motorway", "--duration", "60"])
    may_ask(tmp_path)
    log, seconds = [], set()
    for line in (tmp_path / "can.log").read_text("ascii").splitlines():
        log.append(line)
        stamp = re.match(r"\((\d+)", line)
        assert stamp is not None
        if stamp[1] not in seconds:
            seconds.add(stamp[1])
            log.append(f"{line.split()[0]} can0 7E8#03410D1E00000000")
    (tmp_path / "can.log").write_text("\n".join(log) + "\n", "ascii")
    (tmp_path / "gnss.nmea").unlink()
    alarms = replay(load(tmp_path)).to_dict()["alarms"]

    reason = "the wheels' speed is far from the car's own (OBD)"
    assert [("malfunction", reason)] == [(alarm["kind"], alarm["reason"]) for alarm in alarms][:1]


def test_the_speed_is_known_until_ten_requests_were_in_vain() -> None:
    """One request without an answer is no car that does not answer."""
    asker, known = ObdAsker(ObdConfig(speed=True)), []
    asker.received(ANSWER, False, bytes([3, 0x41, 0x0D, 50]), 0.0)
    for second in range(3, 3 + UNANSWERED):
        asker.received(0x0B0, False, bytes(8), float(second))
        assert asker.frames(float(second), True)
        known.append(asker.status()["speed_kmh"])

    assert [50] * (UNANSWERED - 1) + [None] == known


@pytest.mark.parametrize(("silent_s", "asked"), [(59.5, 0), (60.0, 0), (60.5, 1)])
def test_a_bus_that_was_silent_for_a_minute_has_slept(silent_s: float, asked: int) -> None:
    """Only then does its next frame say that somebody woke it up."""
    asker = ObdAsker(ObdConfig(speed=True))
    asker.received(0x0B0, False, bytes(8), 0.0)
    asker.received(0x0B0, False, bytes(8), silent_s)

    assert asked == len(asker.frames(silent_s + LISTEN_S, False))


@pytest.mark.parametrize("extended", [False, True])
def test_the_filters_let_answers_and_a_testers_requests_through(extended: bool) -> None:
    """By the mask of SocketCAN: those identifiers of that length, and no other; none for a car that is not
    asked."""
    config = ObdConfig(speed=True, extended_ids=extended)
    filters = ObdAsker(config).filters()
    around = range(0x18DA_0000, 0x18DC_0000) if extended else range(0x800)
    let = {number for number in around for one in filters if not (number ^ one["can_id"]) & one["can_mask"]}

    assert {config.request_id, *config.answer_ids} == let
    assert [extended] * 2 == [one["extended"] for one in filters]
    assert [] == ObdAsker(ObdConfig(extended_ids=extended)).filters()
    if extended:
        assert not any((0x7E8 ^ one["can_id"]) & one["can_mask"] == 0 for one in filters)


def test_the_status_counts_requests_and_answers() -> None:
    """Nothing is known before the first; a frame that is no answer counts for none."""
    asker = ObdAsker(ObdConfig(speed=True))
    assert {"asked": 0, "answered": 0, "speed_kmh": None, "stopped": ""} == asker.status()
    asker.received(0x0B0, False, bytes(8), 0.0)
    assert asker.frames(5.0, True)
    for identifier, data in ((0x7E7, "03410d32"), (0x7F0, "03410d32"), (ANSWER, "03410c32")):
        asker.received(identifier, False, bytes.fromhex(data), 5.1)
    assert {"asked": 1, "answered": 0, "speed_kmh": None, "stopped": ""} == asker.status()
    asker.received(0x7EF, False, bytes.fromhex("03410d00"), 5.2)
    assert {"asked": 1, "answered": 1, "speed_kmh": 0, "stopped": ""} == asker.status()


@pytest.mark.parametrize(
    ("asked_before", "pause_s", "asked"),
    [(0, 2.99, 0), (0, 3.0, 1), (1, 0.99, 0), (1, 1.0, 1), (9, 1.0, 1), (10, 59.5, 0), (10, 60.0, 1)],
)
def test_a_request_is_due_with_the_end_of_its_pause(asked_before: int, pause_s: float, asked: int) -> None:
    """Three seconds of listening, then one; behind ten requests in vain a minute."""
    asker, now_s = ObdAsker(ObdConfig(speed=True)), 0.0
    asker.received(0x0B0, False, bytes(8), now_s)
    for number in range(asked_before):
        now_s += 1.0 if number else LISTEN_S
        asker.received(0x0B0, False, bytes(8), now_s)
        assert asker.frames(now_s, True)
    asker.received(0x0B0, False, bytes(8), now_s + pause_s)

    assert asked == len(asker.frames(now_s + pause_s, True))


@pytest.mark.parametrize(("silent_s", "asked"), [(60.0, 1), (60.25, 0)])
def test_on_a_silent_bus_nobody_is_asked(silent_s: float, asked: int) -> None:
    """A receiver that says that the car moves wakes up no bus that has slept."""
    asker = ObdAsker(ObdConfig(speed=True))
    asker.received(0x0B0, False, bytes(8), 0.0)
    assert asked == len(asker.frames(silent_s, True))


def test_a_testers_request_is_said_once_and_by_its_own_identifier() -> None:
    """The same number of the other length is another identifier; a second request is no news."""
    asker = ObdAsker(ObdConfig(speed=True))
    request = bytes.fromhex("02010c5555555555")
    said = [asker.received(0x7DF, extended, request, 1.0) for extended in (True, False, False)]
    assert ["", "[obd] the car is asked no more: another node sends 0x7DF", ""] == said
    assert [] == asker.frames(20.0, True)
