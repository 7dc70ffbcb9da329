"""Drive that is shared unevenly by the axles."""

from __future__ import annotations

import pytest

from bench.worlds.kinematic import Spec, drive
from tests.diagnosis.recorded import recording_of
from tests.physics.motions import accelerating, car
from tpmsd.diagnosis.diagnose import diagnose
from tpmsd.physics.catalogue import EFFECTS, make_effect


def test_forty_to_sixty_of_the_force_is_a_difference_of_slips() -> None:
    """At 1.5 m/s2 axles with 0.40 and 0.60 of the force and 0.55 and 0.45 of the load slip by 4e-3 s2/m times
    the ratio of the two; their difference is that of the wheels."""
    front, rear = (4e-3 * force / load for force, load in ((0.40, 0.55), (0.60, 0.45)))
    slip = make_effect("drive_split", difference=front - rear).wheel_slip(accelerating(1.5), car("all"))[0]

    assert slip[0] - slip[2] == pytest.approx(1.5 * (front - rear))
    assert [0.0, 0.0] == [slip[0] - slip[1], slip[2] + slip[0]]


def test_only_a_car_that_drives_all_wheels_splits_its_drive() -> None:
    """On others it is no hypothesis, and load transfer is not limited there."""
    motion, effect, load = accelerating(1.0), EFFECTS["drive_split"], EFFECTS["load_transfer_longitudinal"]

    assert [False, False, True] == [
        effect.observable(motion, car(driven)) for driven in ("front", "rear", "all")
    ]
    assert [2e-3, 2e-3, 3e-4] == [
        load.limits(car(driven))["coefficient"][1] for driven in ("front", "rear", "all")
    ]


def test_what_no_load_transfer_can_be_is_the_split_of_the_drive() -> None:
    """Eight times a usual load transfer, 5e-4 s2, on a car that drives all wheels are 3.2e-3 s2/m."""
    spec = Spec(
        duration_s=240.0,
        driven="all",
        physics={"load_transfer_longitudinal": {"coefficient": 5e-4}},
    )
    (finding,) = diagnose([recording_of(drive(spec, 12))]).findings
    value = finding.parameters["difference"]

    assert ("drive_split", ()) == (finding.effect, finding.indistinguishable_from)
    assert finding.confidence > 0.95
    assert value.std is not None
    assert value.value == pytest.approx(-2.0 * 5e-4 / spec.radius_m, abs=4.0 * value.std)
