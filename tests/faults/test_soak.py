"""The short version of `make soak`: twenty minutes of driving with faults, in logical time."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.faults.drives import METHODS
from tests.faults.soak import OFFSET_M, Mark, Soaked, problems, soak


@pytest.mark.parametrize("method", METHODS)
def test_twenty_minutes_of_faults_leaves_nothing_behind(tmp_path: Path, method: str) -> None:
    """Two legs with a fault after the other: no false alarm, the puncture found, memory, descriptors and tick
    rate steady, and the radii those of the car."""
    result = soak(2, 1, tmp_path, leg_s=600.0, method=method)

    assert [] == problems(result)
    assert 10 * 2 * 720 * 0.98 <= result.marks[-1].ticks
    assert sum(result.happened.values()) >= 5


@pytest.mark.parametrize(
    ("off_mm", "std_mm", "wrong"),
    [(0.61, 0.24, []), (0.61, 0.12, ["leg 3: radii off by 0.61 mm, 5.1 of their standard deviations"])],
)
def test_radii_are_held_against_what_the_estimate_states(
    off_mm: float, std_mm: float, wrong: list[str]
) -> None:
    """Half a millimetre off is wrong where the estimate claims to know better, and not just after a fault."""
    soaked = Soaked(puncture_s=4000.0, alarms=[(4010.0, "deflation", "rr", "raised")])
    for leg in range(4):
        off_m = [offset + (1e-3 * off_mm if leg == 2 else 0.0) for offset in OFFSET_M]
        time_s = 1020.0 * (leg + 1)
        mark = Mark(leg, round(10.0 * time_s), time_s, 60_000, 13, off_m, [1e-3 * std_mm] * 4)
        soaked.marks.append(mark)
    assert wrong == problems(soaked)
