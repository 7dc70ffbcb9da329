"""A status document in the shape that other systems want."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.interfaces.bridges.documents import alarm, document
from tpmsd.interfaces.bridges.summary import summarise


def test_an_alarm_is_a_problem_of_its_wheel() -> None:
    """An alarm concerns its wheel, one without a wheel all of them, a malfunction none."""
    problems = [
        [wheel.name for wheel in summarise(document(one)).wheels if wheel.problem]
        for one in (
            alarm(),
            alarm("radius_deviation", None),
            alarm("malfunction", None),
            alarm("slow_leak", "fr"),
        )
    ]

    assert [["rl"], ["fl", "fr", "rl", "rr"], [], ["fr"]] == problems
    assert summarise(document(alarm("malfunction", None))).malfunction


@pytest.mark.parametrize(
    ("changed", "health"),
    [
        ({}, "ok"),
        ({"can": {"state": "down"}}, "bus down"),
        ({"gnss": {"state": "silent"}}, "receiver silent"),
        ({"gnss": {"state": "off"}}, "ok"),
        ({"wheels": {}}, "no wheel"),
        ({"alarms": [alarm("malfunction", None)]}, "malfunction"),
    ],
)
def test_health_names_the_first_thing_wrong(changed: dict[str, Any], health: str) -> None:
    """Malfunction before bus before receiver; a receiver that is not configured is nothing wrong."""
    assert health == summarise(document(**changed)).health


def test_the_key_of_an_alarm_tells_repetitions() -> None:
    """The same alarm has the same key in every document, another one has another."""
    keys = {summarise(document(one)).alarms[0].key for one in (alarm(), alarm() | {"deviation_mm": -3.0})}

    assert {"deflation:rl:1000.000"} == keys
    assert "deflation:rl:1001.000" == summarise(document(alarm(time_s=1001.0))).alarms[0].key


junk = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@settings(derandomize=True, deadline=None, max_examples=200)
@given(st.dictionaries(st.sampled_from(sorted(document())), junk))
def test_strange_documents_are_borne(changed: dict[str, Any]) -> None:
    """Whatever stands where something else belongs, there is a summary."""
    summary = summarise(document() | changed)

    assert summary.health
    assert all(
        wheel.deviation_mm is None or isinstance(wheel.deviation_mm, float) for wheel in summary.wheels
    )
