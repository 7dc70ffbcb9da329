"""Discovery on drawn cars: how often wheels, counts, axle, tracks, latency and antenna are right.

    python -m bench run discover [--cars 40] [--first 1] [--minutes 10] [--json FILE]

Each car has a drawn layout, meaningless names, ten decoys and, half the time, a late copy of its wheels
(`drawn_buses`); it is asked with its DBC and without. A result is right, undecided (the program says so) or
wrong; shares come with 95 % Wilson intervals.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from bench.campaigns.drawn_buses import DrawnBus, draw
from tpmsd.config.dbc import load_dbc
from tpmsd.discovery.discover import discover
from tpmsd.discovery.result import Discovery
from tpmsd.wheels import WHEELS

_SURE = 0.95
_BARS = {
    "track_rear_m": 0.02,
    "track_front_m": 0.02,
    "latency_s": 0.02,
    "antenna_left_m": 0.3,
    "antenna_forward_m": 0.3,
}


def options(parser: argparse.ArgumentParser) -> None:
    """The campaign's own options."""
    parser.add_argument("--cars", type=int, default=40, metavar="N")
    parser.add_argument("--first", type=int, default=1, metavar="SEED")
    parser.add_argument("--minutes", type=float, default=10.0, metavar="M")


def main(args: argparse.Namespace) -> dict[str, Any]:
    """Ask every car, print the table, and give the counts."""
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(args.first, args.first + args.cars):
            bus = draw(seed, 60.0 * args.minutes)
            file = Path(folder) / "bus.dbc"
            file.write_text(bus.dbc)
            for mode, database in (("with DBC", load_dbc(file)), ("raw", None)):
                found = discover(bus.log, bus.fixes, database, bus.tyre)
                _judge(counts, mode, bus, found)
    rows = sorted({key.rsplit("|", 1)[0] for key in counts})
    print("| figure | right | undecided | wrong | right, 95 % interval |")
    print("| --- | --- | --- | --- | --- |")
    for row in rows:
        right, unsure, wrong = (counts[f"{row}|{what}"] for what in ("right", "undecided", "wrong"))
        low, high = _wilson(right, right + unsure + wrong)
        print(f"| {row} | {right} | {unsure} | {wrong} | {100 * low:.0f} to {100 * high:.0f} % |")
    return {"cars": args.cars, "first": args.first, "minutes": args.minutes, "counts": dict(counts)}


def _judge(counts: Counter[str], mode: str, bus: DrawnBus, found: Discovery) -> None:
    wheels = "undecided"
    if found.kind is not None:
        right = [_is_wheel(bus, found, wheel, mode) for wheel in WHEELS]
        sure = found.wheels_decided
        wheels = "undecided" if not sure else "right" if all(right) else "wrong"
    counts[f"four wheels, {mode}|{wheels}"] += 1
    if wheels != "right" or mode == "raw":
        return
    if found.counts_per_rev is not None:
        sure = found.counts_probability >= _SURE
        same = found.counts_per_rev.value == bus.spec.vehicle.teeth_per_rev
        counts[f"counts per revolution|{'undecided' if not sure else 'right' if same else 'wrong'}"] += 1
    axle, sure_axle = found.driven_axle or ("front", 0.0)
    same = axle == bus.spec.vehicle.driven_axle
    counts[f"driven axle|{'undecided' if sure_axle < _SURE else 'right' if same else 'wrong'}"] += 1
    truth = {
        "track_rear_m": bus.spec.vehicle.track_rear_m,
        "track_front_m": bus.spec.vehicle.track_front_m,
        "latency_s": bus.spec.receiver.latency_s,
        "antenna_left_m": bus.spec.antenna_left_m,
        "antenna_forward_m": bus.spec.antenna_forward_m,
    }
    for key, bar in _BARS.items():
        one = found.geometry.get(key) or found.gnss.get(key)
        limit = bar * truth[key] if key.startswith("track") else bar
        if one is None:
            counts[f"{key} within the bar or two std|undecided"] += 1
            continue
        good = abs(one.value - truth[key]) <= max(limit, 2 * one.std)
        counts[f"{key} within the bar or two std|{'right' if good else 'wrong'}"] += 1


def _is_wheel(bus: DrawnBus, found: Discovery, wheel: str, mode: str) -> bool:
    role = found.roles.get(f"wheel_{bus.layout.kind.removesuffix('s')}_{wheel}")
    if role is None:
        return False
    if mode == "with DBC":
        return role.field.signal == bus.truth[wheel]
    place = role.field.place
    lowest = place.shift
    if place.big_endian:
        lowest = 8 * (place.word_bytes - 1 - place.shift // 8) + place.shift % 8
    identifier, at, _ = bus.raw_truth[wheel]
    return (role.field.key, lowest) == (identifier, at)


def _wilson(right: int, n: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if n == 0:
        return 0.0, 1.0
    z, p = 1.96, right / n
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return centre - half, centre + half
