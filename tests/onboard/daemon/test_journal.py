"""Lines of the log, as the journal and as a terminal receive them."""

from __future__ import annotations

import io
import logging
import math
import re
from collections.abc import Iterator

import pytest

from tpmsd.onboard.daemon.journal import LOGGER, log_alarm, set_up_logging
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind

JOURNAL = {"JOURNAL_STREAM": "8:12345"}


@pytest.fixture(autouse=True)
def logger() -> Iterator[logging.Logger]:
    """The daemon's logger; afterwards it is as it was."""
    log = logging.getLogger(LOGGER)
    before = list(log.handlers), log.propagate, log.level
    yield log
    log.handlers[:], log.propagate = before[:2]
    log.setLevel(before[2])


class Terminal(io.StringIO):
    """A stream that a person reads."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("environment", [JOURNAL, {"JOURNAL_STREAM": ""}, {}], ids=["set", "empty", "none"])
@pytest.mark.parametrize("stream", [io.StringIO, Terminal])
def test_lines_are_the_journals_where_it_listens_and_no_terminal_does(
    stream: type[io.StringIO], environment: dict[str, str]
) -> None:
    """A shell that was started under systemd passes JOURNAL_STREAM on: its terminal is none of the
    journal's."""
    out = stream()
    set_up_logging(stream=out, environment=environment).warning("no %s", "fix")
    if stream is io.StringIO and environment is JOURNAL:
        assert "<4>no fix\n" == out.getvalue()
    else:
        assert re.fullmatch(r"\d\d:\d\d:\d\d WARNING  no fix\n", out.getvalue())


def test_standard_error_and_the_process_environment_are_used(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a service is started: nothing is given."""
    monkeypatch.setenv("JOURNAL_STREAM", "8:12345")
    set_up_logging().info("began")
    assert ("", "<6>began\n") == capsys.readouterr()


def test_each_level_has_the_priority_of_syslog() -> None:
    """Between two levels that of the lower counts (sd-daemon(3): 2 critical, 3 error, 4 warning, 6 info,
    7 debug)."""
    out = io.StringIO()
    log = set_up_logging(verbose=True, stream=out, environment=JOURNAL)
    for level in (10, 19, 20, 29, 30, 39, 40, 49, 50, 60):
        log.log(level, "x")
    assert [7, 7, 6, 6, 4, 4, 3, 3, 2, 2] == [int(line[1]) for line in out.getvalue().splitlines()]


def test_a_message_of_several_lines_is_one_entry() -> None:
    """Each line would be an entry of its own, those behind the first without a priority."""
    out = io.StringIO()
    set_up_logging(stream=out, environment=JOURNAL).error("one\ntwo\n  three")
    assert "<3>one two three\n" == out.getvalue()


@pytest.mark.parametrize(("verbose", "said"), [(False, ["<6>b"]), (True, ["<7>a", "<6>b"])])
def test_details_are_said_where_they_are_wanted(verbose: bool, said: list[str]) -> None:
    """Set up a second time, each line is still said once, and nowhere else."""
    elsewhere, out = io.StringIO(), io.StringIO()
    root = logging.StreamHandler(elsewhere)
    logging.getLogger().addHandler(root)
    try:
        set_up_logging(verbose=not verbose, stream=out, environment=JOURNAL)
        log = set_up_logging(verbose=verbose, stream=out, environment=JOURNAL)
        log.debug("a")
        log.info("b")
    finally:
        logging.getLogger().removeHandler(root)
    assert (said, "") == (out.getvalue().splitlines(), elsewhere.getvalue())


@pytest.mark.parametrize(
    ("kind", "priority"),
    [
        (AlarmKind.DEFLATION, 2),
        (AlarmKind.MALFUNCTION, 3),
        (AlarmKind.RADIUS_DEVIATION, 4),
        (AlarmKind.SLOW_LEAK, 4),
    ],
)
def test_an_alarm_is_as_urgent_as_its_kind_until_it_is_cleared(kind: AlarmKind, priority: int) -> None:
    """A deflation calls for a stop; that an alarm is over is news, no trouble."""
    out = io.StringIO()
    log = set_up_logging(stream=out, environment=JOURNAL)
    for wheel, state in (("rl", "raised"), (None, "cleared")):
        log_alarm(log, AlarmEvent(1.0, kind, wheel, state, math.nan, math.nan, 0.9, "a reason"))  # type: ignore[arg-type]
    assert [
        f"<{priority}>ALARM {kind} rl raised: a reason",
        f"<6>alarm {kind} cleared: a reason",
    ] == out.getvalue().splitlines()
