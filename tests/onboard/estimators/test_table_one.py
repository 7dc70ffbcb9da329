"""`mpf-pn-paper` against Table I of [Lundquist 2013], written as loops over particles."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.onboard.estimators.test_filters import straight_ticks
from tests.onboard.estimators.world import (
    RADIUS_M,
    STEERING_RATIO,
    TRACK_M,
    VEHICLE,
    WHEELBASE_M,
    Receiver,
    World,
    filter_of,
    run,
)
from tpmsd.car.config.model import FilterConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.estimators.table import TABLE
from tpmsd.onboard.timeline.tick import Fix, Tick

COUNT = 40
PRECISE = Receiver(position_std_m=0.15, white_std_m=0.05)
"""States 0.16 m: less than the floor of the program's own filters."""
WINDOW_S = 20.0


@dataclass
class Particle:
    """x = (east, north, heading), and the statistics S of w."""

    x: FloatArray
    moved: FloatArray
    weight: float
    gamma: float
    mean: FloatArray
    nu: float
    scale: FloatArray

    def copy(self) -> Particle:
        return Particle(
            self.x.copy(),
            self.moved.copy(),
            self.weight,
            self.gamma,
            self.mean.copy(),
            self.nu,
            self.scale.copy(),
        )


GAMMA_MPS = FilterConfig().min_speed_mps
"""gamma of (38c), of which the paper says nothing: the program's limit of informative driving."""


def moved_by(x: FloatArray, tick: Tick, w: FloatArray) -> FloatArray:
    """How (1a) with (9a), (9b) changes the pose: heading psi_k, as printed; below gamma (38c) in place of
    (7c)."""
    T, r = tick.dt_s, RADIUS_M
    omega3, omega4 = tick.rotation_rad[2:] / T
    v_virt, psi_dot_virt = (omega3 * r + omega4 * r) / 2, (omega4 * r - omega3 * r) / TRACK_M
    cos, sin = math.cos(x[2]), math.sin(x[2])
    f = np.array([T * v_virt * cos, T * v_virt * sin, T * psi_dot_virt])
    g = np.array(
        [
            [T * omega3 * cos / 2, T * omega4 * cos / 2],
            [T * omega3 * sin / 2, T * omega4 * sin / 2],
            [-T * omega3 / TRACK_M, T * omega4 / TRACK_M],
        ]
    )
    out = f + g @ w
    if math.isfinite(tick.steering_wheel_angle_rad) and v_virt < GAMMA_MPS:
        delta_f = tick.steering_wheel_angle_rad / STEERING_RATIO
        out[2] = T * delta_f * (v_virt + omega3 * w[0] / 2 + omega4 * w[1] / 2) / WHEELBASE_M
    return np.asarray(out)


