"""The filters that [Lundquist 2013] compares: against Kalman filters where all is linear, against closed
forms and sampling, and over long trouble."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.onboard.estimators.test_filters import straight_ticks
from tests.onboard.estimators.world import (
    METHODS,
    RADIUS_M,
    TRACK_M,
    VEHICLE,
    WHEELBASE_M,
    Receiver,
    World,
    country_speed,
    country_yaw,
    errors_m,
    estimator,
    filter_of,
    run,
)
from tpmsd.car.config.model import FilterConfig
from tpmsd.car.physics.kinematics import WheelPositions
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.base import RadiusEstimate
from tpmsd.onboard.estimators.published.front_contrast import FrontContrast
from tpmsd.onboard.estimators.published.gaussian import GaussianPieces, Transform, linearised, unscented
from tpmsd.onboard.estimators.published.gnss_likelihood import gaussian_log
from tpmsd.onboard.estimators.published.niw import NormalInverseWishart
from tpmsd.onboard.estimators.published.radius_models import NiwRadii, WalkingRadii, step_sigma
from tpmsd.onboard.estimators.published.samples import SampledPieces
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.estimators.table import Row
from tpmsd.onboard.timeline.tick import Tick

STIFF = replace(VEHICLE, track_rear_m=1e9)
"""A car that cannot turn by its wheels, so that its motion along a line is linear."""
FIX_STD_M = 0.8
NOISE_M = 0.003
DRIFT_M = 0.05e-3


def no_outliers(size: FloatArray) -> FloatArray:
    return np.ones_like(size)


def line_kalman(ticks: list[Tick], noise_m: float, drift_m: float, prior_m: float) -> tuple[float, float]:
    """Mean and variance of the mean rear radius error by a plain Kalman filter along a line: place and error.

    Each wheel's radius error has noise of its own in each tick and walks at random in informative ticks; the
    first does not, and the first fix places the car.
    """
    x, p = np.zeros(2), np.diag([0.0, prior_m**2 / 2])
    placed = False
    for tick in ticks:
        angle = float(tick.rotation_rad[2])
        f = np.array([[1.0, angle], [0.0, 1.0]])
        x = np.array([x[0] + angle * (RADIUS_M + x[1]), x[1]])
        p = f @ p @ f.T
        p[0, 0] += angle**2 * noise_m**2 / 2
        if tick.index > 1:
            p[1, 1] += drift_m**2 / 2 * tick.dt_s
        for fix in tick.fixes:
            if not placed:
                placed = True
                x[0], p[0, :], p[:, 0] = fix.east_m, 0.0, 0.0
                p[0, 0] = FIX_STD_M**2
                continue
            gain = p[:, 0] / (p[0, 0] + FIX_STD_M**2)
            x = x + gain * (fix.east_m - x[0])
            p = p - np.outer(gain, p[0, :])
    return float(x[1]), float(p[1, 1])


def mean_error(estimate: RadiusEstimate) -> tuple[float, float]:
    return float(estimate.deviation_m[2:].mean()), float(estimate.covariance_m2[2:, 2:].mean())


PRIOR_M = SETTINGS.radius_prior * RADIUS_M


@pytest.mark.parametrize(("transform", "slack"), [(linearised, 1e-6), (unscented, 0.1)])
def test_aug_kf_is_a_kalman_filter_where_all_is_linear(transform: Transform, slack: float) -> None:
    """Along a line: the EKF's radius is the plain Kalman filter's to rounding; the UKF's to a tenth of its
    standard deviation, for it also counts what an unsure first heading takes off the way."""
    ticks = straight_ticks(RADIUS_M + 0.0015, FIX_STD_M)
    filter_ = filter_of(Row(GaussianPieces(transform, no_outliers, DRIFT_M, NOISE_M)), STIFF)
    found, own = mean_error(run(filter_, ticks)[-1])
    mean, variance = line_kalman(ticks, NOISE_M, DRIFT_M, PRIOR_M)
    assert mean == pytest.approx(found, abs=slack * math.sqrt(variance))
    assert variance == pytest.approx(own, rel=slack)
    assert abs(found - 0.0015) < 3 * math.sqrt(variance)


def test_aug_pf_agrees_with_the_kalman_filter_where_all_is_linear() -> None:
    """Along a line, with Gaussian fixes: the radius is the Kalman filter's within a third of its standard
    deviation, and as sure within a third."""
    ticks = straight_ticks(RADIUS_M + 0.0015, FIX_STD_M)[:600]
    mean, variance = line_kalman(ticks, NOISE_M, DRIFT_M, PRIOR_M)
    founds = []
    for seed in range(3):
        pieces = SampledPieces(radii=WalkingRadii(DRIFT_M, NOISE_M), likelihood=gaussian_log)
        filter_ = filter_of(Row(pieces), STIFF, FilterConfig(particles=3000), seed=seed)
        founds.append(mean_error(run(filter_, ticks)[-1]))
    found, own = np.mean(founds, axis=0)
    assert mean == pytest.approx(found, abs=math.sqrt(variance) / 3)
    assert math.sqrt(variance) == pytest.approx(math.sqrt(own), rel=1 / 3)


def test_mpf_pn_is_a_kalman_filter_where_noise_is_known() -> None:
    """Statistics that know Sigma (nu without end), no forgetting, Gaussian fixes, along a line: the radius's
    mean and standard deviation are the Kalman filter's, within what some thousand particles leave."""
    ticks = straight_ticks(RADIUS_M + 0.0015, FIX_STD_M)[:250]
    sure = 1e9
    prior = 0.003
    mean, variance = line_kalman(ticks, NOISE_M, 0.0, prior)
    founds = []
    for seed in range(3):
        count = 4000
        known = NormalInverseWishart(
            gamma=(prior / NOISE_M) ** 2,
            mean=np.zeros((count, 2)),
            nu=sure,
            scale=np.tile(np.eye(2) * NOISE_M**2 * sure, (count, 1, 1)),
        )
        pieces = SampledPieces(radii=NiwRadii(known=known), likelihood=gaussian_log)
        settings = FilterConfig(particles=count, window_s=86_400.0)
        filter_ = filter_of(Row(pieces), STIFF, settings, seed=seed)
        founds.append(mean_error(run(filter_, ticks)[-1]))
    found, own = np.mean(founds, axis=0)
    assert mean == pytest.approx(found, abs=math.sqrt(variance) / 3)
    assert math.sqrt(variance) == pytest.approx(math.sqrt(own), rel=1 / 3)


