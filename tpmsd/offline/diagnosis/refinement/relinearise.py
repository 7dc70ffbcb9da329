"""Moves the point about which everything is linear to the best model so far (Gauss-Newton).

In: a `Regression` and its `Selection`. Out: the regression with columns about that point. Radii that are off
by a third of a per cent and a slip of half a per cent make products that are as large as faint effects: what
is linear about the configured car is not linear enough for them.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.physics.catalogue import RADIUS
from tpmsd.car.physics.effect import Effect
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.diagnosis.prepared.regression import Regression
from tpmsd.offline.diagnosis.refinement.damped import damped_values
from tpmsd.offline.diagnosis.selection.catalogue_effect import effect_of
from tpmsd.offline.diagnosis.selection.chosen import Selection
from tpmsd.offline.diagnosis.settings import SETTINGS


def relinearised(regression: Regression, selection: Selection) -> Regression:
    """Return the regression linearised about the calibrated radii and the chosen effects."""
    shorter = damped_values(regression, selection)
    fitted = selection.fit.design @ (selection.fit.values if shorter is None else shorter)
    values_of = _values_of(selection, shorter)
    drives = []
    for number, drive in enumerate(regression.drives):
        effects: list[Effect] = []
        origin = np.zeros(len(fitted))
        for one, its_values in zip(selection.chosen, values_of, strict=True):
            if number in regression.acting_drives(one.term):
                added = effect_of(one.term, its_values)
                if added is not None:
                    effects.append(added[0])
                    origin += one.term.design @ added[1]
        # Every drive's radii are its own columns: the common vector, seen from this drive.
        own = drive.own_design(fitted[:, None])[:, 0]
        radii = drive.reader.reference.car.radius_m.copy()
        for k, name in enumerate(drive.names):
            if name[0] == RADIUS.name:
                wheel = WHEELS.index(name[1])
                most = SETTINGS.refinement.max_relative_radius_change * radii[wheel]
                radii[wheel] += float(np.clip(own[k], -most, most))
        values = drive.own_design(origin[:, None])[1:, 0]
        drives.append(drive.relinearised(ExtendedModel(tuple(effects)), radii, values, own[1:]))
    return regression.with_drives(drives)


def _values_of(selection: Selection, shorter: FloatArray | None) -> list[FloatArray]:
    """Return the values (k,) of each chosen term: those of the fit, or those of a shorter step."""
    if shorter is None:
        return [one.values for one in selection.chosen]
    sizes = [len(one.values) for one in selection.chosen]
    return np.split(shorter[len(shorter) - sum(sizes) :], np.cumsum(sizes)[:-1])
