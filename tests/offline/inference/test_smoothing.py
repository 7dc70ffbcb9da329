"""Smoothing and first-order recursions, against SciPy's filters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, median_filter, uniform_filter1d
from scipy.signal import lfilter

from tpmsd.car.physics.first_order import accumulated
from tpmsd.offline.inference.smoothing import NEAREST, REFLECT, gaussian, running_mean, running_median


@pytest.mark.parametrize(("beyond", "mode"), [(NEAREST, "nearest"), (REFLECT, "reflect")])
@pytest.mark.parametrize("sigma", [0.7, 3.5, 80.0])
def test_a_gaussian_is_scipys(beyond: str, mode: str, sigma: float) -> None:
    """A smoothed walk equals that of `scipy.ndimage`, whose kernel may be longer than the samples."""
    walk = np.cumsum(np.random.default_rng(1).standard_normal((200, 2)), axis=0)

    assert np.allclose(
        gaussian_filter1d(walk, sigma, axis=0, mode=mode), gaussian(walk, sigma, beyond), atol=1e-10
    )
    assert np.allclose(gaussian_filter1d(walk[:, 0], sigma, mode=mode), gaussian(walk[:, 0], sigma, beyond))


def test_running_median_and_mean_are_scipys() -> None:
    """Nine samples around each, the ends extended as `scipy.ndimage` does."""
    values = np.random.default_rng(2).standard_normal(50)

    assert np.array_equal(median_filter(values, size=9, mode="nearest"), running_median(values, 9))
    assert np.allclose(uniform_filter1d(values, 9), running_mean(values, 9))


@pytest.mark.parametrize("kept", [0.0, 0.5, 0.9999])
def test_what_accumulates_is_a_first_order_filter(kept: float) -> None:
    """Each sample adds to what is left of the one before, as `scipy.signal.lfilter` has it."""
    fresh = np.random.default_rng(3).standard_normal(5000)
    expected, _ = lfilter([1.0], [1.0, -kept], fresh, zi=[kept * 2.0])

    assert np.allclose(expected, accumulated(fresh, kept, before=2.0), rtol=1e-12)
    assert len(accumulated(fresh[:0], kept)) == 0
