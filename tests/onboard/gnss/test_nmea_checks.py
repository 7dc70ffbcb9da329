"""The epochs' checks by themselves, at the very edge of their limits."""

from __future__ import annotations

import math

import pytest

from tpmsd.onboard.sources.events import GnssFix
from tpmsd.onboard.sources.gnss.nmea_checks import Episodes, EpochInterval, FrozenPosition, Leap

DEGREE_M = 111195.0  # of a meridian of a sphere of 6371 km


def fix(north_m: float = 0.0, east_m: float = 0.0, at_s: float = 0.0, speed_mps: float = 20.0) -> GnssFix:
    """A fix so far from 60 degrees north, 179.999 degrees east; the date line is near."""
    latitude = 60.0 + north_m / DEGREE_M
    longitude = 179.999 + east_m / (DEGREE_M * math.cos(math.radians(latitude)))
    if longitude > 180.0:
        longitude -= 360.0
    return GnssFix(at_s, at_s, latitude_deg=latitude, longitude_deg=longitude, quality=1, speed_mps=speed_mps)


@pytest.mark.parametrize(("north", "east"), [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.6, 0.8)])
@pytest.mark.parametrize("elapsed_s", [0.0, 2.0])
def test_a_position_is_out_of_reach_beyond_its_distance(north: float, east: float, elapsed_s: float) -> None:
    """500 m and 150 m/s since the last fix, in any direction and over the date line, are within reach."""
    for factor, leapt in ((0.999, False), (1.001, True)):
        distance_m, leap = factor * (500.0 + 150.0 * elapsed_s), Leap()
        assert not leap.judge(fix())
        assert leapt is leap.judge(fix(north * distance_m, east * distance_m, elapsed_s))


def test_a_new_place_is_believed_from_the_third_fix_on() -> None:
    """Three fixes in a row within reach of one another are accepted; one that is elsewhere begins again."""
    leap = Leap()
    reported = [leap.judge(fix(north_m)) for north_m in (0.0, 9e3, 5e4, 5e4, 5e4, 5e4, 0.0, 5e4)]
    assert [False, True, True, True, False, False, True, False] == reported


def test_a_position_is_frozen_from_the_fifth_time_on() -> None:
    """The same place five times at more than 2 m/s; slower fixes restart the count, until it is frozen."""
    frozen = FrozenPosition()
    assert [False] * 4 + [True] * 2 == [frozen.judge(fix()) for _ in range(6)]
    assert frozen.judge(fix(speed_mps=0.0))
    assert not frozen.judge(fix(1.0))
    speeds = (3.0, 3.0, 2.0, 2.1, 2.1, 2.1, 2.1, 2.1)
    assert [False] * 6 + [True] * 2 == [frozen.judge(fix(1.0, speed_mps=speed)) for speed in speeds]


def test_an_episode_is_reported_once_and_ends_with_good_epochs() -> None:
    """One good epoch ends an episode; of repeated epochs it takes twenty."""
    counts = dict.fromkeys(Episodes.KINDS, 0)
    for kind, good in (("leap", 1), ("repeated", 20)):
        episodes = Episodes(counts)
        reported = []
        for wrong in [True, True] + [False] * (good - 1) + [True] + [False] * good + [True]:
            reported += [fault.time_s for fault in episodes.note(float(len(reported)), kind, wrong)]
        assert [0.0, 1.0] == reported
        assert 4 == counts[kind]


def test_intervals_between_epochs_are_those_of_receivers() -> None:
    """Intervals from 5 ms to 10 s count, also over midnight; others, as those of lost fixes, do not."""
    for step_s, counted in ((0.004, False), (0.06, True), (9.9, True), (10.1, False)):
        interval = EpochInterval()
        interval.learn(86399.99)
        interval.learn((86399.99 + step_s) % 86400.0)
        interval.learn(86399.99)  # back by that much: no interval
        gap_s = min(max(0.3 * step_s, 0.02), 0.25)
        assert pytest.approx(gap_s if counted else 0.25) == interval.gap_s
    interval = EpochInterval()
    for time_s in (0.0, 0.1, 0.2, 9.9, 10.0):
        interval.learn(time_s)
    assert pytest.approx(0.03) == interval.gap_s
