"""The filter that eliminates the motion, against the noise it assumes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.diagnose import initial_noise
from tpmsd.offline.inference.stack import ColumnStack
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.whitening import Whitener, whiten
from tpmsd.offline.inference.windows import EAST, GYRO, SPEED, Reader


@pytest.fixture(scope="module")
def reader() -> Reader:
    """Ten minutes of mixed driving."""
    recording = recording_of(drive(Spec(duration_s=600.0), 5))
    return Reader(recording, reference(recording))


def zero(reader: Reader) -> FloatArray:
    """(w, 9, 1) a residual of nothing where something was measured."""
    return np.where(np.isfinite(reader.windows.measured), 0.0, np.nan)[:, :, None]


def test_errors_of_the_reference_motion_leave_no_trace(reader: Reader) -> None:
    """A residual that a wrong speed, yaw rate and heading would make is whitened to next to nothing."""
    windows, noise = reader.windows, initial_noise(reader)
    rng = np.random.default_rng(3)
    errors = rng.standard_normal((len(windows), 2)) * (0.05, 0.005)
    columns = zero(reader)
    columns[:, :, 0] += windows.design[:, :, 0] * errors[:, :1] + windows.design[:, :, 1] * errors[:, 1:]
    columns[:, 6:, 0] = np.nan  # course and position would need the errors' integrals
    white, _ = whiten(windows, noise, columns)
    honest = errors[:, 0] / 0.02

    assert np.sqrt((white**2).mean()) < 0.05 * np.sqrt((honest**2).mean())


def test_a_count_at_an_edge_enters_two_windows_with_opposite_signs(reader: Reader) -> None:
    """Reading errors of the wheels' angles, which alternate, are whitened to unit variance."""
    windows, noise = reader.windows, initial_noise(reader)
    noise = dataclasses.replace(noise, reading_m=(0.01,) * 4, stamp_s=1e-6)
    rng = np.random.default_rng(4)
    edge = 0.01 * rng.standard_normal((int(windows.index.max()) + 2, 4))
    columns = zero(reader)
    columns[:, :4, 0] = edge[windows.index + 1] - edge[windows.index]
    columns[:, :4, 0] += (
        1e-2 * 0.04 * np.sqrt(windows.covariates["speed"][:, None]) * rng.standard_normal((len(windows), 4))
    )
    columns[:, GYRO:, 0] = np.nan
    white, _ = whiten(windows, noise, columns)
    contrasts = white[:, 2:4, 0]

    assert contrasts.std() == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(contrasts[1:, 0], contrasts[:-1, 0])[0, 1] == pytest.approx(0.0, abs=0.12)


def test_what_was_not_measured_gives_no_row(reader: Reader) -> None:
    """Missing channels are zero rows, and do not disturb the others' likelihood."""
    windows, noise = reader.windows, initial_noise(reader)
    columns = zero(reader)
    columns[:, SPEED:, 0] = np.nan
    white, with_wheels = whiten(windows, noise, columns)
    columns[:, :, 0] = np.nan
    _, with_nothing = whiten(windows, noise, columns)

    assert float(np.abs(white[:, EAST:]).max()) == 0.0
    assert with_nothing == 0.0
    assert with_wheels != 0.0


@pytest.mark.parametrize("width", [5, 60])
def test_a_stack_is_whitened_as_an_array_of_its_columns(reader: Reader, width: int) -> None:
    """Few columns and many, all of them and those from the second on."""
    rng = np.random.default_rng(width)
    arrays = rng.standard_normal((width, len(reader.windows), 9))
    here = np.isfinite(reader.windows.measured)
    made = Whitener.of(reader.windows, initial_noise(reader), here)
    expected = made.apply(np.moveaxis(arrays, 0, 2))
    stack = ColumnStack(*arrays)
    assert np.allclose(expected, made.apply_all(stack), rtol=0.0, atol=1e-9 * np.abs(expected).max())
    assert np.allclose(
        expected[:, :, 2:], made.apply_all(stack, 2), rtol=0.0, atol=1e-9 * np.abs(expected).max()
    )
