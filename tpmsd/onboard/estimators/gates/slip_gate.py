"""Gate of informative ticks, judged by what slips instead of how hard the car is driven.

In: as `motion_gate`. Out: the same verdict. What biases a radius is not the acceleration but the
slip that carries it, and the same force costs two driven wheels more of it than four braked ones. The slips
come from the forces by the tyre model, for a car of which only the geometry is known; the state filter's
estimate serves no better here (`docs/explanation/vehicle-state.md`) and costs more.

Inputs are those of the thresholds: the accelerometer or else the wheels' own acceleration, the yaw rate of
gyro, receiver or wheels, and the steering where the bus has it.
"""

from __future__ import annotations

import math

import numpy as np

from tpmsd.car.config.model import FilterConfig, VehicleConfig
from tpmsd.car.vehicle_state.car import typical
from tpmsd.car.vehicle_state.slips import slip_traces
from tpmsd.onboard.estimators.gates.motion_gate import MotionGate
from tpmsd.onboard.timeline.tick import Tick


class SlipGate(MotionGate):
    """A `MotionGate` whose limits are slips."""

    def __init__(self, settings: FilterConfig, vehicle: VehicleConfig) -> None:
        self._car = typical(
            vehicle.wheelbase_m, vehicle.track_front_m, vehicle.track_rear_m, vehicle.driven_axle
        )
        self._steering_ratio = vehicle.steering_ratio or math.nan
        super().__init__(settings)

    def _is_gentle(self, tick: Tick, yaw_rate_radps: float) -> bool:
        """Return whether the slips by the tick's forces are within the limits."""
        accel = self._accel_long(tick)
        steer = tick.steering_wheel_angle_rad / self._steering_ratio
        slips = slip_traces(
            self._car,
            np.array([accel]),
            np.array([self.speed_mps * yaw_rate_radps]),
            steer_rad=np.array([steer if math.isfinite(steer) else 0.0]),
        )
        limits = self._settings
        rolling = float(np.abs(slips.wheel_slip).max()) <= limits.max_wheel_slip
        return rolling and abs(float(slips.side_slip_rad[0])) <= limits.max_side_slip_rad


def make_gate(settings: FilterConfig, vehicle: VehicleConfig) -> MotionGate:
    """Return the gate that [filter] gate names."""
    return SlipGate(settings, vehicle) if settings.gate == "slip" else MotionGate(settings)
