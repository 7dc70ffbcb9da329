"""When a malfunction is raised and when it is cleared: the limits themselves."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.monitor.drives import ALL, RADIUS_M
from tpmsd.car.config.model import MonitorConfig
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.gates.agreement import AGREED, Agreement
from tpmsd.onboard.monitor.alarms.saved_alarms import alarm_from_json, alarm_to_json
from tpmsd.onboard.monitor.health.signal_watch import ReceiverSpeed, SignalWatch, WatchState
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind
from tpmsd.onboard.sources.events import SourceFault
from tpmsd.onboard.timeline.tick import Fix, Tick

NAN4 = np.full(4, math.nan)
DT_S = 0.5
WITHHELD, UNSTEADY = Agreement(True, False, False), Agreement(False, True, False)
SEES = WatchState(can_detect=True, undecided=False)


class Ticks:
    """Ticks of half a second into a watch whose limits are 30 and 300 s."""

    def __init__(self, wheels: tuple[int, ...] = ALL) -> None:
        self.watch, self.time_s = SignalWatch(MonitorConfig(), wheels), 1000.0

    def until(
        self,
        word: str,
        *,
        mps: float = 20.0,
        lost: tuple[int, ...] = (),
        age_s: float = 0.1,
        kinds: tuple[str, ...] = (),
        agreement: Agreement = AGREED,
        watching: WatchState = SEES,
        source: str = "gnss",
        max_s: float = 700.0,
    ) -> list[tuple[float, str]]:
        """Seconds until the first event of that state, and every reason of that tick."""
        for step in range(1, round(max_s / DT_S) + 1):
            self.time_s += DT_S
            rotation = np.full(4, mps * DT_S / RADIUS_M)
            rotation[list(lost)] = math.nan
            faults = tuple(SourceFault(self.time_s, source, kind) for kind in kinds)
            tick = Tick(0, self.time_s, DT_S, rotation, NAN4, faults=faults, host_time_s=self.time_s)
            estimate = RadiusEstimate(
                self.time_s, np.zeros(4), np.eye(4) * 1e-8, NAN4, True, 0.0, mps, 0.0, 0.0, 0.0, 0.0,
                1.0, 0.0, age_s, 40.0,
            )  # fmt: skip
            found = [e for e in self.watch.update(tick, estimate, watching, agreement) if e.state == word]
            if found:
                return [(step * DT_S, event.reason) for event in found]
        return []


def wrong(kind: str) -> dict[str, object]:
    """A tick in which something is out of order."""
    return {
        "rear": {"lost": ALL},
        "wheel": {"lost": (1,)},
        "gnss": {"age_s": 10.1},
        "unplugged": {"kinds": ("unplugged",)},
        "spoofed": {"kinds": ("spoofed",), "source": "can"},
        "disagree": {"agreement": WITHHELD},
        "unsteady": {"agreement": UNSTEADY},
        "blind": {"watching": WatchState(can_detect=False, undecided=False)},
        "undecided": {"watching": WatchState(can_detect=True, undecided=True)},
        "contradicted": {"watching": WatchState(True, False, "left and right")},
        "restarted": {"kinds": ("restarted",)},
    }[kind]  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("kind", "raised_s", "cleared_s"),
    [
        ("rear", 30.0, 3.0),
        ("wheel", 30.0, 3.0),
        ("gnss", 300.0, 30.0),
        ("unplugged", 30.0, 5.5),  # a fault stands for 2.5 s after it was last reported
        ("spoofed", 30.0, 5.5),
        ("unsteady", 30.0, 3.0),
        ("blind", 600.0, 10.0),
        ("undecided", 600.0, 60.0),
        ("contradicted", 0.5, 2.0),
        ("restarted", 0.5, 32.0),
    ],
)
def test_a_malfunction_takes_its_time_to_come_and_a_tenth_of_it_to_go(
    kind: str, raised_s: float, cleared_s: float
) -> None:
    """Raised with the tick that completes its time; cleared after a tenth of it in order, at least 2 s."""
    ticks = Ticks()
    assert [] == ticks.until("raised", max_s=20.0)
    ((raised, reason),) = ticks.until("raised", **wrong(kind))
    assert raised_s == raised
    assert [reason] == [event.reason for event in ticks.watch.active]
    ((cleared, over),) = ticks.until("cleared")
    assert (cleared_s, f"over: {reason}") == (cleared, over)
    assert () == ticks.watch.active


@pytest.mark.parametrize(
    ("kind", "all_blind"),
    [
        *((kind, True) for kind in ("rear", "disagree", "unsteady", "contradicted", "restarted")),
        *((kind, False) for kind in ("wheel", "gnss", "unplugged", "spoofed", "blind", "undecided")),
    ],
)
def test_some_malfunctions_leave_no_wheel_watched(kind: str, all_blind: bool) -> None:
    """Those of the rear pair, of the speed, of stamps, of the estimate and of the configuration."""
    ticks = Ticks()
    ticks.until("raised", max_s=5.0)
    assert not ticks.watch.unusable
    assert ticks.until("raised", **wrong(kind))
    assert all_blind == ticks.watch.unusable


def test_a_second_in_order_takes_back_what_was_counted() -> None:
    """Twenty-nine seconds, then one in order, count on; one and a half begin again."""
    for good_s, rest_s in ((1.0, 1.0), (1.5, 30.0)):
        ticks = Ticks()
        assert [] == ticks.until("raised", lost=(2, 3), max_s=29.0)
        assert [] == ticks.until("raised", max_s=good_s)
        assert [rest_s] == [after for after, _ in ticks.until("raised", lost=(2, 3))][:1]


def test_a_wheel_is_lost_after_its_time_and_not_before() -> None:
    """More than thirty seconds without a value; a wheel that was never read is lost from the start."""
    ticks = Ticks()
    assert [] == ticks.watch.recently_valid(ticks.time_s)
    ticks.until("raised", max_s=5.0)

    assert [0, 1, 2, 3] == ticks.watch.recently_valid(ticks.time_s + 30.0)
    assert [] == ticks.watch.recently_valid(ticks.time_s + 30.1)


@pytest.mark.parametrize(
    ("kind", "name", "cleared_s"),
    [("rear", "rear", 3.0), ("wheel", "fr", 3.0), ("gnss", "gnss", 30.0), ("blind", "blind", 10.0)],
)
def test_a_malfunction_of_a_missing_signal_stands_again_after_a_restart(
    kind: str, name: str, cleared_s: float
) -> None:
    """At once, as it was raised, while the signal is missing (UN R141: when the ignition is on again); it
    goes with the signal as ever, and is raised again by none."""
    before, after = Ticks(), Ticks()
    before.until("raised", **wrong(kind))  # type: ignore[arg-type]
    saved = json.loads(json.dumps(before.watch.to_json()))
    assert name in [entry["of"] for entry in saved]
    after.watch.restore(saved)
    assert [(one.reason, one.time_s) for one in before.watch.active] == [
        (one.reason, one.time_s) for one in after.watch.active
    ]
    assert [] == after.until("raised", max_s=5.0, **wrong(kind))  # type: ignore[arg-type]
    assert [cleared_s] == [after_s for after_s, _ in after.until("cleared", max_s=60.0)][:1]
    assert [] == after.watch.to_json()


@pytest.mark.parametrize(
    "kind", ["spoofed", "disagree", "unsteady", "contradicted", "restarted", "undecided"]
)
def test_other_malfunctions_are_found_anew(kind: str) -> None:
    """They say nothing of a signal that is missing."""
    ticks = Ticks()
    ticks.until("raised", **wrong(kind))  # type: ignore[arg-type]
    assert ticks.watch.active
    assert [] == ticks.watch.to_json()


@pytest.mark.parametrize(
    "saved", [[{"of": "rl"}], [{"of": "spare", "time_s": 1.0}], [{"of": "rl", "time_s": "x"}], [1], 1]
)
def test_what_is_no_malfunction_is_not_taken_up(saved: object) -> None:
    """And what stands goes on standing."""
    ticks = Ticks()
    ticks.until("raised", lost=(1,))
    standing = ticks.watch.active
    with pytest.raises((ValueError, KeyError, TypeError)):
        ticks.watch.restore(saved)  # type: ignore[arg-type]
    assert standing == ticks.watch.active


def test_a_slow_car_without_fixes_is_in_order() -> None:
    """Below 2 m/s a receiver may be without a fix for ever, as in a garage."""
    for mps, raised in ((2.0, []), (2.1, [300.0])):
        assert raised == [after for after, _ in Ticks().until("raised", mps=mps, age_s=99.0)]


def test_blind_time_is_that_above_forty_kilometres_an_hour() -> None:
    """At 40 km/h it does not count, above it does."""
    blind = WatchState(can_detect=False, undecided=False)
    for mps, raised in ((40.0 / 3.6, []), (40.1 / 3.6, [600.0])):
        assert raised == [after for after, _ in Ticks().until("raised", mps=mps, watching=blind)]


def at(time_s: float, speed_mps: float = math.nan, east_m: float = 0.0, north_m: float = 0.0) -> Tick:
    """A tick with one fix."""
    fix = Fix(time_s, 0.5, east_m, north_m, 1.0, speed_mps=speed_mps)
    return Tick(0, time_s, DT_S, NAN4, NAN4, (fix,))


def test_the_receivers_speed_is_its_own_for_two_seconds() -> None:
    """After that nothing is known; a fix that lies ahead says nothing either."""
    speed = ReceiverSpeed()
    assert 9.0 == speed.update(at(10.0, 9.0))
    later = [replace(at(10.0), time_s=time_s, fixes=()) for time_s in (10.0, 12.0, 12.1, 9.9)]
    assert [9.0, 9.0, True, True] == [math.isnan(now) or now for now in map(speed.update, later)]


def test_a_reckoned_fix_hides_no_other_of_its_tick() -> None:
    """Of two fixes in a tick, one reckoned by the receiver itself (quality 6), the other tells the speed."""
    first, second = at(10.0, 30.0).fixes[0], at(10.0, 9.0).fixes[0]
    both = replace(at(10.0), fixes=(replace(first, quality=6), second))
    assert 9.0 == ReceiverSpeed().update(both)


def test_the_distance_between_positions_a_second_apart_makes_a_speed() -> None:
    """From one to two seconds; of less and of more nothing is made."""
    speed = ReceiverSpeed()
    assert math.isnan(speed.update(at(10.0)))
    assert math.isnan(speed.update(at(10.9, east_m=90.0)))
    assert 5.0 == speed.update(at(11.0, east_m=3.0, north_m=4.0))
    assert 2.5 == speed.update(at(13.0, east_m=6.0, north_m=8.0))
    assert math.isnan(speed.update(at(15.1, east_m=9.0, north_m=12.0)))
    assert math.isclose(4.0, speed.update(at(16.1, east_m=9.0, north_m=16.0)))


def test_an_alarm_is_kept_as_it_was_but_for_its_radii() -> None:
    """Time, probability, reason, pressure and since when; what nobody knew stays unknown."""
    known = {(AlarmKind.DEFLATION, 2)}
    event = AlarmEvent(7.0, AlarmKind.DEFLATION, "rl", "raised", -0.001, 1e-4, 0.995, "soft", 0.25, 0.06, "")
    nan = math.nan
    for kept in (event, replace(event, pressure_loss=nan, pressure_loss_std=nan)):
        back = alarm_from_json(alarm_to_json(kept), known)
        assert repr(replace(kept, deviation_m=nan, std_m=nan)) == repr(back)
    for key, value in (
        ("wheel", "fr"),
        ("kind", "radius_deviation"),
        ("pressure_loss", 10.1),
        ("probability", 1.1),
    ):
        with pytest.raises(ValueError, match=r"of this car|pressure|probability"):
            alarm_from_json({**alarm_to_json(event), key: value}, known)
