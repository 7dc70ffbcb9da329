"""Both filters of the product on the demonstration's drives and on recordings, and what a tick of them costs.

    python -m bench run filter-drives                   five seeds of the demonstration, all recordings
    python -m bench run filter-drives --seeds 20 --drives van-motorway-a
    python -m bench report filter-drives --write

The demonstration's drive (`make demo`, a tyre loses 2 % of its radius over 30 s) is simulated with each seed,
written as a recording and replayed. A recording is replayed as it is: alarms, poses lost, and above 20 m/s
the rear radii on line against those of `calibrate` (`bench run online-radii`). The cost is that of the
estimator alone, both filters in turn over pieces of one drive, so that other load burdens both alike.
"""

from __future__ import annotations

import argparse
import math
import statistics
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.campaigns.onboard.estimators.methods import ALL, build
from bench.campaigns.onboard.estimators.tasks import driven
from bench.campaigns.onboard.filters import METHODS
from bench.campaigns.onboard.online_radii import STEADY_AFTER_S, STEADY_MPS
from bench.campaigns.onboard.recorded_losses import Drive, read_drive
from bench.places import OUT, RECORDINGS, REPO
from bench.runner import code_state, resume, rows_in
from tpmsd.foundation.errors import TpmsdError
from tpmsd.foundation.wheels import RL, RR, WHEELS
from tpmsd.interfaces.api.functions import calibrate
from tpmsd.interfaces.cli.demo import DURATION_S, LOSS_PERCENT, PUNCTURE_AT_S, PUNCTURE_OVER_S
from tpmsd.offline.simulator.drive import DriveSpec, simulate_drive
from tpmsd.offline.simulator.drive_writer import write_drive
from tpmsd.offline.simulator.faults import Fault
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database

Row = dict[str, Any]
Unit = tuple[str, str, int]
"""What (demo, recording, calibrated, cost), of which wheel or folder, seed or number of wheels."""
DEMO, RECORDING, CALIBRATED, COST = "demo", "recording", "calibrated", "cost"
PARTICLES = 500
PIECE = 500
"""Ticks after which the filters take turns."""
WITHIN_S = 60.0


def plan(args: argparse.Namespace) -> list[Unit]:
    """The cheap ones first; `calibrate` of the recordings comes last."""
    folders = [str(args.recordings / name) for name in args.drives or names(args.recordings)]
    units: list[Unit] = [(DEMO, args.wheel, seed) for seed in range(1, args.seeds + 1)]
    units += [(COST, "puncture", wheels) for wheels in (2, 4)]
    units += [(what, folder, 0) for what in (RECORDING, CALIBRATED) for folder in folders]
    return units


def names(recordings: Path) -> list[str]:
    """Of the drive folders there."""
    return sorted(path.parent.name for path in recordings.glob("*/vehicle.toml"))


def with_method(drive: Drive, method: str) -> Drive:
    """The same with another filter."""
    return replace(drive, config=replace(drive.config, filter=replace(drive.config.filter, method=method)))


def work(unit: Unit) -> list[Row]:
    """Rows of a unit, one of each filter where it plays a drive."""
    what, name, number = unit
    if what == COST:
        return costs(number)
    if what == CALIBRATED:
        return calibrated_radii(Path(name))
    if what == RECORDING:
        drive = read_drive(Path(name))
        return [{"what": what, "name": drive.name, **played(with_method(drive, one), one)} for one in METHODS]
    fault = Fault("puncture", LOSS_PERCENT, "percent", name, PUNCTURE_AT_S, PUNCTURE_OVER_S)
    spec = DriveSpec(duration_s=DURATION_S, seed=number, faults=(fault,))
    with tempfile.TemporaryDirectory(prefix="tpmsd-demo-") as folder:
        write_drive(Path(folder), simulate_drive(spec))
        drive = read_drive(Path(folder))
        rows = [played(with_method(drive, method), method) for method in METHODS]
    return [{"what": what, "name": str(number), **judged(row, name), **row} for row in rows]


