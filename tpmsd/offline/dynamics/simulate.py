"""Predictions of an extended baseline for a recording's inputs, and comparison with a user's own simulation.

In: baseline, drive, effects. Out: outputs over the whole drive, run freely from its first row; a drive whose
outputs part from the baseline's as the recording parts from the simulation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tpmsd.car.physics.baselines.base import Baseline
from tpmsd.car.physics.dynamics_effect import DynamicsEffect
from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.dynamics.drive import DynamicsDrive
from tpmsd.offline.dynamics.noise import white_noise
from tpmsd.offline.dynamics.path import Setup
from tpmsd.offline.dynamics.predict import free_run, outputs_along


def simulated_outputs(
    baseline: Baseline, drive: DynamicsDrive, effects: Sequence[DynamicsEffect] = ()
) -> dict[str, FloatArray]:
    """Return every output of the baseline, (n,) each; what follows a pause starts as it was recorded."""
    theta = tuple(effects)
    yaw = drive.outputs.get("yaw_rate", np.full(len(drive.time_s), np.nan))
    setup = Setup(baseline, replace(drive, outputs={**drive.outputs, "yaw_rate": yaw}).whole(), ("yaw_rate",))
    start = setup.start(theta)
    if "speed" not in drive.outputs and "u" in setup.states(theta):
        start[:, setup.states(theta).index("u")] = drive.inputs.speed_mps
    names = baseline.outputs(theta)
    table = outputs_along(setup, theta, free_run(setup, theta, start), names)
    return {name: table[:, k] for k, name in enumerate(names)}


def as_recorded(
    drive: DynamicsDrive, simulation: Mapping[str, FloatArray], rng: np.random.Generator
) -> DynamicsDrive:
    """Return the drive as it were if the car were the simulation: its outputs, (n,) each, where there is a
    recorded one, with the white noise of that."""
    outputs = {
        name: np.where(
            np.isfinite(values),
            simulation[name] + white_noise(values) * rng.standard_normal(len(values)),
            np.nan,
        )
        for name, values in drive.outputs.items()
        if name in simulation
    }
    return replace(drive, outputs=outputs)


def against_simulation(
    baseline: Baseline,
    drive: DynamicsDrive,
    simulation: Mapping[str, FloatArray],
    simulated: Sequence[DynamicsEffect] = (),
) -> DynamicsDrive:
    """Return the drive with recording minus simulation plus baseline as its outputs, (n,) each.

    `simulated` are the effects with which the baseline moves like the simulation. To first order the effects
    that the simulation lacks change the recording as they change that baseline.
    """
    own = simulated_outputs(baseline, drive, simulated)
    outputs = {
        name: np.asarray(values - simulation[name] + own[name])
        for name, values in drive.outputs.items()
        if name in simulation and name in own
    }
    return replace(drive, outputs=outputs)
