"""The parameters of a car that a fleet estimates: their names, effects and units.

In: the names of a calibration's parameters. Out: the fleet's names, the matrix between both, and for each its
effect, its parameter, unit and factor, as findings have them. Radii are stated as mean and contrasts,
for within an axle they agree to a tenth of a per cent, and from car to car to half of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.calibration.equations import PARAMETERS
from tpmsd.offline.calibration.joint import PRIOR


@dataclass(frozen=True, slots=True)
class FleetParameter:
    """A number that each drive estimates and the fleet pools over cars: of an effect, or a radius."""

    name: str
    effect: str
    """Name in the catalogue; `radius` for the radii themselves, which are no effect."""
    parameter: str
    unit: str
    scale: float
    """Size that is usual, in `unit`: all parameters are divided by it, so that matrices are of one kind."""
    null: bool = True
    """True where zero is the value of the rolling model."""


RADII = tuple(f"radius_{wheel}" for wheel in WHEELS)
CONTRASTS = (
    "radius_mean",
    "radius_front_minus_rear",
    "radius_front_left_minus_right",
    "radius_rear_left_minus_right",
)
RADII_OF_CONTRASTS = np.array(
    [[1.0, 0.5, 0.5, 0.0], [1.0, 0.5, -0.5, 0.0], [1.0, -0.5, 0.0, 0.5], [1.0, -0.5, 0.0, -0.5]]
)
"""(4, 4) radii fl fr rl rr of the four contrasts."""
_EFFECTS = {
    name: (effect.name, what, unit)
    for effect in EFFECTS.values()
    for name, what, unit in effect.in_calibration
}
OTHER_PARAMETERS = tuple(name for name in PARAMETERS if name not in RADII)
PARAMETERS_OF_FLEET = (
    *(
        FleetParameter(name, "radius", name, "1", 5e-3 if k < 2 else 1e-3, False)
        for k, name in enumerate(CONTRASTS)
    ),
    *(FleetParameter(name, *_EFFECTS[name], PRIOR[name][1]) for name in OTHER_PARAMETERS),
)
NAMES = tuple(parameter.name for parameter in PARAMETERS_OF_FLEET)
SCALES = np.array([parameter.scale for parameter in PARAMETERS_OF_FLEET])


def statistics_in_fleet_parameters(
    names: Sequence[str], information: FloatArray, vector: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a drive's information matrix and vector in the fleet's parameters, (..., p, p) and (..., p).

    Radii become their mean and contrasts, and each parameter is divided by its scale. `names` are those of
    the drive's own parameters, or of several drives with the same ones; a parameter that they lack has no
    information.
    """
    jacobian = np.zeros((len(names), len(NAMES)))
    for k, name in enumerate(names):
        if name in RADII:
            jacobian[k, :4] = RADII_OF_CONTRASTS[RADII.index(name)]
        elif name in OTHER_PARAMETERS:
            jacobian[k, 4 + OTHER_PARAMETERS.index(name)] = 1.0
    jacobian = jacobian * SCALES
    return jacobian.T @ information @ jacobian, vector @ jacobian
