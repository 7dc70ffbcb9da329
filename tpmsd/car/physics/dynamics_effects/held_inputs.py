"""Steering is held over a step while the car moves on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class HeldInputs(DynamicsEffect):
    """The front tyres' force moves the car as it was half a step ago: dF_f = -C_f * delta' * step_s / 2.

    A simulation that holds its inputs over a step of integration answers them half a step late, while an
    acceleration that it writes at the same instant has the new angle in it; so does a controller that reads
    the wheel angle in a cycle of its own. The delay of a whole signal is another thing. Source: zero-order
    hold, to first order in the step; simulations step by 1 to 10 ms, controllers too.
    """

    name = "held_inputs"
    kind = NUISANCE
    wording = Wording(
        formula="dv/dt, dr/dt with F_f - C_f * delta' * step_s / 2 at the front",
        sentence="the car answers the steering in steps",
        distinguished_by="steer quickly from side to side; record or simulate in shorter steps",
    )
    channel = "yaw_rate"
    covariate = "steering_rate"
    confounded_with = ("steering_delay", "gyro_delay")
    positive = True
    parameters = (
        Parameter(
            "step_s",
            "s",
            0.005,
            -0.02,
            0.02,
            "step over which the steering is held",
            probe=1e-4,
            prior=Prior(0.0, 0.005, "1 to 10 ms: simulations, control cycles"),
        ),
    )
    step_s: float = 0.0

    def add_rates(self, frame: Frame) -> None:
        """Subtract the front force that half a step of steering adds, from dv/dt and dr/dt."""
        front = frame.stiffness[0] if frame.axles else frame.stiffness[0] + frame.stiffness[1]
        late = np.asarray(-0.5 * self.step_s * front * frame.inputs.steer_rate_radps)
        frame.rates["v"] = frame.rates["v"] + late / frame.mass
        frame.rates["r"] = frame.rates["r"] + frame.front * late / frame.inertia
