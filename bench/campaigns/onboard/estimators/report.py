"""The tables, in Markdown.

In: the bench's result as plain numbers. Out: text.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from bench.campaigns.onboard.estimators.methods import (
    ALL,
    DEFAULT,
    INPUTS,
    POSITIONS,
    SAMPLED,
    TEXTBOOK,
    WANTED,
)
from bench.campaigns.onboard.estimators.summary import (
    Claim,
    bars,
    diverged,
    interval,
    paired,
    paper_claims,
    pick,
)
from bench.campaigns.onboard.estimators.tasks import FOUR, NUMBERS, RECEIVERS, USUAL
from bench.worlds.paper_drive import SCENARIOS

Row = dict[str, Any]
ADDED = [name for name in INPUTS if name not in (POSITIONS, ALL)]
"""Columns of the table of one measurement more; positions alone and all have tables of their own."""
SHOWN = [name for name in SCENARIOS if name != "unbalanced"]
"""Columns of the tables of scenarios; on the unbalanced drive the figures are those of the balanced one."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A Markdown table and an empty line."""
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def number(value: float, digits: int = 3) -> str:
    """A figure, or a dash where there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def markdown(result: dict[str, Any]) -> str:
    """All tables of what was done."""
    lines = []
    lines.append(
        f"Commit {result['commit']}; {result['machine']}; {result['elapsed_s'] / 60:.1f} min. "
        "Figures are means over drives and half the width of their 95 % intervals (Student's t)."
    )
    if result["missing"]:
        lines.append(f"Not among this program's methods: {', '.join(result['missing'])}.")
    lines.append("")
    rows: list[Row] = result.get("rows", [])
    speed = result.get("speed")
    batches: list[Row] = result.get("batches", [])
    if rows:
        lines += _claims("The paper's claims, by positions alone", paper_claims(rows, speed, batches))
        lines += _claims("Beyond the paper", bars(speed)) if speed is not None else []
        for receiver in RECEIVERS:
            lines += _fig9(rows, receiver)
        lines += _fig10(rows + batches)
        for receiver in RECEIVERS:
            lines += _scenarios(rows, receiver, POSITIONS)
        lines += _scenarios(rows, "correlated", ALL)
        lines += _inputs(rows)
        lines += _ratios(rows)
    if speed is not None:
        lines += _speed(speed)
    if result.get("recordings"):
        lines += _recordings(result["recordings"])
    if result.get("survival"):
        lines += _survival(result["survival"])
    return "\n".join(lines).rstrip() + "\n"


def within(pair: tuple[float, float], digits: int = 3) -> str:
    """A mean and half the width of its interval."""
    middle, half = pair
    if not math.isfinite(half):
        return number(middle, digits)
    return f"{middle:.{digits}f}±{half:.{digits}f}"


def _claims(title: str, claims: list[Claim]) -> list[str]:
    said = {True: "holds", False: "does not hold", None: "not looked at"}
    return [
        f"## {title}",
        "",
        *table(("claim", "here", "figures"), [(c.text, said[c.holds], c.figures) for c in claims]),
    ]


def _order(methods: Iterable[str]) -> list[str]:
    return sorted(methods, key=lambda m: WANTED.index(m) if m in WANTED else len(WANTED))


def _fig9(rows: list[Row], receiver: str) -> list[str]:
    some = pick(rows, scenario="puncture", receiver=receiver, front=False, inputs=POSITIONS)
    lines = [f"## RMSE of mu3 - mu4 on the slow puncture, mm (Fig 9), {receiver} position errors", ""]
    body = []
    for method in _order({row["method"] for row in some} - {"limit"}):
        cells = []
        for count in NUMBERS if method in SAMPLED else (0,):
            these = pick(some, method=method, particles=count)
            found = within(interval(these, "rmse_difference_m", 1e3))
            cells.append(found if these else "")
        body.append((method, *cells, *[""] * (len(NUMBERS) - len(cells))))
    return lines + table(("method", *(f"N={n}" for n in NUMBERS)), body)


def _fig10(rows: list[Row]) -> list[str]:
    """Return a table of the methods that diverged, and a sentence with the others."""
    lines = [
        "## Runs that diverged (Fig 10), of the puncture",
        "",
        "Runs of 100 particles include the batches.",
        "",
    ]
    body, sound = [], []
    for receiver in RECEIVERS:
        some = pick(rows, scenario="puncture", receiver=receiver, front=False, inputs=POSITIONS)
        for method in _order({row["method"] for row in some} - {"limit"}):
            cells = []
            for count in NUMBERS if method in SAMPLED else (0,):
                these = pick(some, method=method, particles=count)
                bad, of = diverged(these)
                cells.append(f"{bad}/{of}" if of else "")
            if diverged(pick(some, method=method))[0]:
                body.append((method, receiver, *cells, *[""] * (len(NUMBERS) - len(cells))))
            else:
                sound.append(f"{method} ({receiver})")
    lines += table(("method", "receiver", *(f"N={n}" for n in NUMBERS)), body)
    return [*lines, f"No run diverged of {', '.join(sound)}.", ""] if sound else lines


def _scenarios(rows: list[Row], receiver: str, inputs: str) -> list[str]:
    outcome = "positions alone" if inputs == POSITIONS else "positions, speed and course"
    lines = [f"## RMSE diff. / radius, mm, at N={USUAL}: {receiver} position errors, {outcome}", ""]
    body = []
    for method, front in [(m, False) for m in WANTED] + [(m, True) for m in FOUR]:
        count = USUAL if method in SAMPLED else 0
        cells = []
        for scenario in SHOWN:
            cell = {"scenario": scenario, "receiver": receiver, "inputs": inputs, "front": front}
            some = pick(rows, **cell, method=method, particles=count)
            pair = [within(interval(some, f"rmse_{name}_m", 1e3)) for name in ("difference", "radius")]
            cells.append(" / ".join(pair) if some else "")
        if any(cells):
            body.append((f"{method}, four wheels" if front else method, *cells))
    return lines + table(("method", *SHOWN), body)


def _inputs(rows: list[Row]) -> list[str]:
    lines = ["## Each measurement added: slow puncture, correlated errors", ""]
    lines += [
        f"RMSE of mu3 - mu4 / of the radius, mm, N={USUAL}, rear pair; for none and both see above.",
        "",
    ]
    body = []
    for method in WANTED:
        cells = []
        for inputs in ADDED:
            cell = {"scenario": "puncture", "receiver": "correlated", "front": False, "inputs": inputs}
            some = pick(rows, **cell, method=method, particles=USUAL if method in SAMPLED else 0)
            pair = [within(interval(some, f"rmse_{name}_m", 1e3)) for name in ("difference", "radius")]
            cells.append(" / ".join(pair) if some else "")
        if any(cells):
            body.append((method, *cells))
    return lines + table(("method", *ADDED), body)


def _ratios(rows: list[Row]) -> list[str]:
    lines = [
        "## Ratios by positions alone, rear pair",
        "",
        f"Of RMSEs on the same drives, all scenarios, N={USUAL}; geometric mean and 95 % interval. "
        "Causal and smoother know the noise of this very receiver.",
        "",
    ]
    body = []
    for receiver in RECEIVERS:
        cell = {"receiver": receiver, "inputs": POSITIONS, "front": False}
        limits = pick(rows, **cell, method="limit")
        for method in (DEFAULT, "mpf-pn"):
            ours = pick(rows, **cell, method=method)
            ours = [r for r in ours if r["particles"] in (0, USUAL)]
            alternatives = {TEXTBOOK: pick(rows, **cell, method=TEXTBOOK, particles=USUAL)}
            alternatives |= {kind: [r | r[kind] for r in limits] for kind in ("causal", "smoother")}
            for name, theirs in alternatives.items():
                cells = []
                for what in ("difference", "radius"):
                    ratio, low, high = paired(ours, theirs, f"rmse_{what}_m")
                    cells.append(f"{ratio:.2f} [{low:.2f}, {high:.2f}]")
                body.append((receiver, method, name, *cells))
    return lines + table(("receiver", "method", "against", "difference", "radius"), body)


def _speed(speed: dict[str, Any]) -> list[str]:
    cost = speed["methods_ms"]
    numbers = sorted({int(n) for values in cost.values() for n in values} - {0})
    lines = ["## Run time per tick, ms (Table III)", ""]
    body = []
    for method, values in cost.items():
        own = (number(values["0"]),) if "0" in values else ("",)
        body.append((method, *own, *(number(values[str(n)]) if str(n) in values else "" for n in numbers)))
    library = speed["library_ms"]
    body.append(
        (
            "library `particles`, AUG-PF",
            "",
            *(number(library[str(n)]) if str(n) in library else "" for n in numbers),
        )
    )
    kernel = speed["kernel_ms"]
    if isinstance(kernel, str):
        lines += [kernel, ""]
    else:
        body.append(("compiled kernel of MPF-PN", "", *(number(kernel[str(n)]) for n in numbers)))
    lines += table(("method", "own N", *(f"N={n}" for n in numbers)), body)
    fits = [
        (m, number(f["fixed_ms"]), number(f["per_1000_ms"]), f"{100 * f['worst_misfit']:.0f} %")
        for m, f in speed["linear"].items()
    ]
    lines += table(("cost over N", "fixed ms", "ms per 1000 particles", "worst misfit"), fits)
    return lines


def _recordings(rows: list[Row]) -> list[str]:
    lines = ["## Real recordings, with the artificial drop of 2.5 mm injected", ""]
    head: tuple[str, ...] = (
        "recording",
        "method",
        "tyres' own mu3 - mu4 mm",
        "RMSE as it is mm",
        "RMSE with drop mm",
    )
    head += ("drop seen at the end mm", "pose given up")
    body = [
        (
            Path(row["folder"]).name,
            row["method"],
            f"{row['own_mm']:.2f} +- {row['own_std_mm']:.2f}",
            number(row["rmse_plain_mm"]),
            number(row["rmse_drop_mm"]),
            f"{row['seen_drop_mm']:.2f} of {row['laid_drop_mm']:.2f}",
            str(row["lost"]),
        )
        for row in rows
    ]
    return lines + table(head, body)


def _survival(rows: list[Row]) -> list[str]:
    lines = ["## Hours of driving with stops, outages, counter resets and pauses", ""]
    head: tuple[str, ...] = (
        "method",
        "hours",
        "survived",
        "RMSE diff. mm, first to last hour",
        "stated mm",
        "state bytes",
        "peak MB",
        "ms per tick",
    )
    body = []
    for row in rows:
        first, last = row["hourly"][0], row["hourly"][-1]
        body.append(
            (
                row["method"],
                f"{row['hours']:g}",
                "yes" if row["survived"] else "no: " + "; ".join(row["faults"]),
                f"{first['rmse_difference_mm']:.3f} to {last['rmse_difference_mm']:.3f}",
                f"{first['std_difference_mm']:.3f} to {last['std_difference_mm']:.3f}",
                f"{first['state_bytes']:.0f} to {last['state_bytes']:.0f}",
                f"{first['peak_mb']:.0f} to {last['peak_mb']:.0f}",
                number(row["cpu_ms"]),
            )
        )
    return lines + table(head, body)
