"""Realistic cases: what they are, how a system on a bus is measured, and what a row is worth."""

from __future__ import annotations

import itertools
import json
import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import can
import cantools
import pytest

from bench.campaigns.onboard.realistic.cases import Act, RealCase, car_of, cases_of
from bench.campaigns.onboard.realistic.run import play, table
from bench.campaigns.onboard.realistic.systems import Lit, Onboard, OnBus
from bench.cli import main
from bench.worlds.trips import Driven, Loss

LAMP_DBC = """VERSION ""

NS_ :

BS_:

BU_: OTHER

BO_ 1234 Warning: 2 OTHER
 SG_ Lamp : 3|2@1+ (1,0) [0|3] "" OTHER
 SG_ Counter : 8|8@1+ (1,0) [0|255] "" OTHER
"""


def test_there_are_sixteen_cases_of_one_car_that_cover_the_list() -> None:
    """Names differ; wheels are named whenever air is lost; two cases reset at low pressure, one is soft
    before anything was learned; no drive begins before the one before has ended."""
    cases = cases_of("development", 1)
    assert 16 == len({case.name for case in cases})
    assert cases == cases_of("development", 1)
    assert cases != cases_of("development", 2)
    for case in cases:
        soft = {loss.wheel for act in case.acts[case.first :] for loss in act.leg.losses}
        assert soft == set(case.wheels)
        assert not any(act.leg.losses for act in case.acts[: case.first])
        for one, other in itertools.pairwise(act.leg for act in case.acts):
            assert other.start_s > one.start_s + one.duration_s
    assert 2 == sum(act.reset for case in cases for act in case.acts)
    assert ["soft-at-first"] == [case.name for case in cases if case.first == 0]
    assert car_of("held-out", 1).kind != car_of("development", 1).kind


@dataclass
class Told:
    """A system that answers as it is told, drive by drive."""

    answers: list[Lit]
    done: list[str] = field(default_factory=list)

    def begin(self) -> None:
        self.done.append("begin")

    def reset(self) -> None:
        self.done.append("reset")

    def drive(self, driven: Driven) -> Lit:
        self.done.append("drive")
        return self.answers.pop(0)


def short(case: RealCase) -> RealCase:
    """The same with drives of twelve seconds, and the loss after two."""

    def cut(act: Act) -> Act:
        losses = tuple(replace(loss, onset_s=2.0, duration_s=0.0) for loss in act.leg.losses)
        return replace(act, leg=replace(act.leg, duration_s=12.0, losses=losses))

    return replace(case, acts=tuple(cut(act) for act in case.acts), limit_s=15.0)


NEVER = Lit(math.nan)


@pytest.mark.parametrize(
    ("answers", "found", "found_s", "false"),
    [
        ([NEVER, NEVER, Lit(7.0)], True, 5.0, []),
        ([NEVER, NEVER, NEVER, Lit(6.0), NEVER], True, 14.0, []),
        ([Lit(3.0), *[NEVER] * 7], False, None, [0]),
        ([*[NEVER] * 4, Lit(2.0), NEVER, NEVER, NEVER], False, 20.0, []),
    ],
)
def test_driving_counts_from_the_loss_on_over_all_trips(
    answers: list[Lit], found: bool, found_s: float | None, false: list[int]
) -> None:
    """Two drives of learning, then six trips of ten seconds after the loss; 15 s are allowed. An alarm on a
    drive of learning is a false one."""
    trips = next(case for case in cases_of("development", 1) if case.name == "short-trips-one")
    row = play(car_of("development", 1), short(trips), Told(list(answers)))
    assert (found, found_s, false) == (row["found"], row["found_s"], row["false_before"])


