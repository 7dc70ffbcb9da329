"""The torsional frequency of a wheel falls with the pressure of its tyre."""

from __future__ import annotations

import numpy as np

from tpmsd.onboard.resonance.torsion import soft_shifts


def test_a_soft_tyre_lowers_the_frequency() -> None:
    """Every change that counts as soft is a fall, of a fifth at most."""
    shifts = soft_shifts()

    assert np.all(shifts < 0.0)
    assert shifts.min() > -0.25
