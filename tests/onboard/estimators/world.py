"""Cars in plain kinematics, as ticks, on their own terms: nothing of the package's physics or simulator.

In: a motion and what the instruments do wrong. Out: ticks and the truth. Speeds and yaw rates are integrated
at 5 ms; a count is the floor of the angle; the receiver's position error wanders (Gauss-Markov) under a white
part, its velocity error has a memory of a second.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from tpmsd.car.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.base import Estimator, RadiusEstimate
from tpmsd.onboard.estimators.build import build_filter
from tpmsd.onboard.estimators.radius_filter import RadiusFilter
from tpmsd.onboard.estimators.table import TABLE, Row
from tpmsd.onboard.timeline.tick import Fix, Tick

STEP_S = 0.005
START_S = 1_700_000_000.0
RADIUS_M = 0.316
TRACK_M = 1.52
WHEELBASE_M = 2.63
STEERING_RATIO = 15.0
VEHICLE = VehicleConfig(
    wheel_radius_m=(RADIUS_M,) * 4,
    track_rear_m=TRACK_M,
    track_front_m=TRACK_M,
    wheelbase_m=WHEELBASE_M,
    driven_axle="front",
    steering_ratio=STEERING_RATIO,
)
OFFSETS_M = (0.0012, -0.0008, 0.0006, -0.0014)
"""True minus nominal radii of fl, fr, rl, rr."""

Profile = Callable[[FloatArray], FloatArray]


def country_speed(time_s: FloatArray) -> FloatArray:
    """Around 20 m/s, gently up and down."""
    return 20.0 + 2.5 * np.sin(time_s / 23.0) + 1.0 * np.sin(time_s / 7.0)


def country_yaw(time_s: FloatArray) -> FloatArray:
    """Long bends to either side, rad/s."""
    return 0.05 * np.sin(time_s / 11.0) + 0.03 * np.sin(time_s / 4.3 + 1.0)


def straight(time_s: FloatArray) -> FloatArray:
    return np.zeros_like(time_s)


@dataclass(frozen=True)
class Receiver:
    period_s: float = 0.2
    position_std_m: float = 1.0
    position_tau_s: float = 30.0
    white_std_m: float = 0.1
    velocity_std_mps: float = 0.05
    doppler: bool = True
    course: bool = True
    outage: tuple[float, float] = (0.0, 0.0)
    """(from, to), s, without fixes."""
    jumps: tuple[tuple[float, float, float], ...] = ()
    """(from, to, metres east) added to positions."""


@dataclass(frozen=True)
class World:
    duration_s: float = 180.0
    dt_s: float = 0.1
    seed: int = 1
    speed_mps: Profile = country_speed
    yaw_radps: Profile = country_yaw
    offsets_m: tuple[float, ...] = OFFSETS_M
    fault: tuple[int, float, float] | None = None
    """(wheel, relative change of its radius, from when)."""
    fault_takes_s: float = 0.0
    lean_s2: float = 0.0
    """c: radii of the left wheels grow by c * a_y, those of the right ones shrink by as much."""
    teeth: float = 48.0
    """Counts per revolution; infinite for exact angles."""
    receiver: Receiver = field(default_factory=Receiver)
    antenna: tuple[float, float] = (0.0, 0.0)
    steering: bool = False

    def drive(self) -> Drive:
        """The drive: the last ones are made once, each caller has a list of ticks of its own."""
        once = _made(self)
        return replace(once, ticks=list(once.ticks))

    def _make(self) -> Drive:
        rng = np.random.default_rng(self.seed)
        time = np.arange(round(self.duration_s / STEP_S) + 1) * STEP_S
        speed, yaw = self.speed_mps(time), self.yaw_radps(time)
        heading = 0.3 + _integral(yaw)
        east, north = _integral(speed * np.cos(heading)), _integral(speed * np.sin(heading))
        radii = RADIUS_M + np.tile(np.array(self.offsets_m), (time.size, 1))
        if self.fault is not None:
            wheel, relative, onset = self.fault
            done = np.clip((time - onset) / max(self.fault_takes_s, 1e-9), 0.0, 1.0)
            radii[:, wheel] *= 1.0 + relative * done
        radii += np.outer(self.lean_s2 * speed * yaw, [1.0, -1.0, 1.0, -1.0])
        half = TRACK_M / 2
        rolling = np.stack(
            [
                np.hypot(speed - yaw * half, yaw * WHEELBASE_M),
                np.hypot(speed + yaw * half, yaw * WHEELBASE_M),
                speed - yaw * half,
                speed + yaw * half,
            ],
            axis=1,
        )
        rolling[:, :2] *= np.sign(speed)[:, None]
        angle = np.stack([_integral(rolling[:, k] / radii[:, k]) for k in range(4)], axis=1)
        angle += rng.random(4)
        quantum = 0.0
        if math.isfinite(self.teeth):
            quantum = 2 * math.pi / self.teeth
            angle = np.floor(angle / quantum) * quantum
        fixes = self._fixes(rng, time, speed, yaw, heading, east, north)
        stamps = np.array([fix.time_s - START_S for fix in fixes])
        assert np.all(np.diff(stamps) > 0.0)
        per_tick = round(self.dt_s / STEP_S)
        ticks = []
        for index in range(1, (time.size - 1) // per_tick + 1):
            at = index * per_tick
            begin, end = time[at - per_tick], time[at]
            first, last = np.searchsorted(stamps, (begin, end), side="right")
            inside = tuple(
                replace(fix, fraction=(fix.time_s - START_S - begin) / self.dt_s) for fix in fixes[first:last]
            )
            curvature = yaw[at] / max(speed[at], 0.1)
            wheel = STEERING_RATIO * math.atan(WHEELBASE_M * curvature)
            ticks.append(
                Tick(
                    index=index,
                    time_s=START_S + end,
                    dt_s=self.dt_s,
                    rotation_rad=angle[at] - angle[at - per_tick],
                    rotation_std_rad=np.full(4, quantum / math.sqrt(6.0)),
                    fixes=inside,
                    steering_wheel_angle_rad=wheel if self.steering else math.nan,
                    host_time_s=START_S + end,
                )
            )
        pose = np.stack([east, north, heading], axis=1)[per_tick::per_tick]
        return Drive(self, ticks, pose[: len(ticks)], radii[per_tick::per_tick][: len(ticks)] - RADIUS_M)

    def _fixes(
        self,
        rng: np.random.Generator,
        time: FloatArray,
        speed: FloatArray,
        yaw: FloatArray,
        heading: FloatArray,
        east: FloatArray,
        north: FloatArray,
    ) -> list[Fix]:
        receiver = self.receiver
        at_s = np.arange(0.07, time[-1], receiver.period_s)
        count = at_s.size
        wander = _gauss_markov(
            rng, count, receiver.period_s, receiver.position_std_m, receiver.position_tau_s
        )
        white = receiver.white_std_m * rng.standard_normal((count, 2))
        slip = _gauss_markov(rng, count, receiver.period_s, receiver.velocity_std_mps, 1.0)
        forward, left = self.antenna
        psi, v, r = (np.interp(at_s, time, values) for values in (heading, speed, yaw))
        x = np.interp(at_s, time, east) + forward * np.cos(psi) - left * np.sin(psi)
        y = np.interp(at_s, time, north) + forward * np.sin(psi) + left * np.cos(psi)
        along, across = v - r * left, r * forward
        ve = along * np.cos(psi) - across * np.sin(psi) + slip[:, 0]
        vn = along * np.sin(psi) + across * np.cos(psi) + slip[:, 1]
        jump = np.zeros(count)
        for begin, end, metres in receiver.jumps:
            jump[(at_s >= begin) & (at_s < end)] += metres
        out = []
        for k in range(count):
            if receiver.outage[0] <= at_s[k] < receiver.outage[1]:
                continue
            moving = math.hypot(ve[k], vn[k])
            out.append(
                Fix(
                    time_s=START_S + float(at_s[k]),
                    fraction=0.0,
                    east_m=float(x[k] + wander[k, 0] + white[k, 0] + jump[k]),
                    north_m=float(y[k] + wander[k, 1] + white[k, 1]),
                    position_std_m=math.hypot(receiver.position_std_m, receiver.white_std_m),
                    speed_mps=moving if receiver.doppler else math.nan,
                    heading_rad=math.atan2(vn[k], ve[k]) if receiver.course and moving > 1.0 else math.nan,
                )
            )
        return out


@dataclass(frozen=True)
class Drive:
    world: World
    ticks: list[Tick]
    pose: FloatArray
    """(n, 3) east, north, heading at the ends of the ticks."""
    offsets_m: FloatArray
    """(n, 4) true minus nominal radii there."""


@functools.lru_cache(maxsize=8)
def _made(world: World) -> Drive:
    return world._make()


def _integral(rate: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * STEP_S)])


def _gauss_markov(
    rng: np.random.Generator, count: int, period_s: float, std: float, tau_s: float
) -> FloatArray:
    keep = math.exp(-period_s / tau_s)
    out = np.empty((count, 2))
    out[0] = std * rng.standard_normal(2)
    for k in range(1, count):
        out[k] = keep * out[k - 1] + std * math.sqrt(1 - keep**2) * rng.standard_normal(2)
    return out


METHODS = tuple(TABLE)


def filter_of(
    row: Row, vehicle: VehicleConfig = VEHICLE, settings: FilterConfig | None = None, *, seed: int = 1
) -> RadiusFilter:
    """A filter of the rear pair made of this row."""
    rng = np.random.default_rng(seed)
    return build_filter(vehicle, GnssConfig(), settings or FilterConfig(), rng, False, row)


def estimator(
    method: str, world: World, *, front: bool = True, seed: int = 1, particles: int | None = None
) -> RadiusFilter:
    settings = FilterConfig(method=method, rate_hz=1.0 / world.dt_s, particles=particles)
    forward, left = world.antenna
    gnss = GnssConfig(antenna_forward_m=forward, antenna_left_m=left)
    return build_filter(VEHICLE, gnss, settings, np.random.default_rng(seed), front)


def soft_rear(wheel: int, receiver: Receiver) -> World:
    """28 m/s straight on, exact angles; after 20 s a rear wheel's radius is 3 % smaller."""
    return World(
        duration_s=60.0,
        speed_mps=lambda t: np.full_like(t, 28.0),
        yaw_radps=straight,
        teeth=math.inf,
        fault=(wheel, -0.03, 20.0),
        receiver=receiver,
    )


def run(filter_: Estimator, ticks: list[Tick]) -> list[RadiusEstimate]:
    return [filter_.step(tick) for tick in ticks]


def errors_m(drive: Drive, estimates: list[RadiusEstimate]) -> FloatArray:
    """(n, 4) estimated minus true radii."""
    return np.array([e.deviation_m for e in estimates]) - drive.offsets_m


def stds_m(estimates: list[RadiusEstimate]) -> FloatArray:
    """(n, 4) the estimates' own standard deviations."""
    return np.sqrt(np.array([np.diag(e.covariance_m2) for e in estimates]))
