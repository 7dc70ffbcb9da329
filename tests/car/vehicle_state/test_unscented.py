"""The unscented transform and the robust weights against what is known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.car.vehicle_state.adaptive import MIN_FACTOR, MIN_WEIGHT, RobustSettings
from tpmsd.car.vehicle_state.robust import igg3
from tpmsd.car.vehicle_state.unscented import moments, sigma_points, sigma_weights


def gaussian(size: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((size, size))
    return rng.standard_normal(size), root @ root.T + 0.1 * np.eye(size)


@pytest.mark.parametrize("size", [1, 2, 3, 5])
def test_the_points_carry_mean_and_covariance(size: int) -> None:
    """Untransformed points give back what they were made of."""
    mean, covariance = gaussian(size)
    weights = sigma_weights(size)
    back, spread, _ = moments(sigma_points(mean, covariance, weights), weights)
    assert np.allclose(mean, back) and np.allclose(covariance, spread)
    assert weights.mean.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("size", [1, 2, 3, 5])
@pytest.mark.parametrize("alpha", [1.0, 0.3])
def test_the_mean_of_a_quadratic_is_exact(size: int, alpha: float) -> None:
    """E[x' A x + b' x + c] = m' A m + tr(A P) + b' m + c, for any spread of the points."""
    mean, covariance = gaussian(size)
    rng = np.random.default_rng(4)
    form, slope = rng.standard_normal((size, size)), rng.standard_normal(size)
    weights = sigma_weights(size, alpha=alpha, beta=2.0)
    points = sigma_points(mean, covariance, weights)
    values = np.einsum("ji,ik,jk->j", points, form, points) + points @ slope + 0.7
    exact = mean @ form @ mean + np.trace(form @ covariance) + slope @ mean + 0.7
    assert exact == pytest.approx(float(moments(values[:, None], weights)[0][0]))


def test_the_variance_of_a_scalar_quadratic_is_exact() -> None:
    """n = 1, kappa = 2 has a Gaussian's fourth moment: var(x^2) = 2 s^4 + 4 m^2 s^2."""
    weights = sigma_weights(1)
    for mean, std in ((0.0, 1.0), (1.5, 0.4), (-2.0, 3.0)):
        points = sigma_points(np.array([mean]), np.array([[std**2]]), weights)
        _, spread, _ = moments(points**2, weights)
        assert 2 * std**4 + 4 * mean**2 * std**2 == pytest.approx(float(spread[0, 0]))


def test_the_covariance_of_a_bilinear_pair_is_exact_where_the_points_see_it() -> None:
    """A linear function beside a quadratic one: their covariance is P (A + A') m + P b, all odd moments
    being zero."""
    mean, covariance = gaussian(3)
    rng = np.random.default_rng(5)
    form, slope = rng.standard_normal((3, 3)), rng.standard_normal(3)
    weights = sigma_weights(3)
    points = sigma_points(mean, covariance, weights)
    quadratic = np.einsum("ji,ik,jk->j", points, form, points)
    _, spread, _ = moments(np.column_stack([points @ slope, quadratic]), weights)
    assert slope @ covariance @ (form + form.T) @ mean == pytest.approx(float(spread[0, 1]))


def test_many_gaussians_at_once_are_as_one_by_one() -> None:
    """Leading axes are independent."""
    weights = sigma_weights(3)
    pairs = [gaussian(3, seed) for seed in range(6)]
    means, covariances = (np.stack(parts) for parts in zip(*pairs, strict=True))
    together = sigma_points(means, covariances, weights)
    for k, (mean, covariance) in enumerate(pairs):
        assert np.allclose(sigma_points(mean, covariance, weights), together[k])


def test_points_that_would_not_spread_are_refused() -> None:
    """n + kappa must be positive."""
    with pytest.raises(ValueError, match="kappa"):
        sigma_weights(3, kappa=-3.0)


# -- weights ------------------------------------------------------------------------------------------------


def test_the_three_zones_of_the_weights() -> None:
    """1 up to K0; K0/|v| ((Kg - |v|)/(Kg - K0))^2 between; 0 from Kg on; the sign does not matter."""
    at = np.array([0.0, 1.0, 1.5, 3.0, 4.0, 6.0, 50.0])
    exact = [1.0, 1.0, 1.0, 0.5 * (3.0 / 4.5) ** 2, 0.375 * (2.0 / 4.5) ** 2, 0.0, 0.0]
    assert exact == pytest.approx(list(igg3(at, 1.5, 6.0)))
    assert np.array_equal(igg3(at, 1.5, 6.0), igg3(-at, 1.5, 6.0))


def test_the_weights_are_continuous_and_fall() -> None:
    """No step at either limit, and never more weight for a larger residual."""
    values = igg3(np.linspace(0.0, 8.0, 8001), 1.2, 5.0)
    assert np.abs(np.diff(values)).max() < 2e-3
    assert (np.diff(values) <= 0.0).all()


def test_no_reading_no_weight() -> None:
    """NaN weighs nothing; limits in the wrong order are refused."""
    assert 0.0 == igg3(np.array(np.nan), 1.5, 6.0)
    with pytest.raises(ValueError, match="k0"):
        igg3(np.array(1.0), 3.0, 2.0)


def test_floors_let_the_filter_divide() -> None:
    """An outlier keeps a weight that can be divided by; a lost prediction keeps some say."""
    settings = RobustSettings()
    assert [1.0, MIN_WEIGHT] == list(settings.weights(np.array([0.1, 99.0]), np.ones(2)))
    assert 1.0 == settings.factor(np.array([1.0, 1.0, 1.0]), np.ones(3))
    assert MIN_FACTOR == settings.factor(np.array([99.0, 99.0, 99.0]), np.ones(3))
    assert 0.5 * (3.0 / 4.5) ** 2 == pytest.approx(settings.factor(np.full(3, 3.0), np.ones(3)))
