"""Signals that stay away, and speeds that do not agree: from which value on, and after how long."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from tests.onboard.monitor.drives import ALL, RADIUS_M
from tpmsd.car.config.model import MonitorConfig
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.monitor.health.signal_watch import SignalWatch, WatchState, _Malfunction
from tpmsd.onboard.monitor.records import AlarmEvent
from tpmsd.onboard.timeline.tick import Fix, Tick

SEES = WatchState(can_detect=True, undecided=False)
NAN4 = np.full(4, math.nan)


@dataclass
class Watched:
    """A watch that is fed by hand, and when its malfunctions were raised or cleared."""

    settings: MonitorConfig = field(default_factory=MonitorConfig)
    reported: list[tuple[str, str, float]] = field(default_factory=list)
    time_s: float = 0.0
    watching: WatchState = SEES

    def __post_init__(self) -> None:
        self._watch = SignalWatch(self.settings, ALL)

    def note_car_speed(self, kmh: int) -> None:
        """The car states its speed over OBD-II."""
        self._watch.car.note_stated(kmh)

    @property
    def standing(self) -> tuple[AlarmEvent, ...]:
        """The malfunctions that stand."""
        return self._watch.active

    def play(
        self,
        duration_s: float,
        wheels_mps: float = 20.0,
        fix: Fix | None = None,
        age_s: float = 0.1,
        dt_s: float = 0.5,
    ) -> list[tuple[str, str, float]]:
        """(state, first words of the reason, seconds since the start of this stretch) of every event."""
        begun, reported = self.time_s, []
        for _ in range(round(duration_s / dt_s)):
            self.time_s += dt_s
            rotation = np.full(4, wheels_mps * dt_s / RADIUS_M)
            fixes = () if fix is None else (replace(fix, time_s=self.time_s),)
            tick = Tick(0, self.time_s, dt_s, rotation, NAN4, fixes, host_time_s=self.time_s)
            estimate = RadiusEstimate(
                self.time_s, np.zeros(4), np.eye(4) * 1e-8, NAN4, True, 0.0, wheels_mps, 0.0, 0.0, 0.0, 0.0,
                1.0, 0.0, age_s, 40.0,
            )  # fmt: skip
            for event in self._watch.update(tick, estimate, self.watching):
                reported.append((event.state, " ".join(event.reason.split()[:4]), self.time_s - begun))
        return reported


def fix(speed_mps: float = math.nan, quality: int = 1, east_m: float = 0.0) -> Fix:
    return Fix(0.0, 0.5, east_m, 0.0, 1.0, speed_mps=speed_mps, quality=quality)


@pytest.mark.parametrize(
    ("wheels_mps", "receiver_mps", "disagree"),
    [
        (5.0, 7.9, False),  # below 15 m/s the limit is 3 m/s
        (5.0, 8.1, True),
        (40.0, 49.0, False),  # above, a fifth of the greater speed
        (40.0, 51.0, True),
        (51.0, 40.0, True),
        (49.0, 40.0, False),
    ],
)
def test_speeds_disagree_beyond_both_limits(wheels_mps: float, receiver_mps: float, disagree: bool) -> None:
    """Speeds apart by more than 3 m/s and a fifth are a malfunction after its time; less never are."""
    watched = Watched()
    limit_s = watched.settings.malfunction_s
    reported = watched.play(limit_s + 20.0, wheels_mps, fix(receiver_mps))
    raised = [("raised", "wheels and receiver disagree", pytest.approx(limit_s, abs=0.6))]
    assert (raised if disagree else []) == reported


def test_speed_between_positions_counts_where_the_receiver_states_none() -> None:
    """Positions that stand still while the wheels turn disagree; without any speed nothing does."""
    watched = Watched()
    limit_s = watched.settings.malfunction_s
    reported = watched.play(limit_s + 20.0, 20.0, fix(east_m=7.0))
    assert ["wheels and receiver disagree"] == [reason for _, reason, _ in reported]
    assert [] == Watched().play(limit_s + 20.0, 20.0)


def test_dead_reckoning_confirms_nothing() -> None:
    """What a receiver has reckoned (quality 6) neither raises a disagreement nor clears one."""
    watched = Watched()
    limit_s = watched.settings.malfunction_s
    assert [] == watched.play(limit_s + 20.0, 20.0, fix(40.0, quality=6))
    assert 1 == len(watched.play(limit_s + 20.0, 20.0, fix(40.0)))
    assert [] == watched.play(60.0, 20.0, fix(20.0, quality=6))
    assert ["cleared"] == [state for state, _, _ in watched.play(60.0, 20.0, fix(20.0))]


@pytest.mark.parametrize(("age_s", "stale"), [(9.9, False), (10.1, True)])
def test_a_fix_is_stale_after_ten_seconds(age_s: float, stale: bool) -> None:
    """Without a fix for more than ten seconds, all the while, the receiver is out of order after its time."""
    watched = Watched()
    limit_s = watched.settings.gnss_malfunction_s
    reported = watched.play(limit_s + 20.0, age_s=age_s)
    raised = [("raised", "no usable fix from", pytest.approx(limit_s, abs=0.6))]
    assert (raised if stale else []) == reported


@pytest.mark.parametrize(("good_s", "cleared"), [(1.5, 0), (2.0, 1)])
def test_a_malfunction_is_cleared_with_the_end_of_its_time_in_good_order(good_s: float, cleared: int) -> None:
    """A tenth of the time that raised it, and two seconds at least; what never stood is never cleared."""
    events: list[AlarmEvent] = []
    lasting = _Malfunction("it is so")
    for second in range(24):
        tick = Tick(second, 0.5 * second, 0.5, NAN4, NAN4, host_time_s=0.5 * second)
        events += lasting.update(second < 20, second >= 20, 10.0, tick) if second < 20 + 2.0 * good_s else []
    assert ["raised"] + ["cleared"] * cleared == [event.state for event in events]
    never = _Malfunction("it was not")
    for second in range(60):
        tick = Tick(second, 0.5 * second, 0.5, NAN4, NAN4, host_time_s=0.5 * second)
        assert [] == never.update(second < 2, second >= 2, 10.0, tick)
