"""The car's own speed by OBD-II: what its rounded numbers can tell, and what they may not do."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.onboard.monitor.test_signal_watch import Watched, fix
from tpmsd.onboard.monitor.health.signal_watch import WatchState
from tpmsd.onboard.monitor.sampling.car_speed import CarSpeed, SpeedAgreement, stated_range

NO_WHEELS = math.nan


@dataclass
class Asked(Watched):
    """A watch of a car that states its speed once a second."""

    reasons: list[str] = field(default_factory=list)

    def states(self, duration_s: float, kmh: int, **more: object) -> list[tuple[str, str, float]]:
        """As `play`, second by second."""
        reported = []
        for second in range(round(duration_s)):
            self.note_car_speed(kmh)
            reported += [(s, r, second + t) for s, r, t in self.play(1.0, **more)]  # type: ignore[arg-type]
            self.reasons += [alarm.reason for alarm in self.standing if alarm.reason not in self.reasons]
        return reported


@given(
    st.floats(0.0, 70.0),
    st.sampled_from([math.floor, math.ceil, round]),
    st.floats(-0.079, 0.079),
)
def test_a_stated_speed_holds_the_true_one(speed_mps: float, whole: object, off: float) -> None:
    """Rounded, truncated or raised, and off by the circumference of another tyre: the truth is within."""
    kmh = min(int(whole(3.6 * speed_mps * (1.0 + off))), 255)  # type: ignore[operator]
    low_mps, high_mps = stated_range(kmh)
    assert low_mps <= speed_mps + 1e-9
    assert speed_mps <= high_mps + 1e-9


def test_a_stated_speed_is_no_wider_than_its_causes() -> None:
    """100 km/h: one km/h to either side, and 8 % of scale."""
    low_mps, high_mps = stated_range(100)
    assert (99.0 / 3.6 / 1.08, 101.0 / 3.6 / 0.92) == pytest.approx((low_mps, high_mps), rel=1e-12)


def test_a_late_answer_is_held_against_the_speeds_of_two_seconds() -> None:
    """At full braking (10 m/s2) an answer that is two seconds old contradicts nobody; a longer one does."""
    car = CarSpeed()
    for tick in range(61):
        car.update(0.1 * tick, 30.0 - tick * 1.0 / 2.5, math.nan)
    car.note_stated(round(3.6 * (30.0 - 40 / 2.5)))
    assert True is car.update(6.0, 6.0, math.nan).wheels
    car.note_stated(round(3.6 * 30.0))
    assert False is car.update(6.1, 6.0, math.nan).wheels


def test_a_statement_holds_for_two_seconds() -> None:
    """What a car said a while ago says nothing any more."""
    car = CarSpeed()
    car.note_stated(72)
    received = [car.update(0.5 * k, 20.0, math.nan) for k in range(8)]
    assert [True] * 5 + [None] * 3 == [one.wheels for one in received]
    assert SpeedAgreement() == received[-1]


def test_wheels_that_stand_while_the_car_drives_are_a_malfunction() -> None:
    """Without a receiver, counters that are frozen look like a car that stands; the car says otherwise."""
    silent, asked = Watched(), Asked()

    assert [] == silent.play(600.0, wheels_mps=0.0)
    assert [("raised", "the wheels' speed is", 30.0)] == asked.states(600.0, 50, wheels_mps=0.0)[:1]
    assert [("cleared", "over: the wheels' speed", 3.0)] == asked.states(10.0, 50, wheels_mps=50 / 3.6)[:1]


def test_wheels_that_are_silent_while_the_car_drives_are_a_malfunction() -> None:
    """A bus without the wheels' frames is that of a parked car, unless the car drives."""
    silent, asked = Watched(), Asked()
    for watched in (silent, asked):
        watched.play(5.0, wheels_mps=0.0)

    assert [] == silent.play(60.0, wheels_mps=NO_WHEELS)
    assert ("raised", "no usable signal of", 30.0) in asked.states(60.0, 50, wheels_mps=NO_WHEELS)


def test_ten_minutes_of_blind_driving_are_counted_by_the_car_too() -> None:
    """While no soft tyre would be seen, the car's own speed counts the driving where wheels and receiver do
    not: from 45 km/h on, which is 40 km/h at the least."""
    blind = WatchState(can_detect=False, undecided=False)
    reported = {kmh: Asked(watching=blind).states(700.0, kmh, wheels_mps=0.0, age_s=1e3) for kmh in (44, 45)}

    of_blindness = {
        kmh: [t for _, reason, t in alarms if reason == "driving for ten minutes,"]
        for kmh, alarms in reported.items()
    }
    assert {44: [], 45: [600.0]} == of_blindness


@pytest.mark.parametrize(
    ("wheels_mps", "receiver_mps", "end"),
    [
        (20.0, 40.0, "; the car's own speed (OBD) agrees with the wheels"),
        (40.0, 20.0, "; the car's own speed (OBD) agrees with the receiver"),
        (40.0, 60.0, "(is it the right DBC?)"),
    ],
)
def test_a_disagreement_says_with_whom_the_car_agrees(
    wheels_mps: float, receiver_mps: float, end: str
) -> None:
    """Where wheels and receiver disagree the reason names the one that the car's own speed fits."""
    asked = Asked()
    asked.states(60.0, 72, wheels_mps=wheels_mps, fix=fix(receiver_mps))
    (reason,) = [text for text in asked.reasons if text.startswith("wheels and receiver disagree")]
    assert reason.endswith(end)


def test_against_wheels_and_receiver_together_it_is_outvoted() -> None:
    """A control unit that lies, or knows another tyre, raises nothing while wheels and receiver agree."""
    asked = Asked()
    assert [] == asked.states(700.0, 200, wheels_mps=20.0, fix=fix(20.0))


def test_a_wheel_speed_in_the_wrong_unit_is_found_without_a_receiver() -> None:
    """Speeds read as m/s that are km/h: the car's own speed is a third of it."""
    asked = Asked()
    assert [("raised", "the wheels' speed is", 30.0)] == asked.states(60.0, 50, wheels_mps=50.0)
