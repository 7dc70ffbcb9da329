"""Common radius drift is distinguished from drift of single wheels."""

from __future__ import annotations

import numpy as np
import pytest

from bench.worlds.kinematic import Spec, drive
from tests.offline.diagnosis.recorded import recording_of
from tests.offline.diagnosis.test_beside_shapes import Given, columns, directions, evidence, shape
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis import stages as whole
from tpmsd.offline.diagnosis.diagnose import diagnose
from tpmsd.offline.diagnosis.hypotheses.terms import PATTERNS, Term
from tpmsd.offline.diagnosis.prepared import regression
from tpmsd.offline.diagnosis.prepared.regression import unusable_effects
from tpmsd.offline.diagnosis.robustness.common_drift import _changed_radius, _common_shape
from tpmsd.offline.diagnosis.selection.selector import Selector

HATS = 6
SIZE = 1e4
"""Length of the whitened response to a metre of one wheel's hat."""


def shapes() -> list[Term]:
    """Over time, on each wheel and on each group of wheels."""
    out = []
    for pattern in (*WHEELS, "front", "rear", "left", "right", "all"):
        design = np.zeros((1 + 4 * HATS, HATS))
        for wheel in PATTERNS[pattern]:
            design += columns(
                *range(1 + WHEELS.index(wheel) * HATS, 1 + (WHEELS.index(wheel) + 1) * HATS),
                width=len(design),
            )
        out.append(shape(pattern, "time", design))
    return out


@pytest.mark.parametrize(
    ("heights_mm", "pattern"),
    [
        ({"fl": 1, "fr": 1}, "front"),
        ({"fr": 1, "rr": 1}, "right"),
        ({"rl": 1}, "rl"),
        ({"fl": 1, "fr": 2}, None),
        ({"fl": 1, "fr": -1, "rl": -1, "rr": 1}, None),
        ({"fl": 1, "fr": 1, "rl": 1, "rr": 1}, None),
        ({}, None),
    ],
)
def test_a_shape_is_reported_only_where_one_group_has_it_to_itself(
    heights_mm: dict[str, int], pattern: str | None
) -> None:
    """An axle, a side, one wheel; not two that go each their own way, not all, as the receiver makes it."""
    u = directions(4 * HATS)
    responses = SIZE * u
    swing = 1e-3 * np.cos(np.arange(HATS))
    data: FloatArray = np.zeros(len(u))
    for wheel, height in heights_mm.items():
        at = WHEELS.index(wheel) * HATS
        # Wheels that go their own way: their swings are of another form, too.
        own = swing if height == 1 else 1e-3 * height * np.sin(np.arange(HATS) + 0.6)
        data = data + responses[:, at : at + HATS] @ own
    selector = Selector(evidence(data, responses), Given(1 + 4 * HATS, [], shapes()), last=True)
    found = _common_shape(selector, [])

    assert pattern == (None if found is None else found.pattern)


@pytest.mark.parametrize(("loses_air", "effect"), [(True, "radius_change"), (False, "unknown")])
def test_a_wheel_that_loses_air_is_not_reported_as_a_shape(loses_air: bool, effect: str) -> None:
    """Slow noise had taken it out: named if it brings nearly what the wheel's spline term does."""
    u = directions(4 * HATS)
    responses = SIZE * u
    ramp = 1e-3 * np.minimum(np.arange(HATS) / 3.0, 1.0)
    rear_left = slice(WHEELS.index("rl") * HATS, (WHEELS.index("rl") + 1) * HATS)
    data = responses[:, rear_left] @ (ramp if loses_air else 1e-3 * np.cos(2.0 * np.arange(HATS)))
    changes = [
        Term("radius_change", np.append(0.0, ramp_of(wheel))[:, None], ("deviation_m",), 9.0, wheel=wheel)
        for wheel in ("rl", "rr")
    ]
    selector = Selector(evidence(data, responses), Given(1 + 4 * HATS, [], shapes()), last=True)
    found = _common_shape(selector, [])

    assert found is not None
    named = _changed_radius(selector, [], found, changes)
    assert effect == (named or found).effect
    assert named is None or named.wheel == "rl"


def ramp_of(wheel: str) -> FloatArray:
    """(4 * HATS,) the heights of a wheel's hats as it loses a metre."""
    out = np.zeros((len(WHEELS), HATS))
    out[WHEELS.index(wheel)] = np.minimum(np.arange(HATS) / 3.0, 1.0)
    return out.ravel()


BRAKES = {"strange_brake_heat": {"wheels": [0, 1], "cooling_s": 66.0, "size_m": 1.6e-3}}


def test_an_axle_that_warms_with_every_braking_is_no_wander(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shape with a memory, which nothing else holds where its effect is unknown: found on its axle; without
    the question no shape was.
    """
    monkeypatch.setattr(
        regression, "unusable_effects", lambda reader: unusable_effects(reader) | {"brake_heat"}
    )
    recording = recording_of(drive(Spec(duration_s=700.0, road="rural", physics=BRAKES), 10))
    diagnosis = diagnose([recording])
    monkeypatch.setattr(whole, "add_common_shape", lambda found, before: found)
    without = diagnose([recording])

    assert "mismatch" == diagnosis.verdict
    assert {"unknown"} == {finding.effect for finding in diagnosis.findings}
    assert {("fl", "fr")} == {finding.where.wheels for finding in diagnosis.findings}
    assert "unknown" not in {finding.effect for finding in without.findings}


def test_an_axle_that_warms_with_every_braking_has_a_name() -> None:
    """Another world's brakes: the axle and the time of cooling."""
    recording = recording_of(drive(Spec(duration_s=700.0, road="rural", physics=BRAKES), 6))
    findings = diagnose([recording]).findings

    assert ("brake_heat", ("fl", "fr")) == (findings[0].effect, findings[0].where.wheels)
    # Its cooling is no exponential: what is left may be told beside it, but not as sure.
    assert all(one.confidence < 0.9 for one in findings[1:])
    cooling = findings[0].parameters["cooling_s"]
    assert cooling.std is not None
    assert abs(cooling.value - 66.0) < 3.0 * cooling.std + 10.0


def test_wheels_that_wander_each_for_itself_are_no_finding() -> None:
    """0.04 % of radius drift, as real tyres have on bad days: one of them looked like a leak of 20 nats."""
    spec = Spec(duration_s=600.0, road="rural", radius_drift=4e-4)
    diagnosis = diagnose([recording_of(drive(spec, 4))])

    assert () == diagnosis.findings
