"""What is stated of the radii: without the chance of a change that was just assumed, and without the floors
that keep the bank quick."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.onboard.estimators.test_error_state import NOMINAL
from tests.onboard.estimators.world import World, estimator, run
from tpmsd.onboard.estimators.bank.error_state import MU
from tpmsd.onboard.estimators.bank.jump_hypotheses import JUMPS, Bank, radius_statement
from tpmsd.onboard.estimators.bank.kernel import KERNEL, ArrayKernel, BankKernel
from tpmsd.onboard.estimators.settings import SETTINGS

KERNELS = (ArrayKernel(), KERNEL)
METHODS = ("gaussian-sum", "mpf-pn")
PAIR = NOMINAL[:2]


def bank_of(weights: list[float], means: list[float], variances: list[float]) -> Bank:
    """A bank of the rear pair, alike in both wheels; hypotheses beyond those given weigh nothing."""
    bank = JUMPS.begin(8, PAIR)
    bank.log_weights[:] = -1e9
    for place, (weight, mean, variance) in enumerate(zip(weights, means, variances, strict=True)):
        bank.log_weights[place] = math.log(weight)
        bank.mean[place, MU:] = mean
        bank.covariance[place, MU:, MU:] = variance * np.eye(2)
    return bank


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: type(kernel).__name__)
def test_a_change_just_supposed_is_distinguished(kernel: BankKernel) -> None:
    """Weights 0.9 and 0.1, the second a change of 3 s ago: its probability is 0.1, and the moments are those
    of the first alone. At 0.4 to 0.6 they are those of the second, and after the time they are both's."""
    bank = bank_of([0.9, 0.1], [1e-3, 2e-3], [1e-8, 4e-6])
    bank.since_s[1] = 3.0
    said = radius_statement(bank, kernel)
    assert (0.1, 1e-3, 1e-8) == pytest.approx(
        (said.change_probability, said.mean_m[0], said.covariance_m2[0, 0])
    )
    bank.log_weights[:2] = np.log([0.4, 0.6])
    said = radius_statement(bank, kernel)
    assert (0.6, 2e-3, 4e-6) == pytest.approx(
        (said.change_probability, said.mean_m[0], said.covariance_m2[0, 0])
    )
    bank.since_s[1] = SETTINGS.recent_change_s + 1.0
    said = radius_statement(bank, kernel)
    mean, within, between = 1.6e-3, 0.4 * 1e-8 + 0.6 * 4e-6, 0.4 * 0.6 * 1e-6
    assert (0.0, mean, within + between, between) == pytest.approx(
        (said.change_probability, said.mean_m[0], said.covariance_m2[0, 0], said.covariance_m2[0, 1])
    )


@pytest.mark.skipif(isinstance(KERNEL, ArrayKernel), reason="the compiled kernel is not built here")
def test_one_triangle_is_enough() -> None:
    """The lower triangle of the covariances may hold anything where compiled code keeps the upper alone."""
    kernel = KERNEL
    bank = bank_of([0.5, 0.5], [0.0, 0.0], [1e-6, 1e-6])
    bank.covariance[:, MU, MU + 1] = bank.covariance[:, MU + 1, MU] = 4e-7
    expected = radius_statement(bank, kernel).covariance_m2
    bank.covariance[:, MU + 1, MU] = 99.0
    assert np.array_equal(expected, radius_statement(bank, kernel).covariance_m2)
    assert 4e-7 == pytest.approx(expected[1, 0])


def test_a_level_kept_in_play_weighs_what_the_evidence_left_it() -> None:
    """A level that fell to e^-9 of the best is raised to the floor and stated at e^-9; one that fell to e^-40
    is stated at the probability that the level has changed to it within the block; the bank's own weights are
    at the floor in either case."""
    count = 4 * len(JUMPS.kinds(2))
    for fallen, chance in ((-9.0, math.exp(-9.0)), (-40.0, 0.005 * 1.0 / SETTINGS.level_tau_s)):
        bank = JUMPS.begin(count, PAIR)
        kinds = len(JUMPS.kinds(2))
        bank.log_weights[:kinds] = 0.0
        last = kinds - 1
        assert 4.0 == bank.level[last, 0]
        bank.log_weights[last] = fallen
        JUMPS.keep_levels(bank, 1.0)
        child = int(np.flatnonzero((bank.kind == last) & (bank.log_weights > -8.0))[0])
        assert math.log(SETTINGS.level_floor) == pytest.approx(bank.log_weights[child])
        assert math.log(chance) == pytest.approx(bank.log_weights[child] - bank.raised[child])
        # What branches off it is raised by as much.
        bank.copy(0, child)
        assert bank.raised[0] == bank.raised[child]


@pytest.mark.parametrize("method", METHODS)
def test_a_quiet_drive_is_stated_sharper_and_a_change_is_reported(method: str) -> None:
    """Before a wheel loses 2 %, a change is improbable and left against right is stated more sharply than by
    all hypotheses together; within 5 s after, a change is probable; 30 s later it is an old one."""
    world = World(duration_s=150.0, fault=(2, -0.02, 110.0))
    drive = world.drive()
    estimates = run(estimator(method, world), drive.ticks)
    rear = np.array([0.0, 0.0, 1.0, -1.0])
    ratios, chances = [], []
    for estimate in estimates[900:1090]:
        assert estimate.stated is not None
        ratios.append(rear @ estimate.stated.covariance_m2 @ rear / (rear @ estimate.covariance_m2 @ rear))
        chances.append(estimate.stated.change_probability)
    assert np.mean(ratios) < 0.95
    assert max(chances) < 0.3
    after = [one.stated.change_probability for one in estimates[1100:1150] if one.stated is not None]
    assert max(after) > 0.9
    last = estimates[-1]
    assert last.stated is not None and last.stated.change_probability < 0.3
    std = math.sqrt(last.stated.covariance_m2[2, 2])
    assert abs(last.stated.mean_m[2] - (drive.offsets_m[-1][2])) < max(3.0 * std, 1e-3)


def test_filters_without_hypotheses_state_none() -> None:
    """AUG-EKF assumes no changes of single wheels."""
    world = World(duration_s=20.0)
    assert run(estimator("aug-ekf", world, front=False), world.drive().ticks)[-1].stated is None