def judged(row: Row, wheel: str) -> Row:
    """When the punctured wheel was announced, s after the puncture began, and what else was (kind, wheel,
    time); malfunctions are told apart."""
    said = [one for one in row["said"] if one[0] != "malfunction"]
    right = [
        at_s for kind, named, at_s in said if (kind, named) == ("deflation", wheel) and at_s >= PUNCTURE_AT_S
    ]
    others = [one for one in said if one[1] != wheel or one[2] < PUNCTURE_AT_S]
    return {"delay_s": right[0] - PUNCTURE_AT_S if right else None, "others": others}


def played(drive: Drive, method: str) -> Row:
    """What was announced on a drive (kind, wheel, seconds from its start), poses lost, and above 20 m/s the
    means of rear radii and of their standard deviations, mm, and of the square of the speed."""
    pipeline = Pipeline(drive.config, load_database(drive.config.can.dbc))
    said, steady = [], []
    for tick in drive.ticks:
        step = pipeline.on_tick(tick)
        said += [
            (str(alarm.kind), alarm.wheel, alarm.time_s - drive.start_s)
            for alarm in step.report.events
            if alarm.state == "raised"
        ]
        estimate = step.estimate
        if tick.host_time_s - drive.start_s > STEADY_AFTER_S and estimate.speed_mps > STEADY_MPS:
            rear = 1e3 * estimate.deviation_m[RL:]
            steady.append(
                [*rear, *1e3 * np.sqrt(np.diag(estimate.covariance_m2)[RL:]), estimate.speed_mps**2]
            )
    mean = np.mean(steady, axis=0).tolist() if steady else []
    lost = getattr(pipeline.estimator.inner, "counts", {}).get("lost_pose", 0)
    return {
        "method": method,
        "said": said,
        "lost_pose": lost,
        "steady": mean,
        "hours": drive.duration_s / 3600,
    }


def calibrated_radii(folder: Path) -> list[Row]:
    """Rear radii of a recording by `calibrate`, mm from nominal, at what speed, and the growth with its
    square, mm s2/m2; none where it cannot be calibrated."""
    try:
        found = calibrate(folder).to_dict()
    except TpmsdError:
        return []
    nominal = read_drive(folder).config.vehicle.wheel_radius_m
    wheels = found["wheels"]
    radii = [1e3 * (wheels[WHEELS[wheel]]["radius_m"] - nominal[wheel]) for wheel in (RL, RR)]
    growth = 1e3 * found["effects"]["growth"]["value"] if "growth" in found["effects"] else 0.0
    speed = found["reference_speed_mps"]
    return [
        {"what": CALIBRATED, "name": folder.name, "radii_mm": radii, "growth": growth, "speed_mps": speed}
    ]


def costs(wheels: int) -> list[Row]:
    """Processor time per tick of both filters, and the median over pieces of the drive of their ratio."""
    ticks = driven("puncture", "correlated", 1).ticks
    filters = [
        build(method, None if method == METHODS[0] else PARTICLES, 1, wheels == 4, ALL) for method in METHODS
    ]
    spent: list[list[float]] = [[], []]
    for begin in range(0, len(ticks), PIECE):
        for filter_, mine in zip(filters, spent, strict=True):
            begun = time.process_time()
            for tick in ticks[begin : begin + PIECE]:
                filter_.step(tick)
            mine.append(1e3 * (time.process_time() - begun) / len(ticks[begin : begin + PIECE]))
    ratio = statistics.median(slow / fast for fast, slow in zip(*spent, strict=True))
    cost = [statistics.median(mine) for mine in spent]
    return [{"what": COST, "name": f"{wheels} wheels", "ms": cost, "ratio": ratio}]


def radius_difference_mm(row: Row, calibrated_rows: Sequence[Row]) -> list[float]:
    """Rear radii on line minus `calibrate`'s, moved to the same speed; empty where either is unknown."""
    known = [one for one in calibrated_rows if one["name"] == row["name"]]
    if not known or not row["steady"]:
        return []
    grown = known[0]["growth"] * (row["steady"][4] - known[0]["speed_mps"] ** 2)
    return [float(row["steady"][k] - known[0]["radii_mm"][k] - grown) for k in (0, 1)]


