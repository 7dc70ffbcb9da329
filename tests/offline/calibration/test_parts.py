"""Un-fused odometry, the paper's settings and the written file, each against a closed form."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tpmsd.car.physics.motion import Car
from tpmsd.offline.calibration.joint import outlier_factors
from tpmsd.offline.calibration.nominal import Vehicle, vehicle_of
from tpmsd.offline.calibration.odometry import odometry_stretches, pose_error
from tpmsd.offline.calibration.paper import PaperSettings, covariances, fit_paper
from tpmsd.offline.calibration.reference import reference_pose
from tpmsd.offline.calibration.result import FittedGeometry, WheelResult
from tpmsd.offline.calibration.vehicle_file import calibrated_toml
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.windows import CHANNELS
from tpmsd.offline.simulator.drive import DEFAULT_VEHICLE

RADIUS_M, SPEED_MPS, TURN_RADIUS_M, TRACK_M = 0.316, 12.0, 60.0, 1.52


def perfect(yaw_radps: np.ndarray, forward_m: float = 0.0, slip_per_accel: float = 0.0) -> Recording:
    """A car at 12 m/s without any noise; its rear axle's course leaves the heading by -c * a_y."""
    count, dt = len(yaw_radps), 0.1
    distance = SPEED_MPS * dt
    turn = yaw_radps * dt
    heading = np.concatenate([[0.0], np.cumsum(turn)])
    course = heading[:-1] + turn / 2 - slip_per_accel * SPEED_MPS * yaw_radps
    chord = distance * np.sinc(turn / 2 / math.pi)
    east = np.concatenate([[0.0], np.cumsum(chord * np.cos(course))])
    north = np.concatenate([[0.0], np.cumsum(chord * np.sin(course))])
    roll = np.stack([distance + side * turn * TRACK_M / 2 for side in (-1, 1, -1, 1)], axis=1)
    silent = np.full(count, math.nan)
    start = car()
    return Recording(
        car=Car(start.radius_m, start.geometry, start.driven, 48, antenna_forward_m=forward_m),
        dt_s=dt,
        start_s=0.0,
        rotation_rad=roll / RADIUS_M,
        quantum_rad=np.zeros(4),
        inertial={
            "yaw_rate_radps": yaw_radps,
            "accel_long_mps2": np.zeros(count),
            "accel_lat_mps2": SPEED_MPS * yaw_radps,
            "compass_rad": heading[1:],
        },
        fix_time_s=np.arange(1, count + 1) * dt,
        east_m=(east + forward_m * np.cos(heading))[1:],
        north_m=(north + forward_m * np.sin(heading))[1:],
        up_m=silent,
        speed_mps=silent,
        course_rad=silent,
    )


def car(rl_m: float = RADIUS_M, rr_m: float = RADIUS_M) -> Vehicle:
    start = vehicle_of(dataclasses.replace(DEFAULT_VEHICLE, track_rear_m=TRACK_M))
    return dataclasses.replace(start, radius_m=np.array([RADIUS_M, RADIUS_M, rl_m, rr_m]))


CIRCLE = np.full(600, SPEED_MPS / TURN_RADIUS_M)
BENDS = 0.15 * np.sign(np.sin(np.arange(1200) * 0.1 / 6.0)) * (np.sin(np.arange(1200) * 0.1 / 6.0) ** 2 > 0.3)


def test_outliers_weigh_less() -> None:
    """A reading five standard deviations off gets its variance raised, a position on both axes."""
    white = np.zeros((3, CHANNELS))
    white[0, 2], white[1, 8], white[2, 4] = 5.0, -8.0, 3.0
    factor = outlier_factors(white)

    assert (6.25, 16.0, 16.0) == (factor[0, 2], factor[1, 7], factor[1, 8])
    assert 3 == int((factor > 1.0).sum())


def test_odometry_of_a_circle() -> None:
    """True radii reproduce the circle; radii 1 % too large draw one that is 1 % larger, so 0.6 m off all
    round."""
    recording = perfect(CIRCLE)

    assert pose_error([recording], car()) < 0.01
    assert pose_error([recording], car(RADIUS_M * 1.01, RADIUS_M * 1.01)) == pytest.approx(
        pose_error_of_larger_circle(), rel=0.02
    )


def pose_error_of_larger_circle() -> float:
    """Two arcs of equal angular speed, the larger laid onto the smaller by its centre of mass."""
    angle = np.linspace(0.0, 600 * 0.1 * SPEED_MPS / TURN_RADIUS_M * 1.01, 600)
    turn = angle / 1.01
    large = TURN_RADIUS_M * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    small = TURN_RADIUS_M * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    large, small = large - large.mean(axis=0), small - small.mean(axis=0)
    spin = math.atan2(
        float(np.sum(large[:, 0] * small[:, 1] - large[:, 1] * small[:, 0])), float(np.sum(large * small))
    )
    cos, sin = math.cos(spin), math.sin(spin)
    return float(np.hypot(*(large @ np.array([[cos, sin], [-sin, cos]]) - small).T).mean())


