"""A receiver that errs for a while, and wheels that are decoded wrongly: what is a malfunction and what is
said of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.onboard.monitor.drives import ALL, RADIUS_M
from tpmsd.car.config.model import MonitorConfig
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.gates.agreement import AgreementWatch
from tpmsd.onboard.monitor.health.signal_watch import SignalWatch, WatchState
from tpmsd.onboard.monitor.records import AlarmEvent
from tpmsd.onboard.timeline.tick import Fix, Tick

DT_S, SPEED_MPS = 0.1, 20.0
RADII_M = np.full(4, RADIUS_M)
RADIUS_STD_M = 0.2e-3
SEES = WatchState(can_detect=True, undecided=False)
NINE_MINUTES_S = 540.0

Profile = Callable[[float], float]


def played(
    duration_s: float, error_mps: Profile, scale: float = 1.0, period_s: float = 0.1
) -> tuple[list[tuple[str, str, float]], float]:
    """Events as (state, reason, time), and for how long fixes were withheld: straight on at 20 m/s, with a
    receiver whose speed is off by `error_mps` of the time and wheels that turn `scale` times too fast."""
    agreement, watch = AgreementWatch(), SignalWatch(MonitorConfig(), ALL)
    events: list[AlarmEvent] = []
    withheld_s = 0.0
    every = round(period_s / DT_S)
    for index in range(1, round(duration_s / DT_S) + 1):
        time_s = DT_S * index
        fixes: tuple[Fix, ...] = ()
        if index % every == 0:
            speed_mps = SPEED_MPS + error_mps(time_s)
            fixes = (Fix(time_s, 1.0, SPEED_MPS * time_s, 0.0, 1.0, speed_mps=speed_mps, heading_rad=0.0),)
        rotation = np.full(4, scale * SPEED_MPS * DT_S / RADIUS_M)
        tick = Tick(index, time_s, DT_S, rotation, np.zeros(4), fixes, host_time_s=time_s)
        said = agreement.update(tick, RADII_M, RADIUS_STD_M)
        estimate = RadiusEstimate(
            time_s, np.zeros(4), np.eye(4) * 1e-8, np.zeros(4), True, 0.0, scale * SPEED_MPS, 0.0,
            SPEED_MPS * time_s, 0.0, 0.0, 1.0, 0.0, 0.1, 40.0,
        )  # fmt: skip
        withheld_s += DT_S * said.withheld
        events += watch.update(tick, estimate, SEES, said)
    return [(event.state, event.reason, event.time_s) for event in events], withheld_s


def burst(begin_s: float, length_s: float, size_mps: float) -> Profile:
    """A speed that is off by so much for so long."""
    return lambda time_s: size_mps if begin_s <= time_s < begin_s + length_s else 0.0


@pytest.mark.parametrize("size_mps", [-2.5, -1.2, 0.8, 1.2])
@pytest.mark.parametrize("period_s", [0.1, 1.0])
def test_twenty_seconds_of_a_wrong_speed_are_no_malfunction(size_mps: float, period_s: float) -> None:
    """After nine good minutes a receiver errs for twenty seconds: its fixes are withheld until it has agreed
    for a while, and nothing is announced."""
    events, withheld_s = played(660.0, burst(NINE_MINUTES_S, 20.0, size_mps), period_s=period_s)
    assert 25.0 < withheld_s < 45.0
    assert [] == events


def test_a_receiver_that_stays_wrong_is_a_malfunction_and_no_wrong_dbc() -> None:
    """After nine good minutes the speed goes wrong for good: announced after `malfunction_s` of it and the
    seconds that a disagreement takes to show, and nobody is asked for the DBC."""
    events, _ = played(660.0, burst(NINE_MINUTES_S, 1e9, -1.2))
    ((state, reason, time_s),) = events
    assert ("raised", "wheels and receiver disagree on the speed, on which they agreed before") == (
        state,
        reason,
    )
    assert time_s == pytest.approx(NINE_MINUTES_S + 5.0 + MonitorConfig().malfunction_s, abs=1.0)


@pytest.mark.parametrize("scale", [0.93, 1.07, 1.6])
def test_wheels_of_a_wrong_scale_are_announced_in_their_time(scale: float) -> None:
    """Wheel speeds that are wrong from the start by 7 % or in unit: announced after `malfunction_s` and the
    three seconds that four fixes take, with the question for the DBC."""
    events, _ = played(60.0, lambda time_s: 0.0, scale=scale)
    ((state, reason, time_s),) = events
    assert ("raised", "wheels and receiver disagree on the speed (is it the right DBC?)") == (state, reason)
    assert time_s <= 3.5 + MonitorConfig().malfunction_s