def test_a_question_is_no_alarm_and_a_reset_comes_before_its_drive() -> None:
    """A row of a case with a reset: asked after 4 s, not found; in the table it says so."""
    reset = next(case for case in cases_of("development", 1) if case.name == "reset-one-soft")
    system = Told([NEVER, NEVER, Lit(math.nan, 6.0)])
    row = play(car_of("development", 1), short(reset), system)
    assert ["begin", "drive", "drive", "reset", "drive"] == system.done
    assert (False, True, 4.0) == (row["found"], row["asked"], row["asked_s"])
    assert "| reset-one-soft | asked | - | 4 | 15 |" in table([row])
    assert "0 of 1 found, 1 more asked." in table([row])


class Other(threading.Thread):
    """A system of another make on a virtual bus: its lamp is lit from the given number of frames on."""

    def __init__(self, channel: str, after: int) -> None:
        super().__init__(daemon=True)
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.after, self.received, self.resets = after, 0, 0
        self.over = threading.Event()

    def run(self) -> None:
        while not self.over.is_set():
            frame = self.bus.recv(0.05)
            if frame is None:
                continue
            if frame.arbitration_id == 0x7A:
                self.resets += 1
                continue
            self.received += 1
            lit = self.received >= self.after
            self.bus.send(can.Message(arbitration_id=1234, is_extended_id=False, data=[16 * lit, 0]))


@pytest.fixture
def database(tmp_path: Path) -> Iterator[cantools.database.can.Database]:
    """Of the other system's frame."""
    path = tmp_path / "other.dbc"
    path.write_text(LAMP_DBC, encoding="utf-8")
    loaded = cantools.database.load_file(path)
    assert isinstance(loaded, cantools.database.can.Database)
    yield loaded


@pytest.mark.parametrize(("after", "lit"), [(150, True), (10**9, False)])
def test_a_system_on_a_bus_is_received(
    database: cantools.database.can.Database, after: int, lit: bool
) -> None:
    """Frames of a drive of twelve seconds at thirty times real time: every frame comes, the lamp is seen when
    it is lit, a reset is sent, and a lamp that stays dark is none."""
    case = short(cases_of("development", 1)[-2])
    channel = f"realistic-{after}"
    other = Other(channel, after)
    bus = can.Bus(interface="virtual", channel=channel)
    reset = can.Message(arbitration_id=0x7A, is_extended_id=False, data=[1])
    system = OnBus(bus, database, ("Warning", "Lamp"), 30.0, 3.0, reset)
    other.start()
    try:
        row = play(car_of("development", 1), replace(case, first=0, acts=case.acts[2:]), system)
    finally:
        other.over.set()
        other.join(5.0)
        bus.shutdown()
        other.bus.shutdown()
    assert lit == (row["found_s"] is not None)
    assert 1 == other.resets
    assert other.received > 500


def test_the_core_finds_a_tyre_that_went_flat_and_keeps_its_state() -> None:
    """Learned on a drive of three minutes, half of the pressure lost before the next one."""
    case = cases_of("development", 1)[0]
    first, _, last = case.acts
    legs = (
        replace(first.leg, duration_s=240.0),
        replace(last.leg, duration_s=200.0, losses=(Loss(0, 0.5),)),
    )
    quick = RealCase("quick", tuple(Act(leg) for leg in legs), 1, (0,), 200.0)
    row = play(car_of("development", 1), quick, Onboard())
    assert row["found"]
    assert [] == row["false_before"]
    assert json.loads(json.dumps(row)) == row


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--case", "nothing"], "no such case: nothing"),
        (["--interface", "virtual"], "needs --channel"),
        (
            ["--interface", "virtual", "--channel", "x", "--dbc", "none.dbc", "--lamp", "A.B"],
            "no such system",
        ),
        (["--pace", "0"], "more than 0"),
    ],
)
def test_wrong_options_are_reported_in_one_line(
    options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2 and no traceback."""
    with pytest.raises(SystemExit) as end:
        main(["run", "realistic", *options])
    assert 2 == end.value.code
    assert said in capsys.readouterr().err.splitlines()[-1]
