"""Normal-inverse-Wishart statistics against the textbook's closed forms and by sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.published.niw import NormalInverseWishart


def prior(dimension: int, particles: int = 1, seed: int = 3) -> NormalInverseWishart:
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((particles, dimension, dimension))
    scale = root @ root.swapaxes(1, 2) + np.eye(dimension)
    return NormalInverseWishart(0.7, rng.standard_normal((particles, dimension)), dimension + 4.0, scale)


def draws(dimension: int, count: int, seed: int = 5) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((count, dimension)) * 2.0 + 1.0


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.integers(1, 4), st.integers(1, 30), st.integers(0, 10_000))
def test_learning_one_by_one_is_the_batch_posterior(dimension: int, count: int, seed: int) -> None:
    """Without forgetting, n updates (19) give the conjugate posterior of all n samples at once."""
    learned = prior(dimension, seed=seed)
    k0, nu0 = 1.0 / learned.gamma, learned.nu
    m0, s0 = learned.mean[0].copy(), learned.scale[0].copy()
    samples = draws(dimension, count, seed)
    for sample in samples:
        learned.learn(sample[None, :])
    mean = samples.mean(axis=0)
    scatter = (samples - mean).T @ (samples - mean)
    away = mean - m0
    assert 1.0 / (k0 + count) == pytest.approx(learned.gamma)
    assert nu0 + count == pytest.approx(learned.nu)
    assert (k0 * m0 + count * mean) / (k0 + count) == pytest.approx(learned.mean[0])
    expected = s0 + scatter + k0 * count / (k0 + count) * np.outer(away, away)
    assert expected == pytest.approx(learned.scale[0])


def test_particles_learn_each_for_itself() -> None:
    """Statistics of many particles are those of each alone."""
    both = prior(2, particles=3)
    noise = draws(2, 3)
    alone = []
    for k in range(3):
        one = NormalInverseWishart(both.gamma, both.mean[[k]].copy(), both.nu, both.scale[[k]].copy())
        one.learn(noise[[k]])
        alone.append(one)
    both.learn(noise)
    assert np.concatenate([one.mean for one in alone]) == pytest.approx(both.mean)
    assert np.concatenate([one.scale for one in alone]) == pytest.approx(both.scale)


def test_the_predictive_is_the_exact_student_t() -> None:
    """Samples have location mu_hat, covariance scale * dof / (dof - 2), scale (1+gamma)/(nu-d+1) Lambda."""
    one = prior(2)
    count = 200_000
    many = NormalInverseWishart(
        one.gamma, np.repeat(one.mean, count, 0), one.nu + 6.0, np.repeat(one.scale, count, 0)
    )
    dof = many.nu - 2 + 1
    scale = one.scale[0] * (1.0 + one.gamma) / dof
    assert dof == many.predictive_dof
    samples = many.sample(np.random.default_rng(1), 2)
    std = np.sqrt(np.diag(scale))
    assert one.mean[0] == pytest.approx(samples.mean(axis=0), abs=5 * float(std.max()) / count**0.5)
    assert scale * dof / (dof - 2) == pytest.approx(np.cov(samples.T), rel=0.03)
    for k in range(2):  # marginals
        p = stats.kstest((samples[:20_000, k] - one.mean[0, k]) / std[k], stats.t(dof).cdf).pvalue
        assert p > 1e-3


def test_the_leading_components_are_a_marginal_of_all() -> None:
    """From four dimensions, the first two (and the first) have the joint's dof and its block of the scale."""
    one = prior(4)
    count = 20_000
    many = NormalInverseWishart(
        one.gamma, np.repeat(one.mean, count, 0), one.nu, np.repeat(one.scale, count, 0)
    )
    dof = one.nu - 4 + 1
    block = one.scale[0] * (1.0 + one.gamma) / dof
    for leading in (1, 2):
        samples = many.sample(np.random.default_rng(2), leading) - one.mean[0, :leading]
        assert (count, leading) == samples.shape
        inverse = np.linalg.inv(block[:leading, :leading])
        squared = np.einsum("ni,ij,nj->n", samples, inverse, samples) / leading
        assert stats.kstest(squared, stats.f(leading, dof).cdf).pvalue > 1e-3


def test_the_posterior_mean_of_the_noise_is_exact() -> None:
    """E[Sigma] = Lambda / (nu - d - 1), against draws from the inverse-Wishart; over particles by weight."""
    one = prior(3)
    sampled = stats.invwishart(df=one.nu + 3, scale=one.scale[0]).rvs(40_000, random_state=4).mean(axis=0)
    wider = NormalInverseWishart(one.gamma, one.mean, one.nu + 3, one.scale)
    assert sampled == pytest.approx(wider.noise_covariance(np.ones(1)), rel=0.1, abs=0.02)
    two = prior(3, particles=2)
    weights = np.array([0.25, 0.75])
    expected = (0.25 * two.scale[0] + 0.75 * two.scale[1]) / (two.nu - 3 - 1)
    assert expected == pytest.approx(two.noise_covariance(weights))


