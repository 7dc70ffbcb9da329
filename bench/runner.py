"""Work that is done once per state of the program, in some processes, and resumed where it was left.

In: units of work (tuples or frozen dataclasses of plain values) and a function of a unit. Out: their results.
Each result is a line of a file at once, `{"unit": [...], "state": "...", "result": ...}`; a line that was cut
off is passed over, and one of another state of the program does not count.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import sys
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from bench.registry import UsageError

Unit = TypeVar("Unit", bound=Hashable)


@dataclass(frozen=True)
class Entry:
    """A line of the file."""

    unit: str
    """The unit as JSON."""
    state: str
    result: Any


def key_of(unit: Any) -> str:
    """A unit as JSON."""
    return json.dumps(dataclasses.astuple(unit) if dataclasses.is_dataclass(unit) else unit)  # type: ignore[arg-type]


def read(file: Path) -> list[Entry]:
    """All whole lines of a file; none if there is no file."""
    entries = []
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else []:
        try:
            entry = json.loads(line)
            entries.append(Entry(json.dumps(entry["unit"]), entry["state"], entry["result"]))
        except (ValueError, KeyError, TypeError):
            continue
    return entries


def last_state(file: Path, any_state: bool = False) -> list[Any]:
    """The results of the state that was written last, or of all; each unit's latest."""
    entries = read(file)
    kept = {entry.unit: entry.result for entry in entries if any_state or entry.state == entries[-1].state}
    return list(kept.values())


def rows_in(out: Path) -> list[Any]:
    """The rows of all units of the last state in a folder's results; UsageError where there are none."""
    rows = [row for unit in last_state(out / "results.jsonl") for row in unit]
    if not rows:
        raise UsageError(f"no results in {out}")
    return rows


def code_state(*roots: Path) -> str:
    """Checksum of some Python sources, and of those below some folders."""
    digest = hashlib.sha256()
    for root in roots:
        for path in [root] if root.is_file() else sorted(root.rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def each(
    units: Sequence[Unit],
    work: Callable[[Unit], Any],
    jobs: int,
    minutes: float = math.inf,
    apart: bool = False,
) -> Iterator[tuple[Unit, Any]]:
    """Units with their results as they come; none is begun after that time.

    One job works in this process, unless it is to work `apart`, so that what piles up in memory burdens
    nothing else.
    """
    ends = time.monotonic() + 60.0 * minutes
    waiting = list(units)[::-1]
    if jobs == 1 and not apart:
        while waiting and time.monotonic() < ends:
            unit = waiting.pop()
            yield unit, work(unit)
    else:
        running: dict[Future[Any], Unit] = {}
        with ProcessPoolExecutor(jobs) as pool:
            while (waiting and time.monotonic() < ends) or running:
                while waiting and len(running) < jobs and time.monotonic() < ends:
                    unit = waiting.pop()
                    running[pool.submit(work, unit)] = unit
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    yield running.pop(future), future.result()
    if waiting:
        print(f"time is up: {len(waiting)} were not begun", file=sys.stderr)


def resume(
    file: Path,
    state: str,
    units: Iterable[Unit],
    work: Callable[[Unit], Any],
    line: Callable[[Unit, Any], str],
    *,
    jobs: int = 1,
    minutes: float | None = None,
    any_state: bool = False,
    apart: bool = False,
    after: Callable[[dict[str, Any]], None] = lambda done: None,
    again: Callable[[Any], bool] = lambda result: False,
) -> list[tuple[Unit, Any]]:
    """Do what the file does not hold yet; units and results in the order of the units.

    `line` says of a result what is printed to standard error; `after` gets all results by `key_of` after each
    unit; `again` is true of results that do not count. Interrupted, it keeps what is done.
    """
    wanted = list(units)
    done = {
        entry.unit: entry.result
        for entry in read(file)
        if (any_state or entry.state == state) and not again(entry.result)
    }
    todo = [unit for unit in wanted if key_of(unit) not in done]
    if len(todo) < len(wanted):
        print(f"{len(wanted) - len(todo)} of {len(wanted)} stand in {file}", file=sys.stderr)
    file.parent.mkdir(parents=True, exist_ok=True)
    begun = time.monotonic()
    cut_off = file.exists() and not file.read_bytes().endswith(b"\n")
    with file.open("a", encoding="utf-8") as log:
        log.write("\n" if cut_off else "")
        try:
            found = each(todo, work, jobs, math.inf if minutes is None else minutes, apart)
            for number, (unit, result) in enumerate(found, start=1):
                entry = {"unit": json.loads(key_of(unit)), "state": state, "result": result}
                log.write(json.dumps(entry, default=float) + "\n")
                log.flush()
                done[key_of(unit)] = result
                left = (time.monotonic() - begun) / number * (len(todo) - number) / 60.0
                reported = f"{number}/{len(todo)}, {left:.0f} min left: {line(unit, result)}"
                print(reported, file=sys.stderr, flush=True)
                after(done)
        except KeyboardInterrupt:
            print("interrupted: what was done is kept", file=sys.stderr)
    return [(unit, done[key_of(unit)]) for unit in wanted if key_of(unit) in done]
