"""Slip under drive force."""

from __future__ import annotations

import pytest

from tpmsd.car.physics.catalogue import EFFECTS


@pytest.mark.parametrize("std", [5e-6, 3e-4])
def test_a_slip_that_two_frames_of_one_reading_make_is_usual(std: float) -> None:
    """Frames 0.24 ms apart make 1.2e-5 s2/m at 20 m/s; tyres have 1e-3 and more, however well it is known."""
    effect = EFFECTS["longitudinal_slip"]

    assert [True, False] == [bool(effect.tolerance_note(slip, std, False)) for slip in (2.2e-5, 1e-3)]
