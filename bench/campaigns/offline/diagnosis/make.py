"""Makes a case's drive.

In: `Case`. Out: the drive, its course and its windows. Integrated and simulated courses come from a cache.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.campaigns.offline.diagnosis.draw import Case
from bench.campaigns.offline.diagnosis.signals import Windows, windows_of
from bench.places import RECORDINGS
from bench.worlds.instruments import Drive
from bench.worlds.origins import ORIGINS, Places


@dataclass(frozen=True)
class Made:
    """A drive and what its windows show."""

    drive: Drive
    windows: Windows


def make(case: Case, courses: Path) -> Made:
    """Drive the case."""
    rng = np.random.default_rng(case.world_seed)
    places = Places(RECORDINGS, courses)
    course, drive = ORIGINS[case.world].drive(case.spec, rng, case.world_seed, places)
    return Made(drive, windows_of(course, drive))
