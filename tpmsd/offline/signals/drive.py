"""From a table of signals and a car to the drive that the diagnosis of vehicle dynamics works on.

In: `SignalTable`, the tables of `vehicle.toml`. Out: `Baseline` and `DynamicsDrive`; InputError where an
input that the baseline needs is missing.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence

import numpy as np

from tpmsd.car.config.dynamics import CarTables
from tpmsd.car.physics.baselines.base import Baseline
from tpmsd.car.physics.baselines.car import DynamicCar
from tpmsd.car.physics.baselines.inputs import make_inputs
from tpmsd.car.physics.baselines.table import BASELINES
from tpmsd.car.physics.motion import GRAVITY_MPS2
from tpmsd.foundation.errors import InputError
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.drive import DynamicsDrive, filled
from tpmsd.offline.signals.columns import (
    BRAKE,
    DRIVE,
    DRIVE_TORQUE,
    OUTPUTS,
    ROAD_WHEEL,
    STEERING_WHEEL,
    WHEELS,
)
from tpmsd.offline.signals.denoise import smooth_series
from tpmsd.offline.signals.read import SignalTable

MAX_HZ = 105.0
"""Rows at a higher rate are thinned out: lateral dynamics end below 10 Hz."""
MAX_ROAD_WHEEL_RAD = 1.2
"""Road wheels turn by 35 to 50 degrees at most (0.9 rad); a recording in degrees has tens."""
OPPOSED = 0.5
"""Correlation of yaw rate and steering, negative, below which one of them has the other sign."""
MAX_GAIN = 8.0
"""Yaw rate over that of a car without slip, u delta / l, above which it is in deg/s: cars reach 0.2 to 3."""
UNIT_FACTORS = {
    "speed in km/h": 1.0 / 3.6,
    "yaw rate in deg/s": math.pi / 180.0,
    "lateral acceleration in g": 1.0 / GRAVITY_MPS2,
}
"""Lateral acceleration over speed times yaw rate, which is 1 but for side slip and bank, by a wrong unit."""
NEAR_FACTOR = 0.25
"""Relative distance from one of these factors: side slip and scales of instruments change it by less."""
PARALLEL = 0.8
"""Correlation of lateral acceleration with speed times yaw rate from which their ratio says anything."""
ACCEL_WALK = 5.0
"""Random walk of a car's longitudinal acceleration, m/s2 per square root of a second: brakes and throttle
change it by 2 to 3 m/s2 in a third of a second."""
MIN_VALUES = 10
"""Values below which nothing is read from a column."""
MAX_STRAIGHT_RAD = 0.5
"""Change of the heading beyond which a car was steered: a gyro's noise adds up to a hundredth of it."""
MOVED_BY_STEERING = tuple(
    OUTPUTS[name] for name in ("yaw_rate", "accel_lat", "velocity_lat", "side_slip", "roll")
)
"""Columns that no steered car leaves at one value."""
DRIVE_SHARES = {"front": 1.0, "rear": 0.0, "all": 0.5}


def dynamic_car(tables: CarTables, ratio: float) -> DynamicCar:
    """Return the car as the baseline models take it; `ratio` is that of the recorded steering angle."""
    d = tables.dynamics
    assert d.mass_kg is not None
    assert d.yaw_inertia_kgm2 is not None
    assert d.cg_to_front_m is not None
    assert d.cg_to_rear_m is not None
    assert d.cornering_stiffness_front_n_per_rad is not None
    assert d.cornering_stiffness_rear_n_per_rad is not None
    return DynamicCar(
        mass_kg=d.mass_kg,
        yaw_inertia_kgm2=d.yaw_inertia_kgm2,
        front_m=d.cg_to_front_m,
        rear_m=d.cg_to_rear_m,
        cornering_front_n=d.cornering_stiffness_front_n_per_rad,
        cornering_rear_n=d.cornering_stiffness_rear_n_per_rad,
        height_m=d.cg_height_m,
        track_front_m=tables.track_front_m,
        track_rear_m=tables.track_rear_m,
        longitudinal_n=d.longitudinal_stiffness_n,
        friction=d.friction,
        drive_front_share=DRIVE_SHARES[tables.driven_axle],
        brake_front_share=d.brake_front_share,
        drag_area_m2=d.drag_area_m2,
        rolling_resistance=d.rolling_resistance,
        steering_ratio=ratio,
    )


