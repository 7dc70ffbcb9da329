"""The confidence that alternatives leave a chosen term, by Bayes' rule with equal priors."""

from __future__ import annotations

import math

import pytest

from tpmsd.offline.diagnosis.selection.alternatives import Alternative, confidence, confounded_effects


def test_confidence_is_the_posterior_of_equal_priors() -> None:
    """With an alternative 2 nats below and nothing 5 nats below, P = 1 / (1 + exp(-2) + exp(-5))."""
    alternatives = [Alternative("a", "a", math.exp(-2.0))]

    assert confidence("true", 5.0, alternatives) == pytest.approx(
        1.0 / (1.0 + math.exp(-2.0) + math.exp(-5.0))
    )
    assert confidence("true", 0.0, []) == pytest.approx(0.5)


def test_rivals_of_one_name_are_one_alternative() -> None:
    """The first of one name counts, and a later one only where it replaces a part and weighs more."""
    twice = [Alternative("a", "a", 0.5), Alternative("a", "a", 0.4)]
    part = [Alternative("a", "a", 0.5), Alternative("a", "a", 0.0, part_weight=0.9)]

    assert confidence("true", 100.0, twice) == pytest.approx(1.0 / 1.5)
    assert confidence("true", 100.0, part) == pytest.approx(1.0 / 1.9)


def test_a_hopeless_gain_is_no_overflow() -> None:
    """A term that is thousands of nats worse than nothing has the confidence of nothing against it."""
    assert 0.0 < confidence("true", -1e5, []) < 1e-20


def test_confounded_effects_come_by_their_gain() -> None:
    """Only effects that would do as well are listed, the best first, each once."""
    alternatives = [
        Alternative("a", "a", 0.1, replaces_by=3.0),
        Alternative("b", "b", 0.9, replaces_by=8.0),
        Alternative("a, rear", "a", 0.0, replaces_by=9.0),
        Alternative("c", "c", 0.9),
    ]

    assert ("b", "a") == confounded_effects(alternatives)
