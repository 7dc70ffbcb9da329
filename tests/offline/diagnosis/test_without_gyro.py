"""What the rounding of counts leaves in a yaw rate that wheels alone tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.stages import State, first_noise, settle
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import WINDOW_S, YAW_SMOOTHING_S, _road_density, reference
from tpmsd.offline.inference.windows import Reader

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
    of a Gaussian of s = 1 s, half of it. The rest is in the receiver's course."""
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
    gaussian = np.exp(-0.5 * (2.0 * np.pi / 4.0 * YAW_SMOOTHING_S) ** 2)

    assert kept == pytest.approx(1.0 - (1.0 - gaussian) ** 2, abs=0.03)


def test_the_road_under_an_axle_is_the_density_of_its_yaw_rate() -> None:
    """Distances with a white rate of density s^2 per wheel make one of 2 s^2 / track^2 of an axle."""
    made = recording_of(drive(Spec(duration_s=600.0, road="motorway", teeth=4e4, rough=0.0), 3))
    std = 4e-3 * np.sqrt(made.dt_s)
    scatter = np.random.default_rng(2).normal(0.0, std, made.rotation_rad.shape) / made.car.radius_m
    track_m = 0.5 * (made.car.geometry.track_front_m + made.car.geometry.track_rear_m)
    found = _road_density(replace(made, rotation_rad=made.rotation_rad + scatter), made.car)

    assert WINDOW_S == 1.0
    assert found == pytest.approx(2.0 * 4e-3**2 / track_m**2, rel=0.15)


def _later(recording: Recording, ticks: int) -> Recording:
    """Begun so many ticks later: its fixes come elsewhere in the windows."""
    return replace(
        recording,
        rotation_rad=recording.rotation_rad[ticks:],
        inertial={name: values[ticks:] for name, values in recording.inertial.items()},
        fix_time_s=recording.fix_time_s - ticks * recording.dt_s,
    )


def test_what_a_rough_road_does_to_the_covariate_is_not_in_what_is_left() -> None:
    """Without a gyro the lateral acceleration has the error of the wheels that it is compared with. On a road
    of ten times the usual roughness nothing is 8 standard deviations of a slip angle then, as it was behind
    0.35 s of smoothing, and 4 of a load transfer, as before all channels had told the motion."""
    spec = Spec(duration_s=400.0, road="motorway", rough=4e-3, doppler_mps=0.02, receiver_hz=1.0)
    recording = _later(_blind(recording_of(drive(spec, 2))), 7)
    regression = Regression([Reader(recording, reference(recording))])
    settled = settle(first_noise(State(regression, regression.hypotheses.everything))).regression
    evidence, hypotheses = settled.evidence(), settled.hypotheses
    stds = {}
    for term in hypotheses.catalogue:
        if term.effect in ("lateral_slip", "load_transfer_lateral") and len(term.parameters) == 1:
            fit = evidence.fit(np.concatenate([hypotheses.nuisance, term.design], axis=1))
            stds[term.effect] = float(fit.values[-1] / np.sqrt(fit.covariance[-1, -1]))

    assert {"lateral_slip": 0.0, "load_transfer_lateral": 0.0} == pytest.approx(stds, abs=2.5)
