"""Parts of the diagnosis that are plain functions: terms as effects, miscounted rings, advice, names."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from tests.offline.calibration.test_parts import CIRCLE, perfect
from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.car.physics.motion import driven_mask
from tpmsd.offline.diagnosis.assessment.identifiability import prior_scale, separating_manoeuvre
from tpmsd.offline.diagnosis.hypotheses.joint_terms import is_copied, is_own
from tpmsd.offline.diagnosis.hypotheses.plausible import (
    bounds_of,
    completion_matrix,
    completions_of,
    is_plausible,
    nats_against_ratio,
)
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.robustness.verdict import is_outweighed
from tpmsd.offline.diagnosis.selection.catalogue_effect import (
    effect_of,
    neutral_of,
    nonlinear_parameters_of,
    text_parameters_of,
    tolerance_note,
)
from tpmsd.offline.diagnosis.selection.chosen import Chosen, Selection
from tpmsd.offline.inference.least_squares import LeastSquaresFit
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.rings.miscount import (
    wheels_with_wrong_teeth,
    with_all_rings_corrected,
    with_single_ring_corrected,
)


def term(effect: str, *parameters: str, **more: object) -> Term:
    """A term without columns."""
    return Term(effect, np.zeros((1, len(parameters))), parameters, 0.0, **more)  # type: ignore[arg-type]


def counted(teeth: float, *shown: float) -> Recording:
    """A minute of a circle on rings of 48 teeth as configured, of which the wheels really have `shown`."""
    drive = perfect(CIRCLE)
    rotation = drive.rotation_rad[:, :1] * np.array(shown) / teeth
    return replace(drive, rotation_rad=rotation, quantum_rad=np.full(4, 0.13), counts_per_rev=(None,) * 4)


@pytest.mark.parametrize("scale", [1.0, 1.002])
def test_a_ring_of_another_number_of_teeth_is_identified_by_its_radius(scale: float) -> None:
    """47 teeth for 48: the radius looks 48/47 as large, and a common factor of all radii changes nothing."""
    drive = counted(48.0, 48.0, 48.0, 48.0, 48.0)
    radii = drive.car.radius_m * scale * np.array([1.0, 48.0 / 47.0, 1.0, 1.0])

    assert [("fr", 47.0)] == wheels_with_wrong_teeth(drive, radii)


def test_a_radius_a_little_off_is_no_other_ring() -> None:
    """Half a per cent is wear."""
    drive = counted(48.0, 48.0, 48.0, 48.0, 48.0)

    assert [] == wheels_with_wrong_teeth(drive, drive.car.radius_m * np.array([1.0, 1.005, 1.0, 1.0]))


def test_the_angles_of_one_miscounted_wheel_are_put_right() -> None:
    """44 teeth read as 48: the wheel shows 44/48 of its turns; afterwards it turns like the others."""
    put_right = with_single_ring_corrected(counted(48.0, 48.0, 48.0, 44.0, 48.0))

    assert (None, None, 44.0, None) == put_right.counts_per_rev
    assert np.allclose(put_right.rotation_rad[:, 2], put_right.rotation_rad[:, 3], rtol=1e-12)


def test_all_rings_are_put_right_together_only_where_no_tyre_explains_it() -> None:
    """43 teeth for 48 make all radii look 12 % too large; 2 % are another tyre."""
    drive = counted(48.0, 43.0, 43.0, 43.0, 43.0)

    assert (43.0,) * 4 == with_all_rings_corrected(drive, drive.car.radius_m * 48.0 / 43.0).counts_per_rev
    assert drive is with_all_rings_corrected(drive, drive.car.radius_m * 1.02)


def test_a_term_becomes_the_effect_with_its_values_within_bounds() -> None:
    """Differences from neutral become values; what lies beyond the bounds stays at them."""
    scale = EFFECTS["yaw_rate_scale"]
    number = scale.parameters[0]

    made = effect_of(term("yaw_rate_scale", number.name), np.array([0.01]))
    far = effect_of(term("yaw_rate_scale", number.name), np.array([1e6]))

    assert made is not None and far is not None
    assert 1.0 == neutral_of("yaw_rate_scale", number.name)
    assert {number.name: pytest.approx(1.01)} == made[0].values()
    assert far[1][0] < 1e6
    assert number.check(far[1][0] + 1.0) == far[0].values()[number.name]


def test_a_term_says_where_and_when_it_acts() -> None:
    """Groups of wheels are written out; a ramp shorter than a window is a step in its middle."""
    lock = term("wheel_lock", "slip", pattern="rear", span_s=(10.0, 14.0))
    step = term("radius_change", "deviation_m", wheel="rl", span_s=(100.0, 102.0))

    assert {"wheels": "rl rr"} == text_parameters_of(lock)
    assert {"onset_s": 10.0, "duration_s": 4.0} == nonlinear_parameters_of(lock)
    assert {"wheel": "rl"} == text_parameters_of(step)
    assert {"onset_s": 101.0, "duration_s": 0.0} == nonlinear_parameters_of(step)


def test_what_instruments_usually_do_is_said_and_no_finding() -> None:
    """A velocity lag of 50 ms is its own, half a second is not; a gyro's zero of 3e-4 rad/s is."""

    def chosen(effect: str, parameter: str, value: float) -> Chosen:
        one = term(effect, parameter)
        return Chosen(one, 50.0, 40.0, 30.0, 1.0, (), np.array([value]), np.array([0.1 * value]))

    assert "0.050 +- 0.005 s" in tolerance_note(chosen("velocity_lag", "lag_s", 0.05), speeds=False)
    assert "" == tolerance_note(chosen("velocity_lag", "lag_s", 0.5), speeds=False)
    assert "3.0e-04 +- 3.0e-05 rad/s" in tolerance_note(chosen("yaw_rate_bias", "bias", 3e-4), speeds=False)
    assert "" == tolerance_note(chosen("yaw_rate_bias", "bias", 1e-3), speeds=False)


