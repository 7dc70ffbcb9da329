"""What repeats with the wheel's rotation is taken out, and little else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.resonance.ring_errors import RingErrors
from tpmsd.onboard.resonance.wheel_stream import SpeedBlock

RATE_HZ = 100.0


def rolling(
    orders: dict[int, float], scale: float = 1.0, seconds: float = 10.24
) -> tuple[FloatArray, FloatArray]:
    """(speeds read, their periodic part) of a wheel at 60 rad/s that speeds up a little; amplitudes by
    order."""
    at = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    speed = 60.0 + 0.4 * at
    angle = scale * (60.0 * at + 0.2 * at * at)
    periodic = sum(amplitude * np.cos(order * angle + order) for order, amplitude in orders.items())
    return speed + periodic, np.asarray(periodic)


def test_harmonics_of_the_rotation_are_removed() -> None:
    """Orders 1, 3 and 17, the last beyond half the sampling rate, go to less than a hundredth."""
    read, periodic = rolling({1: 0.5, 3: 0.2, 17: 0.1})
    left = RingErrors().remove(SpeedBlock(RATE_HZ, read, 0.0, True))

    assert np.std(left) < 0.01 * np.std(periodic)


def test_noise_is_left_but_for_its_degrees_of_freedom() -> None:
    """Of white noise a tenth is lost: one part in 1024 for each of 100 terms."""
    noise = np.random.default_rng(1).normal(size=1024)
    read, _ = rolling({})
    left = RingErrors().remove(SpeedBlock(RATE_HZ, read + noise, 0.0, True))

    assert math.sqrt(1.0 - 100.0 / 1024.0) == pytest.approx(float(np.std(left)), rel=0.03)


def test_the_scale_of_a_speed_signal_is_found() -> None:
    """A control unit that reckons with another radius shows it by the harmonics: 0.6 % off is found."""
    ring = RingErrors()
    read, periodic = rolling({1: 0.3, 2: 0.2, 5: 0.2}, scale=1.006)
    rng = np.random.default_rng(2)
    for _ in range(3):
        left = ring.remove(SpeedBlock(RATE_HZ, read + 0.1 * rng.normal(size=read.size), 0.0, False))

    assert 1.006 == pytest.approx(ring.scale, abs=2.6e-4)
    assert np.std(left) < 0.5 * np.std(periodic)


def test_without_ring_errors_the_scale_stays() -> None:
    """Noise alone moves nothing."""
    ring = RingErrors()
    rng = np.random.default_rng(3)
    for _ in range(12):
        read, _ = rolling({})
        ring.remove(SpeedBlock(RATE_HZ, read + 0.1 * rng.normal(size=read.size), 0.0, False))

    assert 1.0 == ring.scale


def test_an_absurd_scale_is_refused() -> None:
    """What a damaged state holds is not taken up."""
    with pytest.raises(ValueError, match="absurd"):
        RingErrors().restore(1.5)
