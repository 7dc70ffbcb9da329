"""Positions that are worse than the receiver states: its own speeds say so, and the radii stay."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tpmsd
from tests.onboard.estimators.world import START_S, Receiver, World, errors_m, estimator, run, stds_m
from tpmsd.foundation.wheels import RR, FloatArray
from tpmsd.offline.drives.reading import DESK_RATE_HZ, read_ticks
from tpmsd.onboard.estimators.build import build_estimator
from tpmsd.onboard.estimators.gates.position_accuracy import PositionAccuracy
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Fix, Tick

STATED_M = 0.18
SPEED_MPS = 20.0
RTK = Receiver(period_s=0.1, position_std_m=0.02, white_std_m=0.01, velocity_std_mps=0.03, course=False)


def straight_fix(time_s: float, error_m: float = 0.0, **more: float) -> Fix:
    """A fix due east at `SPEED_MPS`; `error_m` is added to its east."""
    return replace(Fix(time_s, 1.0, SPEED_MPS * time_s + error_m, 0.0, STATED_M, speed_mps=SPEED_MPS), **more)


def town_speed(time_s: FloatArray) -> FloatArray:
    """Between 0 and 24 m/s within a minute."""
    return 12.0 - 12.0 * np.cos(time_s / 9.0)


def used_m(fixes: list[Fix]) -> list[float]:
    """Standard deviation of each position that is used."""
    watch = PositionAccuracy()
    return [watch.with_judged_std(fix).position_std_m for fix in fixes]


def test_a_slide_is_matched_by_the_slow_error() -> None:
    """Positions that run ahead of the speed by 1 m/s for T: the variance that is added is that of a slow
    error whose change over T is what the stated one and the speed leave unexplained."""
    used = used_m([straight_fix(0.125 * k, 0.125 * k) for k in range(97)])

    span_s, path_m = 5.0, 21.0 * 5.0  # five steps of a second
    growth = 2.0 * (1.0 - math.exp(-span_s / 40.0))
    known_m2 = (
        2.0 * STATED_M**2 + growth * (3.0 * STATED_M) ** 2 + 0.06**2 * 2.0 * span_s + (0.003 * path_m) ** 2
    )
    expected_m = math.sqrt(STATED_M**2 + (span_s**2 - 9.0 * known_m2) / growth)
    assert used[:40] == [STATED_M] * 40
    assert used[-1] == pytest.approx(expected_m, rel=1e-6)


def test_what_was_found_fades_with_the_slow_error() -> None:
    """A slide that has ended: what it added falls by e within the correlation time of the slow error."""
    fixes = [straight_fix(0.1 * k, min(0.1 * k, 10.0)) for k in range(1000)]
    used = np.array(used_m(fixes))
    added = np.sqrt(used**2 - STATED_M**2)
    assert added[700] / added[300] == pytest.approx(math.exp(-40.0 / SETTINGS.bias_tau_s), rel=1e-6)


def test_speeds_that_are_stated_to_be_poor_convict_no_position() -> None:
    """The same slide against speeds that the receiver calls ten times worse than usual adds less; against no
    speeds it adds nothing."""
    slide = [straight_fix(0.1 * k, 0.1 * k) for k in range(101)]
    poor = used_m([replace(fix, speed_noise=10.0) for fix in slide])
    silent = used_m([replace(fix, speed_mps=math.nan) for fix in slide])
    assert STATED_M == poor[-1]
    assert {STATED_M} == set(silent)


@pytest.mark.parametrize("radius_m", [40.0, 150.0, 600.0])
def test_a_bend_is_no_slide(radius_m: float) -> None:
    """On a circle driven at 4 m/s2 across, without a course, chords become arcs and the statement stands."""
    speed = math.sqrt(4.0 * radius_m)
    fixes = []
    for k in range(600):
        angle = speed * 0.1 * k / radius_m
        at = radius_m * math.cos(angle), radius_m * math.sin(angle)
        fixes.append(Fix(0.1 * k, 1.0, *at, STATED_M, speed_mps=speed))
    assert {STATED_M} == set(used_m(fixes))


@pytest.mark.parametrize("lag_s", [-0.1, 0.1])
def test_a_speed_of_another_epoch_is_no_slide(lag_s: float) -> None:
    """Braking from 30 m/s at 4 m/s2 with a speed that is a tenth of a second off leaves the statement."""
    fixes = []
    for k in range(75):
        time_s = 0.1 * k
        east_m = 30.0 * time_s - 2.0 * time_s**2
        fixes.append(Fix(time_s, 1.0, east_m, 0.0, STATED_M, speed_mps=30.0 - 4.0 * (time_s - lag_s)))
    assert {STATED_M} == set(used_m(fixes))


@pytest.mark.parametrize("receiver", [Receiver(), Receiver(period_s=1.0, position_std_m=2.0), RTK])
def test_an_honest_receiver_is_taken_at_its_word(receiver: Receiver) -> None:
    """Of twenty minutes of errors as they are stated, and with town speeds, no position is judged worse; nor
    where half of the error is not stated."""
    drive = World(duration_s=1200.0, receiver=receiver, speed_mps=town_speed).drive()
    fixes = [fix for tick in drive.ticks for fix in tick.fixes]
    stated = [fix.position_std_m for fix in fixes]
    assert stated == used_m(fixes)
    modest = [replace(fix, position_std_m=fix.position_std_m / 2.0) for fix in fixes]
    assert [one / 2.0 for one in stated] == used_m(modest)


def slid(ticks: list[Tick], error_m: Callable[[float], float]) -> list[Tick]:
    """The ticks with positions that are off by `error_m` of the time along the way."""
    out = []
    for tick in ticks:
        fixes = []
        for fix in tick.fixes:
            off_m = error_m(fix.time_s - START_S)
            fixes.append(replace(fix, east_m=fix.east_m + off_m, position_std_m=STATED_M))
        out.append(replace(tick, fixes=tuple(fixes)))
    return out


def float_solution(time_s: float) -> float:
    """20 m behind from 90 s on, sliding to nothing within 25 s."""
    return -20.0 * max(1.0 - (time_s - 90.0) / 25.0, 0.0) if time_s >= 90.0 else 0.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_float_solution_that_slides_moves_no_radius(seed: int) -> None:
    """20 m of error that slide away within 25 s while decimetres are stated: from the jump on every rear
    radius stays within three of its standard deviations, and moves by less than half a millimetre from one
    second to the next."""
    world = World(
        duration_s=150.0,
        seed=seed,
        receiver=RTK,
        speed_mps=lambda t: np.full_like(t, SPEED_MPS),
        yaw_radps=lambda t: 0.02 * np.sin(t / 9.0),
    )
    drive = world.drive()
    estimates = run(estimator("gaussian-sum", world, front=False), slid(drive.ticks, float_solution))
    off, std = errors_m(drive, estimates)[890:, 2:], stds_m(estimates)[890:, 2:]
    assert np.abs(off / std).max() < 3.0
    assert np.abs(off[10:] - off[:-10]).max() < 0.5e-3


GROWTH_S2PM = 1.0e-6
"""Radius per square of the speed, as of `physics.priors`."""


def test_the_vans_float_solution_moves_no_radius(recordings: Path) -> None:
    """`van-motorway-c` loses its solution at 507 s and slides back by 15 m within 25 s: from 300 s on, above
    3 m/s, the rear right radius is within three of its own standard deviations of +0.05 mm, which RTK and the
    other drives of these days say at 27 m/s, less the growth with speed."""
    drive = tpmsd.load(recordings / "van-motorway-c")
    ticks = read_ticks(drive.recording, drive.config, DESK_RATE_HZ)
    filter_ = build_estimator(drive.config, np.random.default_rng(1))
    said = [filter_.step(tick) for tick in ticks]
    steady = [one for one in said if one.time_s - ticks[0].time_s > 300.0 and one.speed_mps > 3.0]
    truth_m = np.array([0.05e-3 + GROWTH_S2PM * (one.speed_mps**2 - 27.0**2) for one in steady])
    found_m = np.array([one.deviation_m[RR] for one in steady])
    std_m = np.sqrt([one.covariance_m2[RR, RR] for one in steady])
    assert len(steady) > 2000
    assert np.all(np.abs(found_m - truth_m) < 3.0 * std_m)
