"""Losses of radius injected into real motorway drives, and these drives in a row with the state kept.

    python -m bench run recorded-losses [DRIVE ...] [--loss-mm 1.4] [--onsets 0.5] [--ramps 1,60]
    python -m bench run recorded-losses --state

Roads, noise, counters and receiver are real; a wheel whose radius is smaller by d turns more by d / r from
the onset (a share of the drive) on. Each drive is a first start: what the car is like has to be learned from
the part before the onset. Found: a `deflation` of that wheel before the drive ends and of no other. With
`--state` the drives are played in turn, as they are, each from the state that the one before left.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.places import RECORDINGS
from bench.statistics import percent, share
from tpmsd.car.config.load import load_config
from tpmsd.car.config.model import Config
from tpmsd.foundation.wheels import WHEELS
from tpmsd.interfaces.cli.drive_reading import read_ticks
from tpmsd.offline.drives.reading import DESK_RATE_HZ
from tpmsd.onboard.monitor.records import AlarmEvent, AlarmKind
from tpmsd.onboard.pipeline import Pipeline
from tpmsd.onboard.sources.can.decoder import load_database
from tpmsd.onboard.timeline.tick import Tick

NAMES = tuple(f"van-motorway-{name}" for name in ("a", "b", "c", "d", "lost-counts"))
REAR = (2, 3)


@dataclass(frozen=True)
class Drive:
    """A recording as ticks."""

    name: str
    config: Config
    ticks: list[Tick]

    @property
    def start_s(self) -> float:
        """Of the first tick, on the host's clock."""
        return self.ticks[0].host_time_s

    @property
    def duration_s(self) -> float:
        """From the first tick to the last."""
        return self.ticks[-1].host_time_s - self.start_s


def read_drive(folder: Path) -> Drive:
    """Read one; `InputError` as of `tpmsd replay`."""
    config = load_config(folder)
    return Drive(folder.name, config, read_ticks(folder, config, DESK_RATE_HZ))


def with_loss(drive: Drive, wheel: int, loss_m: float, onset_s: float, ramp_s: float) -> Iterable[Tick]:
    """The ticks of a drive on which a wheel loses `loss_m` of radius within `ramp_s` from `onset_s` on."""
    radius = drive.config.vehicle.wheel_radius_m[wheel]
    for tick in drive.ticks:
        since = tick.host_time_s - drive.start_s - onset_s
        lost = loss_m * min(max(since / max(ramp_s, 1e-9), 0.0), 1.0)
        if lost == 0.0:
            yield tick
            continue
        rotation = tick.rotation_rad.copy()
        rotation[wheel] *= radius / (radius - lost)
        yield replace(tick, rotation_rad=rotation)


def play(
    config: Config, ticks: Iterable[Tick], state: dict[str, Any] | None = None
) -> tuple[list[AlarmEvent], dict[str, Any], dict[str, tuple[float, float]]]:
    """What was said, the state that is left, and change and standard deviation by wheel at the end, m."""
    pipeline = Pipeline(config, load_database(config.can.dbc))
    if state is not None:
        pipeline.restore(state)
    events: list[AlarmEvent] = []
    changes: dict[str, tuple[float, float]] = {}
    for tick in ticks:
        report = pipeline.on_tick(tick).report
        events += report.events
        changes = {wheel.wheel: (wheel.change_m, wheel.change_std_m) for wheel in report.wheels}
    return events, json.loads(json.dumps(pipeline.snapshot())), changes


def injected(drive: Drive, wheel: int, loss_m: float, onset: float, ramp_s: float) -> dict[str, Any]:
    """One loss, and what came of it; `onset`: share of the drive."""
    onset_s = onset * drive.duration_s
    events, _, changes = play(drive.config, with_loss(drive, wheel, loss_m, onset_s, ramp_s))
    raised = [event for event in events if event.state == "raised" and event.kind is AlarmKind.DEFLATION]
    after = [event for event in raised if event.time_s - drive.start_s >= onset_s]
    right = bool(after) and all(event.wheel == WHEELS[wheel] for event in raised)
    change, std = changes[WHEELS[wheel]]
    return {
        "drive": drive.name,
        "wheel": WHEELS[wheel],
        "onset_s": onset_s,
        "ramp_s": ramp_s,
        "found": right,
        "delay_s": after[0].time_s - drive.start_s - onset_s if right else None,
        "named": [[event.wheel, event.time_s - drive.start_s, event.since] for event in raised],
        "change_mm": 1e3 * change,
        "change_std_mm": 1e3 * std,
    }


