"""Two effects that fit all but alike are not told apart, and clearly different ones are."""

from __future__ import annotations

import numpy as np
import pytest

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import ANY_CAR, Hypotheses, Term
from tpmsd.offline.diagnosis.selection.candidates import Candidates
from tpmsd.offline.diagnosis.selection.selector import Selector
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.inference.least_squares import Evidence, part

WINDOWS, TRUE_SIZE = 600, 8.0


class Two(Hypotheses):
    """A slip and a load transfer, and nothing else."""

    def __init__(self) -> None:
        terms = [
            Term(effect, np.eye(3)[:, column : column + 1], (name,), 3.5)
            for column, effect, name in (
                (1, "longitudinal_slip", "slip_per_accel"),
                (2, "load_transfer_longitudinal", "coefficient"),
            )
        ]
        super().__init__(np.zeros((3, 0)), terms, [], ANY_CAR)

    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """None."""
        return []

    pulse_gains = ramp_gains


def evidence(angle: float) -> Evidence:
    """Unit noise, and responses of two effects, that far apart (rad); the second is what the data hold."""
    rng = np.random.default_rng(3)
    first, other = np.linalg.qr(rng.standard_normal((WINDOWS * 9, 2)))[0].T * np.sqrt(WINDOWS * 9)
    second = np.cos(angle) * first + np.sin(angle) * other
    # Values within what the effects' bounds allow, and so a response of the size of one over them.
    data = TRUE_SIZE * second + rng.standard_normal(WINDOWS * 9)
    rows = np.stack([data, 1e3 * first, 1e4 * second], axis=1).reshape(WINDOWS, 9, 3)
    return Evidence([part(rows, np.arange(WINDOWS) // 30)], 3)


@pytest.mark.parametrize(("angle", "alike"), [(0.015, True), (0.15, False)])
def test_effects_that_differ_by_less_than_any_model_is_right_are_rivals(angle: float, alike: bool) -> None:
    """Of a gain of 170,000 nats forty are no ground for a name; four thousand are."""
    selector = Selector(evidence(angle), Two(), last=True)
    chosen = selector.select().chosen

    assert ["load_transfer_longitudinal"] == [one.term.effect for one in chosen]
    loss = chosen[0].gain - selector.gain([selector.hypotheses.catalogue[0]])
    assert loss == pytest.approx(chosen[0].gain * np.sin(angle) ** 2, rel=0.4)
    assert loss > 2.0 * SETTINGS.selection.admit_nats
    assert (("longitudinal_slip",) if alike else ()) == chosen[0].confounded_with
    assert (chosen[0].confidence < 0.9) is alike


@pytest.mark.parametrize(
    ("pattern", "covariate", "share"),
    [
        ("all", "time", SETTINGS.selection.drift_gain_margin),
        ("all", "speed", SETTINGS.selection.spline_gain_margin),
        ("rl", "time", SETTINGS.selection.spline_gain_margin),
    ],
)
def test_a_spline_gives_away_a_share_of_its_gain(pattern: str, covariate: str, share: float) -> None:
    """More where the receiver's slow error looks alike: over time, on all wheels."""
    term = Term("unknown", np.eye(3)[:, :1], ("at_1",), 5.0, pattern=pattern, covariate=covariate)

    assert pytest.approx((1.0 - share) * 100.0 - 5.0) == Candidates.penalised_gain(term, 100.0, 1e-3)


class Arm(Hypotheses):
    """An antenna's place of two values, and a latency."""

    def __init__(self) -> None:
        names = ("forward_m", "left_m")
        terms = [
            Term("antenna_lever_arm", np.eye(4)[:, 1:3], names, 7.0),
            Term("gnss_latency", np.eye(4)[:, 3:], ("latency_s",), 3.5),
        ]
        super().__init__(np.zeros((4, 0)), terms, [], ANY_CAR)

    def ramp_gains(self, gram: FloatArray, b: FloatArray) -> list[tuple[float, Term]]:
        """None."""
        return []

    pulse_gains = ramp_gains


@pytest.mark.parametrize(
    ("angle", "left_m", "alike"),
    [(0.05, 0.09, True), (0.8, 0.1, False), (0.8, 0.0, False), (0.05, 0.6, False)],
)
def test_a_name_is_unsure_where_a_rival_takes_the_place_of_one_of_its_values(
    angle: float, left_m: float, alike: bool
) -> None:
    """A forward arm that a latency replaces, beside a sideways one that nothing does: both are possible. What
    stands beside a forward arm that suffices alone replaces nothing; and a name that rests on its sideways
    value by nine tenths of the gain stands whatever takes the forward one's place."""
    rng = np.random.default_rng(4)
    forward, left, other = np.linalg.qr(rng.standard_normal((WINDOWS * 9, 3)))[0].T * np.sqrt(WINDOWS * 9)
    late = np.cos(angle) * forward + np.sin(angle) * other
    data = 0.1 * forward + left_m * left + rng.standard_normal(WINDOWS * 9)
    rows = np.stack([data, 0.2 * forward, 0.4 * left, late], axis=1).reshape(WINDOWS, 9, 4)
    facts = Evidence([part(rows, np.arange(WINDOWS) // 30)], 4)
    chosen = Selector(facts, Arm(), last=True).selection_of([Arm().catalogue[0]]).chosen

    assert (("gnss_latency",) if alike else ()) == chosen[0].confounded_with
    assert (chosen[0].confidence < 0.6) is alike
