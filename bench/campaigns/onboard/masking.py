"""Losses beside another change of the radii: does a change of other wheels keep a lost tyre silent?

    python -m bench run masking [--cars 2] [--first 1] [--generator trips,kinematic,simulator,multibody]

Four situations are played on cars of four generators: `trips` (Magic Formula tyres, weather, loads),
`kinematic` (a rigid car), `simulator` (the project's own, through a drive folder) and `multibody` (a
CommonRoad car, 29 states). Only the last two share nothing with each other or the rest; the first two share
instruments. Each car is learned on two drives. On the third one, a day later, its wheels are of another
size or soft from the beginning, or one tyre loses air after five minutes within ten seconds.

Printed: how long after its beginning each change was said. `deflation` of the tyre that lost air, or
`radius_deviation` of wheels of another size, or a question; nothing within ten minutes is *silent*. A
`deflation` of another wheel is wrong.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.onboard.alarms.cases import group
from bench.campaigns.onboard.alarms.play import beginning, config_of
from bench.campaigns.onboard.alarms.ticks import ticks_of
from bench.registry import UsageError
from bench.worlds import kinematic
from bench.worlds.folder import write_folder
from bench.worlds.instruments import START_S, Drive
from bench.worlds.magic_tyre import Array
from bench.worlds.spec import Spec
from bench.worlds.trips import Leg, Loss, drive_leg
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.foundation.wheels import WHEELS
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.timeline.tick import Tick

Row = dict[str, Any]
LIMIT_S = 600.0
DAY_S = 90_000.0
LEARN_S = (900.0, 600.0)
LOST_IN_S = 10.0
RADIUS_PER_PRESSURE = 0.0046 / 0.20
"""Relative loss of radius per share of the pressure: 20 % is 1.4 mm of a 205/60R15 (Magic Formula 6.1)."""


@dataclass(frozen=True)
class Situation:
    """What has changed on the third drive."""

    name: str
    larger_m: tuple[float, float, float, float]
    """Other size of each wheel, from the beginning on."""
    lost: tuple[int, ...]
    share: float = 0.0
    """Of their pressure that these tyres lose."""
    onset_s: float = 0.0
    """0: they are soft from the beginning on."""
    duration_s: float = 900.0

    @property
    def done_s(self) -> float:
        """When all of it is lost."""
        return self.onset_s + (LOST_IN_S if self.onset_s > 0.0 else 0.0)

    def change_m(self, time_s: Array, radius_m: Array) -> Array:
        """(n, 4) change of the radii (4,) at these times since the beginning."""
        done = np.clip((time_s - self.onset_s) / max(self.done_s - self.onset_s, 1e-9), 0.0, 1.0)
        falls = [float(wheel in self.lost) * self.share * RADIUS_PER_PRESSURE for wheel in range(4)]
        return np.asarray(np.array(self.larger_m) - done[:, None] * np.array(falls) * radius_m)


SITUATIONS = (
    Situation("all +5 mm, then one -20 %", (5e-3,) * 4, (1,), 0.20, 300.0),
    Situation("front axle +8 mm, then fl -27 %", (8e-3, 8e-3, 0.0, 0.0), (0,), 0.27, 300.0),
    Situation("all +9 mm", (9e-3,) * 4, (), duration_s=720.0),
    Situation("front pair -20 % from the beginning", (0.0,) * 4, (0, 1), 0.20, duration_s=1200.0),
)
SOUND = Situation("nothing", (0.0,) * 4, ())


@dataclass(frozen=True)
class Car:
    """A car of a generator: its configuration and the ticks of its drives."""

    config: Config
    learn: Callable[[int], list[Tick]]
    """The drive of this number on which it is learned."""
    third: Callable[[Situation], list[Tick]]


def trips_car(seed: int, folder: Path) -> Car:
    """A car of `bench/worlds/trips.py`; a loss is one of pressure there."""
    made = group("development", 1000 * seed + 421, 1)
    usual = made.healthy[1]

    def learn(number: int) -> list[Tick]:
        return ticks_of(drive_leg(made.car, made.healthy[number]).drive)

    def third(what: Situation) -> list[Tick]:
        losses = tuple(
            Loss(wheel, what.share, what.onset_s, what.done_s - what.onset_s) for wheel in what.lost
        )
        leg: Leg = replace(
            usual,
            seed=500,
            start_s=usual.start_s + DAY_S,
            duration_s=what.duration_s,
            resized_m=what.larger_m,
            losses=losses,
        )
        return ticks_of(drive_leg(made.car, leg).drive)

    config = config_of(beginning(drive_leg(made.car, replace(usual, duration_s=60.0))), folder)
    return Car(config, learn, third)


def kinematic_car(seed: int, folder: Path) -> Car:
    """A rigid car of `bench/worlds/kinematic.py`, whose wheels turn the more often the smaller they are."""
    spec = Spec(road="mixed", radius_spread_m=0.0)
    write_folder(kinematic.drive(replace(spec, duration_s=60.0), seed), folder)

    def ticks(what: Situation, number: int) -> list[Tick]:
        duration_s = (*LEARN_S, what.duration_s)[number]
        drive = kinematic.drive(replace(spec, duration_s=duration_s), 100 * seed + number)
        shown = resized(drive.shown_rad, drive.time_s, drive.radius_m, what)
        return ticks_of(_begun(replace(drive, shown_rad=shown), number))

    return Car(load_config(folder), partial(ticks, SOUND), partial(ticks, number=2))


def _begun(drive: Drive, number: int) -> Drive:
    return replace(drive, start_s=START_S + number * DAY_S)


def resized(angle_rad: Array, time_s: Array, radius_m: Array, what: Situation) -> Array:
    """(n, 4) angles of wheels that roll as far on other radii."""
    steps = np.diff(angle_rad, axis=0, prepend=angle_rad[:1])
    turned = np.cumsum(steps * radius_m / (radius_m + what.change_m(time_s, radius_m)), axis=0)
    return np.asarray(angle_rad[:1] + turned)


def simulator_car(seed: int, folder: Path) -> Car:
    """A car of the project's simulator, by its catalogue's effect and the folder that it writes."""
    from tpmsd.car.physics.effects.radius_change import RadiusChange
    from tpmsd.car.physics.model import ExtendedModel
    from tpmsd.interfaces.cli.drive_reading import read_ticks
    from tpmsd.offline.simulator.clock import Clocks
    from tpmsd.offline.simulator.drive import DEFAULT_VEHICLE, DriveSpec, simulate_drive
    from tpmsd.offline.simulator.drive_writer import write_drive

    radius_m = np.array(DEFAULT_VEHICLE.wheel_radius_m)

    def simulated(what: Situation, number: int, target: Path) -> list[Tick]:
        begun, done = what.change_m(np.array([-1.0, what.duration_s]), radius_m)
        effects = [
            RadiusChange(WHEELS[wheel], float(size), *span)
            for wheel in range(4)
            for size, span in (
                (begun[wheel], (0.0, 0.0)),
                (done[wheel] - begun[wheel], (what.onset_s, what.done_s - what.onset_s)),
            )
            if size != 0.0
        ]
        spec = DriveSpec(
            duration_s=(*LEARN_S, what.duration_s)[number],
            seed=100 * seed + number,
            radius_offset_m=(1e-3, -5e-4, 0.0, 8e-4),
            model=ExtendedModel().plus(*effects),
            clocks=Clocks(start_utc_s=START_S + number * DAY_S),
        )
        write_drive(target, simulate_drive(spec))
        return read_ticks(target, load_config(target))

    def ticks(what: Situation, number: int) -> list[Tick]:
        with tempfile.TemporaryDirectory() as place:
            return simulated(what, number, Path(place) / "drive")

    simulated(replace(SOUND, duration_s=60.0), 2, folder)
    return Car(load_config(folder), partial(ticks, SOUND), partial(ticks, number=2))


def multibody_car(seed: int, folder: Path) -> Car:
    """A CommonRoad car; one run is integrated, and its drives differ by instruments and what has changed."""
    from bench.worlds.commonroad_car import rolling_radius_m
    from bench.worlds.hard_drives import Setting, instrumented, truth

    setting = Setting(1, slip_stiffness=0.8) if seed % 2 else Setting(2)
    run = truth(seed, SITUATIONS[-1].duration_s, hard=False, setting=setting)
    radius_m = np.broadcast_to(rolling_radius_m(setting.parameters()), 4)
    write_folder(kinematic.drive(Spec(duration_s=60.0), seed), folder)

    def ticks(what: Situation, number: int) -> list[Tick]:
        angle = resized(run.angle_rad, run.time_s, radius_m, what)
        drive = instrumented(replace(run, angle_rad=angle), 100 * seed + number, setting=setting)
        kept = [tick for tick in drive.ticks if tick.time_s - drive.ticks[0].time_s < what.duration_s]
        return [_later(tick, number * DAY_S) for tick in kept]

    made = instrumented(run, seed, setting=setting)
    return Car(
        replace(load_config(folder), vehicle=made.vehicle), partial(ticks, SOUND), partial(ticks, number=2)
    )


def _later(tick: Tick, by_s: float) -> Tick:
    fixes = tuple(replace(fix, time_s=fix.time_s + by_s) for fix in tick.fixes)
    return replace(tick, time_s=tick.time_s + by_s, host_time_s=tick.host_time_s + by_s, fixes=fixes)


GENERATORS: dict[str, Callable[[int, Path], Car]] = {
    "trips": trips_car,
    "kinematic": kinematic_car,
    "simulator": simulator_car,
    "multibody": multibody_car,
}


def play(config: Config, state: dict[str, Any], ticks: list[Tick], what: Situation) -> tuple[Row, Any]:
    """Play a drive from a saved state: when each change was said, and the state at its end."""
    pipeline = Pipeline(config, load_database(config.can.dbc))
    if state:
        pipeline.restore(json.loads(json.dumps(state)))
    row: Row = {"deflation": {}, "radius_deviation": {}, "asked_s": None, "question": None}
    start_s = ticks[0].host_time_s
    for tick in ticks:
        report = pipeline.on_tick(tick).report
        now_s = round(tick.host_time_s - start_s, 1)
        for event in report.events:
            if event.state == "raised" and str(event.kind) in ("deflation", "radius_deviation"):
                row[str(event.kind)].setdefault(event.wheel, now_s)
        if report.questions and row["asked_s"] is None and now_s >= what.done_s:
            row |= {"asked_s": now_s, "question": report.questions[0].question}
    return row, json.loads(json.dumps(pipeline.snapshot()))


def scored(row: Row, what: Situation) -> Row:
    """The row with how soon the loss and the size were said after their beginning, and a verdict:
    `found`, `asked`, `silent`, or `wrong` where another wheel's deflation was said."""
    lost = {WHEELS[wheel] for wheel in what.lost}
    larger = {WHEELS[wheel] for wheel, size in enumerate(what.larger_m) if size}
    loss_s = _all(row["deflation"], lost) - what.onset_s
    pair_s = _all(row["radius_deviation"], lost) - what.onset_s if len(lost) > 1 else math.nan
    size_s = _all(row["radius_deviation"], larger)
    said_s = size_s if not lost else min((s for s in (loss_s, pair_s) if s == s), default=math.nan)
    asked_s = math.nan if row["asked_s"] is None else row["asked_s"] - what.onset_s
    wrong = sorted(set(row["deflation"]) - lost)
    verdict = "silent"
    if wrong:
        verdict = "wrong"
    elif said_s <= LIMIT_S:
        verdict = "found"
    elif asked_s <= LIMIT_S:
        verdict = "asked"
    return {
        "verdict": verdict,
        "loss_s": _or_none(loss_s if lost else math.nan),
        "size_s": _or_none(size_s if larger else math.nan),
        "question_s": _or_none(asked_s),
        "wrong": wrong,
        **row,
    }


