"""Admission of drives: which are examined, and how much of each.

In: `Recording`s. Out: a `Reader` per drive that is fit, and notes on what was left out. Memory is bounded by
a number of windows and of drives: of more, every drive keeps a fair share, in stretches spread over it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import RL, RR
from tpmsd.offline.diagnosis.settings import SETTINGS
from tpmsd.offline.drive_checks.same_car import car_difference, check_same_car
from tpmsd.offline.inference.count_age import without_common_age
from tpmsd.offline.inference.count_rhythm import without_rhythms
from tpmsd.offline.inference.recording import Recording
from tpmsd.offline.inference.trajectory import reference
from tpmsd.offline.inference.windows import CHANNELS, EAST, MAX_WINDOWS, NORTH, Reader
from tpmsd.offline.rings.miscount import with_all_rings_corrected, with_single_ring_corrected


def admitted_readers(recordings: Sequence[Recording]) -> tuple[list[Reader], tuple[str, ...]]:
    """Return the readers of the drives that can be examined, and notes on those left out.
    ConfigError where the configurations describe different cars.
    """
    check_same_car(recordings)
    several = len(recordings) > 1
    notes = []
    readers: list[Reader] = []
    for recording in recordings:
        reason = unfit_reason(recording)
        if not reason:
            reader = corrected_reader(recording)
            reason = unfit_windows_reason(reader)
        if reason:
            notes.append(f"{recording.name}: left out, for {reason}" if several else reason)
        else:
            readers.append(reader)
    readers, more = limited_readers(readers)
    return readers, (*notes, *more)


def readers_against_simulation(
    recording: Recording, simulation: Recording
) -> tuple[list[Reader], tuple[str, ...]]:
    """Return the readers of a recording and of its simulation, and notes; no readers if the recording is
    unfit.
    ConfigError where the simulation is unfit, or of another car or another road.
    """
    difference = car_difference(recording, simulation, teeth=False)
    if difference:
        raise ConfigError(f"the simulation is of another car: {difference}")
    readers = []
    for one in (recording, simulation):
        reason = unfit_reason(one)
        if not reason:
            readers.append(corrected_reader(one, MAX_WINDOWS // 2))
            reason = unfit_windows_reason(readers[-1])
        if reason and one is recording:
            return [], (reason,)
        if reason:
            raise ConfigError(f"the simulation is of no use: {reason}")
    reason = road_mismatch(*readers)
    if reason:
        raise ConfigError(f"the simulation is of another road: {reason}")
    return readers, tuple(_examined_note(reader) for reader in readers if reader.left_out)


def corrected_reader(recording: Recording, limit: int = MAX_WINDOWS) -> Reader:
    """Return the reader of a recording whose tooth numbers, count rhythms and common delay of counts are
    corrected."""
    counted = without_common_age(without_rhythms(with_single_ring_corrected(recording)))
    first = reference(counted)
    right = with_all_rings_corrected(counted, first.car.radius_m)
    return Reader(right, first if right is counted else reference(right), limit)


def road_mismatch(recorded: Reader, simulated: Reader) -> str:
    """Return the difference between a simulation's road and the recording's as text; empty if they agree.
    Both drives' positions are counted from their own first fix.
    """
    paths = [one.windows.measured[:, [EAST, NORTH]] for one in (recorded, simulated)]
    path, other = (one[np.isfinite(one).all(axis=1)] for one in paths)
    if min(len(path), len(other)) < SETTINGS.preparation.min_driving_s:
        distance, driven = (float(one.reference.motion.distance_m[-1]) for one in (recorded, simulated))
        far = abs(distance - driven) > 0.3 * max(distance, driven)
        return f"{driven / 1e3:.1f} km long, the recording {distance / 1e3:.1f} km" if far else ""
    from scipy.spatial import cKDTree  # of two drives only

    off, _ = cKDTree(other).query(path)
    share = float(
        np.mean(off < SETTINGS.preparation.near_m + SETTINGS.preparation.near_share * np.hypot(*path.T))
    )
    if share >= 0.5:
        return ""
    return (
        f"{100 * (1 - share):.0f} % of the recording lies beside it"
        f" (by {np.median(off):.0f} m in the median, both counted from their first fix)"
    )


def limited_readers(
    readers: Sequence[Reader], windows: int = MAX_WINDOWS, drives: int = SETTINGS.preparation.max_drives
) -> tuple[list[Reader], list[str]]:
    """Return at most `drives` readers (those with most driving) of at most `windows` windows in all, and
    notes on the rest."""
    notes = []
    most = sorted(range(len(readers)), key=lambda k: -_driving_windows(readers[k]))[:drives]
    for k, reader in enumerate(readers):
        if k not in most:
            notes.append(f"{reader.recording.name}: left out, for {drives} drives hold more driving")
    kept = [reader for k, reader in enumerate(readers) if k in most]
    shares = fair_shares([_driving_windows(reader) for reader in kept], windows)
    out = []
    for reader, share in zip(kept, shares, strict=True):
        if share < len(reader.windows):
            reader = Reader(reader.recording, reader.reference, share)
        if reader.left_out:
            notes.append(_examined_note(reader))
        out.append(reader)
    return out, notes


def fair_shares(wanted: Sequence[int], total: int) -> list[int]:
    """Return what each gets of a total: all that it wants if that is no more than an equal share, else the
    most that is left for it.
    """
    shares = [0] * len(wanted)
    left = total
    order = sorted(range(len(wanted)), key=lambda k: wanted[k])
    for position, k in enumerate(order):
        shares[k] = min(wanted[k], left // (len(order) - position))
        left -= shares[k]
    return shares


def unfit_reason(recording: Recording) -> str:
    """Return the reason why a recording cannot be examined; empty if it can."""
    if not {RL, RR} <= set(recording.wheels):
        return "the rear wheels are not both read"
    if recording.ticks * recording.dt_s < SETTINGS.preparation.min_driving_s:
        return f"the drive is shorter than {SETTINGS.preparation.min_driving_s} s"
    return ""


def unfit_windows_reason(reader: Reader) -> str:
    """Return the reason why too few windows are left to compare; empty if there are enough."""
    windows = reader.windows
    if len(windows) < SETTINGS.preparation.min_driving_s:
        min_s = SETTINGS.preparation.min_driving_s
        return f"only {len(windows)} s of driving with all wheels read, {min_s} s are needed"
    gnss = np.isfinite(windows.measured[:, 5:CHANNELS]).any(axis=1).sum()
    if gnss < SETTINGS.preparation.min_driving_s / 2:
        return f"the receiver speaks in only {gnss} s of the driving"
    return ""


def _examined_note(reader: Reader) -> str:
    """Return the note that only part of a drive's windows was examined."""
    return (
        f"{reader.recording.name}: of {_driving_windows(reader)} s of driving, {len(reader.windows)} s in"
        " stretches spread over the drive were examined"
    )


def _driving_windows(reader: Reader) -> int:
    """Return the number of windows of driving, the left-out ones included."""
    return len(reader.windows) + reader.left_out
