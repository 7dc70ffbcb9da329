"""Averaged spectra of jitter."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.onboard.resonance.spectrum import Spectrum, bins_hz, periodograms
from tpmsd.onboard.resonance.wheel_stream import SpeedBlock


def gathered(jitter: np.ndarray, rate_hz: float = 100.0) -> Spectrum:
    """The spectrum of one long block of a speed signal."""
    block = SpeedBlock(rate_hz, jitter, 0.0, False)
    spectrum = Spectrum.empty(bins_hz(rate_hz).size)
    spectrum.add(periodograms(block, jitter, rate_hz))
    return spectrum


def test_white_noise_has_its_density() -> None:
    """Variance over half the sampling rate, at every frequency."""
    spectrum = gathered(0.3 * np.random.default_rng(1).normal(size=60_000))

    assert 0.09 / 50.0 == pytest.approx(float(spectrum.mean().mean()), rel=0.02)


def test_averages_scatter_as_many_as_they_are() -> None:
    """The variance of a mean of K half-overlapped segments is a little more than 1 / K."""
    spectrum = gathered(np.random.default_rng(2).normal(size=200_000), 200.0)
    relative = spectrum.mean() / spectrum.mean().mean()

    assert 1.06 == pytest.approx(float(relative.var()) * spectrum.averages, rel=0.4)


def test_a_pothole_counts_for_little() -> None:
    """A second of a hundredfold power lifts the mean by a few per cent, not by a half."""
    jitter = np.random.default_rng(3).normal(size=30_000)
    rough = jitter.copy()
    rough[15_000:15_100] *= 14.0

    assert gathered(rough).mean().mean() < 1.06 * gathered(jitter).mean().mean()


def test_slow_sampling_has_no_bins() -> None:
    """At 10 and 20 Hz no frequency of the band is seen."""
    assert [0, 0] == [bins_hz(rate_hz).size for rate_hz in (10.0, 20.0)]


def test_fading_takes_averages_but_no_density() -> None:
    """What fades counts for less; its mean is what it was."""
    spectrum = gathered(np.random.default_rng(4).normal(size=20_000))
    before = spectrum.averages, spectrum.mean()
    spectrum.fade(0.1)

    assert before[1] == pytest.approx(spectrum.mean())
    assert 0.2 * before[0] == pytest.approx(spectrum.averages)


def test_steady_fading_keeps_twice_its_memory() -> None:
    """Fading by a hundredth per segment, a spectrum is worth 199 of them: (1 + q) / (1 - q)."""
    spectrum = Spectrum.empty(1)
    for _ in range(2000):
        spectrum.fade(0.99)
        spectrum.add(np.ones((1, 1)))

    assert 1.99 / 0.01 == pytest.approx(spectrum.averages)


def test_a_spectrum_survives_as_json() -> None:
    """Averages and density come back."""
    spectrum = gathered(np.random.default_rng(5).normal(size=20_000))
    back = Spectrum.from_json(spectrum.to_json(), bins_hz(100.0).size)

    assert spectrum.mean() == pytest.approx(back.mean(), rel=1e-5)
    assert spectrum.averages == pytest.approx(back.averages)


@pytest.mark.parametrize(
    "saved",
    [
        {},
        {"averages": 3.0, "density": [1.0]},
        {"averages": 3.0, "density": [-1.0] * 38},
        {"averages": 0.0, "density": [1.0] * 38},
        {"averages": 3.0, "density": ["x"] * 38},
        {"averages": float("nan"), "density": [1.0] * 38},
    ],
)
def test_what_is_no_spectrum_is_refused(saved: dict[str, object]) -> None:
    """A damaged state is a ValueError."""
    with pytest.raises(ValueError, match="spectrum"):
        Spectrum.from_json(saved, 38)
