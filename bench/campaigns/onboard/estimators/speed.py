"""Run time per tick: of every method over N, of a library's filter, of a compiled kernel, and where it goes.

In: the ticks of one drive. Out: plain numbers. All is processor time of this process, in which nothing
else runs meanwhile; each figure is the least of several passes, for other work on the machine only ever
adds to it.
"""

from __future__ import annotations

import cProfile
import os
import pstats
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.onboard.estimators.kernel import Kernel, compile_kernel
from bench.campaigns.onboard.estimators.library import LibraryAugPf
from bench.campaigns.onboard.estimators.methods import (
    DEFAULT,
    SAMPLED,
    TEXTBOOK,
    available,
    build,
)
from bench.campaigns.onboard.estimators.tasks import NUMBERS, USUAL, driven
from tpmsd.onboard.estimators.base import Estimator
from tpmsd.onboard.timeline.tick import Tick

WARM_TICKS = 2300
"""Well into the rural road: every filter has its pose, and every tick is informative."""
TIMED_TICKS = 600
PASSES = 3
TURNS = 4
"""Parts of a pass, after each of which the next method is timed."""
LONG_NUMBERS = (*NUMBERS, 20_000)
"""The last tells whether the cost is linear beyond the paper's range."""


def min_ms(step: Callable[[Tick], Any], ticks: list[Tick], timed: int, passes: int) -> float:
    """Least processor time per tick over several passes along the drive, in ms."""
    best = float("inf")
    for k in range(passes):
        some = ticks[k * timed : (k + 1) * timed]
        begun = time.process_time()
        for tick in some:
            step(tick)
        best = min(best, (time.process_time() - begun) / len(some))
    return 1e3 * best


def time_methods(quick: bool, say: Callable[[str], None]) -> dict[str, dict[str, float]]:
    """Method -> number of particles ('0': its own) -> ms per tick; the default on four wheels too.

    The methods take turns over the same stretch: a machine is quick in one minute and slow in another, and so
    all of them meet both.
    """
    ticks = driven("puncture", "correlated", 0).ticks
    have, _ = available()
    out: dict[str, dict[str, float]] = {}
    filters: list[tuple[str, int, Estimator]] = []
    for method, front in [(m, False) for m in have] + [(DEFAULT, True)]:
        name = f"{method}, four wheels" if front else method
        out[name] = {}
        for number in LONG_NUMBERS if method in SAMPLED else (0,):
            estimator = build(method, number or None, 1, front)
            for tick in ticks[WARM_TICKS - (300 if number >= 5000 else 600) : WARM_TICKS]:
                estimator.step(tick)
            filters.append((name, number, estimator))
            out[name][str(number)] = float("inf")
    turns = TURNS * PASSES
    for turn in range(turns):
        for name, number, estimator in filters:
            many = number >= 5000
            timed = (40 if many and quick else 150 if many else TIMED_TICKS) // TURNS
            some = ticks[WARM_TICKS + turn * timed :]
            least = min_ms(estimator.step, some, timed, 1)
            out[name][str(number)] = min(out[name][str(number)], least)
        say(f"run time of {len(filters)} filters, turn {turn + 1} of {turns}")
    for name, number, _ in filters:
        say(f"{name} N={number or 'own'}: {out[name][str(number)]:.3f} ms per tick")
    return out


def linearity(cost_ms: dict[str, float]) -> dict[str, float]:
    """Least squares cost = fixed + each N, relative errors counted; and the growth from 5000 to 20000."""
    numbers = np.array([float(n) for n in cost_ms])
    costs = np.array(list(cost_ms.values()))
    A = np.stack([np.ones_like(numbers), numbers], axis=1) / costs[:, None]
    fixed, each = np.linalg.lstsq(A, np.ones_like(costs), rcond=None)[0]
    worst = float(np.abs((fixed + each * numbers) / costs - 1.0).max())
    return {"fixed_ms": float(fixed), "per_1000_ms": float(1e3 * each), "worst_misfit": worst}


def time_library() -> dict[str, float]:
    """The augmented particle filter of the library `particles`, ms per tick, on the same ticks."""
    ticks = driven("puncture", "correlated", 0).ticks
    part = ticks[WARM_TICKS - 200 : WARM_TICKS + PASSES * TIMED_TICKS + 10]
    filter_ = LibraryAugPf(part, USUAL, seed=1)
    for _ in range(200):
        filter_.step()
    return {str(USUAL): min_ms(lambda _: filter_.step(), part[200:], TIMED_TICKS, PASSES)}


