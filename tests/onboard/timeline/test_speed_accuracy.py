"""What a receiver says of its speed becomes a factor, whatever its scale."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tpmsd.onboard.estimators.bank import measurements
from tpmsd.onboard.estimators.bank.error_state import PSI
from tpmsd.onboard.estimators.bank.measurements import Present
from tpmsd.onboard.sources.events import GnssFix
from tpmsd.onboard.timeline.speed_accuracy import MOST, TOLERATED, TYPICAL_MPS, SpeedAccuracy
from tpmsd.onboard.timeline.tick import Fix, Tick
from tpmsd.onboard.timeline.timeline import Timeline

OPEN, STREET = 0.05, 0.5


def factors(stated: list[float]) -> list[float]:
    accuracy = SpeedAccuracy()
    return [accuracy.factor(one) for one in stated]


@pytest.mark.parametrize("lie", [1 / 2.4, 1.0, 3.0])
def test_a_street_is_reported_whatever_the_scale(lie: float) -> None:
    """Ten times its usual error is a factor of ten, also from a receiver that is off by a factor of three."""
    stated = [lie * one for one in [OPEN] * 100 + [STREET] * 40 + [OPEN] * 20]
    got = factors(stated)

    assert [1.0] * 100 == pytest.approx(got[:100])
    assert [STREET / OPEN] * 40 == pytest.approx(got[100:140])
    assert [1.0] * 20 == pytest.approx(got[140:])


def test_what_is_off_by_more_is_taken_at_its_word() -> None:
    """A receiver that always says 1 m/s is weighed by it, beyond the tolerated factor of three."""
    assert 1.0 / (TOLERATED * TYPICAL_MPS) == pytest.approx(factors([1.0] * 50)[-1])


def test_silence_changes_nothing() -> None:
    """Without a statement, or with a nonsensical one, the error is the usual one."""
    assert [1.0] * 4 == factors([math.nan, 0.0, -1.0, math.inf])


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.lists(st.floats(), max_size=60))
def test_the_factor_is_bounded(stated: list[float]) -> None:
    """Whatever is stated, the factor lies between one and the most there is."""
    assert all(1.0 <= factor <= MOST for factor in factors(stated))


def test_the_factor_comes_with_the_fix() -> None:
    """From the receiver's statement through the timeline into the tick."""
    timeline = Timeline(10.0)
    ticks: list[Tick] = []
    for k in range(60):
        at_s = 1.7e9 + 0.1 * k
        place = {"latitude_deg": 48.0, "longitude_deg": 11.0, "position_std_m": 1.0}
        std = STREET if k == 40 else OPEN
        ticks += timeline.advance(at_s)
        ticks += timeline.add(GnssFix(at_s, at_s, **place, quality=1, speed_mps=20.0, speed_std_mps=std))
    noise = [round(fix.speed_noise, 6) for tick in ticks for fix in tick.fixes]

    assert {1.0: len(noise) - 1, 10.0: 1} == {one: noise.count(one) for one in set(noise)}


def test_variances_grow_with_the_square() -> None:
    """A course of three times the error has nine times the Doppler part of its variance."""
    mean = np.zeros((1, PSI + 20))
    now = Present(20.0, 0.0, 0.0, 0.0)
    tick = Tick(1, 1.0, 0.1, np.zeros(4), np.zeros(4))
    variance = [
        measurements.course(
            mean,
            Fix(1.0, 1.0, 0.0, 0.0, 1.0, speed_mps=20.0, heading_rad=0.0, speed_noise=noise),
            tick,
            now,
            0.0,
            1e9,
        ).variance
        for noise in (0.0, 1.0, 3.0)
    ]

    assert 9.0 == pytest.approx((variance[2] - variance[0]) / (variance[1] - variance[0]))


def test_the_usual_statement_is_the_lower_quarter_of_the_last_600_renewed_every_ten() -> None:
    """It is renewed by each of the first nine and by every tenth: another sky is followed."""
    rng = np.random.default_rng(4)
    stated = np.concatenate([rng.uniform(0.05, 0.08, 45), rng.uniform(0.1, 0.15, 780)])
    expected, usual, since = [], math.nan, 0
    for k in range(1, len(stated) + 1):
        since += 1
        if k < 10 or since == 10:
            usual, since = float(np.quantile(stated[max(k - 600, 0) : k], 0.25)), 0
        expected.append(max(stated[k - 1] / usual, 1.0))

    assert expected == pytest.approx(factors(stated.tolist()), rel=1e-12)
    assert max(expected[50:]) > 1.5 > 1.4 > max(expected[700:])


@pytest.mark.parametrize(("stated_mps", "factor"), [(1.49, 29.8), (1.5, 30.0), (1.6, 30.0)])
def test_a_speed_of_two_metres_per_second_error_carries_nothing(stated_mps: float, factor: float) -> None:
    """Thirty times the usual is the most; nothing is more accurate than usual."""
    assert [factor, 1.0] == pytest.approx(factors([OPEN] * 20 + [stated_mps, 0.01])[-2:])


def after(*stated_mps: float) -> float:
    """The factor of the last of these statements."""
    receiver = SpeedAccuracy()
    return [receiver.factor(one) for one in stated_mps][-1]


@pytest.mark.parametrize(
    ("usual_mps", "stated_mps", "factor"),
    [
        (0.06, 0.12, 2.0),
        (0.18, 0.36, 2.0),  # three times the usual error is tolerated
        (0.6, 0.6, 0.6 / 0.18),  # more is taken at its word beyond that
        (0.02, 0.04, 2.0),
        (0.002, 0.02, 1.0),
        (0.002, 0.04, 2.0),
        (0.06, 1.8, 30.0),
        (0.06, 1.74, 29.0),
        (0.06, 60.0, 30.0),
        (0.06, 0.03, 1.0),
        (0.06, math.inf, 1.0),
        (0.06, math.nan, 1.0),
        (0.06, 0.0, 1.0),
        (0.06, -1.0, 1.0),
    ],
)
def test_a_statement_counts_against_the_usual_one(usual_mps: float, stated_mps: float, factor: float) -> None:
    """The factor is their ratio, within 1 and 30, the usual one taken within a third to three times 0.06."""
    assert factor == pytest.approx(after(*[usual_mps] * 20, stated_mps))


def test_a_quarter_of_the_last_six_hundred_statements_is_the_usual() -> None:
    """Under open sky a quarter of the time and a little more, the statement there counts; with less it does
    not, nor with what lies more than six hundred fixes back."""
    assert 2.0 == pytest.approx(after(*[0.12] * 440, *[0.06] * 151, *[0.12] * 9))
    assert 1.0 == pytest.approx(after(*[0.12] * 460, *[0.06] * 140))  # below one is one
    assert 1.0 == pytest.approx(after(*[0.12] * 460, *[0.06] * 131, *[0.12] * 9))
    assert 1.0 == pytest.approx(after(*[0.06] * 600, *[0.12] * 600))
