"""Descriptions and effects in one another's place."""

from __future__ import annotations

import math

import pytest

from tests.offline.diagnosis.test_beside_shapes import Given, columns, directions, noiseless, shape
from tpmsd.offline.diagnosis.hypotheses.terms import Term
from tpmsd.offline.diagnosis.selection.selector import Selector

COSINE, NATS = 0.85, 47.0
"""Of the angle between the responses of an effect and a description, and what the description gains."""


@pytest.mark.parametrize(("scatter", "name"), [(1.5, "load_transfer_lateral"), (1.0, "unknown")])
def test_a_description_takes_an_effects_place_by_what_its_scatter_leaves(
    monkeypatch: pytest.MonkeyPatch, scatter: float, name: str
) -> None:
    """It gains 4 nats more than its penalty; at 1.5 times the variance from block to block it keeps 10 less.

    Whichever of the two stands there first, the same one stays.
    """
    u = directions(2)
    free = COSINE * u[:, 0] + math.sqrt(1.0 - COSINE**2) * u[:, 1]
    effect = Term("load_transfer_lateral", columns(1, width=3), ("coefficient",), 3.5)
    spline = shape("rl", "accel_lat", columns(2, width=3))
    data = math.sqrt(2.0 * NATS) * free
    made = noiseless(data, 1e5 * u[:, :1] @ [[1.0, 0.0]] + 1e5 * free[:, None] @ [[0.0, 1.0]])
    selector = Selector(made, Given(3, [effect], [spline]))
    monkeypatch.setattr(
        selector,
        "variance_ratio",
        lambda terms, which: scatter if terms[which].nonparametric else 1.0,
        raising=True,
    )

    for first in (effect, spline):
        assert [name] == [term.effect for term in selector._exchange([first])]


def test_an_effect_takes_a_descriptions_place_by_its_gain_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The truth gains 13 nats more than a description; its scatter is 3 times as large."""
    u = directions(2)
    free = COSINE * u[:, 0] + math.sqrt(1.0 - COSINE**2) * u[:, 1]
    effect = Term("load_transfer_lateral", columns(1, width=3), ("coefficient",), 3.5)
    spline = shape("rl", "accel_lat", columns(2, width=3))
    data = math.sqrt(2.0 * NATS) * u[:, 0]
    made = noiseless(data, 1e5 * u[:, :1] @ [[1.0, 0.0]] + 1e5 * free[:, None] @ [[0.0, 1.0]])
    selector = Selector(made, Given(3, [effect], [spline]))
    monkeypatch.setattr(
        selector, "variance_ratio", lambda terms, which: 1.0 if terms[which].nonparametric else 3.0
    )

    assert ["load_transfer_lateral"] == [term.effect for term in selector._exchange([spline])]
