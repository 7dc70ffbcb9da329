"""Responses of the channels to the slips of tyres, by the tyre model of `vehicle_state`.

In: a `Reader`. Out: named columns: per axle the ways of wheels that slip under drive and under brakes, and
the course of a car whose rear axle slips sideways. The slips are those of a typical car of the configured
geometry and driven axle, from the recording's own motion: closed forms over the whole drive, no filter. What
is fitted is how stiff the tyres are and how the force is shared out, one value per column.

The catalogue's slip is of the driven axle alone and goes with the acceleration of either sign. Brakes slip
all wheels, in other shares than the engine does.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.vehicle_state.slip_shapes import typical_slips, wheel_slip_shapes
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.windows import CHANNELS, COURSE, Reader

WHEEL_SLIP, SIDE_SLIP = "wheel_slip", "side_slip"
"""Names of the columns: the name of each is one of these and a value's name."""


def slip_columns(reader: Reader) -> list[tuple[tuple[str, ...], FloatArray]]:
    """Return the names and columns (w, 9) of all slips that the car's wheels can have.

    Wheel slip needs all four wheels: one axle alone shows much like GNSS latency and a driven axle's slip.
    """
    motion, car = reader.reference.motion, reader.reference.car
    out: list[tuple[tuple[str, ...], FloatArray]] = []
    shapes = wheel_slip_shapes(motion, car) if len(reader.recording.wheels) == 4 else {}
    for name, slip in shapes.items():
        column = np.zeros((len(reader.windows), CHANNELS))
        for wheel in range(4):
            column[:, wheel] = reader.rolled_m[:, wheel] * reader.over_windows(slip[:, wheel])
        out.append(((WHEEL_SLIP, name), column))
    course = np.zeros((len(reader.windows), CHANNELS))
    course[:, COURSE] = reader.over_windows(typical_slips(motion, car).side_slip_rad)
    out.append(((SIDE_SLIP, "share"), course))
    return out
