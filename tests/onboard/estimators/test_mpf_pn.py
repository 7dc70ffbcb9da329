"""MPF-PN, the program's, where no radius changes: the noise it learns, outages, resets of the counters; and
all methods in the few ticks without counts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.estimators.world import (
    METHODS,
    RADIUS_M,
    START_S,
    Receiver,
    World,
    errors_m,
    estimator,
    filter_of,
    run,
    straight,
)
from tpmsd.car.config.model import FilterConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.published.niw import NormalInverseWishart
from tpmsd.onboard.estimators.published.radius_models import Floors, NiwRadii
from tpmsd.onboard.estimators.published.samples import SampledPieces
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.estimators.table import TABLE, Row
from tpmsd.onboard.timeline.tick import Fix, Tick

STATED_M = 4.5
"""What the bench's correlated receiver states to MPF-PN (`bench/campaigns/onboard/estimators/methods.py`)."""
SHARED_M, APART_M = 10e-3, 0.14e-3
"""Noise of a tick after hours: that which both wheels share, and each wheel's own."""


def learned(count: int, mean_m: FloatArray, memory: float) -> NormalInverseWishart:
    """Statistics as after hours of forgetting over `memory` ticks."""
    noise = np.full((2, 2), SHARED_M**2) + np.eye(2) * APART_M**2
    return NormalInverseWishart(
        gamma=1.0 / memory,
        mean=np.tile(mean_m, (count, 1)),
        nu=memory,
        scale=np.tile(noise * (memory - 3.0), (count, 1, 1)),
    )


def test_the_noise_of_left_against_right_has_a_floor() -> None:
    """var(left - right) = S11 + S22 - 2 S12 of E[Sigma] is that of two floors at least, the variances stay,
    and what is above is left alone."""
    tight, loose = learned(3, np.zeros(2), 200.0), learned(3, np.zeros(2), 200.0)
    loose.scale[:, 0, 1] = loose.scale[:, 1, 0] = 0.3 * loose.scale[:, 0, 0]
    for each in (tight, loose):
        before = each.scale.copy()
        # A realised error at the mean adds nothing to Lambda: what changes is what the floors do.
        NiwRadii(floors=Floors(apart=True)).learn(each, each.mean.T)
        sigma = each.noise_covariance(np.full(3, 1 / 3))
        assert np.array_equal(each.scale[:, [0, 1], [0, 1]], before[:, [0, 1], [0, 1]])
        assert np.linalg.eigvalsh(sigma)[0] > 0.0
        apart = sigma[0, 0] + sigma[1, 1] - 2 * sigma[0, 1]
        if each is tight:
            assert apart == pytest.approx(2 * SETTINGS.noise_floor_m**2, rel=1e-6)
        else:
            assert np.array_equal(each.scale, before)


def town(time_s: FloatArray) -> FloatArray:
    return 12.0 + 1.0 * np.sin(time_s / 17.0)


@pytest.mark.parametrize("seed", [2, 4, 5])
def test_a_receiver_that_errs_slowly_is_no_change_of_a_radius(seed: int) -> None:
    """After hours of driving, slow errors of 3 m and a step of 8 m: left against right stays within 0.6 mm of
    the truth (0.33 at most). With the noise frozen, changes of 2.5 to 9 mm were assumed in turn."""
    receiver = Receiver(position_std_m=3.0, white_std_m=0.3, jumps=((100.0, math.inf, 8.0),))
    world = World(180.0, seed=seed, speed_mps=town, yaw_radps=straight, receiver=receiver)
    drive = world.drive()
    ticks = [
        replace(t, fixes=tuple(replace(f, position_std_m=STATED_M) for f in t.fixes)) for t in drive.ticks
    ]
    settings = FilterConfig(method="mpf-pn-niw", rate_hz=10.0, window_s=20.0)
    known = learned(500, drive.offsets_m[0, 2:], 200.0)
    pieces = TABLE["mpf-pn-niw"].pieces
    assert isinstance(pieces, SampledPieces)
    row = Row(replace(pieces, radii=NiwRadii(floors=Floors(apart=True), known=known)))
    filter_ = filter_of(row, settings=settings, seed=seed)
    error = errors_m(drive, run(filter_, ticks))
    assert np.abs(error[:, 2] - error[:, 3]).max() < 0.6e-3


def test_without_fixes_no_change_is_supposed() -> None:
    """Half a minute without the receiver: left against right is not stated wider than the noise of these
    ticks makes it (it was, by the changes that nothing judged)."""
    receiver = Receiver(outage=(150.0, 180.0))
    world = World(180.0, receiver=receiver)
    drive = world.drive()
    estimates = run(estimator("mpf-pn", world, front=False), drive.ticks)
    covariance = np.array([e.covariance_m2[2:, 2:] for e in estimates])
    apart = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1] - 2 * covariance[:, 0, 1])
    assert apart[-1] < 1.5 * apart[1530:1540].mean()


def straight_on(method: str, torn: range) -> float:
    """How far the heading is off, rad, after ticks without counts or fixes, on a straight road at 12 m/s.

    Before them the right wheel is read one count ahead, which no estimate can know.
    """
    quantum = 2 * math.pi / 48
    filter_ = estimator(method, World(), front=False)
    off = math.nan
    for k in range(1, torn.stop + 1):
        fixes: tuple[Fix, ...] = ()
        if k < torn.start:
            fixes = (Fix(START_S + 0.1 * k, 1.0, 1.2 * k, 0.0, 1.0, speed_mps=12.0, heading_rad=0.0),)
        angle = np.full(4, 1.2 / RADIUS_M)
        angle[3] += quantum if k == torn.start - 1 else 0.0
        if k in torn:
            angle[:] = math.nan
        tick = Tick(k, START_S + 0.1 * k, 0.1, angle, np.full(4, quantum / math.sqrt(6)), fixes)
        off = filter_.step(tick).heading_rad
    return abs(math.remainder(off, 2 * math.pi))


@pytest.mark.parametrize("method", sorted(METHODS))
def test_one_count_turns_no_car_while_the_counts_are_missing(method: str) -> None:
    """One count of 48 is 0.041 m or 0.027 rad in a tick of 0.1 s; held for 0.7 s it would be 0.19 more."""
    assert straight_on(method, range(301, 308)) < 0.08
