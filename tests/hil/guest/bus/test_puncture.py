"""Car, daemon and listener, each a process of its own, on one bus: the listener hears of the puncture.

simulator -> vcan0 -> tpmsd run -> vcan0 -> candump; the receiver is a pseudo terminal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.hil.guest.rig import ALARM_ID, STATUS_ID, Frame, decode, listening, running, simulating, wait_until

SPEED_UP = 2.0
"""Time stamps are that much less exact, too: at more than five times the pace the decoder begins to doubt."""
LEARN_S = 20.0
AT_S, OVER_S, LOSS_PERCENT, DURATION_S = 60.0, 15.0, 2.0, 140.0
"""The radii are learned 36 s after the car sets off, and later by what the daemon takes to start."""
RADIUS_MM = 316.0
AFTER_S = 12.0
"""Of the drive, after the alarm: a false alarm on another wheel would show."""


@dataclass
class Outcome:
    """What the drive left behind."""

    alarms: list[dict[str, Any]]
    status: list[dict[str, Any]]
    frames: list[Frame]
    document: dict[str, Any]
    log: str
    exit_code: int
    state: Path
    socket: Path


@pytest.fixture(scope="module", params=["gaussian-sum", "mpf-pn"])
def outcome(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Outcome]:
    """One drive with a puncture, played once for all tests of a filter."""
    folder = tmp_path_factory.mktemp("puncture")
    car, pty = folder / "car", folder / "gnss"
    drive = ["--route", "rural", "--duration", f"{DURATION_S:g}", "--seed", "3"]
    drive += [
        "--puncture",
        "rl",
        "--loss-percent",
        f"{LOSS_PERCENT:g}",
        "--at",
        f"{AT_S:g}",
        "--over",
        f"{OVER_S:g}",
    ]
    live = ["--live", "vcan0", "--pty", str(pty), "--speed-up", f"{SPEED_UP:g}"]
    with (
        listening("vcan0", folder / "heard", "6F0:7FE") as listener,
        simulating(car, *drive, *live),
    ):
        wait_until(pty.exists, "the car drives")
        with (car / "vehicle.toml").open("a") as config:
            config.write(f"\n[monitor]\nlearn_s = {LEARN_S:g}\n")
        speed_up = ["--speed-up", f"{SPEED_UP:g}"]
        with running(car, "--method", request.param, "--device", str(pty), *speed_up) as daemon:
            daemon.ready()
            wait_until(lambda: listener.frames(ALARM_ID), "an alarm is heard", 120.0)
            first_s = listener.frames(ALARM_ID)[0].time_s
            wait_until(
                lambda: listener.frames(STATUS_ID)[-1].time_s > first_s + AFTER_S / SPEED_UP, "it drives on"
            )
            document = daemon.status()
            exit_code = daemon.stop()
            frames = listener.frames()
            yield Outcome(
                decode(listener.frames(ALARM_ID)),
                decode(listener.frames(STATUS_ID)),
                frames,
                document,
                daemon.log(),
                exit_code,
                daemon.state,
                daemon.socket,
            )


def test_the_puncture_is_announced_on_the_bus(outcome: Outcome) -> None:
    """The first alarm frame names the deflation of the rear left wheel, with the loss that it has so far."""
    first = outcome.alarms[0]

    assert ("deflation", "rl", "raised") == (first["AlarmKind"], first["AlarmWheel"], first["AlarmRaised"])
    assert -1.3 * LOSS_PERCENT / 100 * RADIUS_MM < first["AlarmChange"] < -0.8
    assert first["AlarmProbability"] >= 99.0
    assert "alarm" == first["Deflation_RL"]


def test_no_other_wheel_is_announced(outcome: Outcome) -> None:
    """Every alarm frame is about that wheel, and the other wheels' bits stay clear."""
    others = [f"{kind}_{wheel}" for kind in ("Deflation", "RadiusDeviation") for wheel in ("FL", "FR", "RR")]

    assert {"rl"} == {alarm["AlarmWheel"] for alarm in outcome.alarms}
    assert {0, "none"} >= {alarm[name] for alarm in outcome.alarms for name in others}


def test_the_alarm_is_repeated_and_numbered(outcome: Outcome) -> None:
    """Frames are counted without a gap, events by their sequence number, and repetitions keep theirs."""
    counters = [alarm["AlarmCounter"] for alarm in outcome.alarms]
    first = [alarm for alarm in outcome.alarms if alarm["AlarmKind"] == "deflation"]

    assert [(counters[0] + i) % 16 for i in range(len(counters))] == counters
    assert len(first) >= AFTER_S / 0.5 / 2
    assert {1} == {alarm["AlarmSequence"] for alarm in first}


def test_the_status_is_cyclic_and_complete(outcome: Outcome) -> None:
    """Three pages a second of the drive, counted without a gap; the wheel's state ends in alarm."""
    counters = [status["StatusCounter"] for status in outcome.status]
    pages = [status["StatusPage"] for status in outcome.status]
    drive_s = (outcome.status[-1]["time_s"] - outcome.status[0]["time_s"]) * SPEED_UP
    rear = [status for status in outcome.status if "State_RL" in status]

    assert [(counters[0] + i) % 16 for i in range(len(counters))] == counters
    assert len(outcome.status) / 3 == pytest.approx(drive_s, rel=0.1, abs=3)
    assert 3 == len(set(pages))
    assert "alarm" == rear[-1]["State_RL"]
    assert "monitoring" == rear[-1]["State_RR"]


def test_socket_log_and_state_agree_with_the_bus(outcome: Outcome) -> None:
    """What the bus says is what the status socket and the log say; it is kept, and the stop is clean."""
    reported = {(alarm["kind"], alarm["wheel"]) for alarm in outcome.document["alarms"]}

    assert ("deflation", "rl") in reported
    assert {"rl"} == {wheel for _, wheel in reported}
    assert "ALARM deflation rl raised" in outcome.log
    assert "Traceback" not in outcome.log
    assert 0 == outcome.exit_code
    assert outcome.state.is_file()
    assert not outcome.socket.exists()
    assert ("ok", "ok") == (outcome.document["can"]["state"], outcome.document["gnss"]["state"])
