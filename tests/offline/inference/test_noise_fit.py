"""The noise of a drive before anything was looked for, and the ends of an interval."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import RADIUS
from tpmsd.offline.diagnosis.assessment.tangent import level_crossing
from tpmsd.offline.diagnosis.prepared.drive_regression import DriveRegression, initial_noise
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.noise_fit import SearchStage, fit_noise
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import Reader


def first_fit(loss_m: float) -> Noise:
    """Of two wheels and a receiver alone, of which one tyre loses this halfway."""
    leak = {"wheel": "rl", "deviation_m": loss_m, "onset_s": 300.0, "duration_s": 2.0}
    recording = recording_of(drive(Spec(duration_s=600.0, physics={"radius_change": leak}), 71))
    rotation = np.where([False, False, True, True], recording.rotation_rad, np.nan)
    inertial = {name: np.full(recording.ticks, np.nan) for name in recording.inertial}
    recording = dataclasses.replace(recording, rotation_rad=rotation, inertial=inertial)
    reader = Reader(recording, reference(recording))
    regression = DriveRegression(reader, {}, {})
    radii = [k for k, name in enumerate(regression.names) if name[0] == RADIUS.name]
    columns = regression.columns.take([0, *radii])
    return fit_noise(reader.windows, columns, initial_noise(reader), SearchStage.FIRST)


def test_a_tyre_that_changed_halfway_does_not_make_single_readings_rough() -> None:
    """Each stretch from which the noise is told has radii of its own: what a window's way is said to scatter
    by stays that of a sound tyre, below two millimetres; with radii in common it was nine centimetres.
    """
    sound, leaking = (first_fit(loss_m) for loss_m in (0.0, -3e-3))
    distance_m = 20.0
    scatter = [math.hypot(noise.rough_m * math.sqrt(distance_m), noise.floor_m) for noise in (sound, leaking)]

    assert max(scatter) < 2e-3


@pytest.mark.parametrize(
    ("inside", "step", "expected"),
    [(2, 1, 2.0 + 2.0 / 20.0), (2, -1, 2.0 - 2.0 / 20.0), (4, 1, 4.0), (0, -1, 0.0)],
)
def test_an_interval_ends_between_two_trials(inside: int, step: int, expected: float) -> None:
    """Where the parabola through the trials crosses the level: of 200 nats per step squared, 2 nats are a
    tenth of a step, and a line would say a hundredth; at the last of all trials where none is outside.
    """
    gains = 10.0 - 200.0 * (np.arange(5) - 2.0) ** 2

    assert level_crossing(gains, 8.0, inside, step) == pytest.approx(expected)
