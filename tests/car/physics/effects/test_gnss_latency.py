"""Fixes that are older than their arrival."""

from __future__ import annotations

from tpmsd.car.physics.catalogue import EFFECTS


def test_the_usual_age_of_wheel_readings_makes_no_latency() -> None:
    """Counts are up to 20 ms old, means of speeds up to 40 ms; a fix cannot come before it is valid."""
    effect = EFFECTS["gnss_latency"]

    counts = [bool(effect.tolerance_note(latency, 2e-3, speeds=False)) for latency in (-0.016, -0.06, 0.02)]
    speeds = [bool(effect.tolerance_note(latency, 2e-3, speeds=True)) for latency in (-0.035, -0.06, 0.02)]

    assert [[True, False, False]] * 2 == [counts, speeds]
