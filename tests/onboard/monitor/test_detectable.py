"""Which losses would be seen: held against what the comparison of hypotheses then says."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.car.config.model import TyreConfig
from tpmsd.car.physics.tyre import tyre_model
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.evidence.detectable import JointLoss, LossDetectability, minimum_detectable_losses
from tpmsd.onboard.monitor.evidence.hypotheses import Comparison
from tpmsd.onboard.monitor.evidence.nuisance import log_normal
from tpmsd.onboard.monitor.evidence.sizes import SizeHypotheses

RADIUS = np.full(4, 0.316)
THRESHOLD, ASKED = 0.0025, 0.99
TYRES = [tyre_model(TyreConfig(), 0.316)] * 4


@pytest.mark.parametrize("common", [1e-4, 5e-4, 1.2e-3])
@pytest.mark.parametrize("own", [1e-4, 4e-4])
def test_the_smallest_losses_are_those_that_are_raised_nine_times_in_ten(common: float, own: float) -> None:
    """Of 400 changes by a tenth more than such a loss (losses are compared on a grid), of one tyre and of all
    alike, as the covariance scatters them; of a quarter less three in four at most."""
    covariance = (np.full((4, 4), common**2) + np.eye(4) * own**2) * 0.316**2
    scatter = np.random.default_rng(1).multivariate_normal(np.zeros(4), covariance, 400)
    similar = JointLoss.from_changes(np.zeros((1, 4)), covariance[None], np.zeros(1), RADIUS)
    found = minimum_detectable_losses(covariance, similar, RADIUS, TYRES, THRESHOLD, ASKED)
    for share, lost in ((found.one_tyre, np.array([1.0, 0.0, 0.0, 0.0])), (found.all_tyres, np.ones(4))):
        min_m = -TYRES[0].radius_change_m(share)
        raised = []
        for times in (1.1, 0.75):
            verdicts = [
                Comparison(RADIUS, THRESHOLD).compare(change, covariance)
                for change in scatter - times * min_m * lost
            ]
            raised.append(np.mean([bool(verdict.deflated[0] >= ASKED) for verdict in verdicts]))
        assert (raised[0] >= 0.85, raised[1] <= 0.75) == (True, True), raised


@pytest.mark.parametrize("chance", [0.08, 0.3])
@pytest.mark.parametrize("lost_m", [0.0, 1.4e-3])
def test_what_a_load_may_do_makes_all_four_harder_to_see(chance: float, lost_m: float) -> None:
    """The axles may bear another load (0.3 and 0.9 mm) on some drives. Of 400 drives as learned with a tenth
    more than the smallest loss nine in ten are raised, of a quarter less three in four at most; and it is
    told alike whether the drive that it is asked on has a loss or none."""
    learned = (np.full((4, 4), 5e-4**2) + np.eye(4) * 2e-4**2) * 0.316**2
    loaded = learned.copy()
    loaded[:2, :2] += 3e-4**2
    loaded[2:, 2:] += 9e-4**2
    both = np.stack([learned, loaded])

    def weights(change_m: FloatArray) -> FloatArray:
        return np.log([1.0 - chance, chance]) + log_normal(change_m, both)

    asked_on = np.full(4, -lost_m)
    similar = JointLoss.from_changes(np.tile(asked_on, (2, 1)), both, weights(asked_on), RADIUS)
    found = minimum_detectable_losses(learned, similar, RADIUS, TYRES, THRESHOLD, ASKED)
    alone = JointLoss.from_changes(np.zeros((1, 4)), learned[None], np.zeros(1), RADIUS)
    assert (
        found.all_tyres
        > 1.1 * minimum_detectable_losses(learned, alone, RADIUS, TYRES, THRESHOLD, ASKED).all_tyres
    )
    min_m = -TYRES[0].radius_change_m(found.all_tyres)
    scatter = np.random.default_rng(2).multivariate_normal(np.zeros(4), learned, 400)
    raised = []
    for times in (1.1, 0.75):
        changes = scatter - times * min_m
        verdicts = [
            Comparison(RADIUS, THRESHOLD).compare_hypotheses(
                SizeHypotheses.as_learned(np.tile(change, (2, 1)), both, weights(change))
            )
            for change in changes
        ]
        raised.append(np.mean([bool(verdict.deflated[0] >= ASKED) for verdict in verdicts]))
    assert (raised[0] >= 0.85, raised[1] <= 0.75) == (True, True), raised


def test_where_all_are_not_judged_no_loss_of_theirs_is_seen() -> None:
    """Not even that of all their air."""
    found = minimum_detectable_losses(np.eye(4) * 1e-8, None, RADIUS, TYRES, THRESHOLD, ASKED)
    assert (1.0, True) == (found.all_tyres, found.one_tyre < 0.15)


def test_a_load_hides_both_tyres_of_the_axle_that_bears_it() -> None:
    """A load that may lower the rear by 0.9 mm on every tenth drive: the least loss that would be seen of
    both rear tyres is twice that of both front ones, and the status says the worse of the two."""
    learned = (np.full((4, 4), 5e-4**2) + np.eye(4) * 2e-4**2) * 0.316**2
    loaded = learned.copy()
    loaded[2:, 2:] += 9e-4**2
    both = np.stack([learned, loaded])
    weights = np.log([0.9, 0.1]) + log_normal(np.zeros(4), both)
    whole, front, rear = (
        JointLoss.from_changes(np.zeros((2, 4)), both, weights, RADIUS * np.array(mask))
        for mask in ([1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0])
    )
    least = [
        minimum_detectable_losses(learned, whole, RADIUS, TYRES, THRESHOLD, ASKED, axles).one_axle
        for axles in ((front,), (rear,), (front, rear))
    ]
    assert least[1] > 2.0 * least[0]
    assert least[1] == least[2]
    lost = tuple(RADIUS * np.array(mask) for mask in ([1.0] * 4, [1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]))
    changes = np.zeros((2, 4)), both, weights
    for wheels, of_axle in ((lost, least[2]), (lost[:2], least[0])):
        detectability = LossDetectability(learned, changes, wheels, RADIUS, TYRES, THRESHOLD, ASKED)
        assert detectability.losses().one_axle == of_axle


def test_the_loss_of_each_wheel_is_said_in_metres_of_its_own_radius() -> None:
    """Known alike relative to their radii, a larger wheel loses as many times more; the largest share of the
    pressure is that of one tyre."""
    radius_m = np.array([0.3, 0.3, 0.36, 0.36])
    tyres = [tyre_model(TyreConfig(), float(radius)) for radius in radius_m]
    found = minimum_detectable_losses(
        np.diag((4e-4 * radius_m) ** 2), None, radius_m, tyres, THRESHOLD, ASKED
    )
    each_m = np.array(found.each_m)

    assert radius_m / 0.3 == pytest.approx(each_m / each_m[0])
    shares = [tyre.pressure_loss(-one_m)[0] for tyre, one_m in zip(tyres, found.each_m, strict=True)]
    assert found.one_tyre == pytest.approx(sum(shares) / 4)
    assert THRESHOLD * 0.3 < each_m[0] < 0.3 * 0.01
