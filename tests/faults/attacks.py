"""Longer drives for attackers: simulated once, their ticks and frames changed, played through the core.

    python -m tests.faults.attacks                          every attack, three drives, both filters: minutes
    python -m tests.faults.attacks --drives rural --methods mpf-pn --only "frames twice"
    python -m tests.faults.attacks --tests                  and the tests that SECURITY.md names, by pytest
    python -m tests.faults.attacks --summary FILE           a row per attack, of the rows that were printed

In: attacks. Out: a table with a row per attack, drive and filter. The rule is that of SECURITY.md: no false
alarm of a tyre, and a `malfunction` within ten minutes of driving or right work. Right work means that the
wheels are monitored at the end and that no radius is further from that of the same drive unattacked than
`FAR_STDS` of its own standard deviations.
"""

from __future__ import annotations

import argparse
import functools
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.faults import attack_changes as changes
from tests.faults import drives
from tests.faults.drives import Change, Item, Outcome, with_method
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.offline.simulator.bus import BusSpec
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.can.signal_plan import compile_plans
from tpmsd.onboard.sources.drive import FolderStream, Sentence
from tpmsd.onboard.timeline.tick import Tick
from tpmsd.onboard.timeline.tick_source import TickSource

REPO = Path(__file__).resolve().parents[2]
DURATION_S = 420.0
SEED = 11
ROUTE = "rural"
ROUTES = {"rural": 11, "motorway": 5, "mixed": 7}
"""Route and seed of the drives of the command; the tests play the first."""
FAR_STDS = 3.0
SOON_S = 600.0


@functools.cache
def attacked(route: str = ROUTE) -> tuple[Config, tuple[Item, ...], tuple[Tick, ...]]:
    """Configuration, items and ticks of a drive; the tyres are sound, the bus has wheels alone."""
    folder = Path(tempfile.mkdtemp(prefix="tpmsd-attacks-"))
    spec = DriveSpec(route, DURATION_S, ROUTES[route], bus=BusSpec(kind="counts16"))
    write_drive(folder, simulate_drive(spec))
    config = load_config(folder)
    signals = {role: name for role, name in config.can.signals.items() if role.startswith("wheel_")}
    config = replace(
        config, can=replace(config.can, signals=signals), filter=replace(config.filter, particles=10)
    )
    database = load_database(config.can.dbc)
    keys = compile_plans(config, database)
    items = tuple(i for i in FolderStream(folder) if isinstance(i, Sentence) or i.arbitration_id in keys)
    source = TickSource(config, database)
    ticks: list[Tick] = []
    for item in items:
        ticks += fed(source, item)
    return config, items, (*ticks, *source.finish())


def fed(source: TickSource, item: Item) -> list[Tick]:
    if isinstance(item, CanFrame):
        return source.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
    return source.on_sentence(item.time_s, item.line)


def played_ticks(change: Callable[[list[Tick], float], Iterable[Tick]], route: str = ROUTE) -> Outcome:
    """Play the ticks as changed."""
    config, _, ticks = attacked(route)
    start_s = ticks[0].time_s
    outcome = Outcome(start_s)
    outcome.pipeline = Pipeline(with_method(config), load_database(config.can.dbc))
    for tick in change(list(ticks), start_s):
        outcome.steps.append(outcome.pipeline.on_tick(tick))
    return outcome


@functools.cache
def unattacked(route: str, method: str) -> Outcome:
    """The drive as it is, played with this filter, which is the one that drives are played with meanwhile."""
    assert method == drives.PLAYED_WITH[-1]
    return played_ticks(lambda ticks, start_s: ticks, route)


def played_items(change: Callable[[list[Item], float], Iterable[Item]], route: str = ROUTE) -> Outcome:
    """Play the frames and sentences as changed, from the decoder on."""
    config, items, _ = attacked(route)
    start_s = items[0].time_s
    outcome = Outcome(start_s)
    pipeline = outcome.pipeline = Pipeline(with_method(config), load_database(config.can.dbc))
    for item in change(list(items), start_s):
        if isinstance(item, CanFrame):
            outcome.steps += pipeline.on_frame(item.time_s, item.arbitration_id, item.is_extended, item.data)
        else:
            outcome.steps += pipeline.on_sentence(item.time_s, item.line)
    outcome.steps += pipeline.finish()
    return outcome


@dataclass(frozen=True)
class Attack:
    """What is done to a drive."""

    name: str
    items: Change | None = None
    ticks: changes.TickChange | None = None
    """One of the two."""
    promised: bool = True
    """False where SECURITY.md says that it is not found out."""

    def play(self, route: str = ROUTE) -> Outcome:
        if self.items is not None:
            return played_items(self.items, route)
        assert self.ticks is not None
        return played_ticks(self.ticks, route)


