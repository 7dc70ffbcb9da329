"""A tyre that changes, or several alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.car.physics.motions import car, steady
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import EFFECTS, make_effect
from tpmsd.offline.diagnosis.diagnose import diagnose


@pytest.mark.parametrize(("wheel", "acts"), [("rl", [0, 0, 1, 0]), ("rr rl", [0, 0, 1, 1])])
def test_the_wheels_that_are_named_change(wheel: str, acts: list[int]) -> None:
    """By the whole deviation once the ramp is over; the others stay."""
    effect = make_effect("radius_change", wheel=wheel, deviation_m=-1e-3, onset_s=1.0, duration_s=2.0)

    assert (
        pytest.approx([-1e-3 * one for one in acts])
        == effect.radius_change_m(steady(20.0), car())[-1].tolist()
    )


@pytest.mark.parametrize("wheel", ["", "xx", "rl xx", 3])
def test_no_other_word_is_a_wheel(wheel: object) -> None:
    """None, or one that no car has."""
    with pytest.raises(ValueError, match="wheel"):
        make_effect("radius_change", wheel=wheel, deviation_m=-1e-3)


def test_several_wheels_are_named_in_the_order_of_the_car() -> None:
    """However they were written."""
    effect = make_effect("radius_change", wheel="rr  rl rr", deviation_m=-1e-3)

    assert "rl rr" == effect.wheels  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("at_s", "share"), [(0.5, 0.0), (3.0, 1.0 - np.exp(-1.0)), (9.0, 1.0 - np.exp(-4.0))]
)
def test_air_leaves_a_hole_in_proportion_to_what_is_left(at_s: float, share: float) -> None:
    """After a time constant 63 % of the change is there, after four 98 %."""
    effect = make_effect(
        "radius_change", wheel="fr", deviation_m=-1e-3, onset_s=1.0, duration_s=2.0, course="exponential"
    )
    motion = steady(20.0)
    change = np.interp(at_s, motion.time_s, effect.radius_change_m(motion, car())[:, 1])

    assert change == pytest.approx(-1e-3 * share)


def test_a_course_is_one_of_those_that_are_known() -> None:
    """Any other word is refused, and the plainest comes first."""
    assert ("ramp", "exponential") == EFFECTS["radius_change"].nonlinear.courses
    with pytest.raises(ValueError, match="course = 'sudden' is not one of ramp exponential"):
        make_effect("radius_change", wheel="fr", deviation_m=-1e-3, course="sudden")


@pytest.mark.parametrize(("tau_s", "course"), [(40.0, "exponential"), (0.0, None)])
def test_the_course_of_a_leak_is_its_own_and_nothing_unknown(tau_s: float, course: str | None) -> None:
    """3 mm that go with a time constant of 40 s are one change by that course, and no shape is left over
    time; what goes evenly for 80 s is a ramp."""
    recording = recording_of(drive(Spec(duration_s=400.0, road="rural"), 6))
    since = np.maximum(recording.edges_s[:-1] - 150.0, 0.0)
    share = -np.expm1(-since / tau_s) if tau_s else np.minimum(since / 80.0, 1.0)
    change = -3e-3 * share[:, None] * np.array([0.0, 0.0, 1.0, 0.0])
    turns = recording.rotation_rad / (1.0 + change / recording.car.radius_m)
    (finding,) = diagnose([replace(recording, rotation_rad=turns)]).findings
    found = finding.parameters

    assert "radius_change" == finding.effect
    assert course == (found["course"].value if "course" in found else None)
    for name, true in (("deviation_m", -3e-3), ("onset_s", 150.0), ("duration_s", tau_s or 80.0)):
        assert found[name].value == pytest.approx(true, abs=4.0 * float(found[name].std or 0.0))