@pytest.mark.parametrize(
    ("effect", "pattern", "gain", "doubtful"),
    [
        ("message_delay", "front", 400.0, True),
        ("message_delay", "front", 600.0, False),
        ("message_delay", "rear", 400.0, False),
        ("longitudinal_slip", "front", 400.0, False),
    ],
)
def test_an_instruments_effect_must_gain_more_than_a_spline_on_its_wheels(
    effect: str, pattern: str, gain: float, doubtful: bool
) -> None:
    """What its form leaves looks like a delay of messages; the car's own physics keeps its name."""
    one = term(effect, "front_s", pattern=pattern)
    shape = term("unknown", "at_1", pattern="front", covariate="grade")

    def chosen(of: Term, brings: float) -> Chosen:
        return Chosen(of, brings, brings, brings, 1.0, (), np.ones(1), np.ones(1))

    both = chosen(one, gain), chosen(shape, 500.0)
    selection = Selection(both, cast(LeastSquaresFit, None), np.zeros(1), np.zeros(1))

    assert doubtful is is_outweighed(both[0], selection)


def test_the_usual_size_of_an_effect_is_that_of_its_prior() -> None:
    """The larger of mean and standard deviation; one where there is no number."""
    growth = EFFECTS["centrifugal_growth"]

    assert 1e-6 == prior_scale(growth, "coefficient")
    assert 0.03 == pytest.approx(prior_scale(EFFECTS["yaw_rate_scale"], "scale"))
    assert 1.0 == prior_scale(EFFECTS["road_grade"], "")


def test_time_belongs_to_each_drive_unless_all_are_of_one_road() -> None:
    """Slopes of a drive's time are its own; an effect of speed stands for all drives and for each."""
    over_time, over_speed = ("smooth", "rl", "time", "3"), ("smooth", "rl", "speed", "3")

    assert [True, False] == [is_own(over_time, same_road) for same_road in (False, True)]
    assert not is_own(over_speed, same_road=False)
    assert [False, True] == [is_copied(over_speed, same_road) for same_road in (False, True)]
    assert is_copied(("centrifugal_growth", "coefficient"), same_road=False)


