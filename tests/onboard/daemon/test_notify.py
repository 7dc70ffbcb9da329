"""`[notify] command`: real programs, run on alarm events."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import replace
from pathlib import Path

import pytest

from tests.onboard.daemon.fakes import car
from tests.onboard.sinks.test_status_document import DEFLATION
from tpmsd.car.config.model import NotifyConfig
from tpmsd.car.config.problems import ConfigProblems
from tpmsd.onboard.daemon.notify import MAX_WAITING, Notices
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind

LOG = logging.getLogger("tests.notify")
MALFUNCTION = AlarmEvent(
    5.0, AlarmKind.MALFUNCTION, None, "cleared", math.nan, math.nan, math.nan, "two\nlines"
)


def script(folder: Path, body: str) -> tuple[str, ...]:
    path = folder / "notice"
    path.write_text(f"#!/bin/sh\n{body}\n", "utf-8")
    path.chmod(0o755)
    return (str(path), "$(touch hacked); a b", str(folder / "out"))


def notices(*command: str, min_interval_s: float = 0.0, timeout_s: float = 5.0, **others: object) -> Notices:
    environment = {"PATH": "/usr/bin:/bin", "LANG": "C.UTF-8", "PASSWORD": "s3cret"}
    config = NotifyConfig(command, min_interval_s=min_interval_s, timeout_s=timeout_s, **others)  # type: ignore[arg-type]
    return Notices(config, LOG, environment)


def serve(made: Notices, seconds: float = 0.4, until: Path | None = None) -> None:
    end_s = time.monotonic() + (5.0 if until is not None else seconds)
    while time.monotonic() < end_s and not (until is not None and until.exists()):
        began_s = time.monotonic()
        made.service(time.monotonic())
        assert time.monotonic() - began_s < 0.25
        time.sleep(0.01)


def test_a_program_receives_what_happened(tmp_path: Path) -> None:
    """Its environment holds the event and no secret of the daemon; its arguments are no shell's affair."""
    command = script(
        tmp_path, 'printf "%s\\n" "$1" > "$2.new"; env | grep -e TPMSD -e PASS >> "$2.new"; mv "$2.new" "$2"'
    )
    made = notices(*command)
    made.add(DEFLATION)
    serve(made, until=tmp_path / "out")
    first, *rest = (tmp_path / "out").read_text("utf-8").splitlines()

    assert "$(touch hacked); a b" == first
    assert {
        "TPMSD_KIND=deflation",
        "TPMSD_STATE=raised",
        "TPMSD_WHEEL=rl",
        "TPMSD_TIME=1000.000",
        "TPMSD_DEVIATION_MM=-3.20",
        "TPMSD_PRESSURE_LOSS_PERCENT=31",
        "TPMSD_PROBABILITY=0.9970",
        "TPMSD_REASON=lost 3.2 mm against the others",
    } == set(rest)


def test_what_nobody_knows_is_empty(tmp_path: Path) -> None:
    """A malfunction has no wheel and no numbers; a reason is one line."""
    made = notices(*script(tmp_path, 'env | grep TPMSD > "$2.new"; mv "$2.new" "$2"'))
    made.add(MALFUNCTION)
    serve(made, until=tmp_path / "out")
    said = (tmp_path / "out").read_text("utf-8").splitlines()

    assert {"TPMSD_WHEEL=", "TPMSD_DEVIATION_MM=", "TPMSD_PROBABILITY=", "TPMSD_REASON=two lines"} <= set(
        said
    )


def test_events_take_turns_and_the_rate_is_limited(tmp_path: Path) -> None:
    """One program at a time, no sooner than the interval; each event has its turn, in order."""
    made = notices(*script(tmp_path, 'echo "$TPMSD_KIND $TPMSD_STATE" >> "$2"'), min_interval_s=10.0)
    for event in (DEFLATION, MALFUNCTION):
        made.add(event)
    begins = []
    for now_s in range(100, 130):
        before = made.counts["run"]
        made.service(float(now_s))
        if made.counts["run"] > before:
            begins.append(now_s)
        time.sleep(0.02)

    assert [100, 110] == begins
    assert ["deflation raised", "malfunction cleared"] == (tmp_path / "out").read_text("utf-8").splitlines()


