"""A spline term as an effect of the catalogue, so that it can be simulated and compensated.

In: a chosen `unknown` term and the knots of its covariate. Out: the effect `unknown` and the standard
deviations of its heights.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.catalogue import NONPARAMETRIC, make_effect
from tpmsd.car.physics.effect import Effect, Std
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.response import READINGS
from tpmsd.offline.diagnosis.hypotheses.terms import ANTISYMMETRIC, PATTERNS
from tpmsd.offline.diagnosis.selection.chosen import Chosen
from tpmsd.offline.diagnosis.settings import SETTINGS


def shape_of(one: Chosen, knots: FloatArray) -> tuple[tuple[float, float, float], ...]:
    """Return (covariate, height, standard deviation) at each knot; a wheel's first height is calibration's:
    zero."""
    if one.term.pulse:
        begin, end = one.term.span_s
        height, std = float(one.values[0]), float(one.stds[0])
        edge = min(SETTINGS.selection.pulse_edge_s, 0.25 * (end - begin))
        return (
            (begin - edge, 0.0, 0.0),
            (begin + edge, height, std),
            (end - edge, height, std),
            (end + edge, 0.0, 0.0),
        )
    first = len(knots) - len(one.values)
    rest = zip(knots[first:], one.values, one.stds, strict=True)
    heights = tuple((float(x), float(v), float(s)) for x, v, s in rest)
    return heights if first == 0 else ((float(knots[0]), 0.0, 0.0), *heights)


def empirical_effect(one: Chosen, knots: FloatArray) -> tuple[Effect, dict[str, Std]]:
    """Return the effect for the model file, its heights limited to plausible ones."""
    on = pattern_text(one.term.pattern)
    largest = NONPARAMETRIC.largest(on)
    x, heights, stds = zip(*shape_of(one, knots), strict=True)
    effect = make_effect(
        NONPARAMETRIC.name,
        on=on,
        covariate=one.term.covariate,
        knots=tuple(x),
        heights=tuple(float(h) for h in np.clip(heights, -largest, largest)),
    )
    return effect, {"heights": tuple(stds)}


def pattern_text(pattern: str) -> str:
    """Return the wheel pattern of a term as the effect `unknown` writes it: `rl rr`, `fl -fr rl -rr`,
    `gnss_speed`.
    """
    if pattern in READINGS:
        return pattern
    if pattern in ANTISYMMETRIC:
        return " ".join(f"-{wheel}" if sign < 0 else wheel for wheel, sign in ANTISYMMETRIC[pattern])
    return " ".join(PATTERNS[pattern])
