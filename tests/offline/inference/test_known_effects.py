"""Effects taken out of a recording leave that of the same drive without them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tpmsd.car.physics.catalogue import parse_effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.interfaces.cli.diagnose import read_recording
from tpmsd.offline.inference.known_effects import without_effects
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.receiver import ReceiverSpec

RECEIVER = ReceiverSpec(position_std_m=0.01, white_std_m=0.001, velocity_std_mps=0.001, jitter_s=0.0)
SPEC = DriveSpec(duration_s=150.0, seed=3, route="rural", flat=True, receiver=RECEIVER)
TOOTH_RAD = 2.0 * np.pi / 48.0


def recorded(folder: Path, model: ExtendedModel) -> Recording:
    """The drive with these effects, as it is read."""
    write_drive(folder, simulate_drive(replace(SPEC, model=model, bus=BusSpec(jitter_s=0.0))))
    return read_recording(folder)


def differences(one: Recording, other: Recording) -> dict[str, float]:
    """The largest of each kind: way of a wheel in teeth, gyro, positions (m), speed (m/s), fix times (s)."""
    n = min(one.ticks, other.ticks)  # later fixes end later
    distances = np.nancumsum(one.rotation_rad[:n] - other.rotation_rad[:n], axis=0)
    gyro = one.inertial["yaw_rate_radps"][:n] - other.inertial["yaw_rate_radps"][:n]
    move = np.hypot(one.east_m - other.east_m, one.north_m - other.north_m)
    return {
        "teeth": float(np.abs(distances).max() / TOOTH_RAD),
        "gyro": float(np.nanpercentile(np.abs(gyro), 98)),
        "moved_m": float(np.percentile(np.abs(move - np.median(move)), 98)),
        "speed_mps": float(np.nanpercentile(np.abs(one.speed_mps - other.speed_mps), 98)),
        "later_s": float(np.abs(one.fix_time_s - other.fix_time_s).max()),
    }


@pytest.mark.parametrize(
    ("effect", "shows", "before", "after"),
    [
        ("centrifugal_growth:coefficient=6e-6", "teeth", 8.0, 2.0),
        ("radius_change:wheel=fr,deviation_m=-4e-3,onset_s=40,duration_s=0", "teeth", 8.0, 2.0),
        ("longitudinal_slip:slip_per_accel=0,slip_per_speed2=2e-5", "teeth", 8.0, 2.0),
        ("yaw_rate_scale:scale=1.4", "gyro", 0.02, 0.004),
        ("gnss_latency:latency_s=0.3", "later_s", 0.25, 0.02),
        ("antenna_lever_arm:forward_m=3", "moved_m", 0.7, 0.15),
        ("velocity_lag:lag_s=0.4", "speed_mps", 0.3, 0.06),
        ("tone_ring_error:wheel=rl,teeth_per_rev=47", "teeth", 50.0, 2.0),
    ],
)
def test_what_is_left_is_the_drive_without_the_effect(
    tmp_path: Path, effect: str, shows: str, before: float, after: float
) -> None:
    """The same drive simulated without it, to within rounding and smoothing; nothing else moves."""
    model = ExtendedModel((parse_effect(effect),))
    acting, plain = recorded(tmp_path / "acting", model), recorded(tmp_path / "plain", ExtendedModel())

    left = without_effects(acting, model)

    there, gone = differences(acting, plain), differences(left, plain)
    assert there[shows] > before
    assert gone[shows] < after
    for kind in set(gone) - {shows}:
        assert gone[kind] <= there[kind] + 0.005


def test_no_effects_leave_the_recording_itself(tmp_path: Path) -> None:
    """And effects of no size leave its numbers to within the rounding of floating point."""
    acting = recorded(tmp_path, ExtendedModel())

    assert without_effects(acting, ExtendedModel()) is acting
    left = without_effects(acting, ExtendedModel((parse_effect("centrifugal_growth:coefficient=0"),)))
    assert np.array_equal(acting.rotation_rad, left.rotation_rad, equal_nan=True)
    assert np.array_equal(acting.east_m, left.east_m, equal_nan=True)
    assert np.allclose(acting.speed_mps, left.speed_mps, atol=1e-12, equal_nan=True)