def in_a_row(drives: list[Drive]) -> list[dict[str, Any]]:
    """Alarms of the drives as they are, each from the state that the one before left."""
    state: dict[str, Any] | None = None
    rows = []
    for drive in drives:
        events, state, changes = play(drive.config, drive.ticks, state)
        said = [
            {
                "at_s": event.time_s - drive.start_s,
                "kind": str(event.kind),
                "wheel": event.wheel,
                "state": event.state,
                "since": event.since,
                "reason": event.reason,
            }
            for event in events
        ]
        rows.append(
            {
                "drive": drive.name,
                "said": said,
                "change_mm": {w: [1e3 * x, 1e3 * s] for w, (x, s) in changes.items() if x == x},
            }
        )
    return rows


def options(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument("drives", nargs="*", type=Path, metavar="DRIVE", help="default: the five motorways")
    parser.add_argument("--loss-mm", type=float, default=1.4, help="20 %% of the pressure are 1.4 mm")
    parser.add_argument("--onsets", default="0.5", help="shares of the drive")
    parser.add_argument("--ramps", default="1,60", help="seconds until all is lost")
    parser.add_argument("--state", action="store_true", help="as they are, in turn, with the state kept")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Run and print."""
    folders = args.drives or [RECORDINGS / name for name in NAMES]
    return _one_state(folders) if args.state else _each_loss(folders, args)


def _one_state(folders: Sequence[Path]) -> dict[str, Any]:
    """Play the drives one after the other with one saved state, and print what was reported on each."""
    rows = in_a_row([read_drive(folder) for folder in folders])
    for row in rows:
        reported = ", ".join(f"{w} {x:+.2f} +- {s:.2f} mm" for w, (x, s) in row["change_mm"].items())
        print(f"{row['drive']}: {reported or 'nothing judged'}")
        for one in row["said"]:
            since = f" ({one['since']})" if one["since"] else ""
            what = f"{one['kind']} {one['wheel']} {one['state']}{since}"
            print(f"  {one['at_s']:6.1f} s  {what}: {one['reason']}")
    return {"in_a_row": rows}


def _each_loss(folders: Sequence[Path], args: argparse.Namespace) -> dict[str, Any]:
    """Inject a loss into each drive, by wheel, onset and ramp, and print how each was found."""
    rows = []
    for folder in folders:
        drive = read_drive(folder)
        for ramp in map(float, args.ramps.split(",")):
            for onset in map(float, args.onsets.split(",")):
                for wheel in REAR:
                    row = injected(drive, wheel, 1e-3 * args.loss_mm, onset, ramp)
                    rows.append(row)
                    delay = "not found" if row["delay_s"] is None else f"after {row['delay_s']:.0f} s"
                    named = ", ".join(f"{w} at {t:.0f} s" for w, t, _ in row["named"])
                    print(
                        f"{drive.name} {row['wheel']} from {row['onset_s']:.0f} s in {ramp:g} s: {delay}; "
                        f"named {named or 'none'}; at the end {row['change_mm']:+.2f} +- "
                        f"{row['change_std_mm']:.2f} mm",
                        flush=True,
                    )
    found, wrong = sum(row["found"] for row in rows), sum(_wrong(row) for row in rows)
    print(f"found, and no other wheel: {percent(share(found, len(rows)))}; with a wrong wheel: {wrong}")
    return {"losses": rows}


def _wrong(row: dict[str, Any]) -> bool:
    return any(wheel != row["wheel"] for wheel, _, _ in row["named"])