ATTACKS = (
    *(
        Attack(f"frames twice, {1e3 * late_s:g} ms apart", changes.duplicated(late_s))
        for late_s in (0.0, 0.001, 0.009, 0.3)
    ),
    Attack("counters of the rear wheels exchanged", changes.exchanged(2, 3), promised=False),
    Attack("counters of the left wheels exchanged", changes.exchanged(0, 2), promised=False),
    Attack("left tyres rotated, 1 mm apart, no reset", ticks=changes.rotated_left, promised=False),
    Attack("stamps 0.3 s early every other five seconds", changes.early_stamps),
    Attack("wheel frames of a second node", changes.spoofed),
    Attack("counters frozen", changes.frozen_counters),
    Attack("rear left counter silent", ticks=changes.silent_counter(2)),
    *(Attack(f"host clock set by {s:+g} s", changes.clock_set(s)) for s in (-3600.0, -0.5, 0.5, 3600.0)),
    *(Attack(f"host clock {ppm:+g} ppm", changes.clock_rate(ppm)) for ppm in (-500.0, 500.0)),
    *(Attack(f"bus clock {ppm:+g} ppm", changes.clock_rate(ppm, bus_alone=True)) for ppm in (-500.0, 500.0)),
    *(Attack(f"UTC jumps by {s:+g} s", changes.utc_jumps(s)) for s in (-3600.0, -1.0, 1.0, 3600.0)),
    Attack("fixes of an earlier drive", ticks=changes.replayed_fixes),
    *(Attack(f"speed scaled by {p:+g} %", ticks=changes.speed_scaled(0.01 * p)) for p in (-3.0, 3.0)),
    *(
        Attack(f"speed and positions scaled by {p:+g} %", ticks=changes.receiver_scaled(0.01 * p))
        for p in (-0.3, 0.3)
    ),
    *(
        Attack(
            f"speed and positions scaled by {p:+g} % within minutes",
            ticks=changes.receiver_drifts(0.01 * p),
            promised=False,
        )
        for p in (-0.5, 0.5)
    ),
    Attack("positions frozen", changes.frozen_position),
    Attack("positions 10 km off for a while", changes.jumped_position),
    Attack("noise in place of sentences", changes.noise),
)


@dataclass(frozen=True)
class Verdict:
    """What came of an attack."""

    tyre_alarms: tuple[tuple[str, str | None], ...]
    malfunction_s: float
    """Time of the first one since the drive's beginning; NaN if there is none."""
    monitored: bool
    """At the end, all wheels."""
    off_m: float
    """The largest difference of a radius to that of the drive unattacked, at the end, ..."""
    off_stds: float
    """... and in standard deviations of what is stated."""

    @property
    def held(self) -> bool:
        """No tyre is accused, and the attack is told or does no harm."""
        reported = self.malfunction_s < SOON_S
        return not self.tyre_alarms and (reported or (self.monitored and self.off_stds <= FAR_STDS))


def verdict(outcome: Outcome, honest: Outcome) -> Verdict:
    """Hold a play against that of the same drive unattacked."""
    alarms = outcome.alarms
    last, true = outcome.steps[-1], honest.steps[-1]
    off = np.abs(last.estimate.deviation_m - true.estimate.deviation_m)
    stds = off / np.array([wheel.std_m for wheel in last.report.wheels])  # NaN where nothing is stated
    reported = any(kind == "malfunction" for kind, _, _ in alarms)
    return Verdict(
        tuple((kind, wheel) for kind, wheel, state in alarms if kind != "malfunction" and state == "raised"),
        outcome.when("malfunction") if reported else math.nan,
        {"monitoring"} == {str(wheel.state) for wheel in last.report.wheels},
        float(np.max(off)),
        float(np.max(stds)),
    )