def make_drive(
    table: SignalTable, tables: CarTables, baseline: str, name: str
) -> tuple[Baseline, DynamicsDrive]:
    """Return the baseline of this car, and the drive with the outputs that were recorded."""
    if len(table.time_s) < MIN_VALUES:
        raise InputError(table.file, f"{len(table.time_s)} rows: {MIN_VALUES} are needed at least")
    thinned = _decimated_columns(table)
    if len(thinned["time_s"]) < MIN_VALUES:
        span_s = table.time_s[-1] - table.time_s[0]
        raise InputError(
            table.file, f"its rows span {span_s:.2g} s: {MIN_VALUES / MAX_HZ:.2g} s are needed at least"
        )
    columns, notes = _varying_columns(thinned)
    time = columns["time_s"] - columns["time_s"][0]
    steer, ratio = _road_wheel_angle(table, columns, tables, time)
    given = _recorded_force_sums(columns)
    forces = BASELINES[baseline].nonlinear and len(given) == 2 and _has_values(columns, OUTPUTS["speed"])
    of_speed = not forces and not _has_values(columns, OUTPUTS["accel_long"])
    model = BASELINES[baseline](dynamic_car(tables, ratio), forces, of_speed)
    speed = _speed(table, columns, tables, time)
    inputs = make_inputs(
        time,
        steer,
        speed,
        _longitudinal_acceleration(columns, time, speed),
        _drive_force(columns, tables, time),
        _filled_column(columns, BRAKE, time),
    )
    outputs = {
        output: columns[column]
        for output, column in OUTPUTS.items()
        if output in model.outputs() and _has_values(columns, column)
    }
    if "velocity_lat" in outputs:
        outputs.pop("side_slip", None)  # both say the same, mostly from one instrument
    _check_steering(table, columns, time, steer, speed, model.car)
    key = hashlib.sha256(np.ascontiguousarray(np.stack([time, steer])).tobytes()).hexdigest()[:12]
    if BASELINES[baseline].nonlinear and len(given) == 1:
        other = "brake" if given == ["drive"] else "drive"
        notes.append(
            f"{given[0]} forces are recorded without {other} forces, so speed is an input and the wheels"
            " carry m a_x"
        )
    return model, DynamicsDrive(name, inputs, outputs, forces, float(columns["time_s"][0]), key, tuple(notes))


def _varying_columns(columns: dict[str, FloatArray]) -> tuple[dict[str, FloatArray], list[str]]:
    """Return the columns that vary, and a note on each of the others.

    A column without values tells nothing, nor does one that stands still where the car cannot: loggers write
    0 for a sensor that is not there.
    """
    notes, left = [], dict(columns)
    for name, values in columns.items():
        count = int(np.isfinite(values).sum())
        if count < MIN_VALUES:
            notes.append(f"{name} has {count or 'no'} values: nothing is read from it")
            del left[name]
    must = MOVED_BY_STEERING if any(_varies(left, name) for name in (ROAD_WHEEL, STEERING_WHEEL)) else ()
    if _varies(left, OUTPUTS["speed"]):
        must = (*must, OUTPUTS["accel_long"])
    for name in must:
        if name in left and not _varies(left, name):
            notes.append(f"{name} is {np.nanmax(left[name]):g} throughout: nothing is read from it")
            del left[name]
    return left, notes


def _varies(columns: dict[str, FloatArray], name: str) -> bool:
    """Return whether a column has more than one value."""
    return name in columns and float(np.nanmax(columns[name]) - np.nanmin(columns[name])) > 0.0


def _decimated_columns(table: SignalTable) -> dict[str, FloatArray]:
    """Return the columns at no more than `MAX_HZ`, a missing value taken from the next rows."""
    time = table.time_s
    step = float(np.median(np.diff(time)))
    every = min(int(np.floor(1.0 / (step * MAX_HZ))), len(time)) if step * MAX_HZ < 1.0 else 1
    if every <= 1:
        return dict(table.columns)
    rows = np.arange(0, len(time) - every + 1, every)
    out = {}
    for name, values in table.columns.items():
        taken = values[rows].copy()
        for later in range(1, every):
            taken = np.where(np.isfinite(taken), taken, values[rows + later])
        out[name] = taken
    out["time_s"] = time[rows]
    return out


def _has_values(columns: dict[str, FloatArray], name: str) -> bool:
    return name in columns and int(np.isfinite(columns[name]).sum()) >= MIN_VALUES


def _recorded_force_sums(columns: dict[str, FloatArray]) -> list[str]:
    """Return which of the two sums of forces are recorded: with one alone the other is unknown, not 0."""
    driven = any(_has_values(columns, name) for name in (DRIVE, DRIVE_TORQUE))
    return [name for name, known in (("drive", driven), ("brake", _has_values(columns, BRAKE))) if known]


def _filled_column(columns: dict[str, FloatArray], name: str, time: FloatArray) -> FloatArray | None:
    """Return a column with gaps filled; None where it has too few values."""
    return filled(time, columns[name]) if _has_values(columns, name) else None


def _drive_force(columns: dict[str, FloatArray], tables: CarTables, time: FloatArray) -> FloatArray | None:
    """Return the drive force: recorded, else by the torque at the wheels; None without either."""
    force = _filled_column(columns, DRIVE, time)
    torque = _filled_column(columns, DRIVE_TORQUE, time)
    if force is None and torque is not None:
        return torque / tables.wheel_radius_m
    return force


