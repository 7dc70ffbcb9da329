"""Wheels of another size beside a loss: against integrals and one regression over all samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from tests.onboard.monitor.drives import RADIUS_M, VEHICLE
from tests.onboard.monitor.test_drive_evidence import RADIUS, SPEEDS, WHEELS, at, judged, learned_car
from tests.onboard.monitor.test_hypotheses import THRESHOLD
from tpmsd.car.config.model import MonitorConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.monitor.evidence.change_bank import ChangeBank
from tpmsd.onboard.monitor.evidence.hypotheses import LOSS_GRID, Comparison, Verdict, severity
from tpmsd.onboard.monitor.evidence.sizes import (
    SizeHypotheses,
    size_rows,
    subsets,
    unchanged_sizes,
    with_sizes,
)
from tpmsd.onboard.monitor.settings import DRIVE_EVIDENCE, JUDGE

SIZES = size_rows((0, 1, 2, 3))
ROWS = range(1, len(SIZES.mean))
LIMIT = MonitorConfig().deviation_percent / 100.0
COVARIANCE_M2 = JUDGE.nuisance.covariance(WHEELS, RADIUS) + (3e-4**2 + 1.5e-4**2 * np.eye(4))
GRID = np.linspace(-8.0, 8.0, 8001)
CHANGES_MM = [(0.0, 0.0, 4.2, 0.2), (5.0, 5.5, 0.0, 0.0), (3.6, 5.0, 5.0, 5.1), (1.4, 1.5, -1.4, -1.6)]


def verdict_of(change_m: FloatArray, covariance_m2: FloatArray = COVARIANCE_M2) -> Verdict:
    change_hypotheses = with_sizes(change_m[None], covariance_m2[None], np.zeros(1), RADIUS, SIZES)
    return Comparison(RADIUS, THRESHOLD, sizes=SIZES, limit=LIMIT).compare_hypotheses(change_hypotheses)


@pytest.mark.parametrize("row", ROWS)
def test_a_row_is_the_integral_over_its_size(row: int) -> None:
    """Weight, and mean and standard deviation of the size, are those of an integral over all sizes by the
    trapezium rule."""
    mean, std, pattern = SIZES.mean[row], SIZES.variance[row] ** 0.5, SIZES.pattern[row]
    change = 0.9 * (mean + std) * pattern * RADIUS + 2e-4
    found = with_sizes(change[None], COVARIANCE_M2[None], np.zeros(1), RADIUS, SIZES)
    size = mean + std * GRID
    around = multivariate_normal(np.zeros(4), COVARIANCE_M2)
    density = around.pdf(change - np.outer(size, pattern) * RADIUS) * norm.pdf(GRID) * (GRID[1] - GRID[0])
    place = int(np.flatnonzero(found.row == row)[0])
    none = found.log_weight[found.row == 0]
    weight = float(found.log_weight[place] - (none[0] if none.size else SIZES.log_prior[0]))
    if none.size:
        assert weight == pytest.approx(
            float(np.log(density.sum() / around.pdf(change)) + SIZES.log_prior[row] - SIZES.log_prior[0]),
            rel=1e-6,
        )
    centre = float(size @ density / density.sum())
    assert centre == pytest.approx(float(found.size[place]), rel=1e-6)
    assert np.sqrt((size - centre) ** 2 @ density / density.sum()) == pytest.approx(
        found.size_std[place], rel=1e-4
    )


@pytest.mark.parametrize("change_mm", CHANGES_MM)
def test_the_posterior_is_that_of_all_losses_beside_all_sizes(change_mm: tuple[float, ...]) -> None:
    """Deflations, deviations and sizes are sums over every loss of every subset, a single larger wheel, and
    every size of every row, by brute force."""
    change = 1e-3 * np.array(change_mm)
    precision = np.linalg.inv(COVARIANCE_M2)
    found = subsets(4)
    members = np.array([[float(k in one) for k in WHEELS] for one in found])
    priors = np.array([JUDGE.prior_by_size[len(one) - 1] for one in found])
    total, lost, off, rows = 0.0, np.zeros(4), np.zeros(4), np.zeros(len(SIZES.mean))
    for row, pattern in enumerate(SIZES.pattern):
        size = SIZES.mean[row] + SIZES.variance[row] ** 0.5 * GRID if row else np.zeros(1)
        share = norm.pdf(GRID) * (GRID[1] - GRID[0]) if row else np.ones(1)
        share = share * np.exp(SIZES.log_prior[row])
        shifts = [(np.zeros(4), 1.0 - priors.sum() - 4 * JUDGE.prior_larger, 0.0, 0.0)]
        shifts += [
            (-s * one, prior / LOSS_GRID.size, weight, float(s > LIMIT))
            for one, prior in zip(members, priors, strict=True)
            for s, weight in zip(LOSS_GRID, severity(THRESHOLD), strict=True)
        ]
        if row == 0:
            shifts += [
                (s * one, JUDGE.prior_larger / LOSS_GRID.size, 0.0, float(s > LIMIT))
                for one in np.eye(4)
                for s in LOSS_GRID
            ]
        over = np.abs(size) > LIMIT
        for shift, prior, severe, far in shifts:
            rest = change - shift * RADIUS - np.outer(size, pattern) * RADIUS
            density = prior * share * np.exp(-0.5 * np.einsum("ni,ij,nj->n", rest, precision, rest))
            chance = float(density.sum())
            total += chance
            rows[row] += chance
            lost += severe * chance * (shift < 0.0)
            off += far * chance * (shift != 0.0)
            if row:
                off += float(density[over].sum()) * (pattern != 0.0)
    got = verdict_of(change)
    assert lost / total == pytest.approx(got.deflated, rel=1e-3, abs=2e-4)
    table = got.table
    of_rows = np.exp(table.none - table.log_total) + np.exp(table.lost - table.log_total).sum(axis=1)
    of_rows[0] += float(np.exp(table.larger - table.log_total).sum())
    assert rows / total == pytest.approx(of_rows, rel=1e-3, abs=2e-4)
    assert off / total == pytest.approx(got.off @ members, abs=1e-3)  # of sizes without a loss


@pytest.mark.parametrize("seed", range(4))
def test_without_another_size_it_is_the_comparison_of_losses(seed: int) -> None:
    """One drive model, an onset before the drive and no other size: to 1e-9 the posterior of `Comparison` on
    the change that the bank gives."""
    rng = np.random.default_rng(seed)
    reference, noise = learned_car(), np.eye(4) * 4e-4**2
    bank = ChangeBank(reference.copy(), np.zeros((4, 4)))
    for speed in SPEEDS[:12]:
        row = reference.features(at(float(speed)))
        bank.update(row @ reference.mean + rng.normal(0.0, 8e-4, 4), noise, row, 0.0, unchanged_sizes(4))
    found = bank.changes(unchanged_sizes(4))
    change, covariance = found.change[0, :1] * RADIUS, found.covariance[0, :1] * RADIUS_M**2
    against = Comparison(RADIUS, THRESHOLD, sizes=SIZES)
    both = [
        Comparison(RADIUS, THRESHOLD).compare(change[0], covariance[0]),
        against.compare_hypotheses(
            SizeHypotheses.as_learned(change, covariance, bank.log_likelihood + found.log_weight[0, :1])
        ),
    ]
    for name in ("deflated", "loss_m", "none"):
        old, new = (getattr(one, name) for one in both)
        assert old == pytest.approx(new, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("row", ROWS)
def test_changes_beside_a_size_are_those_of_one_regression(row: int) -> None:
    """Size, change and their evidence are those of one regression over all samples: the size acts from the
    first one on with its prior, parameters have theirs and the change has none."""
    rng = np.random.default_rng(row)
    reference = learned_car()
    mean, prior = reference.mean.copy(), reference.covariance.copy()
    bank, noise = ChangeBank(reference.copy(), np.zeros((4, 4))), np.eye(4) * 4e-4**2
    rows = [reference.features(at(float(v))) for v in SPEEDS[:14]]
    seen = [one @ mean + rng.normal(0.0, 1e-3, 4) for one in rows]
    for one, sample in zip(rows, seen, strict=True):
        bank.update(sample, noise, one, 0.0, SIZES)
    h, off = np.vstack(rows), np.concatenate(seen) - np.vstack(rows) @ mean
    resized = np.tile(SIZES.pattern[row], 14)
    plain = h @ prior @ h.T + np.kron(np.eye(14), noise)
    whole = plain + SIZES.variance[row] * np.outer(resized, resized)
    off_resized = off - SIZES.mean[row] * resized
    evidence = [
        multivariate_normal(np.zeros(56), one).logpdf(value)
        for one, value in ((plain, off), (whole, off_resized))
    ]
    found = bank.changes(SIZES)
    gain = found.log_weight[row, 0] - found.log_weight[0, 0] - SIZES.log_prior[row] + SIZES.log_prior[0]
    assert evidence[1] - evidence[0] == pytest.approx(float(gain), rel=1e-6)
    old = np.flatnonzero(14 - bank._onset >= JUDGE.full_samples)
    for place, hypothesis in enumerate(old):
        since = np.arange(14.0) - int(bank._onset[hypothesis])
        share = np.maximum(since, 0.0) if bank._ramp[hypothesis] else (since >= 0.0).astype(float)
        design = np.kron(share[:, None], np.eye(4)) / float(share[-1])
        information = design.T @ np.linalg.solve(whole, design)
        change = np.linalg.solve(information, design.T @ np.linalg.solve(whole, off_resized))
        assert change == pytest.approx(found.change[row, place], rel=1e-4, abs=1e-8)
        assert np.linalg.inv(information) == pytest.approx(found.covariance[row, place], rel=1e-4, abs=1e-12)


def test_the_car_beside_a_size_and_a_change_is_that_of_one_regression() -> None:
    """What is known of the car beside both has mean and variances of that regression."""
    rng = np.random.default_rng(8)
    reference, row = learned_car(), int(np.flatnonzero(SIZES.pattern.sum(axis=1) == 4.0)[0])
    mean, prior = reference.mean.copy(), reference.covariance.copy()
    bank, noise = ChangeBank(reference.copy(), np.zeros((4, 4))), np.eye(4) * 4e-4**2
    rows = [reference.features(at(float(v))) for v in SPEEDS[:12]]
    step = np.array([0.0, 0.0, -5e-3, 0.0])
    seen = [one @ mean + rng.normal(0.0, 4e-4, 4) + 0.016 + (k >= 3) * step for k, one in enumerate(rows)]
    for one, sample in zip(rows, seen, strict=True):
        bank.update(sample, noise, one, 0.0, SIZES)
    h, resized = np.vstack(rows), np.ones(48)
    design = np.kron((np.arange(12) >= 3)[:, None], np.eye(4))
    whole = h @ prior @ h.T + np.kron(np.eye(12), noise) + SIZES.variance[row] * np.outer(resized, resized)
    off = np.concatenate(seen) - h @ mean - SIZES.mean[row] * resized
    precision = np.linalg.inv(whole)
    left = precision - precision @ design @ np.linalg.solve(
        design.T @ precision @ design, design.T @ precision
    )
    gain = prior @ h.T @ left
    old = np.flatnonzero(12 - bank._onset >= JUDGE.full_samples)
    place = int(np.flatnonzero((bank._onset[old] == 3) & ~bank._ramp[old])[0])
    found = bank.reference_fitted_jointly(row, place, SIZES)
    assert mean + gain @ off == pytest.approx(found.mean, abs=2e-6)
    spread = np.diag(prior - gain @ h @ prior)
    assert spread == pytest.approx(np.diag(found.covariance), rel=1e-3, abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("larger", [0.016, 0.028])
def test_a_drive_with_other_tyres_has_grip(seed: int, larger: float) -> None:
    """All four are 1.6 or 2.8 % larger all drive long: no drive model that slips explains it, all four are
    off, and a tyre that loses 20 % after a third of the drive is named alone."""
    extra = np.full((60, 4), larger * RADIUS_M)
    found = judged(learned_car().mean.copy(), extra, seed)
    assert sum(found.drive_models[name] for name in DRIVE_EVIDENCE.slipping) < 0.01
    assert np.all(found.deviates > 0.99)
    assert np.all(found.deflated < 0.1)
    extra[20:, 1] -= 0.0046 * RADIUS_M
    assert [1] == np.flatnonzero(judged(learned_car().mean.copy(), extra, seed).deflated > 0.99).tolist()


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_wheels_changed_front_to_rear_have_lost_nothing(sign: float) -> None:
    """1.5 mm more tread on one axle has moved to the other one: no wheel is deflated."""
    change = sign * 1.5e-3 * np.array([1.0, 1.0, -1.0, -1.0])
    assert np.all(verdict_of(change).deflated < 0.5)


def test_of_a_pair_no_single_wheel_is_larger() -> None:
    """Nothing tells there which of the two has changed: only both are of another size."""
    assert [[0.0, 0.0], [1.0, 1.0]] == size_rows((2, 3)).pattern.tolist()
    assert VEHICLE.driven_axle == "front"