def table(methods: list[str], routes: list[str], wanted: list[Attack]) -> int:
    """Print a row for each attack, drive and filter; the number of those that broke the rule."""
    print("| attack | drive | filter | tyre alarms | malfunction | monitored at the end | radii off | |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    broken = 0
    for route in routes:
        for method in methods:
            drives.PLAYED_WITH.append(method)
            honest = unattacked(route, method)
            for attack in wanted:
                found = verdict(attack.play(route), honest)
                broken += attack.promised and not found.held
                seen = "" if found.held else "BROKEN" if attack.promised else "not promised"
                reported = "-" if math.isnan(found.malfunction_s) else f"after {found.malfunction_s:.0f} s"
                named = ", ".join(f"{kind} {wheel or ''}".strip() for kind, wheel in found.tyre_alarms) or "-"
                print(
                    f"| {attack.name} | {route} | `{method}` | {named} | {reported} | "
                    f"{'yes' if found.monitored else 'no'} | {1e3 * found.off_m:.2f} mm, "
                    f"{found.off_stds:.1f} std | {seen} |",
                    flush=True,
                )
            drives.PLAYED_WITH.pop()
    return broken


def plays_of(text: str) -> dict[str, list[list[str]]]:
    """The rows of a printed table, cell by cell, under the name of their attack."""
    plays: dict[str, list[list[str]]] = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| ") and len(cells) == 8 and cells[0] not in ("attack", "---"):
            plays.setdefault(cells[0], []).append(cells)
    return plays


def summary(text: str) -> list[str]:
    """Fold a printed table into one with a row per attack that raised an alarm or broke the rule.

    A row has the plays, those with an alarm of a tyre, when a malfunction came, and the worst radii.
    A sentence names the other attacks.
    """
    plays = plays_of(text)
    out = ["| attack | plays | with a tyre alarm | malfunction | radii off, at most | broke the rule |"]
    out.append("| --- " * 6 + "|")
    quiet = []
    for name, rows in plays.items():
        alarms = {cells[3] for cells in rows} - {"-"}
        accused = sum(cells[3] != "-" for cells in rows)
        reported = [float(cells[4].split()[1]) for cells in rows if cells[4] != "-"]
        off_mm, stds = (max(float(cells[6].split()[k]) for cells in rows) for k in (0, 2))
        off = f"{off_mm:.2f} mm, {stds:.1f} std"
        verdicts = {cells[7] for cells in rows} - {""}
        if not alarms and not reported and not verdicts:
            quiet.append((stds, name, off))
            continue
        when = f"{len(reported)}, after {min(reported):.0f} to {max(reported):.0f} s" if reported else "-"
        broke = "not promised" if "not promised" in verdicts else sum(cells[7] == "BROKEN" for cells in rows)
        shown = f"{accused} ({'; '.join(sorted(alarms))})" if alarms else "0"
        out.append(f"| {name} | {len(rows)} | {shown} | {when} | {off} | {broke} |")
    return [*out, "", f"No alarm, and radii off: {without_alarm(quiet)}."]


def without_alarm(quiet: list[tuple[float, str, str]]) -> str:
    """Attacks (standard deviations, name, radii off) in words, those below one deviation together."""
    small = [entry for entry in quiet if entry[0] < 1.0]
    parts = [f"{name} ({off})" for stds, name, off in quiet if stds >= 1.0]
    if small:
        parts.append(f"{', '.join(name for _, name, _ in small)} (at most {max(small)[2]})")
    return "; ".join(parts) or "none"


def named_tests() -> list[str]:
    """Tests that SECURITY.md names, by pytest's own names."""
    from tests.faults.test_table import ATTACKS as DOCUMENT
    from tests.faults.test_table import NAME

    return list(dict.fromkeys(f"{file}::{name}" for file, name in NAME.findall(DOCUMENT.read_text("utf-8"))))


def main() -> int:
    """Play the attacks; 1 if one of them broke the rule."""
    parser = argparse.ArgumentParser(description="every attack on drives, with both filters")
    parser.add_argument("--drives", default=",".join(ROUTES), metavar="LIST")
    parser.add_argument("--methods", default=",".join(drives.METHODS), metavar="LIST")
    parser.add_argument("--only", default="", metavar="TEXT", help="attacks whose names hold this")
    parser.add_argument("--tests", action="store_true", help="run the tests that SECURITY.md names, too")
    parser.add_argument("--summary", type=Path, metavar="FILE", help="fold what an earlier run printed")
    args = parser.parse_args()
    if args.summary is not None:
        print("\n".join(summary(args.summary.read_text("utf-8"))))
        return 0
    routes, methods = args.drives.split(","), args.methods.split(",")
    wanted = [attack for attack in ATTACKS if args.only in attack.name]
    if {*routes} - {*ROUTES} or {*methods} - {*drives.METHODS} or not wanted:
        parser.error(f"drives: {', '.join(ROUTES)}; filters: {', '.join(drives.METHODS)}; or no such attack")
    began = time.monotonic()
    broken = table(methods, routes, wanted)
    plays = len(routes) * len(methods) * len(wanted)
    print(f"\n{broken} of {plays} broke the rule, in {(time.monotonic() - began) / 60.0:.1f} min")
    code = 0
    if args.tests:
        code = subprocess.run([sys.executable, "-m", "pytest", "-q", *named_tests()], cwd=REPO).returncode
    return 1 if broken or code else 0


if __name__ == "__main__":
    sys.exit(main())
