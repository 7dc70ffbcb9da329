"""The tables, in Markdown.

In: the bench's result as plain numbers. Out: text.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from bench.campaigns.onboard.estimators.methods import DEFAULT, SAMPLED, WANTED
from bench.campaigns.onboard.estimators.summary import (
    Claim,
    bars,
    diverged,
    fig9,
    mean,
    paper_claims,
    pick,
    ratios,
)
from bench.campaigns.onboard.estimators.tasks import NUMBERS, RECEIVERS, USUAL
from bench.worlds.paper_drive import SCENARIOS

Row = dict[str, Any]


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A Markdown table and an empty line."""
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    return [*lines, *("| " + " | ".join(row) + " |" for row in rows), ""]


def number(value: float, digits: int = 3) -> str:
    """A figure, or a dash where there is none."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def markdown(result: dict[str, Any]) -> str:
    """All tables of what was done."""
    lines = ["# Estimators", ""]
    lines.append(
        f"Commit {result['commit']}; {result['machine']}; {result['runs']} Monte-Carlo runs (half of them "
        f"with N={NUMBERS[-1]}); {result['elapsed_s'] / 60:.1f} min."
    )
    if result["missing"]:
        lines.append(f"Not among this program's methods: {', '.join(result['missing'])}.")
    lines.append("")
    rows: list[Row] = result.get("rows", [])
    speed = result.get("speed")
    batches: list[Row] = result.get("batches", [])
    if rows:
        lines += _claims("The paper's claims", paper_claims(rows, speed, batches))
        lines += _claims("Beyond the paper", bars(rows, speed))
        for receiver in RECEIVERS:
            lines += _fig9(rows, receiver)
        lines += _fig10(rows + batches)
        for receiver in RECEIVERS:
            lines += _scenarios(rows, receiver)
        lines += _ratios(rows)
    if batches:
        lines += _batches(batches)
    if speed is not None:
        lines += _speed(speed)
    if result.get("recordings"):
        lines += _recordings(result["recordings"])
    if result.get("survival"):
        lines += _survival(result["survival"])
    return "\n".join(lines).rstrip() + "\n"


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
    found = fig9(rows, receiver)
    lines = [f"## RMSE of mu3 - mu4 on the slow puncture, mm (Fig 9), {receiver} position errors", ""]
    body = []
    for method in _order(found):
        if method in SAMPLED:
            body.append((method, *(number(found[method].get(n, math.nan)) for n in NUMBERS)))
        else:
            body.append((method, number(found[method].get(0, math.nan)), *[""] * (len(NUMBERS) - 1)))
    return lines + table(("method", *(f"N={n}" for n in NUMBERS)), body)


def _fig10(rows: list[Row]) -> list[str]:
    lines = ["## Runs that diverged (Fig 10), of the puncture", ""]
    body = []
    for receiver in RECEIVERS:
        some = pick(rows, scenario="puncture", receiver=receiver, front=False)
        for method in _order({row["method"] for row in some} - {"limit"}):
            cells = []
            for count in NUMBERS if method in SAMPLED else (0,):
                these = pick(some, method=method, particles=count)
                bad, of = diverged(these)
                why = ", ".join(sorted({row["diverged"] for row in these if row["diverged"]}))
                cells.append(f"{bad}/{of}" + (f" ({why})" if why else ""))
            cells += [""] * (len(NUMBERS) - len(cells))
            body.append((method, receiver, *cells))
    return lines + table(("method", "receiver", *(f"N={n}" for n in NUMBERS)), body)


def _scenarios(rows: list[Row], receiver: str) -> list[str]:
    lines = [f"## All scenarios at N={USUAL}, {receiver} position errors", ""]
    head: tuple[str, ...] = (
        "scenario",
        "method",
        "RMSE diff. mm",
        "RMSE radius mm",
        "cover diff. %",
        "cover radius %",
    )
    head += ("NEES diff. (1)", "NEES pair (2)", "diverged")
    body = []
    for scenario in SCENARIOS:
        for method in (*WANTED, f"{DEFAULT} 4"):
            front = method.endswith(" 4")
            name = method.removesuffix(" 4")
            count = USUAL if name in SAMPLED else 0
            some = pick(rows, scenario=scenario, receiver=receiver, method=name, particles=count, front=front)
            if not some:
                continue
            bad, of = diverged(some)
            body.append(
                (
                    scenario,
                    f"{name}, four wheels" if front else name,
                    number(1e3 * mean(some, "rmse_difference_m")),
                    number(1e3 * mean(some, "rmse_radius_m")),
                    number(100 * mean(some, "cover_difference"), 0),
                    number(100 * mean(some, "cover_radius"), 0),
                    number(mean(some, "nees_difference"), 2),
                    number(mean(some, "nees_pair"), 2),
                    f"{bad}/{of}",
                )
            )
    return lines + table(head, body)


def _ratios(rows: list[Row]) -> list[str]:
    lines = [
        f"## {DEFAULT} against the textbook MPF-PN of {NUMBERS[-1]} particles and what the data hold",
        "",
        "Causal and smoother know the noise of this very receiver and hear the rear pair only.",
        "",
    ]
    head: tuple[str, ...] = (
        "receiver",
        "scenario",
        "wheels",
        "error of",
        f"{DEFAULT} mm",
        "textbook mm",
        "ratio",
    )
    head += ("causal limit mm", "ratio", "smoother mm", "ratio")
    body = []
    for receiver in RECEIVERS:
        for line in ratios(rows, receiver):
            for name in ("difference", "radius"):
                body.append(
                    (
                        receiver,
                        line["scenario"],
                        "four" if line["front"] else "rear",
                        name,
                        number(line[f"{name}_mm"]),
                        number(line[f"{name}_book_mm"]),
                        number(line[f"{name}_to_book"], 2),
                        number(line[f"{name}_causal_mm"]),
                        number(line[f"{name}_to_causal"], 1),
                        number(line[f"{name}_smoother_mm"]),
                        number(line[f"{name}_to_smoother"], 1),
                    )
                )
    return lines + table(head, body)


def _batches(rows: list[Row]) -> list[str]:
    lines = ["## Many runs of MPF-PN at once", ""]
    body = []
    for key in sorted({(r["receiver"], r["particles"]) for r in rows}):
        some = pick(rows, receiver=key[0], particles=key[1])
        bad, of = diverged(some)
        body.append(
            (
                key[0],
                str(key[1]),
                f"{bad}/{of}",
                number(1e3 * mean(some, "rmse_difference_m")),
                number(mean(some, "cpu_ms")),
            )
        )
    return lines + table(("receiver", "N", "diverged", "RMSE diff. mm", "ms per tick and run"), body)


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
    where = dict(speed["where"])
    calls = where.pop("calls_per_tick")
    lines += [f"Where a tick of MPF-PN with N={USUAL} goes ({calls:.0f} calls):", ""]
    return lines + table(("part", "share"), [(name, f"{100 * share:.0f} %") for name, share in where.items()])


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
