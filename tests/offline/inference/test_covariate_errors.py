"""How well covariates are known, and what shapes over them may be told."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.hypotheses.response import finer_knots, smooth_knots
from tpmsd.offline.diagnosis.prepared.drive_regression import initial_noise
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.covariate_errors import expected
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import Reader


@pytest.mark.parametrize("gyro_std", [0.0015, 0.02])
def test_the_smoothed_motion_is_as_good_as_it_says(gyro_std: float) -> None:
    """Moved by its smoothed errors, speed and yaw rate of the windows miss the true ones of the world by what
    the standard deviations say, within a factor of two, whatever the gyro."""
    world = drive(Spec(duration_s=400.0, road="mixed", gyro_std=gyro_std, radius_spread_m=0.0), 5)
    recording = recording_of(world, counted=True)
    reader = Reader(recording, reference(recording))
    windows = reader.windows
    noise = dataclasses.replace(initial_noise(reader), gyro_radps=gyro_std / math.sqrt(50.0))
    left = windows.measured - reader.predict(ExtendedModel())
    made = Whitener.of(windows, noise, np.isfinite(left))
    errors = made.smooth(made.apply(left[:, :, None])[:, :, 0])
    stds = made.motion_stds()
    for k, (name, true) in enumerate((("speed", world.speed), ("yaw_rate", world.yaw_rate))):
        mean = true[: 50 * (len(true) // 50)].reshape(-1, 50).mean(axis=1)[windows.index]
        missed = (windows.covariates[name] + errors[:, k] - mean) / stds[:, k]
        assert 0.5 < np.std(missed) < 2.0


def test_no_two_knots_are_nearer_than_four_standard_deviations_of_the_covariate() -> None:
    """Most of a motorway is straight: by quantiles alone the knots over the yaw rate would crowd there."""
    rng = np.random.default_rng(1)
    yaw = np.where(rng.random(1000) < 0.9, 3e-4, 0.1) * rng.standard_normal(1000)
    crowded = smooth_knots({"yaw_rate": yaw})["yaw_rate"]
    apart = smooth_knots({"yaw_rate": yaw}, {"yaw_rate": 1e-3})["yaw_rate"]
    finer = finer_knots(yaw, 20, 1e-3)

    assert np.diff(crowded).min() < 1e-3
    assert min(np.diff(apart).min(), np.diff(finer).min()) >= SETTINGS.hypotheses.apart_stds * 1e-3
    assert (crowded[0], crowded[-1]) == (apart[0], apart[-1])


def test_a_covariate_that_hardly_varies_beside_its_error_bears_no_shape() -> None:
    """A range of less than the knots' least distance has none."""
    values = np.linspace(-1e-3, 1e-3, 500)

    assert {} == smooth_knots({"yaw_rate": values}, {"yaw_rate": 1e-3})


def test_a_straight_null_drive_does_not_bend() -> None:
    """On a motorway with wheel speeds, a fix per second and errors of Doppler speed as large as on real
    recordings nothing is found, although the yaw rate is mostly its own error."""
    world = drive(Spec(duration_s=500.0, road="motorway", receiver_hz=1.0, doppler_mps=0.1), 12)
    found = diagnose([recording_of(world, counted=False)])

    assert ("consistent", ()) == (found.verdict, found.findings)


def test_what_is_expected_of_a_normal_covariate_is_its_regression_on_the_estimate() -> None:
    """True values of standard deviation 2 with errors of 1: four fifths of what was estimated, within what
    the blurred density allows."""
    rng = np.random.default_rng(7)
    true = 2.0 * rng.standard_normal(20_000)
    estimated = true + rng.standard_normal(20_000)
    slope = float(np.polyfit(estimated, expected(estimated, 1.0), 1)[0])

    assert slope == pytest.approx(0.8, abs=0.03)
    assert np.all(expected(estimated, 0.0) == estimated)


def test_on_straights_the_error_goes_and_in_bends_nothing_changes() -> None:
    """Nine tenths of a drive is straight: what is left of the error there is a third of it, and bends of
    fifteen errors keep their lateral acceleration."""
    rng = np.random.default_rng(8)
    bend = rng.random(2000) < 0.1
    true = np.where(bend, rng.choice([-2.0, 2.0], 2000), 0.0)
    estimated = true + 0.13 * rng.standard_normal(2000)
    missed = expected(estimated, 0.13) - true

    assert np.std(missed[~bend]) < 0.4 * 0.13
    assert np.std(missed[bend]) < 0.13
