"""A week in logical time: every day a start of its own, with other weather, other tyres or a wrong clock.

In: days, a seed, a filter. Out: what the daemon made of it, day by day. Each day is one of `soak`: the whole
daemon, faults of bus, receiver, clock and clients in turn. The state file is all that a day leaves to the
next.

    python -m tests.faults.soak --week
    python -m tests.faults.soak --week --days 2 --method mpf-pn
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.faults.soak import LEG_S, OFFSET_M, START_S, USUAL, Mark, Soaked, Special, problems, soak

DAY_S = 86_400.0
LEGS = 3
PER_KELVIN_M = 28e-6
"""Of all radii: 0.56 mm in 20 K on a 205/60R15 [Besselink, Schmeitz and Pacejka 2010]."""
WEATHER_K = (0.0, -8.0, 6.0, -3.0, -12.0, 4.0, 0.0)
"""Warmer than on the first day."""
WINTER_M = (2.2e-3, 0.4e-3, 0.3e-3, 1.7e-3)
"""True minus nominal radii of the other set: larger as a whole by 1.2 mm, its tyres alike to 0.3 mm. One
that is millimetres smaller than the other three is announced as soft (docs/explanation/alarms.md)."""
WINTER = (3, 4)
"""Days on which the other set is mounted, counted from 0."""
CLOCKS_S = {1: -START_S + 60.0, 5: 3600.0}
"""Days that begin with a wrong clock: at 1970, an hour fast."""


def day(number: int, days: int) -> Special:
    """What is special on a day; the last one ends with a puncture."""
    warm_m = PER_KELVIN_M * WEATHER_K[number % len(WEATHER_K)]
    winter = number % 7 in WINTER
    before = (number - 1) % 7 in WINTER if number else False
    tyres = None if winter == before and number else "winter" if winter else "summer"
    start_s = START_S + number * DAY_S
    clock_off_s = CLOCKS_S.get(number % 7, 0.0)
    return replace(
        USUAL,
        offset_m=tuple(offset + warm_m for offset in (WINTER_M if winter else OFFSET_M)),
        start_s=start_s,
        punctured=number == days - 1,
        tyres=tyres,
        clock_off_s=clock_off_s if clock_off_s >= 0.0 else 60.0 - start_s,
    )


@dataclass(frozen=True)
class Week:
    """All days, and what was not as it should be."""

    days: tuple[Soaked, ...]
    problems: tuple[str, ...]


def week(
    days: int,
    seed: int,
    folder: Path,
    method: str,
    reported: Callable[[int, Mark, Soaked], None] = lambda number, mark, so_far: None,
    legs: int = LEGS,
    leg_s: float = LEG_S,
) -> Week:
    """Live so many days with one state file."""
    found: list[Soaked] = []
    wrong: list[str] = []
    for number in range(days):
        special = day(number, days)

        def tell(mark: Mark, so_far: Soaked, number: int = number) -> None:
            reported(number, mark, so_far)

        one = soak(legs, 100 * seed + number, folder, tell, leg_s, method, special)
        found.append(one)
        wrong += [f"day {number + 1}: {line}" for line in problems(one) if _counts(line, special)]
        if special.tyres is not None and b"error" in one.answer:
            wrong.append(f"day {number + 1}: the reset was refused: {one.answer!r}")
        if not (folder / "state.json").is_file():
            wrong.append(f"day {number + 1}: no state was left")
    return Week(tuple(found), tuple(wrong))


def _counts(line: str, special: Special) -> bool:
    """Ticks are not counted where the clock was set by more than faults set it."""
    return special.clock_off_s == 0.0 or " ticks instead of " not in line


def main(days: int, seed: int, method: str) -> int:
    """Live a week and say how it went; 1 if something is not as it should be."""

    def reported(number: int, mark: Mark, so_far: Soaked) -> None:
        off_mm = 1e3 * (np.array(mark.deviation_m) - so_far.offset_m)
        print(
            f"day {number + 1}/{days} leg {mark.leg + 1}  {mark.rss_kb / 1024:6.1f} MB  "
            f"{mark.descriptors:3d} fds  radii off "
            f"{np.array2string(off_mm, precision=2, floatmode='fixed')} mm (+- {1e3 * max(mark.std_m):.2f})  "
            f"{len(so_far.tyre_alarms)} alarm events of tyres",
            flush=True,
        )

    with tempfile.TemporaryDirectory(prefix="tpmsd-week-") as folder:
        result = week(days, seed, Path(folder), method, reported)
    for number, one in enumerate(result.days):
        if one.tyre_alarms:
            print(f"day {number + 1}: tyre alarms {[(round(t), *rest) for t, *rest in one.tyre_alarms]}")
    memory = [mark.rss_kb / 1024.0 for one in result.days for mark in one.marks]
    hours = sum(one.marks[-1].elapsed_s for one in result.days) / 3600.0
    print(f"{hours:.1f} h of {days} days; memory {memory[0]:.1f} to {memory[-1]:.1f} MB")
    for problem in result.problems:
        print(f"WRONG: {problem}")
    return 1 if result.problems else 0
