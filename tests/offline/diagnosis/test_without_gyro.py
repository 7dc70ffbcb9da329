"""What the rounding of counts leaves in a yaw rate that wheels alone tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference

TEETH = 40.0


def _blind(recording: Recording) -> Recording:
    """Without its gyro."""
    inertial = {**recording.inertial, "yaw_rate_radps": np.full(recording.ticks, np.nan)}
    return replace(recording, inertial=inertial)


@pytest.mark.parametrize(("seed", "road"), [(3, "city"), (5, "rural")])
def test_a_lag_of_the_velocity_is_no_low_pass(seed: int, road: str) -> None:
    """Of 0.3 s on a bus of coarse rings and no gyro: heading that trembles by the rounding of counts looked
    as if the receiver smoothed it, `gnss_smoothing` at 1.00."""
    spec = Spec(duration_s=400.0, road=road, teeth=TEETH, doppler_age_s=0.3, receiver_hz=5.0)
    (finding,) = diagnose([_blind(recording_of(drive(spec, seed)))]).findings
    lag = finding.parameters["lag_s"]

    assert "velocity_lag" == finding.effect
    assert lag.std is not None
    assert lag.value == pytest.approx(0.3, abs=3.0 * lag.std)
    assert lag.std < 0.02


@pytest.mark.parametrize(("teeth", "max_radps"), [(TEETH, 7e-3), (40_000.0, 2e-5)])
def test_a_yaw_rate_by_wheels_has_little_of_their_rounding(teeth: float, max_radps: float) -> None:
    """Two readings of one drive whose counts begin elsewhere differ by rounding alone: on a coarse ring by
    less than 7 mrad/s each, where 0.35 s of smoothing left 12; on a fine one by next to nothing."""
    made = drive(Spec(duration_s=120.0, road="city", teeth=teeth), 3)
    pitch = 2.0 * np.pi / teeth
    begun = np.random.default_rng(1).random((2, 4)) * pitch
    moved = [replace(made, shown_rad=made.shown_rad + begin) for begin in begun]
    yaw = [reference(_blind(recording_of(one))).motion.yaw_rate_radps for one in moved]

    assert float(np.std(yaw[0] - yaw[1])) / np.sqrt(2.0) < max_radps


def test_a_lane_change_stays_in_a_yaw_rate_by_wheels() -> None:
    """Of one that lasts four seconds, on a coarse ring: 1 - (1 - G)^2 of it with G = exp(-(2 pi f s)^2 / 2)
    of a Gaussian of s = 0.6 s, 87 %. At s = 1.5 s a tenth is left, the rest is in the receiver's course."""
    plain = _blind(recording_of(drive(Spec(duration_s=120.0, road="motorway", teeth=TEETH), 3)))
    time_s = plain.dt_s * np.arange(plain.ticks + 1)
    lane = np.sin(2.0 * np.pi * time_s / 4.0)
    turned = 0.04 * np.concatenate([[0.0], np.cumsum(0.5 * (lane[1:] + lane[:-1]) * plain.dt_s)])
    half = 0.5 * plain.car.geometry.track_rear_m / plain.car.radius_m[0] * np.array([-1.0, 1.0, -1.0, 1.0])
    angle = 25.0 / plain.car.radius_m[0] * time_s[:, None] + turned[:, None] * half
    pitch = 2.0 * np.pi / TEETH
    rotation = np.diff(np.floor(angle / pitch) * pitch, axis=0)
    motion = reference(replace(plain, rotation_rad=rotation)).motion
    scale = float(np.median(motion.speed_mps)) / 25.0  # the receiver is still that of the other drive
    kept = float(lane @ motion.yaw_rate_radps / (lane @ lane)) / 0.04 / scale
    gaussian = np.exp(-0.5 * (2.0 * np.pi / 4.0 * 0.6) ** 2)

    assert kept == pytest.approx(1.0 - (1.0 - gaussian) ** 2, abs=0.03)
