"""Rotations and readings of the ticks that a decoded block covers, computed at once.

In: the tracks of a timeline, a decoded block, the edges of the ticks to come. Out: `TickPlan`: for each tick
the very numbers that the tracks would give once its frames were played, and which frames those are. Pure; no
track is changed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.sources.ahead.decoded_block import DecodedBlock
from tpmsd.onboard.timeline.reading_track import ReadingTrack
from tpmsd.onboard.timeline.rotation_track import RotationTrack


class TickReadings(NamedTuple):
    """Rotations and readings of one tick."""

    rotation_rad: FloatArray
    """(4,)"""
    rotation_std_rad: FloatArray
    """(4,)"""
    means: dict[str, float]
    """Means by field of `Tick`."""


class TickPlan:
    """Rotations and readings of n ticks that follow each other."""

    def __init__(
        self,
        first: int,
        ends_s: FloatArray,
        rotation_rad: FloatArray,
        rotation_std_rad: FloatArray,
        means: Mapping[str, FloatArray],
        needs: NDArray[np.intp],
    ) -> None:
        """`first`: index of the first; ends (n,), rotations (n, 4), means (n,) by field of `Tick`; `needs`
        (n,): index in the block before which all frames must have been played."""
        self._first = first
        self._ends_s: list[float] = ends_s.tolist()
        self._rotation, self._std = rotation_rad, rotation_std_rad
        self._fields = tuple(means)
        self._means = list(zip(*(value.tolist() for value in means.values()), strict=True)) or [()] * len(
            needs
        )
        self._needs: list[int] = needs.tolist()

    def tick(self, index: int, end_s: float, frame: int) -> TickReadings | None:
        """Return the tick of this index and end; None if it is not in the plan or needs the frame `frame` or
        later ones."""
        row = index - self._first
        if not (0 <= row < len(self._needs) and self._needs[row] <= frame and self._ends_s[row] == end_s):
            return None
        means = dict(zip(self._fields, self._means[row], strict=True))
        return TickReadings(self._rotation[row], self._std[row], means)


def plan_ticks(
    decoded: DecodedBlock,
    shift_s: float,
    tracks: Sequence[RotationTrack],
    readings: Mapping[str, tuple[str, ReadingTrack]],
    first: int,
    edges_s: FloatArray,
) -> TickPlan | None:
    """Return the plan of the ticks that a decoded block covers.

    `shift_s`: logical time minus the host's; `tracks` of the four wheels; `readings`: role and track by field
    of `Tick`, of all roles that are in a track or in the block; `first`: index of the tick between the
    first two edges (n + 1,). None where the tracks would leave out or sort what the block holds, or where it
    covers no tick.
    """
    times_s = [group.time_s + shift_s for group in decoded.groups]
    ticks = len(edges_s) - 1
    rotation, std = np.full((ticks, 4), math.nan), np.full((ticks, 4), math.nan)
    needs = np.zeros(ticks, dtype=np.intp)
    decoded_wheels = {angles.wheel for angles in decoded.wheels}
    further = {values.role: values for values in decoded.readings}
    if len(decoded_wheels) < len(decoded.wheels) or len(further) < len(decoded.readings):
        return None  # some of them twice
    if any(wheel not in decoded_wheels and not track.is_empty for wheel, track in enumerate(tracks)):
        return None
    for angles in decoded.wheels:
        found = tracks[angles.wheel].rotations_ahead(
            *(times_s[angles.group], angles.angle_rad, angles.segment, angles.quantum_rad, edges_s)
        )
        if found is None:
            return None
        ticks = min(ticks, len(found.needs))
        rotation[:ticks, angles.wheel] = found.rotation_rad[:ticks]
        std[:ticks, angles.wheel] = found.std_rad[:ticks]
        needs[:ticks] = np.maximum(needs[:ticks], _frames_needed(decoded, angles.group, found.needs[:ticks]))
    if not ticks:
        return None
    means: dict[str, FloatArray] = {}
    nothing = np.zeros(0)
    for field, (role, track) in readings.items():
        values = further.get(role)
        new = (nothing, nothing) if values is None else (times_s[values.group], values.value)
        mean = track.means_ahead(*new, edges_s[1 : ticks + 1])
        if mean is None:
            return None
        means[field] = mean.value
        if values is not None:
            needs[:ticks] = np.maximum(needs[:ticks], _frames_needed(decoded, values.group, mean.needs))
    return TickPlan(first, edges_s[1 : ticks + 1], rotation[:ticks], std[:ticks], means, needs[:ticks])


def _frames_needed(decoded: DecodedBlock, group: int, readings: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the (n,) index in the block before which all frames must have been played for so many readings
    (n,) of a group; 0 for none."""
    return np.append(0, decoded.groups[group].indices + 1)[np.maximum(readings, 0)]
