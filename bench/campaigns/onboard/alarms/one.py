"""One case or one leg again: what was said, or its drive folder.

In: the name that a row bears. Out: text, or a folder that `tpmsd replay` takes: all legs from the first one
that taught to this one, with the car parked in between.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.campaigns.onboard.alarms.cases import group
from bench.campaigns.onboard.alarms.lives import LEARNING, SLIPPERY_OF, kinds, life, slippery
from bench.campaigns.onboard.alarms.play import LegResult, replay_leg
from bench.worlds.folder import write_folder
from bench.worlds.magic_tyre import Array
from bench.worlds.trip_cars import POOLS, Car
from bench.worlds.trips import Driven, Leg, drive_leg


@dataclass(frozen=True)
class Story:
    """Legs in order; the last one is what is asked for."""

    car: Car
    legs: tuple[Leg, ...]


def story(name: str) -> Story:
    """What leads to a case or a leg. ValueError if there is none of that name."""
    parts = name.split("/")
    if len(parts) not in (3, 4) or parts[0] not in POOLS:
        raise ValueError(f"{name}: names are POOL/SEED/CASE or POOL/life/SEED/LEG; pools: {', '.join(POOLS)}")
    try:
        if len(parts) == 4:
            pool, what, seed = parts[0], parts[1], int(parts[2])
            if what in SLIPPERY_OF:
                whole = slippery(pool, seed, SLIPPERY_OF[what])
            else:
                whole = {"life": life, "kinds": kinds}[what](pool, seed)
            number = int(parts[3])
            asked = whole.legs[number : number + 1] if number >= LEARNING else ()
            return Story(whole.car, (*whole.legs[: min(number + 1, LEARNING)], *asked))
        of_car = group(parts[0], int(parts[1]))
    except KeyError:
        raise ValueError(f"{name}: legs are those of `life`, `kinds` or `slippery`") from None
    except ValueError:
        raise ValueError(f"{name}: seeds and legs are whole numbers") from None
    found = [case for case in of_car.cases if case.name == name]
    if not found:
        raise ValueError(f"{name}: this car has {', '.join(case.name for case in of_car.cases)}")
    return Story(of_car.car, (*of_car.healthy, found[0].leg))


def one(name: str, folder: Path | None) -> str:
    """Play it and say all that was said; or write it."""
    life_story = story(name)
    if folder is not None:
        write_story(life_story, folder)
        return f"{folder}: {len(life_story.legs)} legs; `tpmsd replay {folder}` plays them"
    state: dict[str, object] = {}
    tyre_k: Array | None = None
    lines: list[str] = []
    for leg in life_story.legs:
        driven = drive_leg(life_story.car, leg, tyre_k)
        outcome = replay_leg(driven, state)
        state, tyre_k = outcome.state, driven.temperature_k
        lines += _described(driven, outcome)
    return "\n".join(lines)


def _described(driven: Driven, outcome: LegResult) -> list[str]:
    leg = driven.leg
    lost = ", ".join(
        f"{100 * x.share:.0f} % of wheel {x.wheel} from {x.onset_s:.0f} to {x.done_s:.0f} s"
        for x in leg.losses
    )
    lines = [f"{leg.road}, {driven.kilometres:.1f} km, {', '.join(leg.tags)} {lost or 'no loss'}"]
    lines += [
        f"  {said.time_s:8.1f} s  {said.kind} {said.wheel} {said.state}: {said.reason}"
        for said in outcome.said
    ]
    true = 1e3 * driven.lost_m[-1]
    for k, (wheel, (change, std)) in enumerate(outcome.change.items()):
        lines.append(
            f"  {wheel}: by estimate {1e3 * change:+.2f} +- {1e3 * std:.2f} mm, by air {-true[k]:+.2f} mm"
        )
    return [*lines, f"  learned: {outcome.learned}; state: {len(json.dumps(outcome.state))} bytes"]


def write_story(life_story: Story, folder: Path) -> None:
    """All legs as one drive folder: each begins where the one before ended, after the pause."""
    east = north = 0.0
    start_s = life_story.legs[0].start_s
    tyre_k: Array | None = None
    for number, leg in enumerate(life_story.legs):
        driven = drive_leg(life_story.car, replace(leg, start_s=start_s), tyre_k)
        drive = driven.drive
        part = folder / f"leg{number}"
        write_folder(replace(drive, fix_east=drive.fix_east + east, fix_north=drive.fix_north + north), part)
        for name in ("can.log", "gnss.nmea"):
            with (folder / name).open("ab" if number else "wb") as out:
                out.write((part / name).read_bytes())
            (part / name).unlink()
        for name in ("vehicle.toml", "bus.dbc"):
            (part / name).replace(folder / name)
        part.rmdir()
        if len(drive.fix_east):
            east, north = east + float(drive.fix_east[-1]), north + float(drive.fix_north[-1])
        start_s += float(np.ceil(drive.time_s[-1] + max(leg.pause_s, 60.0)))
        tyre_k = driven.temperature_k
