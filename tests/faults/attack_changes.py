"""What an attacker, a broken receiver or a workshop does to a drive: changes of its items or of its ticks.

In: the items (frames and sentences in the order of arrival) or the ticks of a drive, and the stamp of its
beginning. Out: what is really received. Each function makes such a change.
"""

from __future__ import annotations

import datetime
import functools
import operator
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from tests.faults.drives import Change, Item
from tpmsd.onboard.sources.can.frame import CanFrame
from tpmsd.onboard.sources.drive import Sentence
from tpmsd.onboard.timeline.tick import Tick

WHEELS_ID = 0xB0
"""Frame of the four counters on the bus `counts16`; two bytes each, fl fr rl rr."""
FROM_S, TO_S = 120.0, 300.0
"""When something happens that passes."""
NOMINAL_M = 0.316
TickChange = Callable[[list[Tick], float], Iterable[Tick]]
DAY_S = 86_400.0


def is_wheels(item: Item) -> bool:
    return isinstance(item, CanFrame) and item.arbitration_id == WHEELS_ID


def in_time(items: Iterable[Item]) -> list[Item]:
    """Return the items in the order of their stamps; those of equal stamps stay as they were."""
    return sorted(items, key=lambda item: item.time_s)


def duplicated(later_s: float, from_s: float = FROM_S, to_s: float = TO_S) -> Change:
    """Each of the wheels' frames comes a second time, `later_s` after the first."""

    def change(items: list[Item], start_s: float) -> list[Item]:
        copies = (
            item._replace(time_s=item.time_s + later_s)
            for item in items
            if is_wheels(item) and from_s <= item.time_s - start_s < to_s
        )
        return in_time([*items, *copies])

    return change


def exchanged(one: int, other: int, from_s: float = FROM_S, to_s: float = 1e9) -> Change:
    """The counters of two wheels change their places in the frame."""
    order = list(range(4))
    order[one], order[other] = other, one

    def change(items: list[Item], start_s: float) -> list[Item]:
        out: list[Item] = []
        for item in items:
            if is_wheels(item) and isinstance(item, CanFrame) and from_s <= item.time_s - start_s < to_s:
                item = item._replace(data=np.frombuffer(item.data, "<u2")[order].tobytes())
            out.append(item)
        return out

    return change


def clock_set(step_s: float, from_s: float = FROM_S) -> Change:
    """All stamps step: the host's clock is set."""

    def change(items: list[Item], start_s: float) -> list[Item]:
        return [
            item._replace(time_s=item.time_s + step_s) if item.time_s - start_s >= from_s else item
            for item in items
        ]

    return change


def clock_rate(ppm: float, bus_alone: bool = False) -> Change:
    """The host's clock, or that of the bus interface alone, runs fast by so many millionths."""

    def change(items: list[Item], start_s: float) -> list[Item]:
        return in_time(
            item
            if bus_alone and isinstance(item, Sentence)
            else item._replace(time_s=start_s + (item.time_s - start_s) * (1.0 + 1e-6 * ppm))
            for item in items
        )

    return change


def sealed(fields: list[bytes]) -> bytes:
    """Return the sentence of these fields, with its checksum."""
    body = b",".join(fields)
    return b"$%s*%02X" % (body, functools.reduce(operator.xor, body))


def utc_jumps(step_s: float, from_s: float = FROM_S, to_s: float = 1e9) -> Change:
    """The receiver's time is off by so much; a leap second that it takes up late is a step of -1 s."""

    def change(items: list[Item], start_s: float) -> list[Item]:
        return [
            item._replace(line=_at_other_time(item.line, step_s))
            if isinstance(item, Sentence) and from_s <= item.time_s - start_s < to_s
            else item
            for item in items
        ]

    return change


def _at_other_time(line: bytes, step_s: float) -> bytes:
    fields = line[1 : line.rindex(b"*")].split(b",")
    reported, dated = fields[1], fields[0].endswith(b"RMC")
    day = datetime.datetime(2024, 7, 1, tzinfo=datetime.UTC)
    if dated:
        day = datetime.datetime.strptime(fields[9].decode(), "%d%m%y").replace(tzinfo=datetime.UTC)
    of_day_s = 3600.0 * int(reported[:2]) + 60.0 * int(reported[2:4]) + float(reported[4:])
    moment = day + datetime.timedelta(seconds=round(of_day_s + step_s, 3))
    digits = len(reported.partition(b".")[2])
    fields[1] = moment.strftime("%H%M%S.%f").encode()[: 7 + digits]
    if dated:
        fields[9] = moment.strftime("%d%m%y").encode()
    return sealed(fields)


def receiver_scaled(share: float) -> TickChange:
    """The receiver scales speeds and positions (about its first fix) alike, from the beginning on."""

    def change(ticks: list[Tick], start_s: float) -> list[Tick]:
        by = 1.0 + share
        return [
            replace(
                tick,
                fixes=tuple(
                    replace(f, speed_mps=f.speed_mps * by, east_m=f.east_m * by, north_m=f.north_m * by)
                    for f in tick.fixes
                ),
            )
            for tick in ticks
        ]

    return change


def receiver_drifts(share: float) -> TickChange:
    """Speeds and the ways between positions are scaled alike, by degrees from second 100 to second 300."""

    def change(ticks: list[Tick], start_s: float) -> list[Tick]:
        out, before, shown = [], None, np.zeros(2)
        for tick in ticks:
            by = 1.0 + share * min(max((tick.time_s - start_s - 100.0) / 200.0, 0.0), 1.0)
            fixes = []
            for fix in tick.fixes:
                place = np.array([fix.east_m, fix.north_m])
                shown = place if before is None else shown + by * (place - before)
                before = place
                east_m, north_m = shown.tolist()
                fixes.append(replace(fix, speed_mps=fix.speed_mps * by, east_m=east_m, north_m=north_m))
            out.append(replace(tick, fixes=tuple(fixes)))
        return out

    return change


