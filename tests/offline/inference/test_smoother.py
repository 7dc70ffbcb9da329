"""The reference motion, moved to where all channels agree."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.diagnose import diagnose, initial_noise
from tpmsd.offline.inference.blocks import PE, PN, PSI, QOLD, Q, V, W
from tpmsd.offline.inference.layouts import DRIFTING_RADII
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.state_space import state_space
from tpmsd.offline.inference.trajectory import WINDOW_S, reference
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import GYRO, Reader, Windows

STATES = DRIFTING_RADII.states
GB = DRIFTING_RADII.names.index("gyro_bias")


def without_gyro(recording: Recording) -> Recording:
    """As a bus without inertial signals gives it."""
    gyro = np.full(recording.ticks, np.nan)
    return dataclasses.replace(recording, inertial={**recording.inertial, "yaw_rate_radps": gyro})


def motion_errors(windows: Windows, noise: Noise, residual: FloatArray) -> FloatArray:
    """(w, 3) smoothed errors of the reference by a residual (w, 9)."""
    made = Whitener.of(windows, noise, np.isfinite(residual))
    return made.smooth(made.apply(residual[:, :, None])[:, :, 0])


@pytest.fixture(scope="module")
def reader() -> Reader:
    """Ten minutes of mixed driving."""
    recording = recording_of(drive(Spec(duration_s=600.0), 5))
    return Reader(recording, reference(recording))


def test_what_becomes_of_an_error_from_window_to_window(reader: Reader) -> None:
    """The end's reading is the next one's start, a heading that is off moves the position across the way
    driven, a bias stays, and what is new in each window is forgotten.
    """
    windows = reader.windows
    made = state_space(windows, initial_noise(reader), np.isfinite(windows.measured), None)
    k = len(windows) // 2
    assert windows.index[k] == windows.index[k - 1] + 1
    error = np.zeros(STATES)
    error[[Q, QOLD + 1, V, W, PSI, GB]] = 0.001, 7.0, 7.0, 7.0, 0.01, 0.002
    moved = made.transition[k] @ error
    assert moved[QOLD] == pytest.approx(0.001)
    assert moved[[Q, Q + 1, QOLD + 1, V, W]] == pytest.approx(0.0)
    assert moved[[PSI, GB]] == pytest.approx([0.01, 0.002])
    distance_m = windows.covariates["speed"][k] * WINDOW_S
    assert np.hypot(moved[PE], moved[PN]) == pytest.approx(0.01 * distance_m, rel=0.05)


def test_the_smoother_is_the_conditional_mean(reader: Reader) -> None:
    """Of a few windows it equals the mean of a multivariate normal given all channels at once, computed with
    the covariance of all states and all readings written out.
    """
    few, rng = 8, np.random.default_rng(2)
    windows = dataclasses.replace(
        reader.windows,
        index=reader.windows.index[:few],
        fixes=reader.windows.fixes[:few],
        covariates={name: values[:few] for name, values in reader.windows.covariates.items()},
        design=reader.windows.design[:few],
        to_east_north=reader.windows.to_east_north[:few],
        measured=reader.windows.measured[:few],
        after_fixes=reader.windows.after_fixes[:few],
        repeated_rounding_m2=reader.windows.repeated_rounding_m2[:few],
    )
    noise = initial_noise(reader)
    here = np.isfinite(windows.measured)
    here[3, :] = False
    here[5, GYRO:] = False
    residual = np.where(here, 0.1 * rng.standard_normal(here.shape), np.nan)
    made = state_space(windows, noise, here, None)
    covariance = np.zeros((few * STATES, few * STATES))
    P = np.diag(made.diagonals.start)
    transition, fresh = made.transition, made.fresh
    for k in range(few):
        F, at = transition[k], slice(k * STATES, (k + 1) * STATES)
        covariance[at, : k * STATES] = (
            F @ covariance[at.start - STATES : at.start, : k * STATES] if k else 0.0
        )
        covariance[: k * STATES, at] = covariance[at, : k * STATES].T
        P = F @ P @ F.T + fresh[k]
        covariance[at, at] = P
    H = np.zeros((few * 9, few * STATES))
    for k in range(few):
        H[9 * k : 9 * k + 9, k * STATES : (k + 1) * STATES] = made.geometry.rows[k]
    seen = here.ravel()
    H, R = H[seen], np.diag(made.diagonals.variance.ravel()[seen])
    mean = covariance @ H.T @ np.linalg.solve(H @ covariance @ H.T + R, residual.ravel()[seen])

    expected = mean.reshape(few, STATES)[:, [V, W, PSI]]
    assert motion_errors(windows, noise, residual) == pytest.approx(expected, rel=1e-5, abs=1e-8)


def test_a_motion_that_was_bent_is_put_right(reader: Reader) -> None:
    """A speed and a yaw rate that were made wrong come out with the opposite sign."""
    windows = reader.windows
    bent = np.zeros((len(windows), 3))
    bent[40:60, 0] = 0.3
    bent[40:60, 1] = 0.02
    bent[:, 2] = np.cumsum(bent[:, 1])
    whole = Reader(reader.recording, reader.reference)
    whole.recalibrate(reader.reference.car.radius_m, ExtendedModel(), bent)
    left = whole.windows.measured - whole.predict(ExtendedModel())
    straight = windows.measured - reader.predict(ExtendedModel())
    noise = initial_noise(reader)
    found = motion_errors(whole.windows, noise, left) - motion_errors(windows, noise, straight)

    assert found[42:58, 0] == pytest.approx(-bent[42:58, 0], abs=0.02)
    assert found[42:58, 1] == pytest.approx(-bent[42:58, 1], abs=0.002)


@pytest.mark.parametrize("coefficient", [4e-4, 8e-4, -4e-4])
def test_a_load_transfer_that_bends_the_motion_itself_is_measured(coefficient: float) -> None:
    """Without a gyro the yaw rate comes from the very wheels that a strong load transfer changes: at 30 m/s
    by more than half of it. The coefficient is found within three per cent all the same.
    """
    physics: dict[str, dict[str, object]] = {"load_transfer_lateral": {"coefficient": coefficient}}
    recording = recording_of(drive(Spec(duration_s=500.0, physics=physics), 21))
    diagnosis = diagnose([without_gyro(recording)])
    finding = diagnosis.findings[0]

    assert "load_transfer_lateral" == finding.effect
    assert finding.parameters["coefficient"].value == pytest.approx(coefficient, rel=0.03)
