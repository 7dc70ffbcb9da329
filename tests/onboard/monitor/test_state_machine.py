"""The alarms' state machine under any history: nothing flaps, nothing is lost, all has a reason.

Its tables are in docs/explanation/alarms.md.
"""

from __future__ import annotations

import json
import re
from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from tests.conftest import REPO
from tests.onboard.monitor.drives import ALL, driven, monitor
from tpmsd.onboard.monitor.baseline.tyre_sets import TOO_MANY
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind, WheelState

DRIVING: dict[str, Any] = {}
PARKED: dict[str, Any] = {"informative": False, "speed_mps": 0.0}
Key = tuple[AlarmKind, str | None]


class Life(RuleBasedStateMachine):
    """A car that was learned, and what may happen to it: one soft tyre at most, but at any time."""

    def __init__(self) -> None:
        super().__init__()
        self.player = driven(70.0)
        self.soft: int | None = None
        self.standing: dict[Key, AlarmEvent] = {}
        self.turned_s: dict[Key, float] = {}

    def play(self, seconds: float, **how: Any) -> None:
        """Let time pass with the present tyres; every event is checked as it comes."""
        change = [-0.02 if k == self.soft else 0.0 for k in range(4)]
        for _ in range(round(seconds)):
            for event in self.player.play(1.0, change, **how):
                key = (event.kind, event.wheel)
                assert event.reason
                if event.state == "raised":
                    assert key not in self.standing, "raised twice"
                    self.standing[key] = event
                else:
                    assert self.standing.pop(key, None) is not None, "cleared without having stood"
                if event.kind is not AlarmKind.MALFUNCTION and "reset" not in event.reason:
                    hold_s = 10.0 if event.state == "raised" else 60.0
                    driven_s = self.player.informative_s - self.turned_s.get(key, -1e9)
                    assert driven_s >= hold_s - 1.0, "flaps"
                self.turned_s[key] = self.player.informative_s

    @rule(seconds=st.integers(5, 90))
    def drive(self, seconds: int) -> None:
        """Steady driving."""
        self.play(seconds)

    @rule(seconds=st.integers(5, 60))
    def drive_hard(self, seconds: int) -> None:
        """Driving that is not informative."""
        self.play(seconds, informative=False)

    @rule(wheel=st.integers(0, 3))
    @precondition(lambda self: self.soft is None)
    def puncture(self, wheel: int) -> None:
        """A tyre goes soft."""
        self.soft = wheel

    @rule()
    @precondition(lambda self: self.soft is not None)
    def inflate(self) -> None:
        """It is put right."""
        self.soft = None

    @rule(hours=st.sampled_from([0.02, 0.1, 2.0, 12.0]))
    def park(self, hours: float) -> None:
        """The car stands, and the daemon with it."""
        self.play(2.0, **PARKED)
        self.player.time_s += 3600.0 * hours

    @rule()
    def restart(self) -> None:
        """The daemon, or the box, is switched off and on: what stood stands again, at once."""
        saved = json.loads(json.dumps(self.player.monitor.snapshot(), allow_nan=False))
        fresh = monitor(ALL)
        fresh.restore(saved)
        self.player.monitor = fresh
        self.play(1.0, **PARKED)

    @rule(tyres=st.sampled_from([None, "default", "winter"]))
    def reset(self, tyres: str | None) -> None:
        """The driver presses the button, rightly or not: with the alarm of these tyres standing in vain."""
        learning = self.player.monitor.learning()
        same = tyres in (None, learning.tyres)
        stands = any(kind is AlarmKind.DEFLATION for kind, _ in self.standing)
        taken, reason = self.player.monitor.reset(tyres)
        assert reason
        # Asked for again while it is learned, a set is told how far that is; too many requests are refused.
        refused = same and stands and learning.reset != "learning"
        assert taken != refused or reason == TOO_MANY

    @rule(lost=st.sampled_from([(0,), (2,), ALL]), seconds=st.integers(10, 60))
    def lose_wheels(self, lost: tuple[int, ...], seconds: int) -> None:
        """Signals stay away for a while."""
        self.play(seconds, lost=lost, informative=False)

    @rule()
    def half_an_hour_tells_all(self) -> None:
        """However it began: after driving on, exactly the soft tyre is announced, and nothing else stands."""
        self.play(260.0)
        deflated = {wheel for kind, wheel in self.standing if kind is AlarmKind.DEFLATION}
        assert deflated == (set() if self.soft is None else {("fl", "fr", "rl", "rr")[self.soft]})
        assert all(kind is not AlarmKind.MALFUNCTION for kind, _ in self.standing)

    @invariant()
    def what_is_reported_is_what_was_raised_and_not_cleared(self) -> None:
        """No alarm goes or comes without an event; each has a reason, and its wheel shows it."""
        report = self.player.last
        assert {(e.kind, e.wheel) for e in report.active} == set(self.standing)
        assert all(e.reason for e in report.active)
        for kind, wheel in self.standing:
            if kind is not AlarmKind.MALFUNCTION:
                state = next(w.state for w in report.wheels if w.wheel == wheel)
                assert state in (WheelState.ALARM, WheelState.UNAVAILABLE)


Life.TestCase.settings = settings(derandomize=True, deadline=None, max_examples=12, stateful_step_count=12)
TestLife = Life.TestCase


def test_the_table_in_the_documentation_names_every_state() -> None:
    """The page on alarms has a row for each state of a wheel, kind of alarm and outcome of a reset."""
    text = (REPO / "docs" / "explanation" / "alarms.md").read_text(encoding="utf-8")
    rows = set(re.findall(r"^\| `([a-z_]+)` ", text, re.MULTILINE))
    assert {str(state) for state in WheelState} <= rows
    assert {str(kind) for kind in AlarmKind} <= rows
    assert {"none", "accepted", "refused"} <= rows
