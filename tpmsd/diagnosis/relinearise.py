"""Moves the point about which everything is linear to the best model so far (Gauss-Newton).

In: a `Study` and its `Selection`. Out: the study's columns, anew. Radii that are off by a third of a per
cent and a slip of half a per cent make products that are as large as faint effects: what is linear about
the configured car is not linear enough for them.
"""

from __future__ import annotations

import numpy as np

from tpmsd.diagnosis.chosen import Chosen, Selection
from tpmsd.diagnosis.study import Study
from tpmsd.physics.catalogue import make_effect, parameters_of
from tpmsd.physics.effect import Effect, Parameter
from tpmsd.physics.model import ExtendedModel
from tpmsd.wheels import WHEELS, FloatArray

NEUTRAL = {"scale": 1.0}
"""What a parameter is where nothing is missing; fitted is the difference from it."""
MAX_CALIBRATION = 0.05
"""Relative change of a radius at one time."""


def relinearise(study: Study, selection: Selection) -> None:
    """Take the calibrated radii and the chosen effects of the catalogue as the new origin of each drive."""
    fitted = selection.fit.design @ selection.fit.values
    for number, drive in enumerate(study.drives):
        effects: list[Effect] = []
        origin = np.zeros(len(fitted))
        for one in selection.chosen:
            if number in study.acting(one.term):
                added = _effect(one)
                if added is not None:
                    effects.append(added[0])
                    origin += one.term.design @ added[1]
        # Every drive's radii are its own columns: the common vector, seen from this drive.
        own = drive.own(fitted[:, None])[:, 0]
        radii = drive.reader.reference.car.radius_m.copy()
        for k, name in enumerate(drive.names):
            if name[0] == "radius":
                wheel = WHEELS.index(name[1])
                most = MAX_CALIBRATION * radii[wheel]
                radii[wheel] += float(np.clip(own[k], -most, most))
        drive.relinearise(ExtendedModel(tuple(effects)), radii, drive.own(origin[:, None])[1:, 0], own[1:])


def _effect(one: Chosen) -> tuple[Effect, FloatArray] | None:
    """A chosen effect within its bounds, and the values (k,) that it has there; None of what is no effect."""
    term = one.term
    if term.effect == "unknown" or term.calibrates or not term.parameters[0]:
        return None
    known = parameters_of(term.effect)
    values: dict[str, float | str] = {}
    used = np.zeros(len(one.values))
    for k, name in enumerate(term.parameters):
        parameter = known[name]
        neutral = NEUTRAL.get(name, 0.0)
        value = float(one.values[k]) + neutral
        if isinstance(parameter, Parameter):
            value = min(max(value, parameter.lower), parameter.upper)
        values[name] = value
        used[k] = value - neutral
    if term.effect == "thermal_growth":
        values["time_constant_s"] = term.time_constant_s
    if term.effect == "radius_change":
        onset, end = term.span_s
        values |= {"wheel": term.wheel, "onset_s": onset, "duration_s": end - onset}
    return make_effect(term.effect, **values), used
