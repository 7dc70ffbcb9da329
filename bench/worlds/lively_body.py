"""Equations of motion with concealed physics, one state at a time, in steps of a millisecond (Heun's rule).

In: `CarSpec`, `Concealed`, steering and speed. Out: the truth every millisecond. Written from the text books
without any code of the program: the linear single-track car, and four wheels with Dugoff's tyres whose slip
carries the forces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP_S = 1e-3
G = 9.80665
RHO = 1.2041


@dataclass(frozen=True)
class CarSpec:
    """A car as its maker states it."""

    m: float = 1480.0
    iz: float = 2350.0
    a: float = 1.18
    b: float = 1.46
    h: float = 0.54
    tf: float = 1.53
    tr: float = 1.51
    cf: float = 105_000.0
    cr: float = 128_000.0
    cx: float = 85_000.0
    mu: float = 1.0
    brake_front: float = 0.65
    driven: str = "front"
    ratio: float = 15.5


@dataclass(frozen=True)
class SensorSpec:
    """Standard deviations of the sensors' white noise, and the rate of the logger."""

    rate_hz: float = 50.0
    yaw: float = 0.002
    ay: float = 0.05
    ax: float = 0.05
    v: float = 0.02
    u: float = 0.03


@dataclass
class Concealed:
    """What acts beside the stated car; by the name that the public contract gives it."""

    values: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def get(self, effect: str, parameter: str, default: float = 0.0) -> float:
        """Return a value, or the default where the effect is not concealed."""
        return float(self.values.get(effect, {}).get(parameter, default))


