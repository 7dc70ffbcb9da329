"""The accelerometers read a constant."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import INSTRUMENT, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior


@dataclass(frozen=True)
class DynamicsAccelerometerBias(DynamicsEffect):
    """reading = truth + (long_mps2, lat_mps2).

    Source: zero-g level of automotive accelerometers, 10 to 50 mg over temperature and life (data sheets).
    """

    name = "accelerometer_bias"
    order = 1
    kind = INSTRUMENT
    wording = Wording(
        formula="accelerations read = truth + (long_mps2, lat_mps2)",
        sentence="an accelerometer reads a constant more than acts",
        distinguished_by="drive the same road there and back; only turned over, a sensor shows its tilt",
    )
    channel = "accel_lat"
    covariate = "time"
    shows_in = MappingProxyType({"long_mps2": "accel_long", "lat_mps2": "accel_lat"})
    confounded_with = ("accelerometer_tilt", "road_bank")
    parameters = (
        Parameter(
            "long_mps2",
            "m/s2",
            0.3,
            -5.0,
            5.0,
            "reading minus truth, forward",
            probe=0.001,
            prior=Prior(0.0, 0.2, "10 to 50 mg: data sheets"),
        ),
        Parameter(
            "lat_mps2",
            "m/s2",
            0.3,
            -5.0,
            5.0,
            "reading minus truth, to the left",
            probe=0.001,
            prior=Prior(0.0, 0.2, "10 to 50 mg: data sheets"),
        ),
    )
    long_mps2: float = 0.0
    lat_mps2: float = 0.0

    def read(self, frame: Frame) -> None:
        """Add the constants."""
        frame.outputs["accel_lat"] = frame.outputs["accel_lat"] + self.lat_mps2
        if "accel_long" in frame.outputs:
            frame.outputs["accel_long"] = frame.outputs["accel_long"] + self.long_mps2
