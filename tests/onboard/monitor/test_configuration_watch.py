"""The first ten minutes of driving against the configuration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.faults.attacks import attacked, played_ticks
from tpmsd.onboard.estimators.build import monitored_wheels
from tpmsd.onboard.monitor.health.configuration_watch import ConfigurationWatch
from tpmsd.onboard.timeline.tick import Tick

Change = Callable[[Tick], Tick]


def wheels(order: list[int], factor: float = 1.0) -> Change:
    """Ticks of a file with exchanged wheels, or other teeth."""
    return lambda tick: replace(tick, rotation_rad=factor * tick.rotation_rad[order])


def gyro(factor: float) -> Change:
    """Ticks of a gyro with this scale, made of the receiver's course."""
    before: list[tuple[float, float]] = []

    def change(tick: Tick) -> Tick:
        rate = float("nan")
        for fix in tick.fixes:
            if before:
                time_s, heading = before.pop()
                turned = (fix.heading_rad - heading + np.pi) % (2.0 * np.pi) - np.pi
                rate = factor * turned / max(fix.time_s - time_s, 1e-3)
            before.append((fix.time_s, fix.heading_rad))
        return replace(tick, yaw_rate_radps=rate if np.isfinite(rate) else 0.0)

    return change


SAME = [0, 1, 2, 3]
WRONG = {
    "left and right": (wheels([1, 0, 3, 2]), "left and right of the front and rear wheels"),
    "left and right of the rear": (wheels([0, 1, 3, 2]), "left and right of the rear wheels"),
    "44 teeth for 48": (wheels(SAME, 48.0 / 44.0), "teeth, unit or scale"),
    "mph for km/h": (wheels(SAME, 1.609), "teeth, unit or scale"),
}


def watched(change: Change) -> tuple[str, float]:
    """What is contradicted, and when; the drive is `attacked`."""
    config, _, ticks = attacked()
    watch = ConfigurationWatch(config.vehicle, list(monitored_wheels(config)))
    for tick in ticks:
        if said := watch.update(change(tick)):
            return said, tick.time_s - ticks[0].time_s
    return "", 0.0


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_file_is_contradicted_within_ten_minutes(kind: str) -> None:
    """Exchanged sides, teeth and units are named."""
    change, words = WRONG[kind]
    said, at_s = watched(change)
    assert words in said
    assert at_s < 600.0


def test_a_right_file_is_not_contradicted() -> None:
    """Nor with one tyre 3 % small, nor with all four 2 % larger than nominal."""
    soft = wheels(SAME)
    assert ("", 0.0) == watched(soft)
    assert ("", 0.0) == watched(lambda t: replace(t, rotation_rad=t.rotation_rad * [1.0, 1.03, 1.0, 1.0]))
    assert ("", 0.0) == watched(wheels(SAME, 1.0 / 1.02))


def test_a_gyro_with_the_wrong_sign_is_named() -> None:
    """The yaw rate against the course; with the right sign it is not."""
    assert "its sign seems wrong" in watched(gyro(-1.0))[0]
    assert ("", 0.0) == watched(gyro(1.0))


def test_a_contradicted_file_is_a_malfunction_and_nothing_is_learned() -> None:
    """Left and right exchanged: `malfunction` with that reason, no wheel is watched, no tyre accused, and the
    baseline holds no sample."""
    change, words = WRONG["left and right"]
    outcome = played_ticks(lambda ticks, start_s: [change(tick) for tick in ticks])
    assert [("malfunction", None, "raised")] == outcome.alarms
    assert any(words in reason for reason in outcome.reasons)
    last = outcome.steps[-1].report
    assert {"unavailable"} == {str(wheel.state) for wheel in last.wheels}
    assert last.learning is not None
    assert 0 == sum(samples for _, samples in last.learning.samples_by_kmh)


def test_tyres_of_unequal_radius_are_not_exchanged() -> None:
    """A wheel that is 4 % small shows a turn all the time, larger than those of the road."""
    unequal = np.array([1.0, 1.0, 1.0, 1.04])
    assert ("", 0.0) == watched(lambda tick: replace(tick, rotation_rad=tick.rotation_rad * unequal))
    small_left = np.array([1.0, 1.0, 1.04, 1.0])
    assert ("", 0.0) == watched(lambda tick: replace(tick, rotation_rad=tick.rotation_rad * small_left))
