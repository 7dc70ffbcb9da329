"""Penalties of terms for their freedom, in nats.

In: how many values and choices a term has. Out: its penalty.
"""

from __future__ import annotations

import math

from tpmsd.car.physics.catalogue import FAULT
from tpmsd.car.physics.effect import Effect
from tpmsd.offline.diagnosis.settings import SETTINGS

RAMPED_PATTERNS = ("fl", "fr", "rl", "rr", "front", "rear", "left", "right")
"""Wheels, axles and sides whose radii may change alike."""


def grid_penalty(effect: type[Effect], at: float | None, second: float | None = None) -> float:
    """Return the penalty of values of the parameters that enter nonlinearly."""
    if effect.nonlinear.grid is None or at is None:
        return 0.0
    more = effect.nonlinear.grid.second
    return effect.nonlinear.grid.penalty(at) + (
        0.0 if more is None or second is None else more.penalty(second)
    )


def ramp_penalty(course: str = "") -> float:
    """Return the penalty of a change of radius: its value, and the choice of wheels and onset; of the
    plainest course, which takes no choice, less than of others."""
    choices = len(RAMPED_PATTERNS) * SETTINGS.hypotheses.ramp_knots
    if course not in ("", FAULT.nonlinear.courses[0]):
        choices *= len(FAULT.nonlinear.courses)
    return SETTINGS.hypotheses.per_value_nats + math.log(choices)


def spline_penalty(hats: int) -> float:
    """Return the penalty of a smooth term: its heights, and the choice of its wheel pattern and covariate."""
    return SETTINGS.hypotheses.per_value_nats * hats + math.log(SETTINGS.hypotheses.shapes)
