"""Discovery on drawn cars: how often wheels, counts, axle, tracks, latency and antenna are right.

    python -m bench run discover [--cars 40] [--first 1] [--minutes 10] [--json FILE]

Each car has a drawn layout, meaningless names, ten decoys and, half the time, a late copy of its wheels
(`drawn_buses`); it is asked with its DBC and without. A result is right, undecided (the program says so) or
wrong; shares come with 95 % Wilson intervals. The second table holds probabilities against what was right.
Every second car has rings off their centres; the others' are perfect, as no real ring is.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

from bench.campaigns.offline.drawn_buses import DrawnBus, draw
from tpmsd.car.config.dbc import load_dbc
from tpmsd.foundation.wheels import WHEELS
from tpmsd.offline.discovery.discover import discover
from tpmsd.offline.discovery.result import BusDiscovery, FoundRole

_SURE = 0.95
_BINS = (0.0, 0.5, 0.7, 0.85, 0.95, 0.99, 1.01)
Claims = dict[str, list[tuple[float, bool]]]
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
    claims: Claims = {"wheels": [], "counts per revolution": [], "driven axle": []}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(args.first, args.first + args.cars):
            bus = draw(seed, 60.0 * args.minutes)
            file = Path(folder) / "bus.dbc"
            file.write_text(bus.dbc)
            for mode, database in (("with DBC", load_dbc(file)), ("raw", None)):
                found = discover(bus.log, bus.fixes, database, bus.tyre)
                _judge(counts, claims, mode, bus, found)
    _table(counts)
    _reliability(claims)
    return {
        "cars": args.cars,
        "first": args.first,
        "minutes": args.minutes,
        "counts": dict(counts),
        "claims": claims,
    }


def _table(counts: Counter[str]) -> None:
    rows = sorted({key.rsplit("|", 1)[0] for key in counts})
    print("| figure | right | undecided | wrong |")
    print("| --- | --- | --- | --- |")
    intervals: dict[str, None] = {}
    for row in rows:
        right, unsure, wrong = (counts[f"{row}|{what}"] for what in ("right", "undecided", "wrong"))
        low, high = _wilson(right, right + unsure + wrong)
        print(f"| {row} | {right} | {unsure} | {wrong} |")
        intervals[f"{right} of {right + unsure + wrong} {100 * low:.0f} to {100 * high:.0f} %"] = None
    print(f"\n95 % intervals: {', '.join(intervals)}.")


def _reliability(claims: Claims) -> None:
    """How often claims of a probability are right: roles without their DBC's names, teeth, axle."""
    print("\n| claims of | probability | number | mean probability | right | 95 % interval |")
    print("| --- | --- | --- | --- | --- | --- |")
    for what in sorted(claims):
        for low, high in pairwise(_BINS):
            reported = [(p, right) for p, right in claims[what] if low <= p < high]
            if not reported:
                continue
            right = sum(one for _, one in reported)
            mean = sum(p for p, _ in reported) / len(reported)
            least, most = _wilson(right, len(reported))
            span = f"{low:g} to {min(high, 1.0):g}"
            share = f"{right / len(reported):.3f} | {least:.2f} to {most:.2f}"
            print(f"| {what} | {span} | {len(reported)} | {mean:.3f} | {share} |")


def _judge(counts: Counter[str], claims: Claims, mode: str, bus: DrawnBus, found: BusDiscovery) -> None:
    """Count how wheels were found, and where the DBC names them rightly also ring, axle and measures."""
    wheels = _judge_wheels(claims, mode, bus, found)
    counts[f"four wheels, {mode}|{wheels}"] += 1
    if wheels != "right" or mode == "raw":
        return
    vehicle = bus.spec.vehicle
    if found.counts_per_rev is not None:
        probability, rings = found.counts_probability, "uneven" if bus.uneven else "perfect"
        same = found.counts_per_rev.value == vehicle.teeth_per_rev
        claims["counts per revolution"].append((probability, same))
        counts[f"counts per revolution, {rings} rings|{_outcome(probability >= _SURE, same)}"] += 1
    axle, probability = found.driven_axle or ("front", 0.0)
    claims["driven axle"].append((probability, axle == vehicle.driven_axle))
    counts[f"driven axle|{_outcome(probability >= _SURE, axle == vehicle.driven_axle)}"] += 1
    _judge_measures(counts, bus, found)


def _outcome(decided: bool, right: bool) -> str:
    return "undecided" if not decided else "right" if right else "wrong"


def _judge_wheels(claims: Claims, mode: str, bus: DrawnBus, found: BusDiscovery) -> str:
    """Return whether the four wheels are right, undecided or wrong; each one's probability is a claim."""
    if found.kind is None:
        return "undecided"
    right = [_is_wheel(bus, found, wheel, mode) for wheel in WHEELS]
    roles = zip(_wheels_of(found), right, strict=True)
    claims["wheels"] += [(role.probability, ok) for role, ok in roles if role is not None]
    return _outcome(found.wheels_decided, all(right))


def _judge_measures(counts: Counter[str], bus: DrawnBus, found: BusDiscovery) -> None:
    """Count which measures are within their bar or two standard deviations of the truth."""
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
        good = one is not None and abs(one.value - truth[key]) <= max(limit, 2 * one.std)
        counts[f"{key} within the bar or two std|{_outcome(one is not None, good)}"] += 1


def _wheels_of(found: BusDiscovery) -> list[FoundRole | None]:
    what = "" if found.kind is None else found.kind.removesuffix("s")
    return [found.roles.get(f"wheel_{what}_{wheel}") for wheel in WHEELS]


def _is_wheel(bus: DrawnBus, found: BusDiscovery, wheel: str, mode: str) -> bool:
    role = found.roles.get(f"wheel_{bus.layout.kind.removesuffix('s')}_{wheel}")
    if role is None:
        return False
    if mode == "with DBC":
        return role.field.signal == bus.truth[wheel]
    layout = role.field.layout
    lowest = layout.shift
    if layout.big_endian:
        lowest = 8 * (layout.word_bytes - 1 - layout.shift // 8) + layout.shift % 8
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