def test_a_program_that_hangs_is_killed_with_its_children(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The loop is never held up; after the time limit the whole group is gone."""
    made = notices(*script(tmp_path, 'sleep 60 & echo $! > "$2"; wait'), timeout_s=0.3)
    made.add(DEFLATION)
    serve(made, until=tmp_path / "out")
    serve(made, 0.8)
    child = Path("/proc", (tmp_path / "out").read_text("utf-8").strip())

    assert (1, 1) == (made.counts["killed"], made.counts["failed"])
    assert not child.exists() or "Z" in (child / "stat").read_text("utf-8").rpartition(")")[2]
    assert "took longer than 0.3 s: killed" in caplog.messages[0]


def test_a_program_that_is_not_there_is_said_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Failures are counted, told once, and end nothing."""
    made = notices(str(tmp_path / "gone"), "an argument")
    for _ in range(3):
        made.add(DEFLATION)
    serve(made)

    assert 3 == made.counts["failed"]
    assert [f"[notify] {tmp_path}/gone cannot be run: No such file or directory"] == caplog.messages


def test_memory_is_bounded_and_kinds_are_chosen() -> None:
    """Of too many events the newest wait; events of other kinds, or without a command, do not."""
    made = notices("x", kinds=("deflation",), min_interval_s=1e9)
    for _ in range(100):
        made.add(MALFUNCTION)
        made.add(DEFLATION)
    none = notices()
    none.add(DEFLATION)
    none.service(0.0)

    assert 100 - MAX_WAITING == made.counts["left_out"]
    assert {"run": 0, "failed": 0, "killed": 0, "left_out": 0} == none.counts


def test_the_configuration_takes_a_list(tmp_path: Path) -> None:
    """Program and arguments as a list of texts; anything else is refused by line."""
    config, _ = car(tmp_path, '[notify]\ncommand = ["/usr/bin/logger", "tyre"]\nkinds = ["deflation"]\n')
    assert ("/usr/bin/logger", "tyre") == config.notify.command
    for bad in ('command = "logger tyre"', "command = [3]", 'kinds = ["soft"]', "min_interval_s = -1"):
        with pytest.raises(ConfigProblems, match=r"\[notify\]"):
            car(tmp_path, f"[notify]\n{bad}\n")


def test_a_program_that_is_not_reaped_yet_is_killed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that lingers after its kill is neither killed nor counted again."""
    made = notices(*script(tmp_path, "sleep 60"), timeout_s=0.5)
    made.add(DEFLATION)
    made.service(100.0)
    process = made._process
    assert process is not None
    kills: list[int] = []
    monkeypatch.setattr("tpmsd.onboard.daemon.notify.os.killpg", lambda group, _: kills.append(group))
    for now_s in (100.4, 100.6, 101.0, 200.0, 9000.0):
        made.service(now_s)

    assert [process.pid] == kills
    assert 1 == made.counts["killed"]
    process.kill()
    process.wait(5.0)


@pytest.mark.parametrize(("events", "left_out"), [(32, 0), (33, 1)])
def test_of_more_than_32_events_the_oldest_is_left_out(events: int, left_out: int) -> None:
    """The newest say how it is."""
    made = notices("x")
    for number in range(events):
        made.add(replace(DEFLATION, time_s=float(number)))
    assert left_out == made.counts["left_out"]
    assert [float(number) for number in range(left_out, events)] == [event.time_s for event in made._waiting]


def test_events_that_wait_at_the_end_are_counted_and_started_no_more(tmp_path: Path) -> None:
    """The program that runs may go on; nothing is started behind the daemon's end."""
    made = notices(*script(tmp_path, "exit 0"), min_interval_s=10.0)
    for _ in range(3):
        made.add(DEFLATION)
    made.service(0.0)
    process = made._process
    assert process is not None
    made.close()
    made.service(100.0)
    process.wait(5.0)

    assert {"run": 1, "failed": 0, "killed": 0, "left_out": 2} == made.counts


def test_a_failure_behind_a_success_is_said_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A failure that goes on is said once; one that was over and is back is news."""
    made = notices(*script(tmp_path, 'test "$TPMSD_KIND" = malfunction || exit 3'))
    for event in (DEFLATION, DEFLATION, MALFUNCTION, DEFLATION):
        made.add(event)
        made.service(0.0)
        assert made._process is not None
        made._process.wait(5.0)
        made.service(0.0)

    assert [f"[notify] {tmp_path}/notice ended with 3"] * 2 == caplog.messages
    assert (4, 3) == (made.counts["run"], made.counts["failed"])


@pytest.mark.parametrize(("later_s", "killed"), [(5.0, 0), (5.25, 1)])
def test_a_program_has_its_whole_time(later_s: float, killed: int, tmp_path: Path) -> None:
    """It is killed behind its time limit, and not with it."""
    made = notices(*script(tmp_path, "sleep 60"), timeout_s=5.0)
    made.add(DEFLATION)
    made.service(100.0)
    process = made._process
    assert process is not None
    made.service(100.0 + later_s)
    assert killed == made.counts["killed"]
    process.kill()
    process.wait(5.0)


def test_a_program_knows_where_programs_are_and_which_language_is_spoken(tmp_path: Path) -> None:
    """PATH and LANG are passed on; what the daemon does not have is not made up."""
    made = notices(*script(tmp_path, 'env > "$2.new"; mv "$2.new" "$2"'))
    made.add(DEFLATION)
    serve(made, until=tmp_path / "out")
    names = {line.partition("=")[0] for line in (tmp_path / "out").read_text("utf-8").splitlines()}

    assert {"PATH", "LANG"} <= names
    assert not {"HOME", "TZ", "LC_ALL", "PASSWORD"} & names
