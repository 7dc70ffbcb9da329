"""Names that compete for one finding, each fitted in its place."""

from __future__ import annotations

from pathlib import Path

from tests.offline.dynamics.drives import diagnosed, hidden


def test_a_soft_axle_and_wheels_that_give_way_are_one_to_a_linear_car(tmp_path: Path) -> None:
    """C / (1 + k C) is a softer axle: whichever is named lists the other, and both share the probability."""
    found = diagnosed(str(tmp_path), hidden(compliance_steer={"coefficient": 0.0025}))

    assert len(found.findings) == 1
    one = found.findings[0]
    assert {"compliance_steer", "cornering_stiffness_error"} <= {one.effect, *one.indistinguishable_from}
    assert 0.1 < one.confidence < 0.9
