"""What a drive could not have shown: concealed at the stated size it is found, at a quarter of it not."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.offline.diagnosis.assessment.identifiability import prior_scale
from tpmsd.offline.diagnosis.assessment.result import FINDING, RollingDiagnosis
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.reporting import detectable

SEEDS = (12, 13, 14, 15)
SHORT_S = 400.0


@functools.cache
def plain(seed: int) -> RollingDiagnosis:
    """The diagnosis of a drive in which nothing is concealed."""
    return concealed(seed, {})


def concealed(seed: int, physics: dict[str, dict[str, float]]) -> RollingDiagnosis:
    """The diagnosis of the same drive with physics concealed by the world's own equations."""
    return diagnose([recording_of(drive(Spec(duration_s=SHORT_S, physics=dict(physics)), seed))])


def smallest(seed: int, effect: str, parameter: str) -> float:
    """The size that the drive without it states."""
    (one,) = (each for each in plain(seed).not_detectable if each.effect == effect)
    value, unit = one.smallest[parameter]
    assert unit == next(p.unit for p in EFFECTS[effect].parameters if p.name == parameter)
    assert value is not None
    return value


def found(seed: int, effect: str, parameter: str, share: float) -> bool:
    """Whether it is a finding at a share of the stated size."""
    size = share * smallest(seed, effect, parameter)
    findings = concealed(seed, {effect: {parameter: size}}).findings
    return any(one.effect == effect and one.status == FINDING for one in findings)


CASES = (
    ("centrifugal_growth", "coefficient"),
    ("antenna_lever_arm", "forward_m"),
    ("thermal_growth", "amplitude_m"),
)


@pytest.mark.parametrize(("effect", "parameter"), CASES)
def test_at_the_stated_size_it_is_found_and_at_a_quarter_not(effect: str, parameter: str) -> None:
    """Nineteen of twenty are promised at the size; at a quarter 0.5 * 1.5^2 nats are far below the
    penalty."""
    at_size = [found(seed, effect, parameter, 1.0) for seed in SEEDS]
    at_quarter = [found(seed, effect, parameter, 0.25) for seed in SEEDS]

    assert sum(at_size) >= len(SEEDS) - 1
    assert sum(at_quarter) == 0


def test_the_size_is_larger_than_usual_and_grows_as_the_drive_shrinks() -> None:
    """Only what is larger than usual stands there; a shorter drive of the same road could show less."""
    for one in plain(12).not_detectable:
        sizes = {name: value for name, (value, _) in one.smallest.items() if value is not None}
        usual = {name: prior_scale(EFFECTS[one.effect], name) for name in sizes}
        assert not sizes or min(sizes[name] / usual[name] for name in sizes) > 1.0
    short = diagnose([recording_of(drive(Spec(duration_s=0.5 * SHORT_S), 12))])
    (less,) = (one for one in short.not_detectable if one.effect == "centrifugal_growth")
    size = less.smallest["coefficient"][0]
    assert size is not None
    assert size > 1.2 * smallest(12, "centrifugal_growth", "coefficient")


def test_what_has_no_reading_has_no_size() -> None:
    """Without a gyro nothing of the gyro shows: the size is None, whatever was driven."""
    blind = recording_of(drive(Spec(duration_s=SHORT_S), 12))
    blind.inertial["yaw_rate_radps"][:] = np.nan
    listed = {one.effect: one.smallest for one in diagnose([blind]).not_detectable}
    assert listed["yaw_rate_scale"] == {"scale": (None, "1")}


@pytest.mark.parametrize(
    "name",
    [
        *("radius_change", "wheel_lock", "tone_ring_error", "counter_lost_low_speed", "clock_drift"),
        *("counter_missed_pulses", "counter_extra_pulses", "unknown", "radius_constant"),
    ],
)
def test_an_effect_with_a_search_of_its_own_has_no_smallest_size(name: str) -> None:
    """Ramps, spans, teeth, counts, readings, descriptions and nuisances have no column that gives one."""
    assert not detectable._has_detectable_size(EFFECTS[name])
    assert detectable._has_detectable_size(EFFECTS["centrifugal_growth"])
