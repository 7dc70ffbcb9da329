"""Intervals and tests of the benchmarks' figures, in one place.

Shares bear 95 % intervals of Clopper and Pearson (1934, Biometrika 26), rates the exact Poisson interval of
Garwood (1936, Biometrika 28), differences between groups Fisher's exact test, and p-values the one-sample
test of Kolmogorov and Smirnov against the uniform distribution.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.stats import beta, chi2, fisher_exact, kstest

Share = dict[str, Any]
"""`hits`, `of`, `share` (None of nothing), `low` and `high`."""
LEVEL = 0.95


def share(hits: int, total: int) -> Share:
    """A share with its interval."""
    tail = 0.5 * (1.0 - LEVEL)
    low = 0.0 if hits == 0 else float(beta.ppf(tail, hits, total - hits + 1))
    high = 1.0 if hits == total else float(beta.ppf(1.0 - tail, hits + 1, total - hits))
    return {"hits": hits, "of": total, "share": hits / total if total else None, "low": low, "high": high}


def count(flags: Iterable[bool]) -> Share:
    """The share of flags that are true."""
    values = list(flags)
    return share(sum(map(bool, values)), len(values))


def percent(part: Share) -> str:
    """Return `3/20 = 15.0 % [3.2, 37.9]`; `0/20 [0.0, 16.8] %` of none or all, `-` of nothing."""
    if not part["of"]:
        return "-"
    low, middle, high = (100.0 * part[name] for name in ("low", "share", "high"))
    if part["hits"] in (0, part["of"]):
        return f"{part['hits']}/{part['of']} [{low:.1f}, {high:.1f}] %"
    return f"{part['hits']}/{part['of']} = {middle:.1f} % [{low:.1f}, {high:.1f}]"


def rate(events: int, exposure: float, per: float) -> dict[str, float]:
    """Events per `per` units of exposure with their interval."""
    scale = per / exposure if exposure > 0.0 else math.nan
    low = 0.0 if events == 0 else float(chi2.ppf(0.5 * (1.0 - LEVEL), 2 * events)) / 2.0
    high = float(chi2.ppf(0.5 * (1.0 + LEVEL), 2 * events + 2)) / 2.0
    return {"events": events, "rate": events * scale, "low": low * scale, "high": high * scale}


def apart(one: Share, others: Share) -> float:
    """Two-sided p-value of two shares being the same."""
    table = [[part["hits"], part["of"] - part["hits"]] for part in (one, others)]
    return float(fisher_exact(table).pvalue)


def even_p_value(exceeded: int, drawn: int, stopped: bool, rng: np.random.Generator) -> float:
    """Return a p-value counted in replicates, drawn evenly from those that its rank allows.

    Few replicates give few values; drawn so, the p-value is exactly uniform where drive and replicates are
    alike (Geyer and Meeden 2005, Statistical Science 20). `stopped`: drawing ended when the last of
    `exceeded` replicates reached the drive's own value (Besag and Clifford 1991, Biometrika 78); of n, more
    than n are needed with probability exceeded / (n + 1).
    """
    low, high = exceeded / (drawn + 1), exceeded / drawn if stopped else (exceeded + 1) / (drawn + 1)
    return float(rng.uniform(low, high))


def uniform(p_values: Sequence[float]) -> float | None:
    """p-value of p-values on null drives being uniform; None of fewer than five."""
    return float(kstest(np.asarray(p_values), "uniform").pvalue) if len(p_values) >= 5 else None
