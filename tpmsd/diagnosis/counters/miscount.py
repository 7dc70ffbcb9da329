"""Rings of another number of teeth than is configured.

In: `Recording`, radii that the configured number gives. Out: wheels with the true number, and recordings
whose angles are put right where the number is plainly another.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpmsd.inference.recording import Recording
from tpmsd.wheels import WHEELS, FloatArray

TEETH = (20, 200)
"""Counts per turn of the rings that cars have (48 to 100 are usual), and of finer ones."""
FROM_OFFSET, WITHIN = 0.012, 0.35
"""Offset of a radius from which a wrong number of teeth is thought of, and how near (in teeth) to a whole
number it must be: radii themselves differ by some tenths of a per cent.
"""
ALL_FROM = 0.055
"""The same of all wheels together: so far off no radius of a tyre of about the right size is."""
FAR = 0.04
"""Offset of one wheel that is put right before anything else is looked for: no small change."""
RADII = 0.003
"""Relative standard deviation between the radii of one car's wheels: where one tooth is less, no count is
told from its neighbour."""


def wrong_teeth(recording: Recording, radii_m: FloatArray) -> list[tuple[str, float]]:
    """(wheel, true number) of wheels whose radius is off by just what some teeth more or less would make."""
    teeth = recording.car.teeth_per_rev
    if teeth > TEETH[1] or len(recording.wheels) < 4:
        return []
    ratio = radii_m / recording.car.radius_m
    out = []
    for k in range(4):
        off = float(ratio[k] / np.median(np.delete(ratio, k)))
        count = _count(teeth, off, FROM_OFFSET)
        if count is not None:
            out.append((WHEELS[k], count))
    return out


def _count(teeth: float, off: float, least: float) -> float | None:
    """The whole number of teeth that makes a radius look so far off; None where none does."""
    if abs(off - 1.0) < least:
        return None
    count = round(teeth / off)
    told = RADII * count > WITHIN or abs(teeth / off - count) < WITHIN
    return float(count) if count != teeth and TEETH[0] <= count <= TEETH[1] and told else None


def one_recounted(recording: Recording) -> Recording:
    """The recording with the angles of a wheel put right whose ring plainly has another number of teeth.

    A wheel that shows far fewer turns than the others over the whole drive: bends to either side cancel.
    """
    whole = np.asarray(np.isfinite(recording.rotation_rad).all(axis=1))
    turns = recording.rotation_rad[whole].sum(axis=0)
    if not _has_rings(recording) or not (turns > 0.0).all():
        return recording
    others = np.array([np.median(np.delete(turns, k)) for k in range(4)])
    teeth = recording.car.teeth_per_rev
    return _put_right(recording, [_count(teeth, float(others[k] / turns[k]), FAR) for k in range(4)])


def all_recounted(recording: Recording, radii_m: FloatArray) -> Recording:
    """The same where all wheels have another ring than is configured; `radii_m` (4,) are those that the
    configured number gives.
    """
    if not _has_rings(recording) or any(count is not None for count in recording.counts_per_rev):
        return recording
    off = float(np.median(radii_m / recording.car.radius_m))
    return _put_right(recording, [_count(recording.car.teeth_per_rev, off, ALL_FROM)] * 4)


def _has_rings(recording: Recording) -> bool:
    """Whether all wheels are counted, by rings and not by finer encoders."""
    counted = len(recording.wheels) == 4 and bool((recording.quantum_rad > 0.0).all())
    return counted and recording.car.teeth_per_rev <= TEETH[1]


def _put_right(recording: Recording, counts: list[float | None]) -> Recording:
    if all(count is None for count in counts):
        return recording
    teeth = recording.car.teeth_per_rev
    factor = np.array([1.0 if count is None else teeth / count for count in counts])
    return replace(
        recording,
        rotation_rad=recording.rotation_rad * factor,
        quantum_rad=recording.quantum_rad * factor,
        counts_per_rev=tuple(counts),
    )
