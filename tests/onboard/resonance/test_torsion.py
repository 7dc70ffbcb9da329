"""The torsional frequencies of a wheel with a rigid-ring tyre."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tpmsd.onboard.resonance.torsion import (
    free_frequency_hz,
    held_frequency_hz,
    sidewall_stiffness,
    soft_shifts,
)


def test_the_free_frequency_is_the_eigenvalue_of_two_masses() -> None:
    """Rim and belt free of the road swing at the eigenvalue of their stiffness over their inertias."""
    rim, belt, stiffness = 0.95, 0.489, 88_540.0
    matrix = stiffness * np.array([[1.0 / rim, -1.0 / rim], [-1.0 / belt, 1.0 / belt]])
    eigenvalues = np.sort(np.linalg.eigvals(matrix))

    assert eigenvalues[0] == pytest.approx(0.0, abs=1e-6)
    assert math.sqrt(eigenvalues[1]) / (2.0 * math.pi) == pytest.approx(
        free_frequency_hz(rim, belt, stiffness)
    )


def test_a_held_belt_is_one_of_endless_inertia() -> None:
    """With the belt held by the road the frequency is that of an infinitely heavy belt."""
    assert free_frequency_hz(0.95, 1e12, 88_540.0) == pytest.approx(held_frequency_hz(0.95, 88_540.0))


def test_the_published_tyre_winds_up_as_published() -> None:
    """On a fixed rim the belt of the 205/60R15 (0.489 kgm2) swings at its 67.7 Hz."""
    assert held_frequency_hz(0.489, 88_540.0) == pytest.approx(67.7, abs=0.05)


def test_frequency_falls_with_the_root_of_the_sidewalls_stiffness() -> None:
    """If pressure makes 60 % of the stiffness, -20 % of pressure is -12 % of it and -6.2 % of frequency."""
    soft = sidewall_stiffness(88_540.0, 0.6, 0.8)

    assert soft == pytest.approx(0.88 * 88_540.0)
    assert held_frequency_hz(1.0, soft) / held_frequency_hz(1.0, 88_540.0) == pytest.approx(math.sqrt(0.88))


def test_a_soft_tyre_lowers_the_frequency() -> None:
    """Every change that counts as soft is a fall, of a fifth at most."""
    shifts = soft_shifts()

    assert np.all(shifts < 0.0)
    assert shifts.min() > -0.25
