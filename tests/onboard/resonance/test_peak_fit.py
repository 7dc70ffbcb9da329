"""The resonance's frequency with an honest standard deviation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.onboard.resonance.oscillator import jitter
from tpmsd.onboard.resonance.peak_fit import Peak, PeakFit
from tpmsd.onboard.resonance.spectrum import Spectrum, bins_hz, periodograms
from tpmsd.onboard.resonance.wheel_stream import SpeedBlock


def peak_of(signal: np.ndarray, rate_hz: float, fit: PeakFit) -> Peak:
    """The fit to a recording of jitter."""
    spectrum = Spectrum.empty(bins_hz(rate_hz).size)
    spectrum.add(periodograms(SpeedBlock(rate_hz, signal, 0.0, False), signal, rate_hz))
    return fit.fit(spectrum)


@pytest.mark.parametrize(("rate_hz", "frequency_hz", "damping"), [(100.0, 36.0, 0.12), (200.0, 42.0, 0.2)])
def test_a_known_resonance_is_found_with_an_honest_std(
    rate_hz: float, frequency_hz: float, damping: float
) -> None:
    """Over 24 recordings of 80 s the error has no bias to speak of, and the size that is stated."""
    rng, fit = np.random.default_rng(1), PeakFit(rate_hz)
    errors, stated = [], []
    for _ in range(24):
        signal = jitter(rng, 80.0, rate_hz, frequency_hz, damping, 0.05)
        signal += 0.02 * rng.normal(size=signal.size)
        mean, std = peak_of(signal, rate_hz, fit).moments()
        errors.append(mean - frequency_hz)
        stated.append(std)
    scores = np.array(errors) / np.array(stated)

    assert abs(float(np.mean(errors))) < 0.02 * frequency_hz
    assert 0.5 < float(np.std(scores)) < 1.4
    assert math.sqrt(float(np.mean(scores**2))) < 2.0


def test_white_noise_holds_no_resonance() -> None:
    """Of ten recordings of mere rounding none shows one."""
    rng, fit = np.random.default_rng(2), PeakFit(100.0)

    assert 0 == sum(peak_of(rng.normal(size=30_000), 100.0, fit).found for _ in range(10))


def test_a_falling_spectrum_holds_no_resonance() -> None:
    """Road alone, whose density falls with the square of the frequency, is no resonance."""
    rng, fit = np.random.default_rng(3), PeakFit(100.0)
    road = jitter(rng, 300.0, 100.0, 2.0, 0.5, 1.0)

    assert not peak_of(road, 100.0, fit).is_usable(PeakFit.max_frequency_hz(100.0))


def test_a_resonance_beyond_reach_is_not_useful() -> None:
    """Of one at 60 Hz sampling at 100 Hz shows an image or a flank; neither is used."""
    rng, fit = np.random.default_rng(4), PeakFit(100.0)
    beyond = jitter(rng, 300.0, 100.0, 49.5, 0.1, 0.05)

    assert not peak_of(beyond, 100.0, fit).is_usable(PeakFit.max_frequency_hz(100.0))


@pytest.mark.parametrize(
    ("rate_hz", "sees"), [(10.0, False), (20.0, False), (50.0, False), (83.0, True), (100.0, True)]
)
def test_reach_says_which_rates_can_see_it(rate_hz: float, sees: bool) -> None:
    """Up to 50 Hz there is nothing to be seen, and reach is 0."""
    assert sees == (PeakFit.max_frequency_hz(rate_hz) > 0.0)
    assert PeakFit.max_frequency_hz(rate_hz) < rate_hz / 2.0