class Body:
    """The equations of motion, one state at a time."""

    def __init__(self, car: CarSpec, hidden: Concealed, model: str, forces: bool) -> None:
        self.car, self.hidden, self.model, self.forces = car, hidden, model, forces
        shift = hidden.get("cg_position_error", "forward_m")
        self.a, self.b = car.a - shift, car.b + shift
        self.m = car.m * (1.0 + hidden.get("mass_error", "relative"))
        self.iz = car.iz * (1.0 + hidden.get("yaw_inertia_error", "relative"))
        self.cf = car.cf * (1.0 + hidden.get("cornering_stiffness_error", "front"))
        self.cr = car.cr * (1.0 + hidden.get("cornering_stiffness_error", "rear"))
        self.h = car.h + hidden.get("cg_height_error", "height_m")
        self.mu = hidden.get("tyre_saturation", "friction", car.mu)
        self.limited = model == "three-dof" or "tyre_saturation" in hidden.values
        self.length = hidden.get("tyre_relaxation", "length_m")
        self.load_loss = hidden.get("load_dependent_stiffness", "coefficient")
        self.roll_steer = hidden.get("roll_steer", "coefficient")
        self.roll_steer_front = hidden.get("roll_steer", "front")
        self.roll_instant = hidden.get("roll_steer", "instant")
        self.roll_delay = hidden.get("roll_lag", "delay_s")
        self.roll_square = hidden.get("roll_lag", "square_s2")
        self.roll_accel, self.roll_accel_rate = 0.0, 0.0
        self.give = hidden.get("compliance_steer", "coefficient")
        self.camber = hidden.get("camber_thrust", "coefficient")
        self.lock = hidden.get("locked_differential", "coefficient")
        self.pull = hidden.get("yaw_moment", "coefficient")
        self.vector = hidden.get("yaw_moment", "lateral_m")
        self.roll_resist = hidden.get("rolling_resistance", "coefficient")
        self.drag = hidden.get("aero_drag", "drag_area_m2")
        self.lift = (hidden.get("aero_downforce", "front_m2"), hidden.get("aero_downforce", "rear_m2"))
        self.drive_gain = 1.0 + hidden.get("drive_force_error", "relative")
        self.brake_gain = 1.0 + hidden.get("brake_force_error", "relative")
        self.outside = hidden.get("beyond", "moment_per_speed2")
        self.instant = hidden.get("instant_loads", "coefficient")
        self.wind_mps = hidden.get("side_wind", "speed_mps")
        self.wind_s = hidden.get("side_wind", "duration_s")
        self.wind_from_s = hidden.get("side_wind", "onset_s")
        self.wind_every_s = hidden.get("side_wind", "every_s", math.inf)
        self.bank = hidden.get("road_bank", "amplitude_rad")
        self.beside = 0.0  # lateral acceleration beside u r, a step ago

    def run(self, steer: Array, speed: Array) -> dict[str, Array]:
        """Return the truth every millisecond."""
        n = len(steer)
        rows = []
        wanted, angles, speeds = np.gradient(speed, STEP_S).tolist(), steer.tolist(), speed.tolist()
        v = r = 0.0
        u = speeds[0]
        lag = [0.0, 0.0]
        for k in range(n):
            drive = brake = 0.0
            ax = wanted[k]
            if self.forces:
                ask = self.car.m * (ax + 0.6 * (speeds[k] - u))
                drive, brake = max(ask, 0.0), max(-ask, 0.0)
            else:
                u = speeds[k]
                ax = ax - v * r
            t = k * STEP_S
            first = self._rates(t, angles[k], u, v, r, ax, drive, brake, lag)
            self.beside = first[3] - u * r
            if self.roll_square:
                bend = (
                    first[3] - self.roll_accel - self.roll_delay * self.roll_accel_rate
                ) / self.roll_square
                self.roll_accel_rate += STEP_S * bend
                self.roll_accel += STEP_S * self.roll_accel_rate
            v1, r1 = v + STEP_S * first[0], r + STEP_S * first[1]
            u1 = u + STEP_S * first[2] if self.forces else speeds[min(k + 1, n - 1)]
            l1 = [lag[i] + STEP_S * first[5 + i] for i in (0, 1)]
            nxt = angles[min(k + 1, n - 1)]
            second = self._rates(t + STEP_S, nxt, u1, v1, r1, ax, drive, brake, l1)
            rows.append((v, r, u, first[3], first[4], first[1], drive, brake))
            v += 0.5 * STEP_S * (first[0] + second[0])
            r += 0.5 * STEP_S * (first[1] + second[1])
            if self.forces:
                u += 0.5 * STEP_S * (first[2] + second[2])
            lag = [lag[i] + 0.5 * STEP_S * (first[5 + i] + second[5 + i]) for i in (0, 1)]
        names = ("v", "r", "u", "ay", "ax", "r_rate", "drive", "brake")
        return dict(zip(names, np.array(rows).T.copy(), strict=True))

    def _rates(
        self,
        t: float,
        delta: float,
        u: float,
        v: float,
        r: float,
        ax: float,
        drive: float,
        brake: float,
        lag: list[float],
    ) -> tuple[float, ...]:
        """Return dv, dr, du, a_y, a_x and the rates of the relaxed slip angles."""
        drive, brake = drive * self.drive_gain, brake * self.brake_gain
        if self.model == "three-dof":
            given = 0.0  # the angle by which bushings give way, in balance with the side force
            for _ in range(7 if self.give else 1):
                wheels = delta + given, u, v, r, ax, drive, brake, lag
                fx, fy, mz, slip_rates, side = self._four_wheels(*wheels)
                given = -self.give * (self.a + self.b) / (self.m * self.b) * side
        else:
            fx, fy, mz, slip_rates = self._two_axles(delta, u, v, r, ax, lag)
        lat = u * r
        if self.camber:
            front = -self.camber * self._axle_load(ax)[0] * lat / G
            rear = -self.camber * self._axle_load(ax)[1] * lat / G
            fy += front + rear
            mz += self.a * front - self.b * rear
        if self.lock:
            track = self.car.tf if self.car.driven == "front" else self.car.tr
            mz -= self.lock * 2.0 * self.car.cx * (track / 2.0) ** 2 * r / u
        if self.pull:
            mz += self.pull * ((drive - brake) if self.forces else self.m * ax)
        mz += self.vector * fy
        wind = self._wind(t, u)
        fy += wind
        mz += 0.25 * wind + self.iz * self.outside * u * u * math.copysign(1.0, r) * min(abs(r) * 20.0, 1.0)
        fx -= 0.5 * RHO * self.drag * u * abs(u) + self.roll_resist * self.m * G
        bank = self._bank(t)
        return (
            fy / self.m - u * r - G * math.sin(bank),
            mz / self.iz,
            fx / self.m + v * r,
            fy / self.m,
            fx / self.m if self.forces else ax,
            *slip_rates,
        )

    def _wind(self, t: float, u: float) -> float:
        """Return the side force of a gust, which may come again and again."""
        since = t - self.wind_from_s
        blows = since >= 0.0 and since % self.wind_every_s < self.wind_s
        return 0.5 * RHO * 4.5 * u * self.wind_mps if blows else 0.0

    def _bank(self, t: float) -> float:
        """Return the road's cross slope."""
        return self.bank * math.sin(2.0 * math.pi * t / 70.0) if self.bank else 0.0

    def _axle_load(self, ax: float) -> tuple[float, float]:
        """Return the loads of front and rear axle."""
        base = self.a + self.b
        rise = self.m * ax * self.h / base
        return self.m * G * self.b / base - rise, self.m * G * self.a / base + rise

    def _relaxed(self, angle: float, u: float, state: float) -> tuple[float, float]:
        """Return the angle that makes the force, and the rate of its state."""
        if self.length <= 0.0:
            return angle, 0.0
        return state, (angle - state) * u / self.length

    def _two_axles(
        self, delta: float, u: float, v: float, r: float, ax: float, lag: list[float]
    ) -> tuple[float, float, float, tuple[float, float]]:
        alpha_f = delta - (v + self.a * r) / u
        alpha_r = -(v - self.b * r) / u
        rolled = self.roll_accel if self.roll_square else u * r + self.roll_instant * self.beside
        alpha_f -= self.roll_steer_front * rolled
        alpha_r += self.roll_steer * rolled
        if self.give:
            alpha_f /= 1.0 + self.give * (self.a + self.b) / (self.m * self.b) * self.cf
        alpha_f, rate_f = self._relaxed(alpha_f, u, lag[0])
        alpha_r, rate_r = self._relaxed(alpha_r, u, lag[1])
        cf, cr = self.cf, self.cr
        if self.load_loss:
            move = 2.0 * self.h * u * r / G
            cf *= 1.0 - self.load_loss * (move / self.car.tf) ** 2
            cr *= 1.0 - self.load_loss * (move / self.car.tr) ** 2
        ff, fr = cf * alpha_f, cr * alpha_r
        if self.limited:
            load_f, load_r = self._axle_load(ax)
            ff *= dugoff(abs(ff), self.mu * load_f)
            fr *= dugoff(abs(fr), self.mu * load_r)
        return 0.0, ff + fr, self.a * ff - self.b * fr, (rate_f, rate_r)

    def _slip_angle(
        self, front: bool, left: bool, angle: float, u: float, v: float, r: float
    ) -> tuple[float, float, float]:
        """Return the place (x, y) of a wheel that points to `angle`, and its slip angle."""
        x = self.a if front else -self.b
        y = (self.car.tf if front else self.car.tr) / 2.0 * (1.0 if left else -1.0)
        return x, y, angle - math.atan2(v + x * r, u - y * r)

    def _four_wheels(
        self,
        delta: float,
        u: float,
        v: float,
        r: float,
        ax: float,
        drive: float,
        brake: float,
        lag: list[float],
    ) -> tuple[float, float, float, tuple[float, float], float]:
        """Return forces, moment, the lags' rates and the front wheels' side force."""
        car, base = self.car, self.a + self.b
        if not self.forces:
            force = self.m * ax
            drive, brake = max(force, 0.0), max(-force, 0.0)
        else:
            ax = (drive - brake) / self.m
        share = {"front": 1.0, "rear": 0.0, "all": 0.5}[car.driven]
        f_front = share * drive - car.brake_front * brake
        f_rear = (1.0 - share) * drive - (1.0 - car.brake_front) * brake
        load_f, load_r = self._axle_load(ax)
        load_f += 0.5 * RHO * self.lift[0] * u * u
        load_r += 0.5 * RHO * self.lift[1] * u * u
        lat = u * r + self.instant * self.beside
        side_f = self.m * self.b / base * lat * self.h / car.tf
        side_r = self.m * self.a / base * lat * self.h / car.tr
        fx = fy = mz = 0.0
        move = 2.0 * self.h * lat / G
        mean = [0.0, 0.0]
        wheels = []
        points = delta, self.roll_steer * u * r
        for front in (True, False):
            for left in (True, False):
                x, y, alpha = self._slip_angle(front, left, points[0 if front else 1], u, v, r)
                mean[0 if front else 1] += alpha / 2.0
                wheels.append((front, left, x, y, alpha))
        rates = (0.0, 0.0)
        if self.length > 0.0:
            rates = ((mean[0] - lag[0]) * u / self.length, (mean[1] - lag[1]) * u / self.length)
        sides = [0.0, 0.0]
        for front, left, x, y, alpha in wheels:
            axle = 0 if front else 1
            if self.length > 0.0:
                alpha += lag[axle] - mean[axle]
            ratio = (f_front if front else f_rear) / 2.0 / car.cx
            slip = ratio / (1.0 - ratio)
            load = (load_f if front else load_r) / 2.0
            transfer = side_f if front else side_r
            load += -transfer if left else transfer
            stiff = (self.cf if front else self.cr) / 2.0
            stiff *= 1.0 - self.load_loss * (move / (car.tf if front else car.tr)) ** 2
            along, side = car.cx * slip, stiff * math.tan(alpha)
            grip = dugoff(math.hypot(along, side), self.mu * max(load, 0.0) * (1.0 + slip)) / (1.0 + slip)
            along, side = along * grip, side * grip
            angle = points[axle]
            sides[axle] += side
            ahead = along * math.cos(angle) - side * math.sin(angle)
            across = along * math.sin(angle) + side * math.cos(angle)
            fx += ahead
            fy += across
            mz += x * across - y * ahead
        return fx, fy, mz, rates, sides[0]


def dugoff(linear: float, limit: float) -> float:
    """Return the share of a tyre's linear force that remains below a friction limit."""
    if linear <= 0.5 * limit:
        return 1.0
    lam = limit / (2.0 * linear)
    return (2.0 - lam) * lam
