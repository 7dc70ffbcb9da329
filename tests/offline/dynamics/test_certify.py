"""Certificates by replicates: what a replicate holds, and how p-values are counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.offline.dynamics.drives import folder, hidden, loaded
from tpmsd.car.physics.dynamics_catalogue import make_dynamics_effect
from tpmsd.offline.dynamics.certify import Replicates, replicate
from tpmsd.offline.dynamics.diagnose import diagnose_dynamics
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.result import CONSISTENT, MISMATCH
from tpmsd.offline.dynamics.search import Search

CHANNELS = ("yaw_rate", "accel_lat", "velocity_lat")


def test_a_replicate_holds_the_model_and_the_fitted_noise(tmp_path: Path) -> None:
    """Its mean follows the given effect; its white noise is that of the sensors."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=60.0), "single-track")
    search = Search(Setup(baseline, drive, CHANNELS))
    rng = np.random.default_rng(3)
    plain = replicate(search, (), rng)
    scaled = replicate(search, (make_dynamics_effect("yaw_rate_scale", scale=1.2),), rng)
    yaw = np.asarray(drive.outputs["yaw_rate"])

    assert float(plain.outputs["yaw_rate"] @ yaw / (yaw @ yaw)) == pytest.approx(1.0, abs=0.01)
    assert float(scaled.outputs["yaw_rate"] @ yaw / (yaw @ yaw)) == pytest.approx(1.2, abs=0.01)
    bend = np.diff(plain.outputs["yaw_rate"], 4)
    assert float(np.std(bend)) / np.sqrt(70.0) == pytest.approx(0.002, rel=0.1)


def test_the_same_generator_draws_the_same_replicate(tmp_path: Path) -> None:
    """Nothing else is random."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=20.0), "single-track")
    search = Search(Setup(baseline, drive, CHANNELS))
    one, other = (replicate(search, (), np.random.default_rng(5)) for _ in range(2))

    for name in CHANNELS:
        assert np.array_equal(one.outputs[name], other.outputs[name], equal_nan=True)


def test_p_values_are_counted_in_replicates(tmp_path: Path) -> None:
    """A plain effect: no replicate reaches it, and the bound is one over one more than their number."""
    where = folder(tmp_path / "d", hidden(yaw_inertia_error={"relative": 0.25}), duration_s=40.0)
    found = diagnose_dynamics(
        *loaded(where, "single-track"), replicates=Replicates(7, np.random.default_rng(0))
    )
    (one,) = found.findings

    assert found.verdict == MISMATCH
    assert one.p_value_is_bound
    assert one.p_value == pytest.approx(1.0 / 8.0)
    assert found.certificate is not None
    assert found.certificate.replicates == 7


def test_nothing_is_left_in_a_null_drive(tmp_path: Path) -> None:
    """The largest evidence of anything is one that replicates have as well."""
    baseline, drive = loaded(folder(tmp_path / "d", duration_s=40.0), "single-track")
    found = diagnose_dynamics(baseline, drive, replicates=Replicates(19, np.random.default_rng(0)))

    assert found.verdict == CONSISTENT
    assert found.certificate is not None
    assert found.certificate.remaining_p_value > 0.05
