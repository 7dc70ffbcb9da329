"""The short version of `make soak`: half an hour of driving with faults, in logical time."""

from __future__ import annotations

from pathlib import Path

from tests.faults.soak import problems, soak


def test_half_an_hour_of_faults_leaves_nothing_behind(tmp_path: Path) -> None:
    """Two legs with a fault after the other: no false alarm, the puncture found, memory, descriptors and tick
    rate steady, and the radii those of the car."""
    result = soak(2, 1, tmp_path)

    assert [] == problems(result, 2)
    assert 10 * 2 * 1020 * 0.98 <= result.marks[-1].ticks
    assert sum(result.happened.values()) >= 8