def test_steps_of_sigma_keep_the_mean_at_five_per_cent() -> None:
    """Eqs (27), (28): inverse-gamma steps of mean 1 and standard deviation 0.05, as scipy has them."""
    ratio = step_sigma(np.full(200_000, 9e-6), np.random.default_rng(1)) / 9e-6
    assert 1.0 == pytest.approx(ratio.mean(), abs=5 * 0.05 / 200_000**0.5)
    assert 0.05 == pytest.approx(ratio.std(), rel=0.02)
    assert stats.kstest(ratio[:20_000], stats.invgamma(402.0, scale=401.0).cdf).pvalue > 1e-3


@pytest.mark.parametrize("dimension", [1, 2, 4])
def test_the_predictives_log_density_is_the_student_ts(dimension: int) -> None:
    """Differences between particles and between samples are those of scipy's multivariate Student-t."""
    rng = np.random.default_rng(8)
    root = rng.standard_normal((3, dimension, dimension))
    scale = root @ root.swapaxes(1, 2) + np.eye(dimension)
    three = NormalInverseWishart(0.4, rng.standard_normal((3, dimension)), dimension + 3.0, scale)
    dof = three.nu - dimension + 1
    offsets = []
    for _ in range(4):
        noise = rng.standard_normal((3, dimension)) * 2.0
        expected = [
            stats.multivariate_t(three.mean[k], scale[k] * 1.4 / dof, dof).logpdf(noise[k]) for k in range(3)
        ]
        offsets.append(np.array(expected) - three.log_predictive(noise))
    assert np.full((4, 3), offsets[0][0]) == pytest.approx(np.array(offsets))


