"""The filter against generalised least squares done by brute force."""

from __future__ import annotations

import numpy as np

from tpmsd.calibration import whitening
from tpmsd.calibration.noise_fit import _log_likelihood, fit_noise, outliers
from tpmsd.calibration.whitening import Noise, whiten
from tpmsd.calibration.windows import CHANNELS, STATES, WINDOW_S, Windows
from tpmsd.wheels import FloatArray

NOISE = Noise(
    rough_m=3e-3, speed_mps=0.2, crab_rad=0.01, slow_m=2.0, lean=1e-3, age_s=3e-3, gyro_drift_radps=1e-3
)


def some_windows(rng: np.random.Generator, count: int, parameters: int = 3) -> Windows:
    """Random equations; some channels are silent in some windows."""
    y = rng.standard_normal((count, CHANNELS))
    y[rng.random(y.shape) < 0.2] = np.nan
    here = np.isfinite(y)[:, :, None]
    return Windows(
        y=y,
        H=rng.standard_normal((count, CHANNELS, STATES)) * here,
        X=rng.standard_normal((count, CHANNELS, parameters)) * here,
        grow=rng.standard_normal((count, 2, 3)),
        speed_mps=rng.uniform(2.0, 30.0, count),
        turn_rad=np.zeros(count),
        time_s=np.arange(count) + 0.5,
        fixes=rng.integers(1, 5, (count, 3)).astype(float),
        reading_m=np.array([0.01, 0.01, 0.012, 0.008]),
        extra_m2=np.zeros(count),
    )


def dense_covariance(windows: Windows, noise: Noise) -> FloatArray:
    """(9k, 9k) of all channels of all windows, by carrying every single source of noise through the model."""
    count = len(windows)
    n = whitening.table([noise])
    read, fresh = whitening._variances(windows, n, np.ones((count, CHANNELS)), np.isfinite(windows.y))
    start = np.linalg.cholesky(whitening._start(n, read[:, 0])[0] + 1e-18 * np.eye(STATES))
    w = whitening
    slow, fast = np.exp(-WINDOW_S / noise.slow_tau_s), np.exp(-WINDOW_S / noise.velocity_tau_s)
    crab, lean = np.exp(-WINDOW_S / noise.crab_tau_s), np.exp(-WINDOW_S / noise.lean_tau_s)
    state = start
    rows = []
    for k in range(count):
        sources = np.zeros((STATES, state.shape[1] + 15))
        moved = np.zeros_like(sources)
        sources[:, : state.shape[1]] = state
        at = state.shape[1]
        moved[w.QOLD : w.QOLD + 4] = sources[w.Q : w.Q + 4]
        new = iter(range(at, at + 15))
        for wheel in range(4):
            moved[w.Q + wheel, next(new)] = np.sqrt(read[0, k, wheel])
        moved[w.V, next(new)] = whitening._SPEED_STD
        moved[w.W, next(new)] = whitening._YAW_STD
        for place, decay, std in (
            (w.BETA, crab, noise.crab_rad),
            (w.BE, slow, noise.slow_m),
            (w.BN, slow, noise.slow_m),
            (w.DS, fast, noise.speed_mps),
            (w.DC, fast, noise.cross_mps),
            (w.LEAN, lean, noise.lean),
        ):
            moved[place] = decay * sources[place]
            moved[place, next(new)] = std * np.sqrt(1 - decay**2)
        moved[w.GB], moved[w.LATE] = sources[w.GB], sources[w.LATE]
        moved[w.GB, next(new)], moved[w.LATE, next(new)] = noise.gyro_drift_radps, noise.age_s
        moved[w.PSI] = sources[w.PSI] + WINDOW_S * moved[w.W]
        for axis in (0, 1):
            by_v, by_w, by_heading = windows.grow[k, axis]
            course = sources[w.PSI] + moved[w.BETA]
            moved[w.PE + axis] = (
                sources[w.PE + axis] + by_v * moved[w.V] + by_w * moved[w.W] + by_heading * course
            )
        state = moved
        rows.append(windows.H[k] @ state)
    table = np.concatenate([np.pad(r, ((0, 0), (0, state.shape[1] - r.shape[1]))) for r in rows])
    return table @ table.T + np.diag(fresh[0].ravel())


def test_innovations_are_those_of_the_dense_covariance() -> None:
    """Products of whitened columns and the log-determinant equal those of the covariance inverted in one
    piece."""
    windows = some_windows(np.random.default_rng(3), 12)
    here = np.isfinite(windows.y).ravel()
    white, log_variance = whiten(windows, [Noise(), NOISE], np.ones((12, CHANNELS)))
    columns = np.concatenate([np.nan_to_num(windows.y)[:, :, None], windows.X], axis=2).reshape(-1, 4)[here]
    for at, noise in enumerate((Noise(), NOISE)):
        covariance = dense_covariance(windows, noise)[np.ix_(here, here)]
        flat = white[at].reshape(-1, 4)

        np.testing.assert_allclose(
            columns.T @ np.linalg.solve(covariance, columns), flat.T @ flat, rtol=1e-5, atol=1e-3
        )
        assert np.isclose(np.linalg.slogdet(covariance)[1], log_variance[at], rtol=1e-7)


def test_the_fitted_noise_is_as_likely_as_the_true_one() -> None:
    """From data drawn with known noise, the fit climbs at least to the likelihood of what made them."""
    rng = np.random.default_rng(5)
    count = 150
    windows = some_windows(rng, count, 1)
    drawn = np.linalg.cholesky(dense_covariance(windows, NOISE)) @ rng.standard_normal(count * CHANNELS)
    y = np.where(np.isfinite(windows.y), drawn.reshape(count, CHANNELS), np.nan)
    windows = Windows(**{**vars(windows), "y": y, "X": windows.X * 0.0})
    even = np.ones((count, CHANNELS))
    found = fit_noise(windows, Noise(), even, np.ones(1), rounds=8)
    start, fitted, true = _log_likelihood(windows, even, [Noise(), found, NOISE], np.ones(1))

    assert fitted > true - 2.0
    assert fitted > start + 100.0


def test_outliers_weigh_less() -> None:
    """A reading five standard deviations off gets its variance raised, a position on both axes."""
    white = np.zeros((3, CHANNELS))
    white[0, 2], white[1, 8], white[2, 4] = 5.0, -8.0, 3.0
    factor = outliers(white, np.ones((3, CHANNELS)))

    assert (6.25, 16.0, 16.0) == (factor[0, 2], factor[1, 7], factor[1, 8])
    assert 3 == int((factor > 1.0).sum())
