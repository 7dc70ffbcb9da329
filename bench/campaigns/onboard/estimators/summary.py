"""From the rows of single runs to means, ratios and verdicts.

In: rows of `tasks.perform`. Out: plain numbers, and what each claim of Lundquist et al. (2013) came to.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from scipy.stats import t as student_t

from bench.campaigns.onboard.estimators.methods import DEFAULT, POSITIONS, TEXTBOOK
from bench.campaigns.onboard.estimators.tasks import LIMIT, NUMBERS, RECEIVERS, USUAL

Row = dict[str, Any]
LIBRARY_BAR = 5.0
COST_MS, COST_RATIO = 0.15, 2.5
KERNEL_BAR = 1.0 / 3.0
EQUAL = 1.10
"""Within a tenth two RMSEs are called the same."""


@dataclass(frozen=True)
class Claim:
    """A sentence, whether it holds (None: not looked at), and the figures."""

    text: str
    holds: bool | None
    figures: str


def pick(rows: list[Row], **want: Any) -> list[Row]:
    """Rows whose entries are as wanted."""
    return [row for row in rows if all(row.get(key) == value for key, value in want.items())]


def mean(rows: list[Row], key: str) -> float:
    """Mean over the finite values; NaN for none."""
    values = [row[key] for row in rows if math.isfinite(row[key])]
    return sum(values) / len(values) if values else math.nan


def interval(rows: list[Row], key: str, scale: float = 1.0) -> tuple[float, float]:
    """Mean over the drives and half the width of its 95 % interval, by Student's t; NaN where there are too
    few."""
    values = [scale * row[key] for row in rows if math.isfinite(row[key])]
    if not values:
        return math.nan, math.nan
    middle = sum(values) / len(values)
    if len(values) < 2:
        return middle, math.nan
    variance = sum((value - middle) ** 2 for value in values) / (len(values) - 1)
    return middle, float(student_t.ppf(0.975, len(values) - 1)) * math.sqrt(variance / len(values))


def paired(ours: list[Row], theirs: list[Row], key: str) -> tuple[float, float, float]:
    """Geometric mean of the ratio over the drives that both have, and its 95 % interval."""
    by_drive = {(row["scenario"], row["receiver"], row["seed"]): row[key] for row in theirs}
    logs = [
        {"log": math.log(row[key] / other)}
        for row in ours
        if (other := by_drive.get((row["scenario"], row["receiver"], row["seed"]), 0.0)) > 0.0
    ]
    middle, half = interval(logs, "log")
    return math.exp(middle), math.exp(middle - half), math.exp(middle + half)


def rms(rows: list[Row], key: str) -> float:
    """Root mean square over the finite values; NaN for none."""
    values = [row[key] ** 2 for row in rows if math.isfinite(row[key])]
    return math.sqrt(sum(values) / len(values)) if values else math.nan


def diverged(rows: list[Row]) -> tuple[int, int]:
    """How many runs diverged, and of how many."""
    return sum(bool(row["diverged"]) for row in rows), len(rows)


def fig9(rows: list[Row], receiver: str) -> dict[str, dict[int, float]]:
    """Method -> N -> mean RMSE of mu3 - mu4 on the puncture, mm; N = 0: no such number."""
    out: dict[str, dict[int, float]] = {}
    for row in pick(rows, scenario="puncture", receiver=receiver, front=False, inputs=POSITIONS):
        if row["method"] != LIMIT:
            out.setdefault(row["method"], {})[row["particles"]] = math.nan
    for method, numbers in out.items():
        for number in numbers:
            some = pick(
                rows,
                scenario="puncture",
                receiver=receiver,
                front=False,
                inputs=POSITIONS,
                method=method,
                particles=number,
            )
            numbers[number] = 1e3 * mean(some, "rmse_difference_m")
    return {method: dict(sorted(numbers.items())) for method, numbers in out.items()}


def ratios(rows: list[Row], receiver: str) -> list[Row]:
    """Per scenario, and over all together: the default against the textbook MPF-PN, both by positions, and
    the limits, on the drives that both have."""
    out = []
    scenarios = sorted({row["scenario"] for row in rows})
    for scenario in [*scenarios, "all"]:
        wanted = {"receiver": receiver, "inputs": POSITIONS, "front": False}
        wanted |= {} if scenario == "all" else {"scenario": scenario}
        book = pick(rows, **wanted, method=TEXTBOOK, particles=USUAL)
        drives = {(row["scenario"], row["seed"]) for row in book}
        limits = [r for r in pick(rows, **wanted, method=LIMIT) if (r["scenario"], r["seed"]) in drives]
        ours = [r for r in pick(rows, **wanted, method=DEFAULT) if (r["scenario"], r["seed"]) in drives]
        if not ours or not book:
            continue
        line: Row = {"scenario": scenario, "receiver": receiver, "runs": len(drives)}
        for name in ("difference", "radius"):
            key = f"rmse_{name}_m"
            line[f"{name}_mm"] = 1e3 * rms(ours, key)
            line[f"{name}_book_mm"] = 1e3 * rms(book, key)
            line[f"{name}_to_book"] = rms(ours, key) / rms(book, key)
            for kind in ("causal", "smoother"):
                bound = rms([row[kind] for row in limits], key) if limits else math.nan
                line[f"{name}_{kind}_mm"] = 1e3 * bound
                line[f"{name}_to_{kind}"] = rms(ours, key) / bound if bound > 0.0 else math.nan
        out.append(line)
    return out


def paper_claims(rows: list[Row], speed: dict[str, Any] | None, batches: list[Row]) -> list[Claim]:
    """The four claims of the paper, per receiver where that matters."""
    out = []
    counted = rows + batches
    for receiver in RECEIVERS:
        table = fig9(rows, receiver)
        book = table.get(TEXTBOOK, {})
        others = {m: v for m, v in table.items() if m.startswith(("aug-", "mpf-mn"))}
        if book and others:
            out.append(_smallest(receiver, book, others))
        if {100, 500} <= set(book) | set(table.get("aug-pf", {})) and "aug-pf" in table:
            ours, theirs = book.get(100, math.nan), table["aug-pf"].get(500, math.nan)
            out.append(
                Claim(
                    f"MPF-PN with 100 particles equals AUG-PF with 500 ({receiver})",
                    ours <= EQUAL * theirs,
                    f"{ours:.3f} mm against {theirs:.3f} mm",
                )
            )
        never = []
        for method in (TEXTBOOK, "aug-ekf", "aug-ukf"):
            some = pick(counted, receiver=receiver, method=method, front=False, inputs=POSITIONS)
            if some:
                never.append((method, *diverged(some)))
        if never:
            out.append(
                Claim(
                    f"MPF-PN and AUG-KF never diverge ({receiver})",
                    all(bad == 0 for _, bad, _ in never),
                    ", ".join(f"{m} {bad} of {of}" for m, bad, of in never),
                )
            )
    if speed is not None:
        out.append(_slowest(speed["methods_ms"]))
    return out


def _smallest(receiver: str, book: dict[int, float], others: dict[str, dict[int, float]]) -> Claim:
    """MPF-PN against the best other method, N by N; a method without N stands in every N."""
    parts, holds = [], True
    for number in NUMBERS:
        if number not in book:
            continue
        alternatives = {m: v.get(number, v.get(0, math.nan)) for m, v in others.items()}
        best = min(
            alternatives, key=lambda m: alternatives[m] if math.isfinite(alternatives[m]) else math.inf
        )
        holds = holds and book[number] <= alternatives[best]
        parts.append(f"N={number}: {book[number]:.3f} mm, best other {best} {alternatives[best]:.3f} mm")
    return Claim(f"MPF-PN has the smallest RMSE ({receiver})", holds, "; ".join(parts))


def _slowest(cost: dict[str, dict[str, float]]) -> Claim:
    """MPF-MN against the rest, at the usual number or their own."""
    usual = {
        m: v.get(str(USUAL), v.get("0", math.nan))
        for m, v in cost.items()
        if m != DEFAULT and "four" not in m
    }
    if "mpf-mn" not in usual:
        return Claim("MPF-MN is the slowest", None, "not built")
    figures = ", ".join(f"{m} {ms:.2f}" for m, ms in sorted(usual.items(), key=lambda item: -item[1]))
    return Claim(
        "MPF-MN is the slowest",
        max(usual, key=lambda m: usual[m]) == "mpf-mn",
        f"ms per tick at N={USUAL}: {figures}",
    )


def bars(speed: dict[str, Any]) -> list[Claim]:
    """The bars of the cost; those of intervals are `bench run intervals`'."""
    usual, thousand = str(USUAL), "1000"
    cost = speed["methods_ms"]
    ours, default = cost["mpf-pn"][usual], cost[DEFAULT]["0"]
    out = [
        Claim(
            f"mpf-pn with N={USUAL} costs at most {COST_MS} ms per tick and {COST_RATIO} times the default",
            ours <= min(COST_MS, COST_RATIO * default),
            f"{ours:.3f} ms, {ours / default:.2f} times {default:.3f} ms",
        )
    ]
    library, book = speed["library_ms"][usual], cost[TEXTBOOK][usual]
    out.append(
        Claim(
            f"MPF-PN N={USUAL} at most one fifth of AUG-PF by the library `particles`",
            LIBRARY_BAR * book <= library,
            f"{book:.3f} against {library:.3f} ms: 1/{library / book:.1f}",
        )
    )
    linear: Callable[[str], Any] = lambda m: speed["linear"][m]["worst_misfit"]  # noqa: E731
    worst = max(speed["linear"], key=linear)
    out.append(
        Claim(
            "Cost is linear in N (fixed + slope N within 30 %, 100 to 20,000)",
            linear(worst) <= 0.3,
            f"worst misfit {100 * linear(worst):.0f} % ({worst})",
        )
    )
    kernel = speed["kernel_ms"]
    if isinstance(kernel, str):
        out.append(Claim("NumPy reaches a third of a scalar compiled kernel's speed", None, kernel))
    else:
        share = kernel[thousand] / cost[TEXTBOOK][thousand]
        out.append(
            Claim(
                "NumPy reaches a third of a scalar compiled kernel's speed at N=1000",
                share >= KERNEL_BAR,
                f"kernel {kernel[thousand]:.3f} ms: NumPy has {share:.2f} of its speed",
            )
        )
    return out
