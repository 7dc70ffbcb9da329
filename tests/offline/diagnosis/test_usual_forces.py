"""What every car does over a force, together: drive slip, brake slip and loads are names, and no spline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.instruments import observe
from bench.worlds.kinematic import Spec, course
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.inference.recording import Recording

MASS_KG, RADIUS_M, GAIN, LATE_S = 1500.0, 0.316, 1.1, 0.12
DRIVE, BRAKES, ENGINE_MPS2 = 4e-3, 3e-3, 0.4
"""Slip per m/s2 of the driven axle and of both, and what the engine alone slows down by."""


def recorded(told: bool) -> Recording:
    """Ten minutes of a rear-driven car; `told`: its bus has the torque, a tenth too much and 0.12 s early."""
    rng = np.random.default_rng(3)
    spec = Spec(duration_s=600.0, road="mixed", driven="rear", with_accel=True)
    road = course(spec, rng)
    force = road.force + 2.7e-4 * road.speed**2 + 0.1
    torque = np.maximum(force, -ENGINE_MPS2) * MASS_KG * RADIUS_M
    rear = DRIVE * np.interp(road.time_s - LATE_S, road.time_s, torque) / (MASS_KG * RADIUS_M)
    brakes = BRAKES * np.minimum(force + ENGINE_MPS2, 0.0)
    spin = np.stack([0.65 * brakes] * 2 + [rear + 0.35 * brakes] * 2, axis=1)
    spin -= 8e-5 / 0.31 * road.force[:, None] * np.array([1.0, 1.0, -1.0, -1.0])
    spin -= 1e-4 / 0.31 * road.a_lat[:, None] * np.array([1.0, -1.0, 1.0, -1.0])
    recording = recording_of(observe(replace(road, spin=spin), spec, rng, 3))
    at = (np.arange(recording.ticks) + 0.5) * recording.dt_s
    read = GAIN * np.interp(at, road.time_s, torque) + rng.normal(0.0, 5.0, recording.ticks)
    shown = read if told else np.full(recording.ticks, np.nan)
    return replace(recording, inertial={**recording.inertial, "drive_torque_nm": shown})


@pytest.mark.parametrize(
    ("told", "name", "parameter", "true"),
    [
        (True, "torque_slip", "slip_per_nm", DRIVE / (MASS_KG * RADIUS_M * GAIN)),
        (False, "longitudinal_slip", "slip_per_accel", DRIVE),
    ],
    ids=["torque", "acceleration"],
)
def test_forces_that_act_together_have_their_names(
    told: bool, name: str, parameter: str, true: float
) -> None:
    """Over the torque, or without it over the acceleration, slip is told with its size to a fifth; neither it
    nor what brakes and loads do beside it has no name."""
    found = {one.effect: one for one in diagnose([recorded(told)]).findings}

    assert "unknown" not in found
    assert {name, "brake_slip", "load_transfer_lateral"} <= set(found)
    assert found[name].parameters[parameter].value == pytest.approx(true, rel=0.2)
    lateral = found["load_transfer_lateral"].parameters["coefficient"].value
    assert lateral == pytest.approx(1e-4, rel=0.1)
    if told:
        assert found[name].parameters["lag_s"].value == pytest.approx(LATE_S, abs=0.05)
