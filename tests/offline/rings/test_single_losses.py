"""Counts that a wheel loses one by one, told from a larger radius by how its way scatters."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from bench.campaigns.offline.lost_counts import case, found
from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import CHANNELS, GYRO, Linearised, Reader
from tpmsd.offline.rings.single_losses import SingleLosses, _sign_test_p_value, single_losses

COUNT_M = np.full(4, 0.041)
GYRO_RADPS = 2e-4
WINDOWS = 720
RL = WHEELS.index("rl")
PASSED = (
    *(("latched", seed) for seed in (2, 6, 8, 13)),
    *(("beating", seed) for seed in (23, 35, 63, 79, 82)),
)
"""Kind and seed of null drives on which the skew alone named losses."""


@cache
def _recording(share: float = 0.0) -> Recording:
    """Six minutes with rings of 48 teeth, of which the one at rl loses a share at random."""
    recording = recording_of(drive(Spec(duration_s=360.0, road="city"), 5))
    rng = np.random.default_rng(1)
    count_rad = 2.0 * np.pi / recording.car.teeth_per_rev
    rotation = recording.rotation_rad.copy()
    counts = np.round(rotation[:, RL] / count_rad).astype(int)
    rotation[:, RL] -= count_rad * rng.binomial(np.maximum(counts, 0), share)
    return dataclasses.replace(recording, rotation_rad=rotation)


@cache
def _windows() -> Linearised:
    reader = Reader(_recording(), reference(_recording()))
    repeated = np.resize(np.arange(len(reader.windows)), WINDOWS)
    return dataclasses.replace(
        reader.windows,
        design=reader.windows.design[repeated],
        covariates={name: values[repeated] for name, values in reader.windows.covariates.items()},
    )


def _left(more: dict[str, FloatArray], seed: int = 3) -> FloatArray:
    """(w, 9) errors of the motion, quantised readings, and more (w,) counts of some wheels."""
    rng = np.random.default_rng(seed)
    left = np.full((WINDOWS, CHANNELS), np.nan)
    moved = _windows().design[:, : GYRO + 1, :2] @ np.array([0.3, 0.02])
    read = rng.uniform(-0.5, 0.5, (WINDOWS + 1, 4))
    left[:, :GYRO] = moved[:, :GYRO] + COUNT_M * np.diff(read, axis=0)
    left[:, GYRO] = moved[:, GYRO] + GYRO_RADPS * rng.standard_normal(WINDOWS)
    for wheel, counts in more.items():
        left[:, WHEELS.index(wheel)] += COUNT_M[0] * counts
    return left


def _lost(share: float, seed: int = 7) -> FloatArray:
    """(w,) counts that are lost, less their mean, which a calibration takes up."""
    mean = share * _windows().covariates["speed"] / COUNT_M[0]
    return np.random.default_rng(seed).poisson(mean) - mean


def _found(left: FloatArray) -> SingleLosses | None:
    return single_losses(_windows(), left, COUNT_M, GYRO_RADPS)


@pytest.mark.parametrize("wheel", WHEELS)
@pytest.mark.parametrize(("sign", "share"), [(-1.0, 0.004), (-1.0, 0.001), (1.0, 0.004)])
def test_lost_and_added_counts_are_reported_with_their_rate(wheel: str, sign: float, share: float) -> None:
    """Four and one in a thousand counts, lost or added on any wheel, within three standard deviations."""
    found = _found(_left({wheel: sign * _lost(share)}))
    rate_per_s = -sign * share * float(np.mean(_windows().covariates["speed"])) / COUNT_M[0]

    assert found is not None
    assert (wheel, ()) == (found.wheel, found.similar_wheels)
    assert found.rate_per_s == pytest.approx(rate_per_s, abs=3.0 * found.rate_std_per_s)
    assert found.rate_std_per_s < 0.2 * abs(rate_per_s)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("freedom", [None, 3.0, 100.0])
def test_symmetric_scatter_of_any_size_is_no_loss(seed: int, freedom: float | None) -> None:
    """Quantisation alone, a wheel twice as rough, one with heavy tails."""
    rng = np.random.default_rng(seed)
    rough = np.zeros(WINDOWS) if freedom is None else 1.5 * rng.standard_t(freedom, WINDOWS)

    assert _found(_left({"rl": rough}, seed)) is None


def test_rounding_at_steady_speed_is_no_loss() -> None:
    """A wheel that falls behind by a count each fourth second, as rounding at steady speed has it: the steps
    are plain, but they come by the clock, and their sums never stray by more than a count."""
    rng = np.random.default_rng(4)
    left = np.full((WINDOWS, CHANNELS), np.nan)
    left[:, : GYRO + 1] = _windows().design[:, : GYRO + 1, :2] @ np.array([0.3, 0.02])
    left[:, :GYRO] += 0.08 * COUNT_M * rng.standard_normal((WINDOWS, 4))
    left[:, GYRO] += GYRO_RADPS * rng.standard_normal(WINDOWS)
    by_the_clock = np.diff(np.floor(0.24 * np.arange(WINDOWS + 1)))
    at_random = rng.binomial(1, 0.24, WINDOWS)
    steady, losing = left.copy(), left.copy()
    steady[:, RL] -= COUNT_M[0] * by_the_clock
    losing[:, RL] -= COUNT_M[0] * at_random

    assert _found(steady) is None
    assert _found(losing) is not None


def test_steps_of_many_counts_are_no_loss_of_single_ones() -> None:
    """A wheel that locks now and then loses dozens of counts at once."""
    locked = np.where(np.random.default_rng(2).uniform(size=WINDOWS) < 0.01, -30.0, 0.0)

    assert _found(_left({"fl": locked})) is None


def test_without_a_gyro_another_wheel_that_adds_counts_looks_the_same() -> None:
    """Four wheels leave two differences open: the wheel that loses counts is named, the other one is said."""
    left = _left({"rl": -_lost(0.004)})
    left[:, GYRO] = np.nan
    found = _found(left)

    assert found is not None
    assert ("rl", ("fl",)) == (found.wheel, found.similar_wheels)
    assert found.rate_per_s > 0.0


def test_two_wheels_alone_do_not_tell() -> None:
    """They tell the motion, and nothing beyond it."""
    left = _left({"rl": -_lost(0.004)})
    left[:, [0, 1, GYRO]] = np.nan

    assert _found(left) is None


@pytest.mark.parametrize("spread", [0.5, 4.0])
def test_readings_that_are_late_by_counts_are_no_loss(spread: float) -> None:
    """A wheel that is read up to some counts late, mostly a little: its way is skewed, and the next reading
    makes up for it. Losses beside readings half a count late are told."""
    late = np.random.default_rng(8).exponential(spread, WINDOWS + 1)
    sawtooth = spread * np.modf(np.arange(WINDOWS + 1) / 7.3)[0]

    for age in (late, sawtooth, late + sawtooth):
        assert _found(_left({"rl": -np.diff(age)})) is None
    if spread < 1.0:
        assert _found(_left({"rl": -np.diff(late) - _lost(0.004)})) is not None


@pytest.mark.parametrize("size", [0.3, 1.0, 3.0])
def test_what_lasts_for_seconds_is_no_loss(size: float) -> None:
    """A radius that answers to the square of a pull that lasts 3 s: of one sign, of one wheel, and skewed."""
    rng = np.random.default_rng(9)
    pull = np.convolve(rng.standard_normal(WINDOWS + 20), np.exp(-np.arange(20) / 3.0) / 1.7, "valid")[
        :WINDOWS
    ]

    assert _found(_left({"fr": -size * pull**2})) is None


def test_an_axle_that_is_late_against_the_other_is_no_loss_of_one_wheel() -> None:
    """Both front wheels lose the same counts at the same time, as no two counters do."""
    lost = -_lost(0.004)

    assert _found(_left({"fl": lost})) is not None
    assert _found(_left({"fl": lost, "fr": lost})) is None


def test_the_stated_probability_is_no_smaller_than_the_drive_supports() -> None:
    """Sixty blocks of signs bear none below a bound of them; symmetric scatter is rarely below its level."""
    found = _found(_left({"rl": -_lost(0.004)}))
    rng = np.random.default_rng(1)
    drawn = [_sign_test_p_value(rng.standard_t(3.0, WINDOWS)) for _ in range(400)]

    assert found is not None
    assert 8.0 * np.exp(-0.5 * WINDOWS / 12) < found.p_value < 0.05
    assert np.mean(np.array(drawn) < 0.05) < 0.05


@pytest.mark.parametrize("kind", ["plain", "latched", "beating", "effects"])
def test_drives_that_lose_no_counts_have_none_lost(kind: str) -> None:
    """Six drives each: counts read at the frame, latched, beating, and beside effects that nothing fits."""
    assert [None] * 6 == [found(case(kind, seed)) for seed in range(201, 207)]


def test_latches_that_passed_for_losses_do_so_no_more() -> None:
    """Drives whose skewed windows passed for losses of 1 to 20 counts a second, or, where an age of a count
    sweeps for half a minute and more, for 0.1 to 0.2: all wheels scatter alike there."""
    assert [None] * len(PASSED) == [found(case(kind, seed)) for kind, seed in PASSED]


def test_losses_are_reported_through_a_latch() -> None:
    """Of six drives that lose 0.3 to 1.5 counts a second most are named on the right wheel, with a latch
    half of six."""
    losing = [case("losing", seed) for seed in range(1, 7)]
    latched = [case("losing-latched", seed) for seed in range(1, 7)]

    right = [one is not None and each.wheel == one.wheel for each in losing for one in [found(each)]]

    assert 5 <= sum(right)
    assert 3 <= sum(found(one) is not None for one in latched)


@pytest.mark.parametrize(("share", "effects"), [(0.0, []), (0.004, ["counter_missed_pulses"])])
def test_a_diagnosis_names_lost_counts_that_a_calibration_takes_up(share: float, effects: list[str]) -> None:
    """In the mean they are a larger radius; the finding has wheel, rate and what tells it."""
    recording = _recording(share)
    diagnosis = diagnose([recording])
    named = [finding for finding in diagnosis.findings if finding.effect == "counter_missed_pulses"]

    assert effects == [finding.effect for finding in named]
    for finding in named:
        assert ("rl", ("rl",)) == (finding.parameters["wheel"].value, finding.where.wheels)
        assert "in steps of a count" in finding.identified_by


def test_without_a_gyro_either_wheel_is_as_likely() -> None:
    """What may as well be counts that another wheel adds is named with the confidence of one of two."""
    recording = _recording(0.004)
    blind = {**recording.inertial, "yaw_rate_radps": np.full(recording.ticks, np.nan)}
    diagnosis = diagnose([dataclasses.replace(recording, inertial=blind)])
    (named,) = [one for one in diagnosis.findings if one.effect == "counter_missed_pulses"]

    assert 0.5 == pytest.approx(named.confidence, abs=0.01)
    assert ("counter_extra_pulses",) == named.indistinguishable_from
