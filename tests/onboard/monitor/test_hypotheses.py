"""Which tyres lost radius: the comparison of hypotheses against integrals, symmetry and plain cases."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.onboard.monitor.evidence.hypotheses import LOSS_GRID, Comparison, Verdict
from tpmsd.onboard.monitor.evidence.nuisance import Nuisance, variance_ratio_of_mean
from tpmsd.onboard.monitor.evidence.sizes import subsets
from tpmsd.onboard.monitor.settings import JUDGE

RADIUS_M = 0.316
THRESHOLD = 0.0025
UNCOMPENSATED = Nuisance(common=0.0025, axle=0.0012, side=0.0003, own=0.0003)
"""What speed, warmth, load and slip do where nothing compensates them."""


def judged(change: list[float], std: float = 3e-4, nuisance: Nuisance | None = None) -> Verdict:
    """Verdict on relative changes of all four wheels, known to `std` each."""
    radius = np.full(4, RADIUS_M)
    nuisance = (nuisance or UNCOMPENSATED).covariance([0, 1, 2, 3], radius)
    against = Comparison(radius, THRESHOLD)
    return against.compare(np.array(change) * RADIUS_M, nuisance + np.eye(4) * (std * RADIUS_M) ** 2)


def integrated(change: FloatArray, covariance: FloatArray, threshold: float) -> FloatArray:
    """P(wheel is deflated) by fine integration over log-uniform losses, those below the threshold by their
    share of it; relative units."""
    d = change.size
    inverse = np.linalg.inv(covariance)
    losses = np.geomspace(LOSS_GRID[0] / 1.09, LOSS_GRID[-1] * 1.09, 20_001)
    none = math.exp(-0.5 * change @ inverse @ change)
    none *= 1.0 - sum(math.comb(d, k) * JUDGE.prior_by_size[k - 1] for k in range(1, d + 1))
    total, lost = none, np.zeros(d)
    larger = JUDGE.prior_larger if d > 2 else 0.0
    for wheel in range(d):
        off = change - losses[:, None] * (np.arange(d) == wheel)
        total += larger * np.exp(-0.5 * np.einsum("ni,ij,nj->n", off, inverse, off)).mean()
    for size in range(1, d + 1):
        for subset in itertools.combinations(range(d), size):
            indicator = np.isin(np.arange(d), subset).astype(float)
            off = change + losses[:, None] * indicator
            density = (
                np.exp(-0.5 * np.einsum("ni,ij,nj->n", off, inverse, off)) * JUDGE.prior_by_size[size - 1]
            )
            total += density.mean()  # equal steps of the logarithm
            above = (density * np.minimum(losses / threshold, 1.0)).mean()
            lost[list(subset)] += above
    return lost / total


@pytest.mark.parametrize("times", [0.5, 1.0, 1.5])
def test_the_share_beyond_the_limit_is_that_of_each_subset(times: float) -> None:
    """A change known to one part in twenty of the limit: of the wheels that lost alike it lies beyond the
    limit by the normal law, of any other wheels it does not."""
    limit, radius, quiet = 0.02, np.full(4, RADIUS_M), Nuisance(1e-4, 1e-4, 1e-4, 1e-4)
    covariance = quiet.covariance([0, 1, 2, 3], radius) + np.eye(4) * (1e-3 * RADIUS_M) ** 2
    for index, members in enumerate(subsets(4)):
        pattern = np.isin(np.arange(4), members) * RADIUS_M
        off = Comparison(radius, THRESHOLD, limit=limit).compare(-times * limit * pattern, covariance).off
        std = 1.0 / math.sqrt(pattern @ np.linalg.inv(covariance) @ pattern)
        beyond = 0.5 * math.erfc(-(times - 1.0) * limit / std / math.sqrt(2.0))
        assert off.shape == (15,)
        assert off[index] == pytest.approx(beyond, abs=0.01)
        assert np.delete(off, index).sum() < 0.01


@pytest.mark.parametrize("count", [2, 4])
def test_other_evidence_shifts_the_odds_of_every_loss_alike(count: int) -> None:
    """Odds of any loss, also that of all wheels, against none are those without it times its ratio; what is
    larger is not shifted."""
    radius, ratio = np.full(count, RADIUS_M), 0.7
    losses = 2**count - 1
    change, covariance = np.full(count, -0.004 * RADIUS_M), np.eye(count) * (1e-3 * RADIUS_M) ** 2
    before = Comparison(radius, THRESHOLD).compare(change, covariance)
    after = Comparison(radius, THRESHOLD, np.full(losses, ratio)).compare(change, covariance)
    intact, kept = float(before.intact.sum()), before.none
    total = kept + (1.0 - kept) * math.exp(ratio)
    assert float(after.intact.sum()) == pytest.approx(intact / total, rel=1e-9)
    assert after.none == pytest.approx(kept / total, rel=1e-9)


@pytest.mark.parametrize(
    "change",
    [(0.0, 0.0), (-0.004, 0.0), (-0.005, 0.0), (0.0, -0.006), (-0.01, -0.01), (-0.02, 0.0), (0.004, -0.003)],
)
def test_two_wheels_against_numerical_integration(change: tuple[float, float]) -> None:
    """For a rear pair the posterior is that of a fine integral over all losses, to a few per cent."""
    covariance = np.array([[3.0, 2.0], [2.0, 3.0]]) * 1e-6
    expected = integrated(np.array(change), covariance, THRESHOLD)
    radius = np.full(2, RADIUS_M)
    found = Comparison(radius, THRESHOLD).compare(np.array(change) * RADIUS_M, covariance * RADIUS_M**2)
    assert expected == pytest.approx(found.deflated, abs=0.05)


def test_the_nuisance_covariance_is_the_sum_of_its_modes() -> None:
    """Variances and covariances of wheels are sums over common, axle, side and own changes."""
    n = Nuisance(common=1.0, axle=0.5, side=0.25, own=0.125)
    cov = n.covariance([0, 1, 2, 3], np.full(4, 2.0)) / 4.0
    own, common, axle, side = 0.125**2, 1.0, 0.25, 0.0625
    assert [common + axle + side + own] * 4 == pytest.approx(np.diag(cov))
    assert common + axle - side == pytest.approx(cov[0, 1])  # same axle, other side
    assert common - axle + side == pytest.approx(cov[0, 2])  # same side, other axle
    assert common - axle - side == pytest.approx(cov[0, 3])  # diagonal
    assert cov[2:, 2:] == pytest.approx(n.covariance([2, 3], np.full(2, 2.0)) / 4.0)


@settings(derandomize=True, deadline=None)
@given(st.lists(st.floats(-0.08, 0.08), min_size=4, max_size=4), st.floats(1e-5, 0.01))
def test_probabilities_are_probabilities(change: list[float], std: float) -> None:
    """For any change: between 0 and 1, no wheel more probable than that something happened, losses finite."""
    verdict = judged(change, std)
    assert np.all((verdict.deflated >= 0.0) & (verdict.deflated <= 1.0))
    assert 0.0 <= verdict.none <= 1.0 + 1e-12
    assert verdict.deflated.max() <= 1.0 - verdict.none + 1e-9
    assert np.all((verdict.loss_m >= 0.0) & (verdict.loss_m <= 0.05001 * RADIUS_M))


@pytest.mark.parametrize("wheel", range(4))
def test_the_more_is_lost_the_more_probable(wheel: int) -> None:
    """One wheel's probability of deflation rises with its loss, from next to nothing to next to one."""
    probabilities = []
    for loss in np.linspace(0.0, 0.03, 61):
        change = [0.0] * 4
        change[wheel] = -float(loss)
        probabilities.append(float(judged(change).deflated[wheel]))
    assert np.all(np.diff(probabilities) > -1e-3)
    assert probabilities[0] < 1e-3
    assert probabilities[-1] > 0.999


