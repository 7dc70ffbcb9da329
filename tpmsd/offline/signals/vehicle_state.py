"""The vehicle state along a table of signals, by the filters that the daemon runs.

In: `SignalTable`, the car's tables, a filter. Out: a state per row; ConfigError where a signal is missing.
"""

from __future__ import annotations

import numpy as np

from tpmsd.car.config.dynamics import CarTables
from tpmsd.car.vehicle_state.configured import configured_car
from tpmsd.car.vehicle_state.estimator import VehicleStateEstimator
from tpmsd.car.vehicle_state.record import VehicleState
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.signals.columns import OUTPUTS, ROAD_WHEEL, STEERING_WHEEL
from tpmsd.offline.signals.drive import make_drive
from tpmsd.offline.signals.read import SignalTable

LONGEST_STEP_S = 1.0
"""Rows further apart are a pause: the estimate begins again behind it."""
NEEDED = ("yaw_rate", "accel_lat")


def states_along(
    table: SignalTable, tables: CarTables, method: str, rng: np.random.Generator, particles: int
) -> tuple[FloatArray, list[VehicleState | None]]:
    """Return the times (n,) of the rows and a state for each, None where it is not known.

    Rows are thinned out as for the diagnosis; a step's inputs are the means of its two rows.
    """
    given_columns = {name for name, values in table.columns.items() if np.isfinite(values).any()}
    missing = [OUTPUTS[name] for name in NEEDED if OUTPUTS[name] not in given_columns]
    if not given_columns & {ROAD_WHEEL, STEERING_WHEEL}:
        missing.append(f"{ROAD_WHEEL} or {STEERING_WHEEL}")
    if missing:
        raise ConfigError(f"{table.file}: the vehicle state needs {', '.join(missing)}")
    car = configured_car(tables.dynamics, tables.track_front_m, tables.track_rear_m, tables.driven_axle)
    _, drive = make_drive(table, tables, "three-dof", "drive")
    given = drive.inputs
    blank = np.full(len(drive.time_s), np.nan)
    yaw, lateral = (drive.outputs.get(name, blank) for name in NEEDED)
    estimator = VehicleStateEstimator(car, method, rng, particles)
    steps = np.diff(drive.time_s)
    ahead, steer = (0.5 * (one[1:] + one[:-1]) for one in (given.accel_long_mps2, given.steer_rad))
    states: list[VehicleState | None] = [None]
    for k, dt_s in enumerate(steps.tolist()):
        if dt_s > LONGEST_STEP_S:
            estimator.reset()
            states.append(None)
            continue
        now = float(ahead[k]), float(lateral[k + 1]), float(yaw[k + 1])
        states.append(estimator.step(dt_s, *now, float(steer[k]), float(given.speed_mps[k + 1])))
    return drive.time_s + drive.start_s, states
