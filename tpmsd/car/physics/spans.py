"""Wheels by name and spans of time: what effects of some wheels for a while are made of.

In: names of wheels, times. Out: masks and shares over time.
"""

from __future__ import annotations

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray

GROUPS: dict[str, tuple[str, ...]] = {
    **{wheel: (wheel,) for wheel in WHEELS},
    "front": ("fl", "fr"),
    "rear": ("rl", "rr"),
    "left": ("fl", "rl"),
    "right": ("fr", "rr"),
    "all": WHEELS,
}


def wheel_mask(names: str) -> FloatArray:
    """(4,) one for each wheel that is named (`rl rr`, `rear`), else zero; ValueError for an unknown name."""
    out = np.zeros(4)
    for word in names.split():
        if word not in GROUPS:
            raise ValueError(f"wheels = {names!r} holds {word!r}, wanted are {' '.join(GROUPS)}")
        for wheel in GROUPS[word]:
            out[WHEELS.index(wheel)] = 1.0
    return out


def within(time_s: FloatArray, onset_s: float, duration_s: float) -> FloatArray:
    """(n,) one from the onset for so long, else zero."""
    return ((time_s >= onset_s) & (time_s < onset_s + duration_s)).astype(np.float64)
