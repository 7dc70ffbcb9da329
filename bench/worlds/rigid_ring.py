"""Wheels with a rigid-ring tyre on a rough road, and what a tone ring and a control unit make of them.

Independent of the package: its own mechanics, its own time base, no common code with
`tpmsd.onboard.resonance`.

Per wheel (Zegelaar 1998; Pacejka, Tire and Vehicle Dynamics, ch. 9), linear about rolling at speed V:

    axle    m_a z_a'' = -k_s z_a - d_s z_a' + k_b (z_b - z_a) + d_b (z_b' - z_a')
            m_a x_a'' = -k_x x_a - d_x x_a' + k_b (x_b - x_a) + d_b (x_b' - x_a')
    belt    m_b z_b'' = -k_b (z_b - z_a) - d_b (z_b' - z_a') + k_c (w - z_b)
            m_b x_b'' = -k_b (x_b - x_a) - d_b (x_b' - x_a') + F - F_z w'/V
    rim     I_a q_a'' = -c (q_a - q_b) - d (q_a' - q_b')
    belt    I_b q_b'' =  c (q_a - q_b) + d (q_a' - q_b') - r F
    contact (s / V) F' + F = -(C / V) (x_b' - r q_b' + e (w - z_b) V / r)

w is the road under the contact: profile of ISO 8608 (density ~ n^-2), averaged over the contact length. The
last term is the effective rolling radius, which shrinks by e times the deflection. Default numbers are those
of a published Magic Formula 6.2 / SWIFT file of a 205/60R15 (belt inertia 0.489 kgm2, wind-up 67.7 Hz on a
fixed rim with 5 % damping, in-plane 76.6 Hz, 210 N/mm), with an unsprung mass and a wheel of a compact car.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

FloatArray = NDArray[np.float64]

RATE_HZ = 1600.0
CHUNK = 1024
"""Steps over which the speed is taken as constant, 0.64 s."""
ISO_CLASS_A = 16e-6
"""Displacement density at 0.1 cycles/m, m3; every further class has four times as much."""


@dataclass(frozen=True)
class Tyre:
    """Tyre, wheel and axle of one corner; SI units."""

    radius_m: float = 0.304
    load_n: float = 4000.0
    axle_kg: float = 38.0
    belt_kg: float = 7.7
    rim_kgm2: float = 0.95
    belt_kgm2: float = 0.489
    torsion_nm: float = 88_540.0
    torsion_damping: float = 0.052
    belt_n_m: float = 1.785e6
    belt_damping: float = 0.049
    vertical_n_m: float = 209_650.0
    slip_stiffness_n: float = 86_800.0
    relaxation_m: float = 0.055
    rolling_share: float = 0.3
    suspension_n_m: float = 22_000.0
    suspension_ns_m: float = 1_500.0
    bushing_hz: float = 17.0
    bushing_damping: float = 0.12
    pressure_share: float = 0.6
    """How much of the sidewall's torsional stiffness is the pressure's."""

    def at_pressure(self, ratio: float) -> Tyre:
        """The same tyre at a pressure relative to nominal: softer sidewall, longer contact."""
        change = ratio - 1.0
        return replace(
            self,
            torsion_nm=self.torsion_nm * (1.0 + self.pressure_share * change),
            belt_n_m=self.belt_n_m * (1.0 + self.pressure_share * change),
            vertical_n_m=self.vertical_n_m * (1.0 + 0.71 * change),
            slip_stiffness_n=self.slip_stiffness_n * (1.0 - 0.35 * change),
            relaxation_m=self.relaxation_m / math.sqrt(1.0 + 0.71 * change),
        )

    def system(self, speed_mps: float) -> tuple[FloatArray, FloatArray]:
        """State (z_a z_b x_a x_b q_a q_b, their rates, F) and input (w, w') matrices at a speed."""
        contact_n_m = 1.0 / (1.0 / self.vertical_n_m - 1.0 / self.belt_n_m)
        belt_d = 2.0 * self.belt_damping * math.sqrt(self.belt_n_m * self.belt_kg)
        torsion_d = 2.0 * self.torsion_damping * math.sqrt(self.torsion_nm * self.belt_kgm2)
        bushing = (2.0 * math.pi * self.bushing_hz) ** 2 * self.axle_kg
        bushing_d = 2.0 * self.bushing_damping * math.sqrt(bushing * self.axle_kg)
        a, b = np.zeros((13, 13)), np.zeros((13, 2))
        a[:6, 6:12] = np.eye(6)
        za, zb, xa, xb, qa, qb, force = 0, 1, 2, 3, 4, 5, 12

        def spring(
            one: int, other: int, stiffness: float, damping: float, masses: tuple[float, float]
        ) -> None:
            for here, there, mass in ((one, other, masses[0]), (other, one, masses[1])):
                a[6 + here, here] -= stiffness / mass
                a[6 + here, there] += stiffness / mass
                a[6 + here, 6 + here] -= damping / mass
                a[6 + here, 6 + there] += damping / mass

        spring(za, zb, self.belt_n_m, belt_d, (self.axle_kg, self.belt_kg))
        spring(xa, xb, self.belt_n_m, belt_d, (self.axle_kg, self.belt_kg))
        spring(qa, qb, self.torsion_nm, torsion_d, (self.rim_kgm2, self.belt_kgm2))
        for number, stiffness, damping in (
            (za, self.suspension_n_m, self.suspension_ns_m),
            (xa, bushing, bushing_d),
        ):
            a[6 + number, number] -= stiffness / self.axle_kg
            a[6 + number, 6 + number] -= damping / self.axle_kg
        a[6 + zb, zb] -= contact_n_m / self.belt_kg
        b[6 + zb, 0] += contact_n_m / self.belt_kg
        a[6 + xb, force] += 1.0 / self.belt_kg
        b[6 + xb, 1] -= self.load_n / speed_mps / self.belt_kg
        a[6 + qb, force] -= self.radius_m / self.belt_kgm2
        a[force, force] -= speed_mps / self.relaxation_m
        slip = -self.slip_stiffness_n / self.relaxation_m
        a[force, 6 + xb] += slip
        a[force, 6 + qb] -= slip * self.radius_m
        a[force, zb] -= slip * self.rolling_share * speed_mps / self.radius_m
        b[force, 0] += slip * self.rolling_share * speed_mps / self.radius_m
        return a, b


def road(rng: np.random.Generator, length_m: float, density: float, wheels: int, step_m: float) -> FloatArray:
    """(wheels, n) heights under the contact, on a grid of `step_m`; `density` at 0.1 cycles/m, m3."""
    count = int(length_m / step_m) + 8
    # Density ~ n^-2 is a random walk: its slope is white, of two-sided density (2 pi 0.1)^2 G / 2.
    slope_std = math.sqrt((2.0 * math.pi * 0.1) ** 2 * density / 2.0 / step_m)
    height = np.cumsum(rng.normal(size=(wheels, count)) * slope_std * step_m, axis=1)
    # Long waves are no matter here and would only cost digits.
    sums = np.cumsum(np.pad(height, ((0, 0), (500, 500)), mode="edge"), axis=1)
    height -= (sums[:, 1000:] - sums[:, :-1000]) / 1000.0
    contact = max(round(0.11 / step_m), 1)
    kernel = np.convolve(np.full(contact, 1.0 / contact), np.full(contact // 2 + 1, 1.0 / (contact // 2 + 1)))
    return np.stack([np.convolve(row, kernel, "same") for row in height])


def wandering_speed(rng: np.random.Generator, seconds: float, mean_mps: float, std_mps: float) -> FloatArray:
    """Speed per chunk: an Ornstein-Uhlenbeck walk of 40 s, as a driver in loose traffic keeps it."""
    chunks = math.ceil(seconds * RATE_HZ / CHUNK)
    keep = math.exp(-CHUNK / RATE_HZ / 40.0)
    speed = np.empty(chunks)
    value = 0.0
    for number in range(chunks):
        value = keep * value + math.sqrt(1.0 - keep * keep) * std_mps * rng.normal()
        speed[number] = mean_mps + min(max(value, -2.0 * std_mps), 2.0 * std_mps)
    return speed


def roll(
    rng: np.random.Generator, tyre: Tyre, speed_mps: FloatArray, density: float, wheels: int
) -> FloatArray:
    """(wheels, steps) angle of the rim, rad, at RATE_HZ; each wheel on a road of its own."""
    nodes = np.append(speed_mps, speed_mps[-1])
    time = np.arange(speed_mps.size * CHUNK)
    speed = np.interp(time, np.arange(nodes.size) * CHUNK, nodes)
    distance = np.cumsum(speed) / RATE_HZ
    step_m = 0.01
    profile = road(rng, distance[-1] + 2.0, density, wheels, step_m)
    state = np.zeros((13, wheels))
    fluctuation = np.empty((wheels, time.size))
    for chunk in range(speed_mps.size):
        at = slice(chunk * CHUNK, (chunk + 1) * CHUNK)
        place = np.clip(distance[at] / step_m, 0, profile.shape[1] - 2)
        left = place.astype(int)
        share = place - left
        height = profile[:, left] * (1.0 - share) + profile[:, left + 1] * share
        slope = (profile[:, left + 1] - profile[:, left]) / step_m
        a, b = tyre.system(float(speed_mps[chunk]))
        whole = expm(np.block([[a, b], [np.zeros((2, 15))]]) / RATE_HZ)
        step, entry = whole[:13, :13], whole[:13, 13:]
        drive = np.einsum("ij,jwt->tiw", entry, np.stack([height, slope * speed_mps[chunk]]))
        seen = fluctuation[:, at]
        for number in range(CHUNK):
            state = step @ state + drive[number]
            seen[:, number] = state[4]
    return np.cumsum(speed)[None, :] / RATE_HZ / tyre.radius_m + fluctuation


@dataclass(frozen=True)
class ToneRing:
    """Angles of a ring's edges in one turn, rad."""

    edges_rad: FloatArray

    @classmethod
    def uneven(
        cls, rng: np.random.Generator, teeth: int = 48, pitch_std: float = 0.002, runout: float = 0.01
    ) -> ToneRing:
        """Teeth off by a share of their pitch each, on a ring off its centre (in pitches)."""
        number = np.arange(teeth)
        error = pitch_std * rng.normal(size=teeth)
        error += runout * np.sin(2.0 * math.pi * number / teeth + rng.uniform(0.0, 2.0 * math.pi))
        return cls((number + error) * 2.0 * math.pi / teeth)

    def edge_times_s(self, angle_rad: FloatArray) -> FloatArray:
        """When the edges pass the sensor, for an angle at RATE_HZ; timed to a microsecond."""
        turns = math.ceil(angle_rad[-1] / (2.0 * math.pi)) + 1
        edges = (2.0 * math.pi * np.arange(turns)[:, None] + self.edges_rad).ravel()
        edges = edges[(edges > angle_rad[0]) & (edges < angle_rad[-1])]
        times = np.interp(edges, angle_rad, np.arange(angle_rad.size) / RATE_HZ)
        return np.asarray(np.round(times, 6))


def ecu_speed_radps(edge_s: FloatArray, teeth: int, rate_hz: float, cycle_s: float) -> FloatArray:
    """Speeds as a control unit finds them: edges in a cycle over the time from last edge to last edge.

    Found once a cycle; of these one is sent at each period of the bus, without any filter.
    """
    cycles = np.arange(1, int(edge_s[-1] / cycle_s)) * cycle_s
    last = np.searchsorted(edge_s, cycles, side="right") - 1
    last = np.maximum(last, 0)
    count, span = np.diff(last), np.diff(edge_s[last])
    speed = np.where(count > 0, count / np.where(span > 0.0, span, 1.0), np.nan) * 2.0 * math.pi / teeth
    held = np.maximum.accumulate(np.where(np.isfinite(speed), np.arange(speed.size), 0))
    return speed[held][:: max(round(1.0 / (rate_hz * cycle_s)), 1)]


def counts(edge_s: FloatArray, rate_hz: float) -> NDArray[np.int64]:
    """A free-running counter of the edges, read at a rate."""
    return np.searchsorted(edge_s, np.arange(int(edge_s[-1] * rate_hz)) / rate_hz, side="right")
