"""Cornering stiffness grows less than in proportion to the load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class LoadDependentStiffness(DynamicsEffect):
    """C = C_0 * (1 - c * z^2), z the lateral load transfer over the wheel's static load.

    A tyre with C(F) = C_0 F/F_0 (1 - c (F/F_0 - 1)) loses this much over the axle whose wheels carry
    F_0 (1 +- z). Source: [Pacejka 2012], section 4.3: c of 0.2 to 0.5 near the static load.
    """

    name = "load_dependent_stiffness"
    kind = PHYSICS
    wording = Wording(
        formula="C = C_0 * (1 - c * z^2), z = load transfer over static load",
        sentence="an axle's cornering stiffness falls with lateral load transfer",
        distinguished_by="hold steady bends from 2 to 8 m/s2",
    )
    channel = "accel_lat"
    covariate = "accel_lat"
    confounded_with = ("tyre_saturation", "cg_height_error")
    positive = True
    parameters = (
        Parameter(
            "coefficient",
            "1",
            0.3,
            -1.0,
            3.0,
            "c",
            probe=0.001,
            prior=Prior(0.0, 0.3, "0.2 to 0.5: Pacejka, section 4.3"),
        ),
    )
    coefficient: float = 0.0

    def adapt_tyres(self, frame: Frame) -> None:
        """Scale each axle's stiffness by its own transfer."""
        share = np.maximum(1.0 - self.coefficient * frame.transfer**2, 0.05)
        frame.stiffness = frame.stiffness * (share if frame.axles else share[[0, 0, 1, 1]])