@pytest.mark.parametrize("wheel", range(4))
@pytest.mark.parametrize("larger", [0.003, 0.005, 0.008])
def test_a_wheel_that_is_larger_is_no_loss_of_its_neighbour(wheel: int, larger: float) -> None:
    """A new tyre: what the axle's other wheel has less than this one, it has not lost."""
    for axle in (5e-4, 1e-3):
        known = Nuisance(common=0.002, axle=axle, side=3e-4, own=3e-4)
        change = [0.0] * 4
        change[wheel] = larger
        assert judged(change, nuisance=known).deflated.max() < 0.9  # the default raises from 0.99
        if larger >= 0.005:
            change[wheel] = -larger
            assert judged(change, nuisance=known).deflated[wheel] > 0.99


@pytest.mark.parametrize(("loss", "std", "raised"), [(0.0036, 5e-4, True), (0.0036, 1e-3, False)])
def test_a_certain_loss_is_raised_though_its_size_is_not_known(loss: float, std: float, raised: bool) -> None:
    """A loss of 1.4 thresholds that is 2.2 of its standard deviations beyond the threshold, and 7 from none,
    is raised; one that may be none (3.6 standard deviations, against its prior) is not."""
    change, covariance = np.array([0.0, 0.0, -loss, 0.0]), np.eye(4) * 2e-4**2
    covariance[2, 2] = std**2
    radius = np.full(4, RADIUS_M)
    verdict = Comparison(radius, THRESHOLD).compare(change * RADIUS_M, covariance * RADIUS_M**2)
    assert raised == bool(verdict.deflated[2] >= 0.99)


