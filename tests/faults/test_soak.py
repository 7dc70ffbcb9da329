"""The short version of `make soak`: twenty minutes of driving with faults, in logical time."""

from __future__ import annotations

from pathlib import Path

from tests.faults.soak import problems, soak


def test_twenty_minutes_of_faults_leaves_nothing_behind(tmp_path: Path) -> None:
    """Two legs with a fault after the other: no false alarm, the puncture found, memory, descriptors and tick
    rate steady, and the radii those of the car."""
    result = soak(2, 1, tmp_path, leg_s=600.0)

    assert [] == problems(result)
    assert 10 * 2 * 720 * 0.98 <= result.marks[-1].ticks
    assert sum(result.happened.values()) >= 5
