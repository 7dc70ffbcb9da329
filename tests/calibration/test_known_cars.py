"""Cars whose radii are known: the calibration gives them back, and says how well."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.calibration.drives import recorded
from tpmsd.calibration.calibrate import calibrate
from tpmsd.calibration.checks import RefusedError
from tpmsd.physics.catalogue import make_effect
from tpmsd.physics.model import ExtendedModel
from tpmsd.simulator.bus import BusSpec
from tpmsd.simulator.drive import DriveSpec
from tpmsd.simulator.faults import Fault
from tpmsd.simulator.receiver import ReceiverSpec
from tpmsd.wheels import WHEELS

NORTH, SOUTH = (50.11, 8.68), (-33.9, 151.2)
TRUE_OFFSETS_M = (1.8e-3, -2.4e-3, -1.1e-3, 2.9e-3)


def spec(
    seed: int, kind: str, wheels: int, place: tuple[float, float], rate_hz: float, **more: object
) -> DriveSpec:
    receiver = ReceiverSpec(rate_hz=rate_hz, latitude_deg=place[0], longitude_deg=place[1])
    options: dict[str, object] = {"route": "mixed", "duration_s": 200.0, "radius_offset_m": TRUE_OFFSETS_M}
    return DriveSpec(
        **{**options, **more}, seed=seed, bus=BusSpec(kind=kind, wheels=wheels), receiver=receiver
    )  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("seed", "kind", "wheels", "place", "rate_hz"),
    [
        (1, "counts16", 4, NORTH, 5.0),
        (2, "speeds", 4, SOUTH, 10.0),
        (3, "counts16", 2, SOUTH, 1.0),
        (4, "speeds", 2, NORTH, 5.0),
    ],
)
def test_known_radii_come_back(
    tmp_path: Path, seed: int, kind: str, wheels: int, place: tuple[float, float], rate_hz: float
) -> None:
    """Radii, their differences and the track are within 3.3 of their own standard deviations of the truth."""
    recording, config = recorded(tmp_path / "d", spec(seed, kind, wheels, place, rate_hz))
    found, _ = calibrate([recording], config.vehicle)
    truth = {wheel: 0.316 + offset for wheel, offset in zip(WHEELS, TRUE_OFFSETS_M, strict=True)}
    off = {w: (r.radius_m - truth[w]) / r.radius_std_m for w, r in found.wheels.items()}
    difference = found.wheels["rr"].radius_m - found.wheels["rl"].radius_m - (truth["rr"] - truth["rl"])

    assert (WHEELS if wheels == 4 else WHEELS[2:]) == tuple(found.wheels)
    assert {} == {wheel: z for wheel, z in off.items() if abs(z) > 3.3}
    assert max(result.radius_std_m for result in found.wheels.values()) < 0.25e-3
    assert abs(difference) < 3.3 * found.difference_std_m < 0.3e-3
    assert abs(found.track_rear_m - 1.52) < 3.3 * found.track_rear_std_m
    assert found.pose_error_after_m < 0.2 * found.pose_error_before_m


def test_two_drives_are_better_than_one(tmp_path: Path) -> None:
    """All drives are solved together: the standard deviation falls, the radii stay true."""
    drives = [
        recorded(tmp_path / str(seed), spec(seed, "counts16", 2, NORTH, 5.0, duration_s=150.0))
        for seed in (5, 6)
    ]
    config = drives[0][1].vehicle
    alone, _ = calibrate([drives[0][0]], config)
    both, _ = calibrate([recording for recording, _ in drives], config)

    assert both.wheels["rl"].radius_std_m < 0.9 * alone.wheels["rl"].radius_std_m
    assert abs(both.wheels["rl"].radius_m - 0.3149) < 3.3 * both.wheels["rl"].radius_std_m


def test_what_confounds_radii_is_estimated_along(tmp_path: Path) -> None:
    """Load transfer, a wrong track and an old receiver neither bias the radii nor pass unseen."""
    model = ExtendedModel(
        (
            make_effect("load_transfer_lateral", coefficient=1.5e-4),
            make_effect("track_width_error", rear_m=0.05, front_m=-0.04),
            make_effect("gnss_latency", latency_s=0.15),
        )
    )
    recording, config = recorded(tmp_path / "d", spec(7, "counts16", 4, NORTH, 5.0, model=model))
    found, _ = calibrate([recording], config.vehicle)
    off = np.array(
        [
            (found.wheels[w].radius_m - 0.316 - d) / found.wheels[w].radius_std_m
            for w, d in zip(WHEELS, TRUE_OFFSETS_M, strict=True)
        ]
    )
    age = found.effects["latency@0"]

    assert [True] * 4 == (np.abs(off) < 3.3).tolist()
    assert abs(found.track_rear_m - 1.57) < 3.3 * found.track_rear_std_m < 0.1
    assert abs(found.track_front_m - 1.49) < 3.3 * found.track_front_std_m < 0.1
    assert abs(age.value - 0.15) < 3.3 * age.std + 0.01


@pytest.mark.parametrize(
    ("seed", "wheels", "fault"),
    [
        (1, 4, Fault("leak", 0.5, "percent", "rl", 40.0, 100.0)),
        (2, 2, Fault("puncture", 1.5, "percent", "rr", 80.0, 20.0)),
    ],
)
def test_a_leaking_tyre_is_refused(tmp_path: Path, seed: int, wheels: int, fault: Fault) -> None:
    """A drive on which one tyre loses pressure is refused, and the wheel is named."""
    recording, config = recorded(tmp_path / "d", spec(seed, "counts16", wheels, NORTH, 5.0, faults=(fault,)))

    with pytest.raises(RefusedError, match=f"wheel {fault.wheel} changes by -.*loses pressure") as refusal:
        calibrate([recording], config.vehicle)
    assert 0 == refusal.value.drive
