"""Counts, turns and distances of a ring against a wheel that is rolled edge by edge."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpmsd.car.rings.ring import (
    amplitude_and_phase,
    count_length_m,
    counts_per_m,
    counts_per_revolution,
    fraction_of_counts,
    harmonic_rad,
    radius_from_counts_m,
    turns_hz,
)
from tpmsd.car.rings.ripple import noise_power, ripple_gain, robust_std

TEETH, RADIUS_M = 48.0, 0.31


def test_counts_of_a_rolled_wheel() -> None:
    """48 edges over 100 turns: so many counts per metre, a length for each, and the radius back from them."""
    distance_m = 100 * 2 * math.pi * RADIUS_M
    edges = np.arange(0.0, distance_m, count_length_m(RADIUS_M, TEETH))

    assert abs(len(edges) - 100 * TEETH) <= 1
    assert counts_per_m(TEETH, RADIUS_M) == pytest.approx(100 * TEETH / distance_m)
    assert radius_from_counts_m(TEETH, counts_per_m(TEETH, RADIUS_M)) == pytest.approx(RADIUS_M)
    assert counts_per_revolution(counts_per_m(TEETH, RADIUS_M), RADIUS_M) == pytest.approx(TEETH)


def test_lost_counts_are_a_share_of_the_turns() -> None:
    """Of 10 turns a second with 48 counts, 24 counts lost in 10 s are half a per cent."""
    revolutions_hz = turns_hz(10 * 2 * math.pi * RADIUS_M, RADIUS_M)

    assert revolutions_hz == pytest.approx(10.0)
    assert fraction_of_counts(2.4, TEETH, revolutions_hz) == pytest.approx(0.005)


def test_the_first_harmonic_of_an_eccentric_ring() -> None:
    """Edges of a ring 0.1 mm off centre, by the angle of each tooth as the axle sees it; its fit gives
    amplitude and phase back."""
    off_m, ring_m, towards = 1e-4, 0.05, 0.7
    tooth = np.arange(TEETH) * 2 * math.pi / TEETH
    x, y = (
        ring_m * np.cos(tooth) + off_m * math.cos(towards),
        ring_m * np.sin(tooth) + off_m * math.sin(towards),
    )
    passes = np.unwrap(np.arctan2(y, x))
    design = np.stack([np.sin(passes), np.cos(passes)], axis=1)
    amplitude, phase = amplitude_and_phase(*np.linalg.lstsq(design, tooth - passes, rcond=None)[0])

    assert amplitude == pytest.approx(off_m / ring_m, rel=1e-3)
    assert harmonic_rad(passes, amplitude, phase) == pytest.approx(tooth - passes, abs=1e-5)


def test_the_ripple_shows_the_share_that_is_missing() -> None:
    """A ripple at 1.002 times the counted angle is likeliest there; noise alone has a gain of one in the
    mean, and its standard deviation is known beside outliers."""
    rng = np.random.default_rng(4)
    angle, noise = np.linspace(0.0, 2 * math.pi * 700, 6000), 1e-3 * rng.standard_normal(6000)
    shares = np.linspace(-0.01, 0.01, 201)
    gains = ripple_gain(angle, noise + harmonic_rad(1.002 * angle, 3e-4, 1.0), shares, 1e-6)
    power = rng.exponential(3.0, size=(2, 4000))
    noise[:50] = 1.0

    assert shares[int(gains.argmax())] == pytest.approx(0.002, abs=1.5e-4)
    assert noise_power(power)[:, 0] == pytest.approx(3.0, rel=0.1)
    assert robust_std(noise) == pytest.approx(1e-3, rel=0.05)
