"""A user's simulation of a recording: its outputs at the recording's times.

In: a table of signals, a recorded drive. Out: values by output; InputError where they are of another time,
sign or unit than the recording's, which no physics explains.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.errors import InputError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.drive import DynamicsDrive
from tpmsd.offline.signals.columns import OUTPUTS
from tpmsd.offline.signals.drive import MIN_VALUES, NEAR_FACTOR, OPPOSED, PARALLEL
from tpmsd.offline.signals.read import SignalTable

MARGIN_S = 1.0
"""Time at either end of the recording that a simulation may leave out."""
DEGREES = ("in degrees", 180.0 / math.pi)
WRONG_UNITS = {
    "yaw_rate": ("in deg/s", 180.0 / math.pi),
    "accel_long": ("in g", 1.0 / GRAVITY_MPS2),
    "accel_lat": ("in g", 1.0 / GRAVITY_MPS2),
    "speed": ("in km/h", 3.6),
    "side_slip": DEGREES,
    "roll": DEGREES,
}
"""The unit that is taken for the right one, and its size, by output."""
SIGNED = ("yaw_rate", "accel_long", "accel_lat", "speed", "roll")
"""Outputs of one sign in any model of the same manoeuvre; sideways speed changes its sign with the speed."""


def outputs_of_simulation(table: SignalTable, drive: DynamicsDrive) -> dict[str, FloatArray]:
    """Return the outputs of a simulation at the drive's rows, (n,) each; InputError if none is usable."""
    at = drive.time_s + drive.start_s
    if table.time_s[0] > at[0] + MARGIN_S or table.time_s[-1] < at[-1] - MARGIN_S:
        raise InputError(table.file, "does not cover the time of the recording")
    found = {}
    for name, column in OUTPUTS.items():
        values = table.columns.get(column)
        good = None if values is None else np.isfinite(values)
        if values is not None and good is not None and good.sum() >= MIN_VALUES:
            found[name] = np.interp(at, table.time_s[good], values[good])
    compared = [name for name in drive.outputs if name in found]
    if not compared:
        raise InputError(table.file, f"has none of the outputs {' '.join(drive.outputs)}", 1)
    for name in compared:
        _check_sign_and_unit(table, name, found[name], drive.outputs[name])
    return found


def _check_sign_and_unit(table: SignalTable, name: str, simulated: FloatArray, recorded: FloatArray) -> None:
    """Raise InputError where an output has the sign opposite to the recorded one, or differs from it by the
    factor of a wrong unit.
    """
    known = np.isfinite(recorded)
    one, other = (values[known] - np.median(values[known]) for values in (simulated, recorded))
    product, square = float(np.sum(one * other)), float(np.sum(other**2))
    size = math.sqrt(square * float(np.sum(one**2)))
    if name in SIGNED and product < -OPPOSED * size:
        raise InputError(table.file, f"{OUTPUTS[name]} moves against the recorded one: of the other sign?", 1)
    unit, factor = WRONG_UNITS.get(name, ("", 1.0))
    if unit and product > PARALLEL * size > 0.0 and abs(product / square / factor - 1.0) < NEAR_FACTOR:
        times = f"{product / square:.2g} times the recorded one"
        raise InputError(table.file, f"{OUTPUTS[name]} is {times}: {unit}?", 1)
