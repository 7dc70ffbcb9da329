"""Rings of another number of teeth than is configured.

In: `Recording`, radii that the configured number gives. Out: wheels with the true number, and recordings
whose angles are put right where the number is plainly another.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.rings.settings import COUNTERS


def wheels_with_wrong_teeth(recording: Recording, radii_m: FloatArray) -> list[tuple[str, float]]:
    """Return (wheel, true number of teeth) of wheels whose radius is off by the ratio of two whole numbers of
    teeth.
    """
    teeth = recording.car.teeth_per_rev
    if teeth > COUNTERS.max_teeth or len(recording.wheels) < 4:
        return []
    ratio = radii_m / recording.car.radius_m
    out = []
    for k in range(4):
        off = float(ratio[k] / np.median(np.delete(ratio, k)))
        count = _true_teeth(teeth, off, COUNTERS.teeth_from_offset)
        if count is not None:
            out.append((WHEELS[k], count))
    return out


def _true_teeth(teeth: float, off: float, least: float) -> float | None:
    """Return the whole number of teeth that explains the apparent radius ratio `off`; None where none
    does.
    """
    if abs(off - 1.0) < least:
        return None
    count = round(teeth / off)
    decided = (
        COUNTERS.radius_spread * count > COUNTERS.teeth_within
        or abs(teeth / off - count) < COUNTERS.teeth_within
    )
    return (
        float(count)
        if count != teeth and COUNTERS.fewest_teeth <= count <= COUNTERS.max_teeth and decided
        else None
    )


def with_single_ring_corrected(recording: Recording) -> Recording:
    """Return the recording with the angles rescaled of a wheel that has another number of teeth.

    Unchanged where no ring clearly has.

    A wheel that shows far fewer turns than the others over the whole drive: bends to either side cancel.
    """
    whole = np.asarray(np.isfinite(recording.rotation_rad).all(axis=1))
    turns = recording.rotation_rad[whole].sum(axis=0)
    if not _has_rings(recording) or not (turns > 0.0).all():
        return recording
    others = np.array([np.median(np.delete(turns, k)) for k in range(4)])
    teeth = recording.car.teeth_per_rev
    return _with_counts(
        recording,
        [_true_teeth(teeth, float(others[k] / turns[k]), COUNTERS.teeth_at_once) for k in range(4)],
    )


def with_all_rings_corrected(recording: Recording, radii_m: FloatArray) -> Recording:
    """Return the recording with all angles rescaled where all rings have another number of teeth.

    Another than is configured; `radii_m` (4,) are those that the configured number gives.
    """
    if not _has_rings(recording) or any(count is not None for count in recording.counts_per_rev):
        return recording
    off = float(np.median(radii_m / recording.car.radius_m))
    return _with_counts(
        recording, [_true_teeth(recording.car.teeth_per_rev, off, COUNTERS.teeth_all_from)] * 4
    )


def _has_rings(recording: Recording) -> bool:
    """Return whether all wheels are counted, by rings and not by finer encoders."""
    counted = len(recording.wheels) == 4 and bool((recording.quantum_rad > 0.0).all())
    return counted and recording.car.teeth_per_rev <= COUNTERS.max_teeth


def _with_counts(recording: Recording, counts: list[float | None]) -> Recording:
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