def _road_wheel_angle(
    table: SignalTable, columns: dict[str, FloatArray], tables: CarTables, time: FloatArray
) -> tuple[FloatArray, float]:
    """Return the road-wheel angle as configured, rad, and the ratio of the recorded angle."""
    if _has_values(columns, ROAD_WHEEL):
        return filled(time, columns[ROAD_WHEEL]), 1.0
    if not _has_values(columns, STEERING_WHEEL):
        raise InputError(table.file, f"neither {ROAD_WHEEL} nor {STEERING_WHEEL} has values", 1)
    if tables.steering_ratio is None:
        raise InputError(tables.file, f"[vehicle] steering_ratio is missing: {STEERING_WHEEL} needs it")
    return filled(time, columns[STEERING_WHEEL]) / tables.steering_ratio, tables.steering_ratio


def _check_steering(
    table: SignalTable,
    columns: dict[str, FloatArray],
    time: FloatArray,
    steer: FloatArray,
    speed: FloatArray,
    car: DynamicCar,
) -> None:
    """Raise InputError where the road wheels turn farther than any car's, or the yaw rate against the
    steering.

    The yaw rate is compared with that of a car without slip, u delta / l, at ordinary steering angles.
    """
    largest = float(np.quantile(np.abs(steer), 0.99))
    if largest > MAX_ROAD_WHEEL_RAD:
        what = f"the steering reaches {largest:.1f} rad at the road wheels"
        raise InputError(table.file, f"{what}: in degrees, or steering_ratio missing?", 1)
    if not _has_values(columns, OUTPUTS["yaw_rate"]):
        return
    yaw = filled(time, columns[OUTPUTS["yaw_rate"]])
    turned = float(np.ptp(np.cumsum((yaw - float(np.median(yaw)))[1:] * np.diff(time))))
    if not np.ptp(steer) > 0.0 and turned > MAX_STRAIGHT_RAD:
        raise InputError(table.file, f"the car turns by {turned:.1f} rad while the steering stands still", 1)
    bend = speed * (steer - float(np.median(steer))) / car.wheelbase_m
    yaw = yaw - float(np.median(yaw))
    size = float(np.sqrt(np.sum(bend**2) * np.sum(yaw**2)))
    if size > 0.0 and float(np.sum(bend * yaw)) < -OPPOSED * size:
        raise InputError(
            table.file, "the yaw rate turns against the steering: one of them has the other sign", 1
        )
    gain = float(np.sum(bend * yaw)) / max(float(np.sum(bend**2)), 1e-12)
    if gain > MAX_GAIN:
        raise InputError(
            table.file, f"the yaw rate is {gain:.0f} times what the steering makes: in deg/s?", 1
        )
    if _has_values(columns, OUTPUTS["accel_lat"]):
        _check_units(table, speed * yaw, filled(time, columns[OUTPUTS["accel_lat"]]))


def _check_units(table: SignalTable, turning: FloatArray, accel_lat: FloatArray) -> None:
    """Raise InputError where lateral acceleration over speed times yaw rate is the factor of a wrong unit."""
    accel_lat = accel_lat - float(np.median(accel_lat))
    turning = turning - float(np.median(turning))
    product, square = float(np.sum(accel_lat * turning)), float(np.sum(turning**2))
    if not product > PARALLEL * math.sqrt(square * float(np.sum(accel_lat**2))) > 0.0:
        return
    for what, factor in UNIT_FACTORS.items():
        if abs(product / square / factor - 1.0) < NEAR_FACTOR:
            said = f"lateral acceleration is {product / square:.2g} times speed times yaw rate"
            raise InputError(table.file, f"{said}: {what}?", 1)


def _speed(
    table: SignalTable, columns: dict[str, FloatArray], tables: CarTables, time: FloatArray
) -> FloatArray:
    """Return the speed without its noise: recorded, else by the wheels, else by the receiver.

    It is an input: a model cannot tell its noise from motion, and what averages rows, such as a delay by half
    a row, would explain readings better.
    """
    if _has_values(columns, OUTPUTS["speed"]):
        return smooth_series(time, columns[OUTPUTS["speed"]], ACCEL_WALK)
    wheels = [columns[name] for name in _usable_names(columns, WHEELS)]
    if wheels:
        mean = np.mean([filled(time, one) for one in wheels], axis=0) * tables.wheel_radius_m
        return smooth_series(time, np.asarray(mean), ACCEL_WALK)
    if _has_values(columns, "gnss_speed_mps"):
        return smooth_series(time, columns["gnss_speed_mps"], ACCEL_WALK)
    raise InputError(table.file, "no speed: speed_mps, wheel_speed_*_radps or gnss_speed_mps is needed", 1)


def _usable_names(columns: dict[str, FloatArray], names: Sequence[str]) -> list[str]:
    return [name for name in names if _has_values(columns, name)]


def _longitudinal_acceleration(
    columns: dict[str, FloatArray], time: FloatArray, speed: FloatArray
) -> FloatArray:
    """Return the longitudinal acceleration: recorded, else the speed's rate over a fifth of a second."""
    if _has_values(columns, OUTPUTS["accel_long"]):
        return filled(time, columns[OUTPUTS["accel_long"]])
    later, before = (np.interp(time + by, time, speed) for by in (0.1, -0.1))
    return np.asarray((later - before) / 0.2)
