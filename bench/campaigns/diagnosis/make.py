"""Makes a case's drive.

In: `Case`. Out: the drive, its course and its windows. The multi-body courses come from a cache.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.campaigns.diagnosis.draw import Case
from bench.campaigns.diagnosis.signals import Windows, windows_of
from bench.worlds import kinematic
from bench.worlds.course import Course
from bench.worlds.instruments import Drive, observe


@dataclass(frozen=True)
class Made:
    """A drive and what its windows show."""

    drive: Drive
    windows: Windows


def make(case: Case, courses: Path) -> Made:
    """Drive the case."""
    rng = np.random.default_rng(case.world_seed)
    course: Course
    spec = case.spec
    if case.world == "kinematic":
        course = kinematic.course(spec, rng)
    else:
        from bench.worlds.multibody import piece

        course, spec = piece(spec, rng, courses)
    drive = observe(course, spec, rng, case.world_seed)
    return Made(drive, windows_of(course, drive))