def time_kernel() -> dict[str, float] | str:
    """The compiled kernel, ms per tick by number of particles; without a compiler a line that says so."""
    library = compile_kernel()
    if isinstance(library, str):
        return library
    ticks = driven("puncture", "correlated", 0).ticks
    out = {}
    for number in LONG_NUMBERS:
        kernel = Kernel(library, number, seed=1)
        for tick in ticks[WARM_TICKS - 600 : WARM_TICKS]:
            kernel.step(tick)
        timed = 150 if number >= 5000 else TIMED_TICKS
        out[str(number)] = min_ms(kernel.step, ticks[WARM_TICKS:], timed, PASSES)
    return out


def where_the_time_goes(number: int = USUAL) -> dict[str, float]:
    """Share of each module in a tick of the textbook MPF-PN, and calls per tick.

    What NumPy does is put down to the module that asked for it. The profiler adds a cost to each call, so
    modules of many small calls come out somewhat too large. The random numbers, of which it knows
    nothing, are measured apart and taken out of the share of `niw`, which draws them.
    """
    ticks = driven("puncture", "correlated", 0).ticks
    estimator: Estimator = build(TEXTBOOK, number, 1)
    for tick in ticks[WARM_TICKS - 600 : WARM_TICKS]:
        estimator.step(tick)
    profile = cProfile.Profile(time.process_time)
    some = ticks[WARM_TICKS : WARM_TICKS + 2 * TIMED_TICKS]
    profile.enable()
    for tick in some:
        estimator.step(tick)
    profile.disable()
    entries: dict[Function, Entry] = vars(pstats.Stats(profile))["stats"]
    total = sum(entry[2] for entry in entries.values())
    shares: dict[str, float] = {}
    for function, entry in entries.items():
        for place, own in owners(function, entry).items():
            shares[place] = shares.get(place, 0.0) + own / total
    drawn = random_ms(number) * len(some) / (1e3 * total)
    shares["random numbers"] = drawn
    shares["niw"] = shares.get("niw", 0.0) - drawn
    small = {name for name, share in shares.items() if share < 0.02}
    out = {name: share for name, share in shares.items() if name not in small}
    out["the rest"] = sum(shares[name] for name in small)
    return dict(sorted(out.items(), key=lambda item: -item[1])) | {
        "calls_per_tick": sum(entry[1] for entry in entries.values()) / len(some)
    }


Function = tuple[str, int, str]
Entry = tuple[int, int, float, float, dict[Function, tuple[int, int, float, float]]]


def owners(function: Function, entry: Entry) -> dict[str, float]:
    """Module -> own time of a function: its own if it is the program's, else that of those who call it."""

    def place(file: str) -> str:
        return Path(file).stem if f"{os.sep}tpmsd{os.sep}" in file else "NumPy's own Python"

    if f"{os.sep}tpmsd{os.sep}" in function[0] or not entry[4]:
        return {place(function[0]): entry[2]}
    out: dict[str, float] = {}
    for caller, spent in entry[4].items():
        name = place(caller[0])
        out[name] = out.get(name, 0.0) + spent[2]
    return out


def random_ms(number: int) -> float:
    """Cost of the numbers that one tick of MPF-PN draws: a Student-t in two dimensions per particle."""
    rng = np.random.default_rng(1)
    best = float("inf")
    for _ in range(5):
        begun = time.process_time()
        for _ in range(200):
            rng.standard_normal((number, 2))
            rng.chisquare(500.0, number)
        best = min(best, (time.process_time() - begun) / 200)
    return 1e3 * best


def all_figures(full: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Everything that is timed."""
    methods = time_methods(not full, say)
    library, kernel = time_library(), time_kernel()
    say(f"library N={USUAL}: {library[str(USUAL)]:.3f} ms per tick")
    say(f"kernel: {kernel}")
    return {
        "methods_ms": methods,
        "linear": {name: linearity(cost) for name, cost in methods.items() if len(cost) > 2},
        "library_ms": library,
        "kernel_ms": kernel,
        "where": where_the_time_goes(),
    }