class TableOne:
    """Lines 1 to 20, one particle after the other; draws are taken in the program's order."""

    def __init__(self, rng: np.random.Generator, rate_hz: float) -> None:
        self.rng = rng
        self.forgetting = 1.0 - 1.0 / (WINDOW_S * rate_hz)
        spread = rng.standard_normal((COUNT, 2)) * 0.01 * RADIUS_M
        self.particles = [
            Particle(
                np.zeros(3),
                np.zeros(3),
                1.0 / COUNT,
                0.2,
                spread[i],
                5.0,
                np.eye(2) * SETTINGS.noise_m**2 * 2.0,
            )
            for i in range(COUNT)
        ]
        self.placed = False
        self.resampled = 0

    def step(self, tick: Tick) -> tuple[FloatArray, FloatArray]:
        for p in self.particles:  # line 9: (20a)-(20d)
            p.gamma /= self.forgetting
            p.nu *= self.forgetting
            p.scale *= self.forgetting
        dof = self.particles[0].nu - 1.0
        normal = self.rng.standard_normal((COUNT, 2))
        chi2 = self.rng.chisquare(dof, COUNT)
        for i, p in enumerate(self.particles):
            # line 10: (21), Student-t with nu - d + 1 degrees of freedom
            root = np.linalg.cholesky(p.scale * (1.0 + p.gamma) / dof)
            w = p.mean + root @ (normal[i] * math.sqrt(dof / chi2[i]))
            # line 13: (19a)-(19d)
            off = w - p.mean
            p.scale = p.scale + np.outer(off, off) / (1.0 + p.gamma)
            p.mean = p.mean + p.gamma / (1.0 + p.gamma) * off
            p.gamma, p.nu = p.gamma / (1.0 + p.gamma), p.nu + 1.0
            # line 11
            p.moved = moved_by(p.x, tick, w)
            p.x = p.x + p.moved
        for fix in tick.fixes:
            self.take(fix, tick)
        effective = 1.0 / sum(p.weight**2 for p in self.particles)  # lines 16, 17
        if effective <= 0.5 * COUNT:
            self.resample()
        weights = np.array([p.weight for p in self.particles])
        mean = sum((p.weight * p.mean for p in self.particles), np.zeros(2))  # (24a)
        sigma = sum((p.weight * p.scale / (p.nu - 3.0) for p in self.particles), np.zeros((2, 2)))  # (24b)
        away = np.array([p.mean for p in self.particles]) - mean
        spread = (away * weights[:, None]).T @ away
        return mean, spread + self.particles[0].gamma * sigma

    def take(self, fix: Fix, tick: Tick) -> None:
        variance = fix.position_std_m**2
        if not self.placed:  # of which the paper says nothing: the program's
            self.placed = True
            heading = fix.heading_rad + (0.05 + 0.2 / fix.speed_mps) * self.rng.standard_normal(COUNT)
            east = fix.east_m + math.sqrt(variance) * self.rng.standard_normal(COUNT)
            north = fix.north_m + math.sqrt(variance) * self.rng.standard_normal(COUNT)
            distances = [math.hypot(p.moved[0], p.moved[1]) for p in self.particles]
            ahead = (1.0 - fix.fraction) * sum(distances) / COUNT
            for i, p in enumerate(self.particles):
                along = np.array([math.cos(heading[i]), math.sin(heading[i]), 0.0])
                p.x = np.array([east[i], north[i], heading[i]]) + ahead * along
                p.moved, p.weight = np.zeros(3), 1.0 / COUNT
            return
        for p in self.particles:  # line 12, (10d)
            at = p.x - (1.0 - fix.fraction) * p.moved
            squared = (fix.east_m - at[0]) ** 2 + (fix.north_m - at[1]) ** 2
            p.weight *= math.exp(-0.5 * squared / variance)
        total = sum(p.weight for p in self.particles)  # line 15
        for p in self.particles:
            p.weight /= total

    def resample(self) -> None:
        self.resampled += 1
        first = self.rng.random()
        edges = np.cumsum([p.weight for p in self.particles])
        chosen = []
        for k in range(COUNT):
            place = 0
            while place < COUNT - 1 and edges[place] <= (k + first) / COUNT:
                place += 1
            chosen.append(self.particles[place].copy())
        self.particles = chosen
        for p in self.particles:
            p.weight = 1.0 / COUNT


def slow(time_s: FloatArray) -> FloatArray:
    return np.interp(time_s, [0.0, 6.0, 10.0, 18.0, 22.0], [9.0, 9.0, 3.0, 3.0, 9.0])


@pytest.mark.parametrize(("bends", "steering"), [(False, False), (True, False), (True, True)])
def test_it_is_table_one_to_the_letter(bends: bool, steering: bool) -> None:
    """Twenty seconds, straight on and through bends, stops included, and below gamma by the steering (38):
    means and covariances of the radii are those of the loops to rounding, resampling and all."""
    world = (
        World(duration_s=25.0, speed_mps=slow, steering=True, receiver=PRECISE)
        if steering
        else World(duration_s=25.0)
    )
    ticks = world.drive().ticks if bends else straight_ticks(RADIUS_M + 0.001, 0.8, period=2)[:200]
    if bends:
        stop = np.zeros(4)
        ticks = [t if not 120 <= k < 130 else replace(t, rotation_rad=stop) for k, t in enumerate(ticks)]
    settings = FilterConfig(method="mpf-pn-paper", particles=COUNT, window_s=WINDOW_S)
    filter_ = filter_of(TABLE["mpf-pn-paper"], VEHICLE, settings, seed=11)
    loops = TableOne(np.random.default_rng(11), settings.rate_hz)
    for tick, said in zip(ticks, run(filter_, ticks), strict=True):
        mean, covariance = loops.step(tick)
        assert mean == pytest.approx(said.deviation_m[2:], abs=1e-9)
        assert covariance == pytest.approx(said.covariance_m2[2:, 2:], rel=1e-6)
    assert loops.resampled > 5