def test_the_moments_of_the_mean_are_those_of_the_mixture() -> None:
    """Mean and covariance of mu over weighted particles: law of total variance, Var(mu) = gamma E[Sigma]."""
    two = prior(2, particles=2)
    weights = np.array([0.3, 0.7])
    mean, covariance = two.mean_moments(weights)
    assert 0.3 * two.mean[0] + 0.7 * two.mean[1] == pytest.approx(mean)
    away = two.mean[1] - two.mean[0]
    within = two.gamma * (0.3 * two.scale[0] + 0.7 * two.scale[1]) / (two.nu - 3)
    assert within + 0.21 * np.outer(away, away) == pytest.approx(covariance)


def test_forgetting_has_the_window_it_is_named_for() -> None:
    """With a forgetting factor of 1 - 1/h, gamma tends to 1/h and nu to h: both count h samples."""
    keep = 1.0 - 1.0 / 50.0
    learned = prior(2)
    for sample in draws(2, 2000):
        learned.forget(keep)
        learned.learn(sample[None, :])
    assert (1.0 - keep) == pytest.approx(learned.gamma)
    assert 1.0 / (1.0 - keep) == pytest.approx(learned.nu)


def test_a_window_of_samples_is_what_the_mean_remembers() -> None:
    """With forgetting, mu_hat is the exponentially weighted mean of the samples."""
    keep = 0.9
    learned = prior(1)
    samples = draws(1, 400)
    for sample in samples:
        learned.forget(keep)
        learned.learn(sample[None, :])
    weights = keep ** np.arange(len(samples))[::-1]
    assert float(weights @ samples[:, 0] / weights.sum()) == pytest.approx(
        float(learned.mean[0, 0]), rel=1e-6
    )


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.floats(0.01, 0.999), st.integers(1, 200), st.integers(1, 4))
def test_forgetting_alone_keeps_the_noise(keep: float, times: int, dimension: int) -> None:
    """Time that passes without samples widens the mean's share (gamma) but leaves E[Sigma] near what it was:
    at the floor of nu exactly (nu - d - 1)-scaled, never infinite or negative."""
    learned = prior(dimension)
    for _ in range(times):
        learned.forget(keep)
    assert learned.nu >= dimension + 2.0
    assert np.all(np.linalg.eigvalsh(learned.scale[0]) > 0.0)
    assert np.all(np.isfinite(learned.noise_covariance(np.ones(1))))


def test_at_the_floor_forgetting_leaves_the_noise_as_it_is() -> None:
    """Once nu has come down to its floor, E[Sigma] no longer changes however long the silence."""
    learned = prior(3)
    for _ in range(500):
        learned.forget(0.98)
    at_floor = learned.noise_covariance(np.ones(1)).copy()
    for _ in range(500):
        learned.forget(0.98)
    assert 5.0 == learned.nu
    assert at_floor == pytest.approx(learned.noise_covariance(np.ones(1)), rel=1e-12)


def test_a_steady_noise_is_learned_under_forgetting() -> None:
    """Samples of N(mu, Sigma): mu_hat and E[Sigma] come to them within the window's own uncertainty."""
    mu, sigma = np.array([0.002, -0.001]), np.array([[4.0, 1.5], [1.5, 2.0]]) * 1e-6
    rng = np.random.default_rng(7)
    learned = NormalInverseWishart(0.5, np.zeros((1, 2)), 6.0, np.eye(2)[None] * 1e-5)
    covariances = []
    for sample in rng.multivariate_normal(mu, sigma, 6000):
        learned.forget(1.0 - 1.0 / 600.0)
        learned.learn(sample[None, :])
        covariances.append(learned.noise_covariance(np.ones(1)))
    assert mu == pytest.approx(learned.mean[0], abs=5 * 2e-3 / 600**0.5)
    assert sigma == pytest.approx(np.mean(covariances[2000:], axis=0), rel=0.1)


def test_selection_copies_particles() -> None:
    """After resampling, particle k is the one that index k named; copies are independent of each other."""
    three = prior(2, particles=3)
    before = three.mean.copy()
    three.select(np.array([2, 0, 0]))
    assert before[[2, 0, 0]] == pytest.approx(three.mean)
    three.mean[1] += 1.0
    assert before[0] == pytest.approx(three.mean[2])
