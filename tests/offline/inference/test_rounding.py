"""Rounding of wheel speeds that a steady car holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.rounding import repeated_rounding_variance
from tpmsd.offline.inference.state_space import diagonals, geometry
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader

STEP_MPS, DT_S = 0.0625 / 3.6, 0.1
CRUISE_S = (40, 65)


def _recorded(step_mps: float, tremble: float = 0.0) -> Recording:
    """From 19 to 20 m/s, a cruise of 25 s and down again, by speeds in such steps whose ticks tremble by a
    share; the last wheel trembles by 1e-4."""
    counted = recording_of(drive(Spec(duration_s=101.0), 3))
    t = np.arange(counted.ticks) * DT_S
    speed = np.interp(t, [0.0, CRUISE_S[0], CRUISE_S[1], 100.0], [19.0, 20.003, 20.003, 19.2])
    shown = np.round(speed / step_mps) * step_mps if step_mps else speed
    shown = shown * (1.0 + tremble * np.where(np.arange(len(t)) % 3, 1.0, -1.0))
    distances = np.repeat(DT_S * shown[:, None], 4, axis=1)
    distances[:, 3] *= 1.0 + 1e-4 * np.random.default_rng(1).standard_normal(len(t))
    turned = distances / counted.car.radius_m
    return replace(counted, rotation_rad=turned, quantum_rad=np.zeros(4))


def test_a_run_of_one_reading_tells_no_more_than_one_rounding() -> None:
    """On a cruise a window has the variance of the rounding times their number; no wheel that trembles."""
    held = repeated_rounding_variance(_recorded(STEP_MPS))
    number = CRUISE_S[1] - CRUISE_S[0]

    assert held[45:60, :3] == pytest.approx(number * STEP_MPS**2 / 12.0, rel=0.1)
    assert held[:35, :3].max() < 0.1 * held[50, 0]
    assert 0.0 == held[:, 3].max()


def test_speeds_without_steps_stamps_that_tremble_and_counts() -> None:
    """Exact speeds of a simulator and counts hold nothing; stamps that leave 4e-6 change nothing."""
    recorded = _recorded(STEP_MPS)
    held = repeated_rounding_variance(recorded)

    assert 0.0 == repeated_rounding_variance(_recorded(0.0)).max()
    assert 0.0 == repeated_rounding_variance(replace(recorded, quantum_rad=np.full(4, 0.01))).max()
    assert repeated_rounding_variance(_recorded(STEP_MPS, 2e-6))[50, 0] == pytest.approx(
        held[50, 0], rel=0.02
    )


def test_the_variance_of_a_distance_holds_it() -> None:
    """That of a window on a cruise is larger by it."""
    recording = _recorded(STEP_MPS)
    reader = Reader(recording, reference(recording))
    space = geometry(reader.windows, np.isfinite(reader.windows.measured))
    noise = Noise.first(recording.quantum_rad, recording.car.radius_m)
    plain = noise.rough_m**2 * space.speed_mps + noise.floor_m**2
    held = repeated_rounding_variance(recording)[reader.windows.index]

    assert held.any()
    assert diagonals(space, noise).variance[:, :4] == pytest.approx(plain[:, None] + held)


def test_a_step_is_that_of_readings_and_not_of_their_means() -> None:
    """Whole kilometres per hour, ten readings to a tick: between two steps ticks are tenths of one, often two
    alike in a row. A cruise of 20 s at 37 km/h holds one rounding of a whole step."""
    counted = recording_of(drive(Spec(duration_s=401.0), 3))
    rng, per_tick = np.random.default_rng(2), 10
    t = np.arange(counted.ticks * per_tick) * DT_S / per_tick
    # Plateaus of 20 s, those of whole numbers on a level and the others between two.
    speed_kmh = 31.0 + np.floor(t / 20.0) * 0.75 + 0.5
    shown = np.floor(speed_kmh + 0.05 * rng.standard_normal(len(t))).reshape(-1, per_tick).mean(axis=1) / 3.6
    distances = np.repeat(DT_S * shown[:, None], 4, axis=1)
    turned = distances / counted.car.radius_m
    held = repeated_rounding_variance(replace(counted, rotation_rad=turned, quantum_rad=np.zeros(4)))

    assert held[:, 0].max() == pytest.approx(20.0 / 3.6**2 / 12.0, rel=0.1)
