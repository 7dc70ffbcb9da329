"""The body rolls, and takes time for it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior
from tpmsd.foundation.wheels import FloatArray

COUPLING = 0.4
"""(m_s h)^2 / (m I_x): sprung mass, its height above the roll axis and its roll inertia about that axis;
0.3 to 0.5 on passenger cars ([Heydinger 1999])."""


@dataclass(frozen=True)
class RollDynamics(DynamicsEffect):
    """d2q/dt2 + 2 D w dq/dt + w^2 q = w^2 a_y, and dv/dt gains COUPLING * d2q/dt2 / w^2, w = 2 pi frequency.

    q is the roll angle over that per lateral acceleration in a steady bend. The body that swings out takes
    the car's lateral motion with it. Source: [Gillespie 1992], ch. 6; roll frequencies of 1 to 2.5 Hz,
    damping 0.2 to 0.5.
    """

    name = "roll_dynamics"
    kind = PHYSICS
    wording = Wording(
        formula="dv/dt gains 0.4 * d2q/dt2 / w^2; d2q/dt2 + 2 D w dq/dt + w^2 q = w^2 a_y",
        sentence="the body rolls and takes time for it",
        distinguished_by="weave at 0.5 to 2 Hz at a constant speed",
    )
    channel = "velocity_lat"
    covariate = "steering_rate"
    states = ("roll_q", "roll_rate_q")
    state_sizes = (10.0, 100.0)  # m/s2 and, at 1.6 Hz, m/s3
    grid = tuple({"frequency_hz": f, "damping": 0.3} for f in (1.0, 1.5, 2.2))
    composes = False
    confounded_with = ("accelerometer_position", "tyre_relaxation")
    parameters = (
        Parameter(
            "frequency_hz",
            "Hz",
            1.5,
            0.4,
            5.0,
            "undamped roll frequency",
            probe=1e-3,
            prior=Prior(1.6, 0.4, "1 to 2.5: Gillespie, ch. 6"),
        ),
        Parameter(
            "damping",
            "1",
            0.3,
            0.02,
            2.0,
            "damping ratio",
            probe=1e-3,
            prior=Prior(0.35, 0.12, "0.2 to 0.5: Gillespie, ch. 6"),
        ),
    )
    frequency_hz: float = 1.5
    damping: float = 0.3

    @classmethod
    def has_neutral(cls, nonlinear: bool) -> bool:
        """Return False: no frequency leaves the body where it is."""
        return False

    def fastest_rate_per_s(self, speed_mps: float) -> float:
        """Return the angular frequency."""
        return 2.0 * math.pi * float(np.max(self.frequency_hz))

    def add_rates(self, frame: Frame) -> None:
        """Roll, and add the body's swing to dv/dt; as a probe, the swing of a recorded drive."""
        w = 2.0 * math.pi * self.frequency_hz
        accel = np.asarray(frame.force_y / frame.mass)
        if "roll_q" in frame.extra:
            q, rate = frame.extra["roll_q"], frame.extra["roll_rate_q"]
            swing = w**2 * (accel - q) - 2.0 * self.damping * w * rate
            frame.rates["roll_q"], frame.rates["roll_rate_q"] = rate, swing
        else:
            swing = _roll_state_acceleration(accel, frame.inputs.time_s, w, self.damping)
        frame.rates["v"] = frame.rates["v"] + COUPLING * swing / w**2


def _roll_state_acceleration(accel: FloatArray, time_s: FloatArray, w: float, damping: float) -> FloatArray:
    """Return d2q/dt2 of the roll state q along the last axis, by the bilinear transform at the usual step."""
    if np.ndim(accel) == 0 or np.ndim(time_s) == 0 or len(time_s) < 3:
        return np.zeros_like(accel)
    k = 2.0 / float(np.median(np.diff(time_s)))
    below = np.array(
        [k * k + 2 * damping * w * k + w * w, 2 * (w * w - k * k), k * k - 2 * damping * w * k + w * w]
    )
    above = w * w * k * k * np.array([1.0, -2.0, 1.0])
    driven = above[0] * accel
    driven[..., 1:] += above[1] * accel[..., :-1]
    driven[..., 2:] += above[2] * accel[..., :-2]
    band = np.repeat(below[:, None], accel.shape[-1], axis=1)
    out, _ = lapack.dtbtrs(band, driven.reshape(-1, accel.shape[-1]).T, uplo="L")
    return np.ascontiguousarray(out.T).reshape(accel.shape)