def speed_scaled(share: float) -> TickChange:
    """Speeds alone are scaled, by degrees from second 100 to second 300."""

    def change(ticks: list[Tick], start_s: float) -> list[Tick]:
        out = []
        for tick in ticks:
            by = 1.0 + share * min(max((tick.time_s - start_s - 100.0) / 200.0, 0.0), 1.0)
            out.append(replace(tick, fixes=tuple(replace(f, speed_mps=f.speed_mps * by) for f in tick.fixes)))
        return out

    return change


def replayed_fixes(ticks: list[Tick], start_s: float) -> list[Tick]:
    """The receiver says for 150 s, with fresh time, what it said two minutes ago."""
    out, behind = list(ticks), 1200
    for k in range(1500, 3000):
        old = ticks[k - behind]
        later_s = ticks[k].time_s - old.time_s
        out[k] = replace(ticks[k], fixes=tuple(replace(f, time_s=f.time_s + later_s) for f in old.fixes))
    return out


def early_stamps(items: list[Item], start_s: float) -> list[Item]:
    """Frames are stamped 0.3 s too early in every other span of five seconds."""
    return [
        item._replace(time_s=item.time_s - 0.3)
        if isinstance(item, CanFrame)
        and FROM_S <= item.time_s - start_s < TO_S
        and int((item.time_s - start_s) / 5.0) % 2
        else item
        for item in items
    ]


def turned(factors: list[float], from_s: float = 0.0) -> TickChange:
    """The wheels turn by these factors more."""

    def change(ticks: list[Tick], start_s: float) -> list[Tick]:
        by = np.array(factors)
        return [
            replace(tick, rotation_rad=tick.rotation_rad * by) if tick.time_s - start_s >= from_s else tick
            for tick in ticks
        ]

    return change


def rotated_left(ticks: list[Tick], start_s: float) -> Iterable[Tick]:
    """The tyres of the left side change places in second 120: 1 mm more in front, 1 mm less behind."""
    larger, smaller = NOMINAL_M / (NOMINAL_M + 1e-3), NOMINAL_M / (NOMINAL_M - 1e-3)
    return turned([larger, 1.0, smaller, 1.0], FROM_S)(ticks, start_s)


def spoofed(items: list[Item], start_s: float) -> list[Item]:
    """A second node sends counters of its own, on which the rear left wheel turns 2 % faster."""
    own, before = np.array([100.0, 7000.0, 30000.0, 50000.0]), np.zeros(4, dtype=np.int64)
    out: list[Item] = []
    for item in items:
        out.append(item)
        if is_wheels(item) and isinstance(item, CanFrame) and FROM_S <= item.time_s - start_s < TO_S:
            counts = np.frombuffer(item.data, "<u2").astype(np.int64)
            own += (counts - before) % 65536 * np.array([1.0, 1.0, 1.02, 1.0]) if before.any() else 0.0
            before = counts
            other = (own.astype(np.int64) % 65536).astype("<u2").tobytes()
            out.append(item._replace(time_s=item.time_s + 0.007, data=other))
    return in_time(out)


def frozen_counters(items: list[Item], start_s: float) -> list[Item]:
    """The counters stand while the car drives."""
    held: list[bytes] = []
    out: list[Item] = []
    for item in items:
        if is_wheels(item) and isinstance(item, CanFrame) and FROM_S <= item.time_s - start_s < TO_S:
            held = held or [item.data]
            item = item._replace(data=held[0])
        out.append(item)
    return out


def silent_counter(wheel: int) -> TickChange:
    """One counter gives no value from second 60 on."""

    def change(ticks: list[Tick], start_s: float) -> list[Tick]:
        out = []
        for tick in ticks:
            rotation = tick.rotation_rad.copy()
            if tick.time_s - start_s > 60.0:
                rotation[wheel] = np.nan
            out.append(replace(tick, rotation_rad=rotation))
        return out

    return change


def frozen_position(items: list[Item], start_s: float) -> list[Item]:
    """The receiver repeats one place, with fresh time and speed."""
    places: dict[bytes, list[bytes]] = {}
    out: list[Item] = []
    for item in items:
        if isinstance(item, Sentence) and FROM_S <= item.time_s - start_s < TO_S:
            fields = item.line[1 : item.line.rindex(b"*")].split(b",")
            at = 3 if fields[0].endswith(b"RMC") else 2
            fields[at : at + 4] = places.setdefault(fields[0], fields[at : at + 4])
            item = item._replace(line=sealed(fields))
        out.append(item)
    return out


def jumped_position(items: list[Item], start_s: float) -> list[Item]:
    """Positions are 10 km to the north for a while."""
    out: list[Item] = []
    for item in items:
        if isinstance(item, Sentence) and FROM_S <= item.time_s - start_s < TO_S:
            fields = item.line[1 : item.line.rindex(b"*")].split(b",")
            at = 3 if fields[0].endswith(b"RMC") else 2
            reported = fields[at]
            minutes = float(reported[2:]) + 5.4
            degrees = int(reported[:2]) + int(minutes // 60.0)
            fields[at] = f"{degrees:02d}{minutes % 60.0:010.7f}".encode()
            item = item._replace(line=sealed(fields))
        out.append(item)
    return out


def noise(items: list[Item], start_s: float) -> list[Item]:
    """The receiver's line carries noise in place of sentences."""
    rng = np.random.default_rng(1)
    return [
        item._replace(line=rng.bytes(60))
        if isinstance(item, Sentence) and FROM_S <= item.time_s - start_s < TO_S
        else item
        for item in items
    ]
