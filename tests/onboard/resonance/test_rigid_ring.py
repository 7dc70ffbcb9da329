"""The simulation behind the figures agrees with closed forms; it shares no code with what it judges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import welch

from bench.worlds.rigid_ring import ISO_CLASS_A, RATE_HZ, ToneRing, Tyre, counts, ecu_speed_radps, road, roll


def frequencies_hz(tyre: Tyre, speed_mps: float) -> np.ndarray:
    """Natural frequencies of the linear system, undamped size."""
    eigenvalues = np.linalg.eigvals(tyre.system(speed_mps)[0])
    return np.asarray(np.abs(eigenvalues[eigenvalues.imag > 0]) / (2.0 * math.pi))


def test_without_grip_rim_and_belt_swing_freely() -> None:
    """With no slip stiffness the torsional mode is the closed form of two masses."""
    tyre = Tyre(slip_stiffness_n=1e-6)
    free = math.sqrt(tyre.torsion_nm * (1.0 / tyre.rim_kgm2 + 1.0 / tyre.belt_kgm2)) / (2.0 * math.pi)

    assert np.min(np.abs(frequencies_hz(tyre, 20.0) - free)) < 0.01


def test_pressure_lowers_the_mode_on_the_road() -> None:
    """-20 % of pressure takes 3 to 6 % off the mode near 37 Hz."""
    sound, soft = (frequencies_hz(Tyre().at_pressure(ratio), 15.0) for ratio in (1.0, 0.8))
    before, after = (float(modes[np.argmin(np.abs(modes - 37.0))]) for modes in (sound, soft))

    assert 0.94 < after / before < 0.97


def test_the_road_has_the_density_of_its_class() -> None:
    """At 0.3 cycles/m, between the contact's length and the waves left out, it is G (n0 / n)^2."""
    profile = road(np.random.default_rng(1), 4000.0, 4.0 * ISO_CLASS_A, 8, 0.02)
    wave, density = welch(profile, 50.0, nperseg=8192)
    at = int(np.argmin(np.abs(wave - 0.3)))

    assert 4.0 * ISO_CLASS_A * (0.1 / 0.3) ** 2 == pytest.approx(float(density[:, at].mean()), rel=0.3)


def test_an_even_ring_at_constant_speed_gives_that_speed() -> None:
    """Edges are timed to a microsecond, so speeds are right to a ten-thousandth; counts are whole teeth."""
    angle = np.asarray(50.0 * np.arange(int(4 * RATE_HZ)) / RATE_HZ, dtype=np.float64)
    edge_s = ToneRing.uneven(np.random.default_rng(1), 48, 0.0, 0.0).edge_times_s(angle)

    assert 50.0 == pytest.approx(ecu_speed_radps(edge_s, 48, 100.0, 0.01)[5:], rel=3e-4)
    assert 50.0 * 3.0 * 48 / (2.0 * math.pi) == pytest.approx(counts(edge_s, 100.0)[300], abs=1.5)


def test_a_smooth_road_turns_the_wheel_evenly() -> None:
    """Without roughness the rim turns at speed over radius."""
    angle = roll(np.random.default_rng(1), Tyre(), np.full(3, 20.0), 0.0, 2)

    assert 20.0 / Tyre().radius_m / RATE_HZ == pytest.approx(np.diff(angle))
