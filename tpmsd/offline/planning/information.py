"""Expected information of a drive that is not driven yet about chosen effects.

In: a `Motion`, a car, a receiver. Out: the log-likelihood gain that each effect of usual size is to bring
beside all the others, by the channels, the noise model and the whitening of the diagnosis itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.catalogue import EFFECTS
from tpmsd.car.physics.forward import antenna_truth, wheel_angles
from tpmsd.car.physics.model import ExtendedModel
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.diagnosis.assessment.identifiability import prior_scale
from tpmsd.offline.diagnosis.hypotheses.response import (
    available_readings,
    calibration_columns,
    catalogue_columns,
)
from tpmsd.offline.inference.min_speed import least_speed
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.recording import INERTIAL, Recording
from tpmsd.offline.inference.trajectory import ReferenceTrajectory
from tpmsd.offline.inference.whitening import Whitener
from tpmsd.offline.inference.windows import Reader

DT_S = 0.1
"""Duration of a tick, s."""
REGULAR = 1e-9
"""Share of its own information that a column keeps although others carry the same."""


@dataclass(frozen=True)
class Equipment:
    """Instruments of car and receiver."""

    car: Car
    receiver_hz: float = 5.0
    counts: bool = True
    """True if the bus has counts; else speeds."""
    gyro: bool = True
    accelerometer: bool = True
    noise: Noise | None = None
    """Noise as a drive of this car showed it; None: that of usual instruments."""


def expected_gains(motion: Motion, equipment: Equipment, effects: Sequence[str]) -> dict[str, float]:
    """Return the expected log-likelihood gain (nats) by effect, at its typical value, with calibration and
    the other effects fitted jointly; zero for one that the drive has no readings for. `motion` has a step of
    `DT_S`.
    """
    reader = _noise_free_reader(motion, equipment)
    here = available_readings(reader)
    shown = [
        name
        for name in effects
        if here >= set(EFFECTS[name].identification.needs) and EFFECTS[name].observable(motion, equipment.car)
    ]
    calibration = calibration_columns(reader)
    columns = catalogue_columns(reader, only=frozenset(shown))
    names = [*calibration.names, *columns.names]
    noise = _reading_noise(equipment, reader)
    whitener = Whitener.of(reader.windows, noise, np.isfinite(reader.windows.measured))
    rows = whitener.apply_all(calibration.stack + columns.stack).reshape(-1, len(names))
    gram = rows.T @ rows
    out = dict.fromkeys(effects, 0.0)
    for name in shown:
        out[name] = _expected_gain(gram, names, name)
    return out


def _expected_gain(gram: FloatArray, names: Sequence[tuple[str, ...]], effect: str) -> float:
    """Return the log-likelihood gain (nats) of an effect on its first wheels, mid-grid.

    Wheels and grid values are those of its first wheel pattern and the middle of its grid.
    """
    own = _effect_columns(names, effect)
    others = [k for k, name in enumerate(names) if name[0] != effect]
    size = np.array([prior_scale(EFFECTS[effect], names[k][1]) for k in own])
    inner = gram[np.ix_(others, others)]
    scale = np.diag(inner)
    inner = inner + REGULAR * np.diag(np.where(scale > 0.0, scale, 1.0))
    cross = gram[np.ix_(others, own)]
    left = gram[np.ix_(own, own)] - cross.T @ np.linalg.solve(inner, cross)
    return max(0.5 * float(size @ left @ size), 0.0)


def _effect_columns(names: Sequence[tuple[str, ...]], effect: str) -> list[int]:
    """Return the column indices of an effect with its first wheel pattern and the middle of its grid."""
    keys = [name for name in names if name[0] == effect]
    grid = EFFECTS[effect].nonlinear.grid
    ends = {name[2:] for name in keys}
    middle = [end for end in ends if grid is None or (end and end[-1] == f"{grid.middle:g}")]
    kept = sorted(middle or ends)[0]
    return [k for k, name in enumerate(names) if name[0] == effect and name[2:] == kept]


def _noise_free_reader(motion: Motion, equipment: Equipment) -> Reader:
    """Return the reader of a recording without noise whose motion is known exactly."""
    car = equipment.car
    turned = np.diff(wheel_angles(motion, car, ExtendedModel()), axis=0)
    n = len(turned)
    unknown = np.full(n, math.nan)
    inertial = dict.fromkeys(INERTIAL, unknown)
    if equipment.gyro:
        inertial["yaw_rate_radps"] = 0.5 * (motion.yaw_rate_radps[1:] + motion.yaw_rate_radps[:-1])
    antenna = antenna_truth(motion, car, ExtendedModel())
    fixes = np.arange(0.5 / equipment.receiver_hz, motion.time_s[-1], 1.0 / equipment.receiver_hz)

    def at(values: FloatArray) -> FloatArray:
        return np.interp(fixes, motion.time_s, values)

    course = np.unwrap(np.arctan2(at(antenna.north_mps), at(antenna.east_mps)))
    step_rad = 2.0 * math.pi / car.teeth_per_rev / math.sqrt(6.0) if equipment.counts else 0.0
    recording = Recording(
        car=car,
        dt_s=DT_S,
        start_s=0.0,
        rotation_rad=turned,
        quantum_rad=np.full(4, step_rad),
        inertial=inertial,
        fix_time_s=fixes,
        east_m=at(antenna.east_m),
        north_m=at(antenna.north_m),
        up_m=at(antenna.up_m),
        speed_mps=np.hypot(at(antenna.east_mps), at(antenna.north_mps)),
        course_rad=course,
    )
    hilly = bool(np.any(motion.grade_rad != 0.0))
    by = "accelerometer" if equipment.accelerometer else "heights" if hilly else "nothing"
    read = np.ones(n, dtype=np.bool_)
    least = least_speed(motion.speed_mps)
    reference = ReferenceTrajectory(motion, car, read, by != "nothing", by, least)
    return Reader(recording, reference)


def _reading_noise(equipment: Equipment, reader: Reader) -> Noise:
    if equipment.noise is not None:
        return equipment.noise
    quantum = reader.recording.quantum_rad / np.sqrt(2.0) * equipment.car.radius_m
    read: FloatArray = np.maximum(quantum, 1e-4)
    return Noise(reading_m=(float(read[0]), float(read[1]), float(read[2]), float(read[3])))


def reaches_target(gains: Mapping[str, float], target: float) -> bool:
    """Return whether all effects reach the required gain."""
    return all(gain >= target for gain in gains.values())
