"""A term and its values as an effect of the catalogue.

In: a `Term`, fitted values (differences from neutral). Out: the parameters by name as a report has them, and
the effect within its bounds, for the model file and for the point about which everything is linear.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.catalogue import make_effect, parameters_of
from tpmsd.car.physics.effect import Effect, Parameter, TextParameter, WheelParameter
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.hypotheses.terms import PATTERNS, Term
from tpmsd.offline.diagnosis.selection.chosen import Chosen
from tpmsd.offline.diagnosis.settings import SETTINGS


def neutral_of(effect: str, parameter: str) -> float:
    """Return the value with which a parameter does nothing; fitted is the difference from it."""
    known = parameters_of(effect)[parameter]
    return known.neutral if isinstance(known, Parameter) else 0.0


def tolerance_note(one: Chosen, speeds: bool) -> str:
    """Return a note on a term within an instrument's usual tolerance; empty of one that is a finding.
    `speeds` says that the bus has wheel speeds and no counts.
    """
    return one.term.kind_of.tolerance_note(float(one.values[0]), float(one.stds[0]), speeds)


def text_parameters_of(term: Term) -> dict[str, str]:
    """Return a term's parameters that are text: its wheel or wheels, and its course."""
    out = {}
    for name, parameter in parameters_of(term.effect).items():
        if isinstance(parameter, WheelParameter) and (term.wheel or term.pattern):
            out[name] = term.wheel or term.pattern
        elif isinstance(parameter, TextParameter) and term.pattern:
            out[name] = " ".join(PATTERNS[term.pattern])
    if term.course:
        out["course"] = term.course
    return out


def nonlinear_parameters_of(term: Term) -> dict[str, float]:
    """Return a term's parameters that enter nonlinearly: a grid's, an onset, a duration."""
    out = {}
    grid = term.kind_of.nonlinear.grid
    if grid is not None and term.at is not None:
        out[grid.parameter] = term.at
        if grid.second is not None and term.second is not None:
            out[grid.second.parameter] = term.second
    if term.ramp or (term.pulse and not term.nonparametric):
        onset, duration = term.span_s[0], term.span_s[1] - term.span_s[0]
        if duration < SETTINGS.selection.step_s and term.ramp and not term.course:
            onset, duration = onset + 0.5 * duration, 0.0
        out |= {"onset_s": onset, "duration_s": duration}
    return out


def effect_of(term: Term, values: FloatArray) -> tuple[Effect, FloatArray] | None:
    """Return the effect with values (k,) limited to its bounds, and the limited values; None for a term
    without a formula or with values fitted on every drive."""
    if term.nonparametric or term.calibrates or not term.parameters[0]:
        return None
    known = parameters_of(term.effect)
    given: dict[str, object] = {**text_parameters_of(term), **nonlinear_parameters_of(term)}
    if term.ramp:
        given |= {"onset_s": term.span_s[0], "duration_s": term.span_s[1] - term.span_s[0]}
    used = np.zeros(len(values))
    for k, name in enumerate(term.parameters):
        parameter, neutral = known[name], neutral_of(term.effect, name)
        value = float(values[k]) + neutral
        if isinstance(parameter, Parameter):
            value = min(max(value, parameter.lower), parameter.upper)
        given[name] = value
        used[k] = value - neutral
    return make_effect(term.effect, **given), used
