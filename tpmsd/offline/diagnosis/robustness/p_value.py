"""From a finding's statistic and its replicates' maxima to a p-value and a decision.

In: the penalised gain of a finding and the maxima of replicates drawn without it. Out: `PValue`.

Two numbers are kept apart. The p-value that is reported is counted: k of n replicates reach the value,
and where none does it is the bound 1 / (n + 1) (Davison and Hinkley, Bootstrap Methods and their Application,
1997, equation 4.11). A decision at a false discovery rate of 1 % needs less than so few replicates can count.
It takes the tail of the Gumbel distribution of the maxima (as Knijnenburg et al., Bioinformatics 25, 2009,
extend permutations), widened for their small number; that tail is an extrapolation, so it is never reported.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.offline.diagnosis.settings import SETTINGS


@dataclass(frozen=True)
class PValue:
    """Probability that a drive without the effect shows as much."""

    p_value: float
    """Counted in replicates."""
    is_bound: bool
    """No replicate reached the value: the p-value is 1 / (n + 1), and the truth at most about that."""
    tail: float
    """Extrapolated beyond the replicates, for the decision."""


def estimate_p_value(value: float, maxima: Sequence[float], own: float = 0.0) -> PValue:
    """Return the p-value of a statistic, from its maxima over replicates.

    `own` is the probability by a test's own distribution, 0 without one; no decision takes a smaller one.
    """
    counted, is_bound = counted_p_value(value, maxima)
    return PValue(max(counted, own), is_bound and own <= counted, max(tail_probability(value, maxima), own))


def counted_p_value(value: float, maxima: Sequence[float]) -> tuple[float, bool]:
    """Return the fraction of the maxima that reach the value, and whether it is the bound 1 / (n + 1) because
    none does."""
    count, exceeded = len(maxima), count_reaching(value, maxima)
    if exceeded >= SETTINGS.robustness.exceeded:
        return exceeded / count, False
    return (exceeded + 1) / (count + 1), exceeded == 0


def tail_probability(value: float, maxima: Sequence[float]) -> float:
    """Return the probability that chance makes as much: counted where some of the maxima reach the value,
    else by the tail of their Gumbel distribution, whose scale is raised by the doubt of so few."""
    count = len(maxima)
    counted, is_bound = counted_p_value(value, maxima)
    if not is_bound:
        return counted
    spread = float(np.std(maxima, ddof=1)) if count > 1 else 0.0
    scale = max(math.sqrt(6.0) / math.pi * spread, SETTINGS.robustness.min_scale_nats) * (
        1.0 + 2.0 / math.sqrt(count)
    )
    middle = float(np.mean(maxima)) - np.euler_gamma * scale
    return min(-math.expm1(-math.exp(-(value - middle) / scale)), counted)


def count_reaching(value: float, maxima: Sequence[float]) -> int:
    """Return the number of maxima that reach the value."""
    return sum(one >= value for one in maxima)


def discoveries(probabilities: Sequence[float], rate: float) -> list[bool]:
    """Return which hypotheses are rejected at a false discovery rate: all up to the largest probability that
    is no more than its rank's share of the rate (Benjamini and Hochberg 1995)."""
    order = sorted(range(len(probabilities)), key=lambda k: probabilities[k])
    last = 0
    for rank, k in enumerate(order, 1):
        if probabilities[k] <= rate * rank / len(probabilities):
            last = rank
    kept = set(order[:last])
    return [k in kept for k in range(len(probabilities))]


def is_decided(value: float, maxima: Sequence[float]) -> bool:
    """Return whether no further replicate would change a decision (Besag and Clifford, Biometrika 1991)."""
    if count_reaching(value, maxima) >= SETTINGS.robustness.exceeded:
        return True
    return (
        len(maxima) >= SETTINGS.robustness.fewest_replicates
        and tail_probability(value, maxima) < SETTINGS.robustness.beyond_doubt
    )
