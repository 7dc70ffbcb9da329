"""Cars whose radii are known: the calibration gives them back, and says how well."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from bench.campaigns.offline.diagnosis.draw import draw_case
from bench.worlds.instruments import observe
from bench.worlds.kinematic import Drive, course
from tests.offline.calibration.drives import configured, recorded, recording_of
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.calibration.calibrate import calibrate
from tpmsd.offline.calibration.joint import JointFit, fit
from tpmsd.offline.calibration.nominal import vehicle_of
from tpmsd.offline.calibration.result import FittedGeometry
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec
from tpmsd.offline.simulator.receiver import ReceiverSpec

NORTH_EAST, SOUTH_EAST, SOUTH_WEST, NORTH_WEST = (50.1, 8.7), (-33.9, 151.2), (-22.9, -43.2), (64.1, -21.9)
TRUE_OFFSETS_M = (1.8e-3, -2.4e-3, -1.1e-3, 2.9e-3)


def off(found: FittedGeometry, truth: dict[str, float]) -> dict[str, float]:
    """Errors of the radii in their own standard deviations, where they are beyond 3.3."""
    sigmas = {w: (r.radius_m - truth[w]) / r.radius_std_m for w, r in found.wheels.items()}
    return {wheel: z for wheel, z in sigmas.items() if abs(z) > 3.3}


@pytest.mark.parametrize(
    ("seed", "kind", "wheels", "place", "rate_hz"),
    [
        (1, "counts16", 4, NORTH_EAST, 5.0),
        (2, "speeds", 4, SOUTH_EAST, 10.0),
        (3, "counts16", 2, SOUTH_WEST, 1.0),
        (4, "speeds", 2, NORTH_WEST, 5.0),
    ],
)
def test_known_radii_come_back(
    tmp_path: Path, seed: int, kind: str, wheels: int, place: tuple[float, float], rate_hz: float
) -> None:
    """On each axle, for counts and speeds, in both hemispheres: radii, their difference and the track."""
    receiver = ReceiverSpec(rate_hz=rate_hz, latitude_deg=place[0], longitude_deg=place[1])
    bus = BusSpec(kind=kind, wheels=wheels)
    spec = DriveSpec(duration_s=130.0, radius_offset_m=TRUE_OFFSETS_M, seed=seed, bus=bus, receiver=receiver)
    recording, config = recorded(tmp_path / "d", spec)
    found, _ = calibrate([recording], config.vehicle)
    truth = {wheel: 0.316 + offset for wheel, offset in zip(WHEELS, TRUE_OFFSETS_M, strict=True)}
    difference = found.wheels["rr"].radius_m - found.wheels["rl"].radius_m - (truth["rr"] - truth["rl"])

    assert (WHEELS if wheels == 4 else WHEELS[2:]) == tuple(found.wheels)
    assert {} == off(found, truth)
    assert max(result.radius_std_m for result in found.wheels.values()) < 0.3e-3
    assert abs(difference) < 3.3 * found.difference_std_m < 0.3e-3
    assert abs(found.track_rear_m - 1.52) < 3.3 * found.track_rear_std_m
    assert found.pose_error_after_m < 0.2 * found.pose_error_before_m


@pytest.fixture(scope="module")
def country_fit(country: Drive) -> JointFit:
    return fit([recording_of(country, wheels=2)], vehicle_of(configured(country.spec)))


@pytest.mark.parametrize(("scales", "mirrored"), [((1.012, 0.985), False), ((0.98, 1.02), True)])
def test_other_circumferences_give_other_rotations(
    country: Drive, country_fit: JointFit, scales: tuple[float, float], mirrored: bool
) -> None:
    """Wheels that turn less by a factor come out larger by just that; a world in the mirror changes sides."""
    recording = recording_of(country, wheels=2)
    turned = recording.rotation_rad / np.array([1.0, 1.0, *scales])
    expected = country_fit.vehicle.radius_m[2:] * scales
    if mirrored:
        turned, expected = turned[:, [1, 0, 3, 2]], expected[::-1]
        recording = dataclasses.replace(
            recording,
            inertial={name: -values for name, values in recording.inertial.items()},
            north_m=-recording.north_m,
            course_rad=-recording.course_rad,
        )
    other = dataclasses.replace(recording, rotation_rad=turned)
    found = fit([other], vehicle_of(configured(country.spec)))

    assert expected == pytest.approx(
        found.vehicle.radius_m[2:], abs=0.3 * 0.31 * country_fit.std("radius_rl")
    )
    assert country_fit.vehicle.geometry.track_rear_m == pytest.approx(
        found.vehicle.geometry.track_rear_m, abs=1.5 * country_fit.std("track_rear")
    )


def test_two_drives_are_better_than_one(country: Drive, country_fit: JointFit) -> None:
    """All drives are solved together: the halves of a drive do about as well as the whole."""
    whole = recording_of(country, wheels=2)
    half = len(whole.rotation_rad) // 2
    early = whole.fix_time_s < half * whole.dt_s
    fixes = ("east_m", "north_m", "up_m", "speed_mps", "course_rad")
    parts = [
        dataclasses.replace(
            whole,
            fix_time_s=whole.fix_time_s[chosen] - begin * whole.dt_s,
            **{name: getattr(whole, name)[chosen] for name in fixes},
            rotation_rad=whole.rotation_rad[begin : begin + half],
            inertial={name: values[begin : begin + half] for name, values in whole.inertial.items()},
        )
        for begin, chosen in ((0, early), (half, ~early))
    ]
    car = vehicle_of(configured(country.spec))
    alone, both = fit(parts[:1], car), fit(parts, car)
    apart = both.vehicle.radius_m[2] - country_fit.vehicle.radius_m[2]

    assert both.std("radius_rl") < 0.9 * alone.std("radius_rl")
    assert country_fit.std("radius_rl") == pytest.approx(both.std("radius_rl"), rel=0.25)
    assert abs(apart) < 2.0 * 0.31 * both.std("radius_rl")


def test_what_confounds_radii_is_estimated_along(country: Drive) -> None:
    """Load transfer, a wrong track and an old receiver neither bias the radii nor pass unseen."""
    found, _ = calibrate([recording_of(country)], configured(country.spec))
    physics = country.spec.physics
    growth_m = physics["centrifugal_growth"]["coefficient"] * found.reference_speed_mps**2
    track = physics["track_width_error"]
    load, age = found.effects["load_lateral"], found.effects["latency@0"]

    assert {} == off(found, dict(zip(WHEELS, country.radius_m + growth_m, strict=True)))
    assert (
        abs(found.track_rear_m - country.spec.track_rear_m - track["rear_m"]) < 3.3 * found.track_rear_std_m
    )
    assert (
        abs(found.track_front_m - country.spec.track_front_m - track["front_m"])
        < 3.3 * found.track_front_std_m
    )
    assert max(found.track_rear_std_m, found.track_front_std_m) < 0.06
    assert abs(load.value - physics["load_transfer_lateral"]["coefficient"]) < 3.3 * load.std < 5e-5
    assert abs(age.value - 0.15) < 3.3 * age.std + 0.01


def test_a_late_receiver_is_linearised_about_its_latency() -> None:
    """Courses of a receiver 0.16 s late bend within that time; what a linear column leaves is no drift of its
    age, which took the place of the latency."""
    case = draw_case("longitudinal_slip+gnss_latency", 2.0, 9)
    spec = dataclasses.replace(case.spec, duration_s=480.0)
    rng = np.random.default_rng(case.world_seed)
    made = observe(course(spec, rng), spec, rng, case.world_seed)
    age = calibrate([recording_of(made)], configured(spec))[0].effects["latency@0"]

    truth = case.spec.physics["gnss_latency"]["latency_s"]
    assert pytest.approx(truth, abs=2.0 * age.std) == age.value
    assert age.std < 0.03