def test_long_drives_are_cut_into_pieces() -> None:
    """Ten kilometres are judged in pieces of two, with an antenna ahead of the axle as well."""
    found = odometry_stretches(perfect(np.tile(BENDS, 7), forward_m=1.5), car())

    assert 5 == len(found)
    assert max(float(piece.distances_m.max()) for piece in found) < 0.01


def test_the_reference_pose_of_a_perfect_drive() -> None:
    """Without noise the smoothed reference lies on the path, and the side-slip has the slope that was put
    in."""
    recording = perfect(BENDS, slip_per_accel=0.005)
    found = reference_pose(recording, car())
    middle = slice(50, -50)

    assert np.abs(found.east_m[1:] - recording.east_m)[middle].max() < 0.15
    assert np.abs(found.north_m[1:] - recording.north_m)[middle].max() < 0.15
    assert np.abs(found.heading_rad[1:] - recording.inertial["compass_rad"])[middle].max() < 0.01
    assert np.polyfit(recording.inertial["accel_lat_mps2"], found.side_slip_rad[1:], 1)[0] == pytest.approx(
        -0.005, abs=5e-4
    )


def test_the_paper_method_finds_what_a_perfect_drive_holds() -> None:
    """From 1.5 % away and with a step of 1, both circumferences come within 0.05 %."""
    found = fit_paper([perfect(BENDS)], car(0.3208, 0.3208), PaperSettings(alpha=1.0))

    assert [RADIUS_M, RADIUS_M] == pytest.approx(found.vehicle.radius_m[2:], rel=5e-4)
    assert found.pose_errors_m[0] > 10 * min(found.pose_errors_m)
    assert found.iterations == len(found.history) == len(found.pose_errors_m) - 1


def test_covariances_shrink_and_stay_positive() -> None:
    """(10a) divides by qM to the power i, (10b) takes off qP * i of 10, and the heading's share goes
    alike."""
    P, M = covariances(4, PaperSettings(q_m=1.5, q_p=0.7))
    last, _ = covariances(50, PaperSettings(q_p=0.7))

    assert [7.2, 7.2, 0.072] == pytest.approx(P)
    assert [10 / 1.5**4, 10 / 1.5**4, 0.1 / 1.5**4] == pytest.approx(M)
    assert (last > 0).all()


VEHICLE_TABLES = [
    "[vehicle]\nwheel_radius_m = 0.316  # a guess\ntrack_rear_m = 1.5\nwheelbase_m = 2.6\n",
    "[vehicle]\nwheelbase_m = 2.6\nwheel_radius_m = { fl = 0.3, fr = 0.3, rl = 0.3, rr = 0.3 }\n",
    "[vehicle]\nwheelbase_m = 2.6\nwheel_radius_m.fl = 0.3\nwheel_radius_m.rr = 0.3\n",
    "[ vehicle ] # car\nwheelbase_m = 2.6\n[vehicle.wheel_radius_m]\nfl = 0.3\n",
]


@pytest.mark.parametrize("vehicle", VEHICLE_TABLES)
@pytest.mark.parametrize("before", ["", '[calibration]\nmade = "2020-01-01"\n'])
def test_the_file_keeps_what_it_does_not_replace(vehicle: str, before: str) -> None:
    """Radii in any form TOML allows are replaced, an older calibration goes, comments and other keys stay."""
    text = f"# my van\n{before}{vehicle}\n[can]\ndbc = 'x.dbc'  # theirs\nchannel = \"can1\"\n"
    wheels = {"rl": WheelResult(0.3123456, 1e-4), "rr": WheelResult(0.3133333, 2e-4)}
    found = FittedGeometry(
        "joint",
        ("a", 'b "x"'),
        wheels,
        1e-5,
        1.5432,
        0.01,
        math.nan,
        math.nan,
        21.5,
        6,
        "still",
        9.0,
        1.0,
        {},
        [],
    )
    radii = {"fl": 0.3, "fr": 0.3, "rl": 0.3123456, "rr": 0.3133333}
    written = calibrated_toml(text, found, radii, {"rl": 0.31}, str(Path("drives") / "bus.dbc"), "2024-07-01")
    data = tomllib.loads(written)

    assert {"fl": 0.3, "fr": 0.3, "rl": 0.312346, "rr": 0.313333} == data["vehicle"]["wheel_radius_m"]
    assert (1.5432, 2.6) == (data["vehicle"]["track_rear_m"], data["vehicle"]["wheelbase_m"])
    assert {"dbc": "drives/bus.dbc", "channel": "can1"} == data["can"]
    assert {
        "made": "2024-07-01",
        "method": "joint",
        "drives": 'a, b "x"',
        "reference_speed_mps": 21.5,
        "radius_std_rl_m": 1e-4,
        "radius_std_rr_m": 2e-4,
        "track_rear_std_m": 0.01,
        "bus_radius_rl_m": 0.31,
    } == data["calibration"]
    assert written.startswith("# my van\n")
