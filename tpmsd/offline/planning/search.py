"""Searches the shortest list of manoeuvres that distinguishes the chosen effects.

In: effects, equipment, a library of manoeuvres. Out: `Plan`. Optimal design of experiments (Fedorov, Theory
of Optimal Experiments, 1972; Atkinson, Donev and Tobias, Optimum Experimental Designs, with SAS, 2007,
chapters 10 and 12): manoeuvres are added one by one, each time the one that raises the criterion most per
second, then those are taken out that are not needed. The criterion is a compound one of c-optimality: the sum
over the effects of the logarithm of their conditional expected gain, each up to what is wanted, so that
the effect that is identified worst counts most.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from tpmsd.offline.planning.information import DT_S, Equipment, expected_gains, reaches_target
from tpmsd.offline.simulator.manoeuvres import Manoeuvre, motion_of, steps_of

TARGET = 25.0
"""Nats that each effect is to bring fitted jointly with the others: the ten from which a drive detects it,
and room for an effect of two thirds of its typical value."""
LEAST = 1e-3
"""Nats from which on a first trace of an effect counts."""
MOST = 24
"""Manoeuvres of a plan."""
WARM_UP = 2
"""Manoeuvres with which a search begins at the least: in a single one calibration takes up everything."""


@dataclass(frozen=True)
class Plan:
    """Manoeuvres in their order, and the effects that they identify."""

    manoeuvres: tuple[Manoeuvre, ...]
    gains: Mapping[str, float]
    """Expected nats by effect, fitted jointly with the others."""
    duration_s: float

    @property
    def identifies_all(self) -> bool:
        """True if it identifies all of its effects."""
        return reaches_target(self.gains, TARGET)


def search_plan(
    effects: Sequence[str],
    equipment: Equipment,
    library: Sequence[Manoeuvre],
    longest_s: float,
    progress: Callable[[float], None] = lambda share: None,
) -> Plan:
    """Return the best plan that was found within `longest_s`; see `Plan.identifies_all`.

    Where not all are identified, the search begins again for those that are: the others stay fitted beside
    them, but get no manoeuvre.
    """

    def evaluate(manoeuvres: Sequence[Manoeuvre]) -> Plan:
        steps = steps_of(manoeuvres)
        motion = motion_of(steps, equipment.car.geometry.wheelbase_m, 1.0 / DT_S)
        gains = expected_gains(motion, equipment, effects)
        return Plan(tuple(manoeuvres), gains, sum(step.duration_s for step in steps))

    wanted = list(effects)
    best = _grow_plan(effects, wanted, library, longest_s, evaluate, progress)
    if not best.identifies_all:
        wanted = [name for name in effects if best.gains[name] >= TARGET]
        if wanted:
            best = _grow_plan(effects, wanted, library, longest_s, evaluate, progress)
    return _group_equal_manoeuvres(_prune(best, wanted, evaluate), wanted, evaluate)


def _grow_plan(
    effects: Sequence[str],
    wanted: Sequence[str],
    library: Sequence[Manoeuvre],
    longest_s: float,
    evaluate: Callable[[Sequence[Manoeuvre]], Plan],
    progress: Callable[[float], None],
) -> Plan:
    """Return a plan grown manoeuvre by manoeuvre until it identifies the `wanted` effects, or no manoeuvre
    raises the criterion.
    """
    best = Plan((), dict.fromkeys(effects, 0.0), 0.0)
    while len(best.manoeuvres) < MOST and not _identifies(best, wanted):
        options = [evaluate([*best.manoeuvres, one]) for one in library]
        options = [one for one in options if one.duration_s <= longest_s]
        if not options:
            break
        now = _criterion(best, wanted)
        ahead = max(
            options, key=lambda one: (_criterion(one, wanted) - now) / (one.duration_s - best.duration_s)
        )
        if _criterion(ahead, wanted) <= now and len(best.manoeuvres) >= WARM_UP:
            break
        best = ahead
        progress(min(_fraction_of_target(best, wanted), 0.95))
    return best


def _identifies(plan: Plan, wanted: Sequence[str]) -> bool:
    """Return whether a plan identifies all `wanted` effects."""
    return reaches_target({name: plan.gains[name] for name in wanted}, TARGET)


def _prune(plan: Plan, wanted: Sequence[str], evaluate: Callable[[Sequence[Manoeuvre]], Plan]) -> Plan:
    """Return the plan without manoeuvres that the `wanted` effects do not need, the longest first."""
    if not wanted:
        return plan
    for one in sorted(set(plan.manoeuvres), key=lambda each: -sum(step.duration_s for step in each.steps)):
        while one in plan.manoeuvres and len(plan.manoeuvres) > 1:
            rest = list(plan.manoeuvres)
            rest.remove(one)
            shorter = evaluate(rest)
            if not _identifies(shorter, wanted):
                break
            plan = shorter
    return plan


def _group_equal_manoeuvres(
    plan: Plan, wanted: Sequence[str], evaluate: Callable[[Sequence[Manoeuvre]], Plan]
) -> Plan:
    """Return the plan with equal manoeuvres next to each other, if it identifies the `wanted` in that order
    too.
    """
    together = sorted(plan.manoeuvres, key=plan.manoeuvres.index)
    if together == list(plan.manoeuvres):
        return plan
    grouped = evaluate(together)
    return grouped if wanted and _identifies(grouped, wanted) else plan


def _criterion(plan: Plan, wanted: Sequence[str]) -> float:
    """Return the sum of the wanted effects' log gains, each gain between `LEAST` and `TARGET`."""
    return sum(math.log(min(max(plan.gains[name], LEAST), TARGET)) for name in wanted)


def _fraction_of_target(plan: Plan, wanted: Sequence[str]) -> float:
    """Return the criterion as a fraction of its range, 0 to 1."""
    worst, best = math.log(LEAST), math.log(TARGET)
    return (_criterion(plan, wanted) / len(wanted) - worst) / (best - worst)
