"""Sets of effects as one model: Bayes factors, and what they say against a spline term."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from tests.offline.diagnosis.test_beside_shapes import Given, columns, directions, evidence, shape
from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.selection.effect_sets import best_set, log_bayes, priors_of
from tpmsd.offline.diagnosis.selection.selector import Selector

SLIP, LOAD = "longitudinal_slip", "load_transfer_longitudinal"


def of(effect: str, design: FloatArray, *parameters: str) -> Term:
    """A term of that effect."""
    return Term(effect, design, parameters, 3.5 * len(parameters))


def test_the_bayes_factor_is_that_of_two_normal_distributions() -> None:
    """With values integrated out data have the covariance 1 + X D^2 X^T: the log of the densities' ratio."""
    rng = np.random.default_rng(1)
    X = rng.standard_normal((40, 3)) * np.array([300.0, 1e6, 2e4])
    slip = of(SLIP, columns(1, 2, width=4), "slip_per_accel", "slip_per_speed2")
    load = of(LOAD, columns(3, width=4), "coefficient")
    means, stds = np.array([4e-3, 8e-7, 6e-5]), np.array([4e-3, 8e-7, 5e-5])
    y = X @ np.array([3e-3, 1e-6, 9e-5]) + rng.standard_normal(40)
    with_them = multivariate_normal(X @ means, np.eye(40) + (X * stds**2) @ X.T).logpdf(y)
    without = multivariate_normal(np.zeros(40), np.eye(40)).logpdf(y)

    assert log_bayes([slip, load], X.T @ X, X.T @ y) == pytest.approx(with_them - without, rel=1e-9)
    assert [list(each) for each in priors_of(slip)] == [[4e-3, 8e-7], [4e-3, 8e-7]]


def test_the_best_set_leaves_out_what_it_is_better_without() -> None:
    """Of slip, its drag and a load transfer, slip alone acts: a value that the data deny costs, and goes."""
    rng = np.random.default_rng(2)
    X = np.linalg.qr(rng.standard_normal((60, 3)))[0] * np.array([1e4, 1e8, 1e6])
    y = 3e-3 * X[:, 0] + rng.standard_normal(60)
    both = of(SLIP, columns(1, 2, width=4), "slip_per_accel", "slip_per_speed2")
    alone = of(SLIP, columns(1, width=4), "slip_per_accel")
    load = of(LOAD, columns(3, width=4), "coefficient")
    found = best_set([both, alone, load], X.T @ X, X.T @ y)

    assert found.terms == (alone,)
    assert found.log_bayes == pytest.approx(log_bayes([alone], X.T @ X, X.T @ y))
    assert best_set([], X.T @ X, X.T @ y).terms == ()


@pytest.mark.parametrize(
    ("share", "found"), [(1.0, {"brake_slip", LOAD, SLIP}), (0.0, {"unknown"})], ids=["usual", "strange"]
)
def test_slip_brakes_and_loads_together_are_no_unknown(share: float, found: set[str]) -> None:
    """Three effects of usual size lie almost within the span of one shape over the force, which none of them
    explains alone nor two of them; what is within that span alone, and is none of theirs, has no name."""
    u = directions(7)
    size = np.array([60.0 / 4e-3, 50.0 / 2e-3, 40.0 / 6e-5])
    usual = u[:, :3] * size
    data = share * usual @ np.array([4e-3, 2e-3, 6e-5]) + (1.0 - share) * 85.0 * u[:, 3]
    spline = np.concatenate([u[:, :4], u[:, 6:]], axis=1)
    responses = np.concatenate([usual, 1e4 * spline], axis=1)
    terms = [
        of(SLIP, columns(1, width=9), "slip_per_accel"),
        of("brake_slip", columns(2, width=9), "front"),
        of(LOAD, columns(3, width=9), "coefficient"),
    ]
    shapes = [shape("front", "accel_long", columns(4, 5, 6, 7, 8, width=9))]
    chosen = Selector(evidence(data, responses), Given(9, terms, shapes), last=True).select().chosen

    assert found == {one.term.effect for one in chosen}
    assert all(
        EFFECTS[one.term.effect].confounding.common == (one.term.effect != "unknown") for one in chosen
    )