def test_four_wheels_against_numerical_integration() -> None:
    """So it is with all wheels, losses of several and the growth of one among the answers."""
    radius = np.full(4, RADIUS_M)
    covariance = Nuisance(common=0.002, axle=5e-4, side=3e-4, own=3e-4).covariance([0, 1, 2, 3], np.ones(4))
    for change in ([0.0, 0.0, 0.0, 0.004], [0.0, 0.0, -0.004, 0.0], [0.0, 0.006, 0.0, 0.0]):
        expected = integrated(np.array(change), covariance, THRESHOLD)
        found = Comparison(radius, THRESHOLD).compare(np.array(change) * RADIUS_M, covariance * RADIUS_M**2)
        assert expected == pytest.approx(found.deflated, abs=0.06)


def test_of_a_pair_alone_the_smaller_wheel_has_lost() -> None:
    """Where only two wheels are read, nothing tells a loss from the other's growth: it is a loss."""
    radius = np.full(2, RADIUS_M)
    nuisance = UNCOMPENSATED.covariance([2, 3], radius)
    half = np.array([-0.0025, 0.0025]) * RADIUS_M
    verdict = Comparison(radius, THRESHOLD).compare(half, nuisance + np.eye(2) * (3e-4 * RADIUS_M) ** 2)
    assert verdict.deflated[0] > 0.99


@pytest.mark.parametrize("change", [0.0036, -0.0036, 0.006, -0.005])
def test_what_happens_to_all_wheels_equally_is_no_deflation(change: float) -> None:
    """Growth with speed by 0.36 % (or its loss when slowing, or warm-up) points at no wheel."""
    assert [0.0] * 4 == pytest.approx(judged([change] * 4).deflated, abs=0.02)


@pytest.mark.parametrize("change", [0.002, -0.002])
@pytest.mark.parametrize("axle", [(0, 1), (2, 3)])
def test_slip_of_the_driven_axle_is_no_deflation(axle: tuple[int, int], change: float) -> None:
    """0.2 % of one axle against the other is slip or load."""
    both = [change if wheel in axle else 0.0 for wheel in range(4)]
    assert [0.0] * 4 == pytest.approx(judged(both).deflated, abs=0.01)


@pytest.mark.parametrize("wheel", range(4))
@pytest.mark.parametrize("common", [0.0, 0.0036])
def test_a_fifth_of_the_pressure_in_one_tyre_is_named(wheel: int, common: float) -> None:
    """-0.46 % (20 % of the pressure) of one well-known wheel names that wheel alone, also while all grow."""
    change = [common] * 4
    change[wheel] -= 0.0046
    verdict = judged(change)
    assert verdict.deflated[wheel] > 0.95
    assert max(np.delete(verdict.deflated, wheel)) < 0.02
    assert 0.0046 * RADIUS_M == pytest.approx(verdict.loss_m[wheel], rel=0.15)


@pytest.mark.parametrize(
    ("pair", "loss"),
    [((0, 2), 0.0046), ((1, 3), 0.0046), ((0, 3), 0.0046), ((1, 2), 0.0046), ((0, 1), 0.02), ((2, 3), 0.02)],
)
def test_two_soft_tyres_are_both_named(pair: tuple[int, int], loss: float) -> None:
    """Two tyres that lost the same: both are named and no other; those of one axle only when they lost more,
    for that looks like slip or load."""
    change = [-loss if wheel in pair else 0.0 for wheel in range(4)]
    verdict = judged(change)
    named = {wheel for wheel in range(4) if verdict.deflated[wheel] > 0.9}
    assert set(pair) == named
    assert max(np.delete(verdict.deflated, list(pair))) < 0.05


def test_two_tyres_that_lost_unequally_are_both_named() -> None:
    """A common loss stands for both where they differ by a quarter."""
    assert [1.0, 0.0, 0.0, 1.0] == pytest.approx(judged([-0.020, 0.0, 0.0, -0.015]).deflated, abs=0.05)


