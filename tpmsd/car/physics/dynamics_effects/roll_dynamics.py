"""The body rolls, and takes time for it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.linalg import lapack

from tpmsd.car.physics.baselines.frame import Frame
from tpmsd.car.physics.dynamics_effect import PHYSICS, DynamicsEffect
from tpmsd.car.physics.effect_records import Wording
from tpmsd.car.physics.parameters import Parameter, Prior
from tpmsd.foundation.wheels import FloatArray


@dataclass(frozen=True)
class RollDynamics(DynamicsEffect):
    """d2q/dt2 + 2 D w dq/dt + w^2 q = w^2 a_y, and dv/dt gains coupling * d2q/dt2 / w^2, w = 2 pi frequency.

    a_y = dv/dt + u r is that of the roll axis, the gain included; q is the roll angle over that per lateral
    acceleration in a steady bend. The body that swings out takes the car's lateral motion with it. An
    accelerometer reads the whole car's acceleration at the height of the centre of gravity, that of the axis
    at the axis. Source: [Gillespie 1992], ch. 6; roll frequencies of 1 to 2.5 Hz, damping 0.2 to 0.5.
    """

    name = "roll_dynamics"
    order = -1  # before other errors of the accelerometer, which hold for what it feels at its place
    kind = PHYSICS
    wording = Wording(
        formula="dv/dt gains coupling * d2q/dt2 / w^2; d2q/dt2 + 2 D w dq/dt + w^2 q = w^2 a_y",
        sentence="the body rolls and takes time for it",
        distinguished_by="weave at 0.5 to 2 Hz at a constant speed",
    )
    channel = "velocity_lat"
    covariate = "steering_rate"
    states = ("roll_q", "roll_rate_q")
    state_sizes = (10.0, 100.0)  # m/s2 and, at 1.6 Hz, m/s3
    grid = tuple(
        {"frequency_hz": frequency, "damping": 0.3, "coupling": 0.4, "sensor_height": height}
        for frequency in (1.0, 1.5, 2.2)
        for height in (0.0, 1.0)
    )
    shaped_by = ("frequency_hz", "damping", "sensor_height")
    shows_in = MappingProxyType({"sensor_height": "accel_lat"})
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
        Parameter(
            "coupling",
            "1",
            0.4,
            0.0,
            0.9,
            "(m_s h)^2 / (m I_x): sprung mass, its height above the roll axis, its inertia about that axis",
            probe=1e-3,
            prior=Prior(0.4, 0.1, "0.3 to 0.5 on passenger cars: Heydinger"),
        ),
        Parameter(
            "sensor_height",
            "1",
            0.5,
            -1.0,
            3.0,
            "height of the accelerometer above the roll axis, over that of the centre of gravity",
            probe=1e-3,
            neutral=1.0,
            prior=Prior(0.5, 0.5, "between the axis and the centre of gravity, on floors: installations"),
        ),
    )
    frequency_hz: float = 1.5
    damping: float = 0.3
    coupling: float = 0.4
    sensor_height: float = 1.0

    @property
    def _rate_per_s(self) -> float:
        """Return the angular frequency of a body whose axis is held."""
        return 2.0 * math.pi * self.frequency_hz

    def fastest_rate_per_s(self, speed_mps: float) -> float:
        """Return the faster of angular frequency and decay on a car whose tyres' forces stay."""
        free = 1.0 - self.coupling
        rates = np.maximum(1.0 / np.sqrt(free), 2.0 * self.damping / free)
        return float(np.max(self._rate_per_s * rates))

    def mass_share(self) -> float:
        """Return the share that does not swing: the body turns about its centre of percussion."""
        return float(np.min(1.0 - self.coupling))

    def add_rates(self, frame: Frame) -> None:
        """Roll, and add the body's swing to dv/dt; as a probe, the swing of a recorded drive.

        With a_y = F_y / m + coupling * d2q/dt2 / w^2 the swing is solved for.
        """
        swing = self._swing(frame)
        if "roll_q" in frame.extra:
            frame.rates["roll_q"], frame.rates["roll_rate_q"] = frame.extra["roll_rate_q"], swing
        frame.rates["v"] = frame.rates["v"] + self.coupling * swing / self._rate_per_s**2

    def read(self, frame: Frame) -> None:
        """Add what the accelerometer's place moves less than the centre of gravity."""
        gain = self.coupling * self._swing(frame) / self._rate_per_s**2
        frame.outputs["accel_lat"] = frame.outputs["accel_lat"] + (1.0 - self.sensor_height) * gain

    def _swing(self, frame: Frame) -> FloatArray:
        """Return d2q/dt2, by the states or, without them, along the recording."""
        w = self._rate_per_s
        accel = np.asarray(frame.force_y / frame.mass)
        if "roll_q" not in frame.extra:
            return _roll_state_acceleration(accel, frame.inputs.time_s, w, self.damping, self.coupling)
        q, rate = frame.extra["roll_q"], frame.extra["roll_rate_q"]
        return np.asarray(w**2 * (accel - q) - 2.0 * self.damping * w * rate) / (1.0 - self.coupling)


def _roll_state_acceleration(
    accel: FloatArray, time_s: FloatArray, w: float, damping: float, coupling: float
) -> FloatArray:
    """Return d2q/dt2 of the roll state q along the last axis, by the bilinear transform at the usual step."""
    if np.ndim(accel) == 0 or np.ndim(time_s) == 0 or len(time_s) < 3:
        return np.zeros_like(accel)
    k = 2.0 / float(np.median(np.diff(time_s)))
    free = (1.0 - coupling) * k * k
    below = np.array(
        [free + 2 * damping * w * k + w * w, 2 * (w * w - free), free - 2 * damping * w * k + w * w]
    )
    above = w * w * k * k * np.array([1.0, -2.0, 1.0])
    driven = above[0] * accel
    driven[..., 1:] += above[1] * accel[..., :-1]
    driven[..., 2:] += above[2] * accel[..., :-2]
    band = np.repeat(below[:, None], accel.shape[-1], axis=1)
    out, _ = lapack.dtbtrs(band, driven.reshape(-1, accel.shape[-1]).T, uplo="L")
    return np.ascontiguousarray(out.T).reshape(accel.shape)
