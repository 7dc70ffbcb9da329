"""Slip under drive force."""

from __future__ import annotations

from tpmsd.car.physics.catalogue import EFFECTS


def test_a_slip_that_two_frames_of_one_reading_make_is_usual() -> None:
    """Frames 0.24 ms apart make 1.2e-5 s2/m at 20 m/s; tyres have 1e-3 and more."""
    effect = EFFECTS["longitudinal_slip"]

    assert [True, False] == [bool(effect.tolerance_note(slip, 5e-6, False)) for slip in (2.2e-5, 1e-3)]
