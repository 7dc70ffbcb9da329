"""Every covariance stays one: symmetric, with no negative eigenvalue, over long drives with everything that
makes covariances small or large."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.onboard.estimators.world import Receiver, World, estimator
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.bank.jump_hypotheses import UNUSED, Bank
from tpmsd.onboard.estimators.bank.kernel import HALF_KERNEL, HalfKernel
from tpmsd.onboard.estimators.bank.marginal import MarginalBelief
from tpmsd.onboard.estimators.bank.mixture import MixtureBelief
from tpmsd.onboard.timeline.tick import Tick

ROUNDING = 1e-12
"""Of an eigenvalue of a correlation matrix of 23 rows in double precision, with a hundred times to spare."""


def smallest(covariances: FloatArray) -> float:
    """The smallest eigenvalue of the correlation matrices of (N, n, n) covariances."""
    std = np.sqrt(np.einsum("kii->ki", covariances))
    assert np.all(std > 0.0)
    return float(np.linalg.eigvalsh(covariances / (std[:, :, None] * std[:, None, :])).min())


def bank_covariances(bank: Bank) -> FloatArray:
    """Those of the hypotheses in use; of the upper triangle alone where that is what is kept."""
    kept = bank.covariance[bank.log_weights > UNUSED]
    if isinstance(HALF_KERNEL, HalfKernel):
        return np.triu(kept) + np.triu(kept, 1).transpose(0, 2, 1)
    return kept


def eventful(ticks: list[Tick]) -> list[Tick]:
    """Wheels silent for ten seconds and for one, a gap of a minute, a standstill, three changed tyres."""
    out = []
    for k, tick in enumerate(ticks):
        second, rotation = k / 10.0, tick.rotation_rad
        if 300.0 <= second < 310.0 or 330.0 <= second < 331.0:
            rotation = np.full(4, math.nan)
        if 400.0 <= second < 520.0:
            rotation = np.zeros(4)
        if second >= 600.0:
            rotation = rotation * np.array([1.004, 1.0, 0.996, 1.02])
        gap_s = 60.0 if k == 7000 else 0.0
        fixes = () if 800.0 <= second < 860.0 or 400.0 <= second < 520.0 else tick.fixes
        out.append(replace(tick, rotation_rad=rotation, gap_s=gap_s, fixes=fixes))
    return out


@pytest.fixture(scope="module")
def ticks() -> list[Tick]:
    """Twenty minutes with outages, silence, a standstill, jumps and changed tyres."""
    receiver = Receiver(jumps=((200.0, 210.0, 300.0), (900.0, 905.0, 8.0)))
    return eventful(World(duration_s=1200.0, receiver=receiver).drive().ticks)


def test_a_matrix_that_is_no_covariance_is_seen() -> None:
    """Correlations of 0.9, 0.9 and -0.9 cannot be: the smallest eigenvalue is 1 - 2 * 0.9."""
    bad = np.array([[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]])
    scale = np.array([1e-6, 1.0, 30.0])
    assert -0.8 == pytest.approx(smallest(np.stack([np.diag(scale**2), bad * np.outer(scale, scale)])))


@pytest.mark.parametrize("method", ["gaussian-sum", "mpf-pn"])
@pytest.mark.parametrize("front", [False, True], ids=["rear pair", "four wheels"])
def test_no_eigenvalue_is_negative(method: str, front: bool, ticks: list[Tick]) -> None:
    """Every estimate of 12,000 ticks, and of every fortieth tick every hypothesis, has a covariance without a
    negative eigenvalue."""
    filter_ = estimator(method, World(), front=front, particles=100 if method == "mpf-pn" else None)
    belief = filter_.belief
    assert isinstance(belief, MixtureBelief if method == "gaussian-sum" else MarginalBelief)
    places = np.arange(4) if front else np.array([2, 3])
    stated, lowest = [], math.inf
    for k, tick in enumerate(ticks):
        covariance = filter_.step(tick).covariance_m2[np.ix_(places, places)]
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-12)
        stated.append(covariance)
        if k % 40 == 0:
            of_bank = bank_covariances(belief.bank)
            if method == "gaussian-sum":
                np.testing.assert_allclose(of_bank, of_bank.transpose(0, 2, 1), rtol=1e-9, atol=1e-30)
            lowest = min(lowest, smallest(of_bank))
    assert 12_000 == len(stated)
    assert lowest > -ROUNDING
    assert smallest(np.array(stated)) > -ROUNDING
