"""Cars that lean in bends at motorway speed: the outer radii shrink, and the wheels show too much turn."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.estimators.world import World, estimator, run
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank.error_state import GYRO, LAT

USUAL_S2 = 2.0e-4
"""Of a car with soft tyres: at 27 m/s its wheels show 1.5 times its turn."""
SPEED_MPS = 27.0
BEND_S = (0.0, 12.0, 14.0, 24.0, 26.0, 40.0)
GYRO_BIAS_RADPS = 0.001


def steady(time_s: FloatArray) -> FloatArray:
    return np.full_like(time_s, SPEED_MPS)


def bends(time_s: FloatArray) -> FloatArray:
    """Ten seconds of 2.3 m/s2 sideways out of forty, left and right in turn; rad/s."""
    side = np.where(time_s // 40.0 % 2 == 0, 1.0, -1.0)
    return 0.085 * side * np.interp(time_s % 40.0, BEND_S, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])


def leaning(seed: int) -> World:
    return World(
        duration_s=240.0, seed=seed, speed_mps=steady, yaw_radps=bends, lean_s2=USUAL_S2, teeth=math.inf
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_a_bend_that_ends_leaves_no_error_of_heading(seed: int) -> None:
    """Without a gyro the heading stays within 1.5 degrees into bends and out of them, and the radii of left
    and right at the end of a straight are right within 0.1 mm."""
    drive = leaning(seed).drive()
    estimates = run(estimator("gaussian-sum", drive.world), drive.ticks)

    off = [
        math.remainder(e.heading_rad - psi, 2 * math.pi)
        for e, psi in zip(estimates[600:], drive.pose[600:, 2], strict=True)
    ]
    assert math.radians(1.5) > np.abs(off).max()
    reported, true = estimates[-1].deviation_m, drive.offsets_m[-1]
    assert reported[2] - reported[3] == pytest.approx(true[2] - true[3], abs=0.1e-3)


def test_a_gyro_is_believed_though_the_wheels_show_half_as_much_turn_again() -> None:
    """The gyro of a leaning car is held against its turn, not against its wheels': its zero is learned."""
    drive = leaning(3).drive()
    filter_ = estimator("gaussian-sum", drive.world)
    for k, tick in enumerate(drive.ticks):
        turning = float(bends(np.array([0.1 * k + 0.05]))[0])
        filter_.step(replace(tick, yaw_rate_radps=turning + GYRO_BIAS_RADPS))

    assert GYRO_BIAS_RADPS == pytest.approx(filter_.snapshot()["nuisance"][GYRO - LAT], abs=2e-4)
