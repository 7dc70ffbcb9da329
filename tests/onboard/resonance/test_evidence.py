"""Likelihoods of soft against sound."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.resonance.evidence import (
    SHIFTS,
    TRUST,
    ResonanceEvidence,
    shift_log_likelihood,
)
from tpmsd.onboard.resonance.peak_fit import DAMPING, LOG_GRID

MAX_LOG = math.log((TRUST + (1.0 - TRUST) / 16) / ((1.0 - TRUST) / 16))
"""Of 16 sets, one is certain or all are alike."""


def bell(frequency_hz: float, relative_std: float) -> FloatArray:
    """Log likelihood of a resonance that is known with this standard deviation, whatever its damping."""
    one = 30.0 - 0.5 * ((LOG_GRID - math.log(frequency_hz)) / relative_std) ** 2
    return np.tile(np.maximum(one, 0.0)[:, None], (1, DAMPING.size))


def moved(change: float, relative_std: float = 0.005) -> FloatArray:
    """A wheel's likelihood over shifts if its frequency moved by this share."""
    return shift_log_likelihood(bell(40.0, relative_std), bell(40.0 * math.exp(change), relative_std))


def test_the_change_has_the_errors_of_both_ends() -> None:
    """Mean: the difference of the logarithms; variance: the sum of both."""
    weight = np.exp(shift_log_likelihood(bell(42.0, 0.01), bell(40.0, 0.02)))
    weight /= weight.sum()
    mean = float(weight @ SHIFTS)

    assert math.log(40.0 / 42.0) == pytest.approx(mean, abs=1e-3)
    assert math.hypot(0.01, 0.02) == pytest.approx(math.sqrt(float(weight @ (SHIFTS - mean) ** 2)), rel=0.03)


def test_what_is_not_known_says_nothing() -> None:
    """A wheel without a resonance now has a flat likelihood and leaves every ratio at one."""
    nothing = np.zeros((LOG_GRID.size, DAMPING.size))
    evidence = ResonanceEvidence.from_shifts({0: shift_log_likelihood(bell(40.0, 0.01), nothing)})

    assert 0.0 == pytest.approx(evidence.wheel_llr(0), abs=1e-9)


def test_one_falling_frequency_names_its_wheel() -> None:
    """8 % down on one wheel of four speaks for that one and against the others."""
    evidence = ResonanceEvidence.from_shifts({0: moved(0.0), 1: moved(0.0), 2: moved(-0.08), 3: moved(0.0)})
    ratios = [evidence.wheel_llr(wheel) for wheel in range(4)]

    assert ratios[2] > 2.0
    assert max(ratios[0], ratios[1], ratios[3]) < 0.1
    assert evidence.log_ratio((2,)) > evidence.log_ratio((0, 2)) + 1.0
    assert (2,) == max(evidence.subsets, key=lambda subset: evidence.subsets[subset])


def test_warmth_of_all_tyres_is_no_soft_tyre() -> None:
    """3 % down on all four at once speaks for one of them less than 3 % on one alone does."""
    together = ResonanceEvidence.from_shifts({wheel: moved(-0.03) for wheel in range(4)})
    alone = ResonanceEvidence.from_shifts({0: moved(-0.03), 1: moved(0.0), 2: moved(0.0), 3: moved(0.0)})

    assert together.log_ratio((0,)) < alone.log_ratio((0,))
    assert together.log_ratio((0,)) < 0.0


def test_a_rising_frequency_is_no_soft_tyre() -> None:
    """5 % up on one of four speaks against its loss, and against that of any single other one."""
    evidence = ResonanceEvidence.from_shifts({wheel: moved(0.05 * (wheel == 0)) for wheel in range(4)})

    assert max(evidence.wheel_llr(wheel) for wheel in range(4)) < 0.0


def test_no_evidence_is_endless() -> None:
    """However clear the shift, no set of wheels gains or loses more than the model is trusted for."""
    evidence = ResonanceEvidence.from_shifts(
        {wheel: moved(-0.15 * (wheel == 1), 0.005) for wheel in range(4)}
    )

    assert all(abs(log) <= MAX_LOG + 1e-9 for log in evidence.subsets.values())


def test_silence_changes_nothing() -> None:
    """Where no wheel has a resonance, every set of wheels has a log-likelihood ratio of 0."""
    assert [0.0] * 3 == [ResonanceEvidence.silent().log_ratio(wheels) for wheels in ((), (0,), (0, 1))]


def test_wheels_without_a_resonance_change_nothing() -> None:
    """The ratio of a set is that of its wheels with a resonance, in any order."""
    evidence = ResonanceEvidence((0, 1), {(): 0.0, (0,): 1.5, (1,): -0.5, (0, 1): 0.25})

    assert [-0.5, 0.25, 0.0] == [evidence.log_ratio(wheels) for wheels in ((1, 3), (1, 0), (2,))]


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.lists(st.floats(-0.3, 0.15), min_size=1, max_size=4), st.floats(0.004, 0.2))
def test_evidence_is_always_a_finite_number(changes: list[float], std: float) -> None:
    """Whatever the wheels did, all ratios are finite and bounded."""
    shifts = {
        wheel: shift_log_likelihood(bell(40.0, std), bell(40.0 * math.exp(x), std))
        for wheel, x in enumerate(changes)
    }
    evidence = ResonanceEvidence.from_shifts(shifts)

    assert all(abs(log) <= MAX_LOG + 1e-9 for log in evidence.subsets.values())
