"""The air is not as dense as the configured drag takes it."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import NUISANCE, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class AirDensityError(DynamicsEffect):
    """rho = (1 + relative) * 1.204 kg/m3, in drag, downforce and wind.

    A drag area alone is no force: the density of the day, or the one with which the area was measured, is
    not configured. Source: the gas law; 1.29 kg/m3 at 0 degC, 1.15 at 35 degC, a tenth less per 1000 m.
    """

    name = "air_density_error"
    kind = NUISANCE
    wording = Wording(
        formula="rho = (1 + relative) * 1.204 kg/m3",
        sentence="the air is denser or thinner than at 20 degrees Celsius at the level of the sea",
        distinguished_by="note temperature and pressure of the air",
    )
    channel = "speed"
    covariate = "speed"
    confounded_with = ("aero_drag",)
    needs_forces = True
    parameters = (
        Parameter(
            "relative",
            "1",
            0.05,
            -0.3,
            0.3,
            "true over assumed density, minus 1",
            probe=0.001,
            prior=Prior(0.0, 0.05, "0 to 35 degC, 0 to 1000 m: gas law"),
        ),
    )
    relative: float = 0.0

    def adapt_car(self, frame: Frame) -> None:
        """Scale the density of the air by 1 + relative."""
        frame.air_kgpm3 = frame.air_kgpm3 * (1.0 + self.relative)