def test_front_wheels_are_learned_beside_the_rear_pair() -> None:
    """Exact angles through bends: a front wheel's error beyond its rear neighbour's is the true one, and the
    joint covariance is that of a sum."""
    drive = World(duration_s=120.0, teeth=math.inf).drive()
    front = FrontContrast(np.full(4, RADIUS_M), WheelPositions(TRACK_M, TRACK_M, WHEELBASE_M), 1 - 1 / 600)
    order = [2, 3, 0, 1]
    rear = drive.offsets_m[0][2:]
    for tick in drive.ticks:
        front.learn(tick.rotation_rad[order], rear, tick.dt_s)
    rear_m2 = np.array([[4.0, 1.0], [1.0, 9.0]]) * 1e-8
    mean, covariance = front.moments(rear, rear_m2)
    assert drive.offsets_m[0][order] == pytest.approx(mean, abs=0.05e-3)
    # Tracks are equal: fl = rl + its own, fr = rr + its own.
    assert rear_m2 == pytest.approx(covariance[:2, 2:])
    own = covariance[2:, 2:] - rear_m2
    assert np.all(np.linalg.eigvalsh(own) > 0.0)
    again = FrontContrast(np.full(4, RADIUS_M), WheelPositions(TRACK_M, TRACK_M, WHEELBASE_M), 1 - 1 / 600)
    again.restore(mean, covariance)
    assert mean == pytest.approx(again.moments(rear, rear_m2)[0])


@pytest.mark.parametrize("method", ["mpf-pn-paper", "aug-pf", "aug-ekf", "aug-ukf", "mpf-mn"])
def test_the_compared_filters_find_the_radii(method: str) -> None:
    """Ordinary drives: absolute radii to two millimetres, left against right to below one."""
    for seed in range(2):
        world = World(duration_s=150.0, seed=seed)
        drive = world.drive()
        error = errors_m(drive, run(estimator(method, world, seed=seed), drive.ticks))[-1]
        assert np.all(np.abs(error) < 2.0e-3)
        assert abs(error[2] - error[3]) < 0.8e-3
        assert abs(error[0] - error[1]) < 0.8e-3


# -- long trouble -------------------------------------------------------------------------------------------

LAP_S = 60.0


def laps(time_s: FloatArray) -> FloatArray:
    """A stop of five seconds in every lap."""
    phase = time_s % LAP_S
    share = np.interp(phase, [0.0, 40.0, 48.0, 53.0, 60.0], [1.0, 1.0, 0.0, 0.0, 1.0])
    return country_speed(time_s) * share


def troubled(ticks: list[Tick]) -> list[Tick]:
    """In every lap an outage of the receiver, and a reset of the counters: no rotation for a tick."""
    out = []
    for k, tick in enumerate(ticks):
        phase = (k * 0.1) % LAP_S
        changed = replace(tick, fixes=()) if 10.0 <= phase < 18.0 else tick
        if abs(phase - 25.0) < 0.01:
            changed = replace(changed, rotation_rad=np.full(4, math.nan))
        out.append(changed)
    return out


def weight_of(filter_: object) -> int:
    """Bytes of everything that an estimator holds."""
    return len(pickle.dumps(vars(filter_)))


@pytest.mark.parametrize("method", sorted(METHODS))
def test_laps_of_stops_outages_and_resets_leave_it_as_it_was(method: str) -> None:
    """Six laps: never a NaN, no wider at the end than after the second, no more memory, radii in reach."""
    world = World(
        duration_s=6 * LAP_S,
        speed_mps=laps,
        yaw_radps=lambda t: country_yaw(t) * laps(t) / 20.0,
        receiver=Receiver(period_s=0.5),
    )
    drive = world.drive()
    filter_ = estimator(method, world)
    second, last = round(2 * LAP_S / 0.1), len(drive.ticks)
    estimates, held = [], []
    for k, tick in enumerate(troubled(drive.ticks), start=1):
        estimates.append(filter_.step(tick))
        if k in (second, last):
            held.append(weight_of(filter_))
    known = np.array([[*e.deviation_m, *np.diag(e.covariance_m2), *e.noise_std_m] for e in estimates])
    assert np.all(np.isfinite(known))
    assert held[1] <= 1.02 * held[0] + 4000
    noise = known[:, 8:]
    assert np.all(noise[-1] < 3.0 * noise[second])
    std = np.sqrt(known[:, 4:8])
    assert np.all(std[-1] < 1.5 * std[second] + 0.2e-3)
    # MPF-MN, which the paper too saw diverge below 1000 particles, need not be right here.
    allowed = 0.03 * RADIUS_M if method == "mpf-mn" else 2.5e-3
    assert np.all(np.abs(known[-1, :4] - drive.offsets_m[-1]) < allowed)
