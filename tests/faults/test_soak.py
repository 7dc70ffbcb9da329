"""The short version of `make soak`: twenty minutes of driving with faults, in logical time."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from tests.faults.drives import METHODS
from tests.faults.soak import OFFSET_M, Mark, Soaked, problems, soak
from tests.faults.soak_week import day, week


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


def test_a_week_has_weather_tyres_clocks_and_one_puncture() -> None:
    """What is special on the days: named sets when tyres are changed and at the very first, wrong clocks on
    two days, radii that follow the weather by 0.56 mm in 20 K, a puncture on the last day alone."""
    days = [day(number, 7) for number in range(7)]
    assert ["summer", None, None, "winter", None, "summer", None] == [one.tyres for one in days]
    assert [False] * 6 + [True] == [one.punctured for one in days]
    at_start_s = [one.start_s + one.clock_off_s for one in days]
    assert [1] == [k for k, time_s in enumerate(at_start_s) if time_s < 86_400.0]
    assert [1, 5] == [k for k, one in enumerate(days) if one.clock_off_s]
    warm, cold = np.array(days[2].offset_m), np.array(days[1].offset_m)
    assert np.allclose(14.0 / 20.0 * 0.56e-3, warm - cold)
    larger_m = np.array(days[3].offset_m) - warm
    assert 0.1e-3 < np.ptp(larger_m) < 0.5e-3  # other tyres, alike among themselves: none looks soft
    assert {86_400.0} == {later.start_s - one.start_s for one, later in itertools.pairwise(days)}


def test_two_days_with_one_state(tmp_path: Path) -> None:
    """A day that learns, and one that begins in 1970 with what the first has left: no false alarm, the
    puncture at its end is found."""
    result = week(2, 1, tmp_path, "mpf-pn", legs=1, leg_s=300.0)

    assert () == result.problems
    assert [False, True] == [bool(one.tyre_alarms) for one in result.days]
    assert result.days[0].answer.startswith(
        b'{"schema": "tpmsd.status/2"'
    )  # a reset that is refused is an error
