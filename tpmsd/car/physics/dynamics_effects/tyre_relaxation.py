"""Slip angles follow with a length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from tpmsd.car.physics.baselines.frame import Frame, Real, stack_contacts
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior
from tpmsd.foundation.wheels import FloatArray

MIN_M = 0.05
"""Shorter lengths act within a step of the integration."""


@dataclass(frozen=True)
class TyreRelaxation(DynamicsEffect):
    """length_m / u * d(alpha')/dt = alpha - alpha', and alpha' makes the force; one alpha' per axle.

    Source: [Pacejka 2012], section 5.4: relaxation lengths of 0.3 to 0.8 m for side slip, about C_alpha
    over the lateral stiffness of the carcass.
    """

    name = "tyre_relaxation"
    order = 1
    kind = PHYSICS
    wording = Wording(
        formula="length_m / u * d(alpha')/dt = alpha - alpha'",
        sentence="the tyres' side force follows with a length",
        distinguished_by="steer quickly from side to side at 10 and at 25 m/s",
    )
    channel = "yaw_rate"
    covariate = "steering_rate"
    states = ("relaxed_front", "relaxed_rear")
    reads_loads = False
    positive = True
    composes = False
    confounded_with = ("steering_delay", "gyro_delay", "yaw_inertia_error")
    grid = ({"length_m": 0.3}, {"length_m": 0.8})
    parameters = (
        Parameter(
            "length_m",
            "m",
            0.5,
            MIN_M,
            5.0,
            "relaxation length",
            probe=1e-3,
            prior=Prior(0.0, 0.5, "0.3 to 0.8: Pacejka, section 5.4"),
        ),
    )
    length_m: float = MIN_M

    def __post_init__(self) -> None:
        if isinstance(self.length_m, float | int) and self.length_m < MIN_M and self.length_m >= 0.0:
            object.__setattr__(self, "length_m", max(float(self.length_m), 0.0))
            return  # a probe: the difference from no length
        DynamicsEffect.__post_init__(self)

    @classmethod
    def near_neutral(cls, nonlinear: bool) -> bool:
        """Return True: short lengths are delays, long ones at low speed are not."""
        return True

    def fastest_rate_per_s(self, speed_mps: float) -> float:
        """Return u / length."""
        return speed_mps / max(float(np.max(self.length_m)), MIN_M)

    def decays_per_s(self, speed_mps: FloatArray) -> dict[str, FloatArray]:
        """Return u / length for both axles."""
        constant = np.asarray(speed_mps / np.maximum(self.length_m, MIN_M))
        return dict.fromkeys(self.states, constant)

    def adapt_angles(self, frame: Frame) -> None:
        """Replace each axle's mean slip angle by the relaxed one.

        Without its states the lag is that along a recording; about no length it is length / u times the
        angle's rate.
        """
        axle = _axle_angles(frame)
        if "relaxed_front" in frame.extra:
            relaxed = np.stack([frame.extra["relaxed_front"], frame.extra["relaxed_rear"]])
            frame.rates["relaxed_front"] = frame.u / self.length_m * (axle[0] - relaxed[0])
            frame.rates["relaxed_rear"] = frame.u / self.length_m * (axle[1] - relaxed[1])
            lag = axle - relaxed
        else:
            lag = _relaxation_lag(frame, axle, self.length_m)
        frame.angle = frame.angle - (lag if frame.axles else lag[[0, 0, 1, 1]])


def _relaxation_lag(frame: Frame, axle: FloatArray, length_m: Real) -> FloatArray:
    """Return the (2, ...) slip angles of the axles minus the relaxed ones, rad.

    Along a recording the angles are linear between rows: lag' = rate of the angle - u / length * lag.
    """
    time_s, delay_s = frame.inputs.time_s, np.asarray(length_m / frame.u)
    recorded = np.ndim(time_s) == 1 and axle.shape[1:] == time_s.shape == delay_s.shape
    if not recorded or np.max(length_m) < 2.0 * MIN_M:
        return np.asarray(delay_s * _angle_rates(frame, axle))
    step_s = np.diff(time_s)
    kept = np.exp(-step_s / delay_s[1:])
    gained = delay_s[1:] * (1.0 - kept) * np.diff(axle) / step_s
    band = np.ones((2, len(time_s)))
    band[1, :-1], band[1, -1] = -kept, 0.0
    out, _ = lapack.dtbtrs(band, np.pad(gained, ((0, 0), (1, 0))).T, uplo="L")
    return np.ascontiguousarray(out.T)


def _axle_angles(frame: Frame) -> FloatArray:
    """Return the mean slip angle of each axle, (2, ...)."""
    if frame.axles:
        return frame.angle
    return np.stack([0.5 * (frame.angle[0] + frame.angle[1]), 0.5 * (frame.angle[2] + frame.angle[3])])


def _angle_rates(frame: Frame, axle: FloatArray) -> FloatArray:
    """Return the rates of the axles' slip angles under linear forces, (2, ...)."""
    front, rear = frame.cornering_front * axle[0], frame.cornering_rear * axle[1]
    v_rate = (front + rear) / frame.mass - frame.u * frame.r
    r_rate = (frame.front * front - frame.rear * rear) / frame.inertia
    ahead = frame.inputs.steer_rate_radps - (v_rate + frame.front * r_rate) / frame.u
    behind = -(v_rate - frame.rear * r_rate) / frame.u
    return stack_contacts(ahead, behind)