def _demonstration(rows: Sequence[Row]) -> list[str]:
    """The table of the demonstration's seeds."""
    lines = ["| demonstration | found within 60 s, no other wheel | delay s |", "| --- | --- | --- |"]
    for method in METHODS:
        own = [row for row in rows if row["method"] == method]
        found = [row["delay_s"] is not None and row["delay_s"] <= WITHIN_S for row in own]
        good = sum(here and not row["others"] for here, row in zip(found, own, strict=True))
        delays = ", ".join("-" if row["delay_s"] is None else f"{row['delay_s']:.0f}" for row in own)
        lines.append(f"| `{method}` | {good} of {len(own)} seeds | {delays} |")
    return [*lines, ""]


def _recordings(rows: Sequence[Row], calibrated_rows: Sequence[Row]) -> list[str]:
    """Return the table of the recordings, and those that have neither an alarm nor a figure in a sentence."""
    lines = [
        "| recording | filters | alarms | poses lost | rl, rr above 20 m/s off `calibrate`, mm |",
        "| --- | --- | --- | --- | --- |",
    ]
    quiet: dict[str, list[str]] = {}
    cells: dict[tuple[str, str, int], list[tuple[str, str]]] = {}
    for row in rows:
        off = ", ".join(f"{value:+.2f}" for value in radius_difference_mm(row, calibrated_rows))
        if not off and not row["said"] and not row["lost_pose"]:
            quiet.setdefault(row["name"], []).append(f"`{row['method']}`")
            continue
        said = ", ".join(f"{kind} {wheel} at {at_s:.0f} s" for kind, wheel, at_s in row["said"]) or "none"
        cells.setdefault((row["name"], said, row["lost_pose"]), []).append((row["method"], off or "-"))
    for (name, said, lost), found in cells.items():
        methods = "both" if len(found) == len(METHODS) else f"`{found[0][0]}`"
        lines.append(f"| {name} | {methods} | {said} | {lost} | {'; '.join(off for _, off in found)} |")
    named = ", ".join(
        name if len(methods) == len(METHODS) else f"{name} with {' and '.join(methods)}"
        for name, methods in quiet.items()
    )
    return [*lines, "", *([f"No alarm, no pose lost: {named}.", ""] if quiet else [])]


def _costs(rows: Sequence[Row]) -> list[str]:
    """The table of the cost."""
    return [
        f"| ms per tick | `{METHODS[0]}` | `{METHODS[1]}`, {PARTICLES} particles | ratio |",
        "| --- | --- | --- | --- |",
        *(f"| {r['name']} | {r['ms'][0]:.3f} | {r['ms'][1]:.3f} | {r['ratio']:.2f} |" for r in rows),
    ]


def markdown(rows: Sequence[Row]) -> str:
    """Tables of the demonstration, the recordings and the cost, as far as each was measured."""
    kinds = {
        what: [row for row in rows if row["what"] == what] for what in (DEMO, RECORDING, CALIBRATED, COST)
    }
    lines = _demonstration(kinds[DEMO]) if kinds[DEMO] else []
    lines += _recordings(kinds[RECORDING], kinds[CALIBRATED]) if kinds[RECORDING] else []
    return "\n".join([*lines, *(_costs(kinds[COST]) if kinds[COST] else [])])


def report(out: Path) -> str:
    """The tables of what stands in a folder; UsageError where there is nothing."""
    return markdown(rows_in(out))


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("--seeds", type=int, default=5, metavar="N", help="of the demonstration")
    parser.add_argument("--wheel", choices=WHEELS, default="rl")
    parser.add_argument("--drives", nargs="*", metavar="NAME", help="recordings (default: all)")
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help="folder of real drives")
    parser.add_argument(
        "--minutes", type=float, default=math.inf, help="stop after this time; run again to go on"
    )
    parser.add_argument("--out", type=Path, default=OUT / "filter-drives")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Play what is not done yet and print the tables."""
    state = code_state(REPO / "tpmsd", Path(__file__))
    file = args.out / "results.jsonl"
    done = resume(
        file,
        state,
        plan(args),
        work,
        lambda unit, rows: f"{unit[0]} {Path(unit[1]).name} {unit[2]}",
        minutes=args.minutes,
    )
    rows = [row for _, found in done for row in found]
    print(markdown(rows))
    return {"filter_drives": rows}
