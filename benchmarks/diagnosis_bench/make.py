"""Makes a case's drive.

In: `Case`. Out: the drive, its course and its windows. The multi-body courses come from a cache.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.diagnosis_bench.draw import Case
from benchmarks.diagnosis_bench.signals import Windows, windows_of
from tests.worlds import kinematic
from tests.worlds.course import Course
from tests.worlds.instruments import Drive, observe


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
        from tests.worlds.multibody import piece

        course, spec = piece(spec, rng, courses)
    drive = observe(course, spec, rng, case.world_seed)
    return Made(drive, windows_of(course, drive))