def test_advice_names_the_drives_of_both_effects_once() -> None:
    """Effects that the same drive tells share its sentence; without an alternative there is nothing to
    say."""
    rounding, scale = "speed_rounding_offset", "speed_scale_nonlinearity"

    assert "" == separating_manoeuvre("centrifugal_growth", ())
    assert 1 == separating_manoeuvre(rounding, (scale,)).count(EFFECTS[rounding].wording.distinguished_by)
    assert separating_manoeuvre("road_grade", ("wear",)).startswith("to tell road_grade from wear: ")


@pytest.mark.parametrize(("driven", "limited"), [("rear", [0.005, 0.003]), ("front", [0.011, -0.003])])
def test_limits_of_brake_slip_hold_for_drive_and_brakes_together(driven: str, limited: list[float]) -> None:
    """On the driven axle the slip of the drive adds to that of the brakes; on the other it does not."""
    car = replace(perfect(CIRCLE).car, driven=driven_mask(driven))
    terms = [term("brake_slip", "front", "rear"), term("longitudinal_slip", "slip_per_accel")]

    into = completion_matrix(terms, completions_of(car))

    assert pytest.approx([*limited, 0.006]) == into @ [0.005, -0.003, 0.006]


@pytest.mark.parametrize(
    ("values", "nats"),
    [
        ([4e-3, 0.0], 0.0),
        ([0.0, 4e-3], 0.0),
        ([-4e-3, -1e-3], 0.0),  # of what a simulation has, and the recording has not
        ([4e-3, -2e-4], 2.0),
        ([-5e-4, 4e-3], 12.5),
    ],
)
def test_either_axle_bears_any_share_of_the_brakes(values: list[float], nats: float) -> None:
    """None as well: two values of opposite signs lose what their nearer one does on its way to zero."""
    brakes = term("brake_slip", "front", "rear")

    assert pytest.approx(nats) == nats_against_ratio(brakes, np.array(values), 1e-8 * np.eye(2))


def test_no_axle_turns_faster_under_the_brakes() -> None:
    """An axle without brakes is within a thousandth of none; what turns faster by 4e-3 s2/m is not braked."""
    brakes, bounds = term("brake_slip", "front", "rear"), bounds_of(perfect(CIRCLE).car)

    assert is_plausible(brakes, np.array([-6e-4, 4e-3]), bounds)
    assert not is_plausible(brakes, np.array([-4.4e-3, 8e-4]), bounds)
    assert not is_plausible(brakes, np.array([4e-3, -2e-3]), bounds)


def test_a_load_of_the_impossible_sign_has_a_limit() -> None:
    """4e-4 s2 of it may be a simulation's alone; -1.4e-3 s2 is the slip of one axle against the other."""
    load, bounds = term("load_transfer_longitudinal", "coefficient"), bounds_of(perfect(CIRCLE).car)

    assert is_plausible(load, np.array([-4e-4]), bounds)
    assert not is_plausible(load, np.array([-1.4e-3]), bounds)


def test_a_ratio_between_limits_loses_what_lies_beyond_the_nearer_one() -> None:
    """Of the load that bends shift, an axle's share is within 0.7 of the mean of both."""
    loads = term("load_transfer_lateral", "coefficient", "front_more")

    assert nats_against_ratio(loads, np.array([1.0, 0.7]), np.eye(2)) == pytest.approx(0.0)
    assert nats_against_ratio(loads, np.array([1.0, 1.0]), np.eye(2)) == pytest.approx(0.5 * 0.09 / 1.49)
    assert nats_against_ratio(loads, np.array([1.0, -1.0]), np.eye(2)) == pytest.approx(0.5 * 0.09 / 1.49)
