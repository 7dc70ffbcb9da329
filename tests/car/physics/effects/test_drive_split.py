"""Drive that is shared unevenly by the axles."""

from __future__ import annotations

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.car.physics.motions import accelerating, car
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.offline.diagnosis.diagnose import diagnose


def test_forty_to_sixty_of_the_force_is_a_difference_of_slips() -> None:
    """At 1.5 m/s2 axles with 0.40 and 0.60 of the force and 0.55 and 0.45 of the load slip by 4e-3 s2/m times
    the ratio of the two; their difference is that of the wheels."""
    front, rear = (4e-3 * force / load for force, load in ((0.40, 0.55), (0.60, 0.45)))
    slip = make_effect("drive_split", difference=front - rear).wheel_slip(accelerating(1.5), car("all"))[0]

    assert slip[0] - slip[2] == pytest.approx(1.5 * (front - rear))
    assert [0.0, 0.0] == [slip[0] - slip[1], slip[2] + slip[0]]


def test_only_a_car_that_drives_all_wheels_splits_its_drive() -> None:
    """On others it is no hypothesis."""
    motion, effect = accelerating(1.0), EFFECTS["drive_split"]

    assert [False, False, True] == [
        effect.observable(motion, car(driven)) for driven in ("front", "rear", "all")
    ]


def test_an_unusually_large_load_transfer_is_listed_beside_the_split_of_the_drive() -> None:
    """Both read the same on a car that drives all wheels: 7.3e-4 s2, twelve times the usual load transfer,
    are 4.6e-3 s2/m. The size decides for the name, and the data for the list."""
    coefficient = 7.3e-4
    spec = Spec(
        duration_s=240.0, driven="all", physics={"load_transfer_longitudinal": {"coefficient": coefficient}}
    )
    (finding,) = diagnose([recording_of(drive(spec, 12))]).findings
    value = finding.parameters["difference"]

    assert finding.effect == "drive_split"
    assert finding.indistinguishable_from == ("load_transfer_longitudinal",)
    assert finding.confidence < 0.9
    assert value.std is not None
    assert value.value == pytest.approx(-2.0 * coefficient / spec.radius_m, abs=4.0 * value.std)


def test_a_size_that_no_drive_has_is_less_likely() -> None:
    """Student's distribution of four degrees about 2e-3 s2/m; four nats more where load transfer is usual."""
    effect = EFFECTS["drive_split"]

    assert effect.penalty(8e-3) == pytest.approx(2.5 * np.log1p(4.0**2 / 4.0))
    assert effect.penalty(-1e-3) - effect.penalty(1e-3) == pytest.approx(4.0)
    assert effect.penalty(-2e-3) == effect.penalty(2e-3)


@pytest.mark.parametrize(("coefficient", "before"), [(6e-5, True), (1.5e-4, True), (2.9e-4, False)])
def test_a_load_transfer_beyond_what_cars_have_is_no_simpler_name(coefficient: float, before: bool) -> None:
    """Of 2.9e-4 s2, 4.6 standard deviations from the usual, the split of a drive is as good a name: Student's
    distribution of four degrees has 2.5 log(1 + 4.6^2 / 4) nats against it."""
    load = EFFECTS["load_transfer_longitudinal"]
    beyond = max(coefficient - 6e-5, 0.0) / 5e-5

    assert before is load.goes_before(coefficient)
    assert load.penalty(coefficient) == pytest.approx(2.5 * np.log1p(beyond**2 / 4.0))
    assert load.penalty(-1e-5) > load.penalty(1e-5)


def test_a_small_split_and_a_large_load_transfer_share_the_confidence() -> None:
    """2.9e-4 s2 of load transfer read like -1.8e-3 s2/m: neither name is sure, and each names the other."""
    spec = Spec(
        duration_s=240.0, driven="all", physics={"load_transfer_longitudinal": {"coefficient": 2.9e-4}}
    )
    (finding,) = diagnose([recording_of(drive(spec, 12))]).findings
    names = {finding.effect, *finding.indistinguishable_from}

    assert {"drive_split", "load_transfer_longitudinal"} == names
    assert finding.confidence < 0.9