def test_a_poorly_known_radius_accuses_nobody() -> None:
    """What is within its own uncertainty is no evidence."""
    assert max(judged([-0.005, 0.0, 0.0, 0.0], std=0.004).deflated) < 0.05


@settings(derandomize=True, deadline=None, max_examples=30)
@given(st.lists(st.floats(-0.02, 0.02), min_size=4, max_size=4))
def test_left_and_right_and_front_and_rear_are_equal(change: list[float]) -> None:
    """Exchanging sides, or axles, exchanges the probabilities and changes nothing else."""
    plain = judged(change).deflated
    for swapped in ([1, 0, 3, 2], [2, 3, 0, 1]):
        other = judged([change[k] for k in swapped]).deflated
        assert plain[swapped] == pytest.approx(other, abs=1e-9)


def test_the_priors_leave_room_for_nothing_having_happened() -> None:
    """All subsets together are improbable beforehand: below one in fifty."""
    total = sum(math.comb(4, size) * prior for size, prior in enumerate(JUDGE.prior_by_size, 1))
    assert 0.0 < total < 0.02
    assert len(WHEELS) == len(JUDGE.prior_by_size)


def test_all_four_equally_are_unseen_for_longer_than_one() -> None:
    """Beforehand they are as probable as a month's share of the four months that those 3 % of cars which are
    driven with all four 25 % low [NHTSA 2001] have been so, to a factor of two; one tyre is by a week's."""
    one, all_four = JUDGE.prior_by_size[0], JUDGE.prior_by_size[3]
    assert 0.5 < all_four / (0.03 / 4.0) < 2.0
    assert all_four / one == pytest.approx(1000.0 / 220.0)


@pytest.mark.parametrize(("loss", "raised"), [(0.0042, True), (0.0034, False)])
def test_a_loss_of_all_four_by_five_standard_deviations_is_raised(loss: float, raised: bool) -> None:
    """A loss of 20 % that is known to 5.2 standard deviations has 13.5 nats: 4.6 for 0.99, 5.4 for its prior
    and 2.6 for its size not being known; four fifths of it have 8.9."""
    std = 0.0042 / 5.2
    common = np.full((4, 4), std**2) + np.eye(4) * 1e-4**2
    found = Comparison(np.ones(4), THRESHOLD).compare(np.full(4, -loss), common)
    assert raised == bool(np.all(found.deflated >= 0.99))


# -- the mean over minutes -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("samples", "correlation"), [(1, 0.5), (2, 0.5), (9, 0.5134), (9, 0.0), (40, 0.9)])
def test_the_variance_of_a_mean_is_that_of_its_covariance_matrix(samples: int, correlation: float) -> None:
    """Ones over n on both sides of the Toeplitz matrix of powers of the correlation."""
    lag = np.abs(np.subtract.outer(np.arange(samples), np.arange(samples)))
    weight = np.full(samples, 1.0 / samples)
    expected = float(weight @ correlation ** lag.astype(float) @ weight)
    assert expected == pytest.approx(variance_ratio_of_mean(samples, correlation))


def test_what_axles_and_all_wheels_do_is_not_averaged_out() -> None:
    """A ninth of the variance is left by side and by wheel; the common part and that of an axle stay."""
    nuisance = Nuisance(common=1e-3, axle=2e-3, side=3e-3, own=4e-3)
    left = nuisance.averaged(1.0 / 9.0)
    assert (1e-3, 2e-3) == (left.common, left.axle)
    assert (1e-3, 4e-3 / 3.0) == pytest.approx((left.side, left.own))


@pytest.mark.parametrize(
    ("smaller_m", "larger_m", "raised"), [(1.15e-3, 1.15e-3, False), (2.3e-3, 0.0, True)]
)
def test_which_of_two_wheels_has_changed_is_identified_by_the_other_axle(
    smaller_m: float, larger_m: float, raised: bool
) -> None:
    """Two wheels of an axle are 2.3 mm apart: where the other axle lies half-way between them, a new tyre is
    a reason, too, and nothing is raised; where it agrees with the larger one, the other has lost."""
    radius = np.full(4, RADIUS_M)
    own = np.full((4, 4), 4e-4**2) + np.eye(4) * 1.2e-4**2
    covariance = JUDGE.nuisance.covariance([0, 1, 2, 3], radius) + own
    verdict = Comparison(radius, THRESHOLD).compare(np.array([0.0, 0.0, -smaller_m, larger_m]), covariance)
    assert raised == bool(verdict.deflated[2] > 0.99)
