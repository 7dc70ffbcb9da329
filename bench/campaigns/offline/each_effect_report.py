"""The tables of the campaign `each-effect`.

In: rows. Out: Markdown. Shares bear 95 % intervals of Clopper and Pearson. A drive identifies an effect by
`effect_tells.py`; `named` and `named first` are of such drives, wrong names of all drives. Names that are
true beside the effect are passed over: they are neither first nor wrong.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from bench.campaigns.offline.diagnosed import Row, by_half, parted
from bench.campaigns.offline.effect_cases import CASES
from bench.statistics import count, percent

SURE = 0.9
STDS = 1.96
"""Of a 95 % interval."""


def judged(row: Row) -> list[dict[str, Any]]:
    """Its findings without those that are true beside the effect."""
    return [each for each in row["findings"] if each["effect"] not in row["also"]]


def named(row: Row) -> bool:
    """Whether the effect is among the findings."""
    return any(each["effect"] == row["effect"] for each in row["findings"])


def named_first(row: Row) -> bool:
    """Whether it is the strongest finding."""
    left = judged(row)
    return bool(left) and left[0]["effect"] == row["effect"]


def right_wheels(row: Row) -> bool:
    """Whether it is found on the wheels on which it acts."""
    found = (each for each in row["findings"] if each["effect"] == row["effect"])
    return any(set(each["where"]["wheels"]) == set(row["wheels"]) for each in found)


def wrong_names(row: Row) -> list[str]:
    """Names of the catalogue that are sure and not true."""
    sure = [each["effect"] for each in judged(row) if each["confidence"] > SURE]
    return [name for name in sure if name not in (row["effect"], "unknown")]


def errors(row: Row) -> Iterable[tuple[str, float]]:
    """Parameters found, with their errors in standard deviations."""
    for finding in row["findings"]:
        if finding["effect"] == row["effect"]:
            for name, true in row["truth"].items():
                value, std = finding["parameters"].get(name, (None, None))
                if isinstance(value, float) and std:
                    yield name, (value - true) / std


def markdown(rows: Sequence[Row]) -> str:
    """All tables."""
    done, failed = parted(rows)
    parts = []
    for title, those in by_half(done):
        parts += [f"### {title}\n", _totals(those), _telling(those), _misses(those)]
    if failed:
        reported = ", ".join(f"{row['effect']} {row['seed']}" for row in failed)
        parts.append(f"Not diagnosed, the program or the benchmark failed: {reported}.\n")
    return "\n".join(parts)


def _totals(rows: Sequence[Row]) -> str:
    can = [row for row in rows if row["can"]]
    held = [abs(z) <= STDS for row in can for _, z in errors(row)]
    lines = ["| figure | measured | bar |", "| --- | --- | --- |"]
    for name, part, bar in (
        ("drives that identify it", count(row["can"] for row in rows), ""),
        ("- named", count(map(named, can)), ""),
        ("- named first", count(map(named_first, can)), "95 %"),
        ("- of these on the right wheels", count(right_wheels(row) for row in can if _on_wheels(row)), ""),
        ("95 % intervals that hold the truth", count(held), "90 to 98 %"),
        ("all drives: a wrong name above 0.9", count(bool(wrong_names(row)) for row in rows), "none"),
        ("all drives: an `unknown`", count(map(_unknown, rows)), ""),
    ):
        lines.append(f"| {name} | {percent(part)} | {bar} |")
    return "\n".join(lines) + "\n"


def _on_wheels(row: Row) -> bool:
    return bool(row["wheels"]) and named(row)


def _unknown(row: Row) -> bool:
    return any(each["effect"] == "unknown" for each in judged(row))


def _telling(rows: Sequence[Row]) -> str:
    """Return the effects that some drives do not identify, with their number, and how many others."""
    blind, others = [], 0
    for effect in CASES:
        can = [row["can"] for row in rows if row["effect"] == effect]
        if not all(can):
            blind.append(f"`{effect}` {len(can) - sum(can)}/{len(can)}")
        elif can:
            others += 1
    reported = f"All of the other {others} effects can. Misses:\n"
    return f"Not identifiable on: {', '.join(blind) or 'none'}. {reported}"


def _misses(rows: Sequence[Row]) -> str:
    """Return what was missed or wrong, drive by drive."""
    lines = []
    for row in rows:
        wrong, missed = wrong_names(row), row["can"] and not named_first(row)
        off = [f"{name} {z:+.1f}" for name, z in errors(row) if row["can"] and abs(z) > STDS]
        if wrong or missed or off or _unknown(row):
            found = ", ".join(f"{each['effect']} {each['confidence']:.2f}" for each in row["findings"])
            close = f", {row['margin']:.0f} beyond `{row['rival']}`" if row["rival"] else ""
            said = [f"found: {found or 'nothing'}"]
            if off:
                said.append(f"off by {', '.join(off)} standard deviations")
            lines.append(
                f"- `{row['effect']}` {row['seed']} ({row['gain']:.0f} nats{close}): {'; '.join(said)}"
            )
    return "\n".join(sorted(lines)) + "\n"