def _all(said: dict[str, float], wheels: set[str]) -> float:
    """When the last of the wheels was named; NaN while one is not."""
    return max((said.get(wheel, math.nan) for wheel in sorted(wheels)), default=math.nan)


def _or_none(value: float) -> float | None:
    return round(value, 1) if math.isfinite(value) else None


def car_rows(generator: str, seed: int) -> list[Row]:
    """All situations of one car."""
    rows = []
    with tempfile.TemporaryDirectory() as place:
        car = GENERATORS[generator](seed, Path(place))
        state: dict[str, Any] = {}
        false: list[str] = []
        for number in range(len(LEARN_S)):
            row, state = play(car.config, state, car.learn(number), SOUND)
            false += [*row["deflation"], *row["radius_deviation"]]
        for what in SITUATIONS:
            row, _ = play(car.config, state, car.third(what), what)
            about = {"generator": generator, "seed": seed, "situation": what.name, "false_before": false}
            rows.append({**about, **scored(row, what)})
    return rows


def table(rows: list[Row]) -> str:
    """As Markdown, a line for each situation and generator."""
    lines = [
        "| situation | generator | said | loss named after s | size named after s | asked after s |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    names = [what.name for what in SITUATIONS]
    cells = sorted({(names.index(row["situation"]), row["generator"]) for row in rows})
    for index, generator in cells:
        of_cell = [row for row in rows if (row["situation"], row["generator"]) == (names[index], generator)]
        said = [row["verdict"] for row in of_cell]
        counted = ", ".join(f"{said.count(one)} {one}" for one in sorted(set(said)))
        seconds = [
            ", ".join("-" if row[key] is None else f"{row[key]:.0f}" for row in of_cell)
            for key in ("loss_s", "size_s", "question_s")
        ]
        lines.append(f"| {names[index]} | {generator} | {counted} | {' | '.join(seconds)} |")
    silent = sum(row["verdict"] == "silent" for row in rows)
    wrong = sum(row["verdict"] == "wrong" for row in rows)
    false = sum(bool(row["false_before"]) for row in rows)
    return "\n".join(
        [*lines, "", f"{len(rows)} drives: {silent} silent, {wrong} wrong, {false} after a false alarm."]
    )


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--cars", type=int, default=2, help="cars of each generator (default: 2)")
    parser.add_argument("--first", type=int, default=1, help="seed of the first car")
    parser.add_argument("--generator", help="some of them, with commas between (default: all)")


def main(args: argparse.Namespace) -> list[Row]:
    """Play, print the table."""
    wanted = list(GENERATORS) if args.generator is None else args.generator.split(",")
    if unknown := sorted(set(wanted) - set(GENERATORS)):
        raise UsageError(f"no such generator: {', '.join(unknown)}; there are {', '.join(GENERATORS)}")
    rows: list[Row] = []
    for generator in wanted:
        for seed in range(args.first, args.first + args.cars):
            rows += car_rows(generator, seed)
            said = ", ".join(row["verdict"] for row in rows[-len(SITUATIONS) :])
            print(f"{generator}/{seed}: {said}", flush=True)
    print()
    print(table(rows))
    return rows
