"""Radii by a factor graph of GTSAM: a fixed-lag smoother and a batch optimum, independent of the filters.

In: a `Driven`. Out: `Smoothed` radii of the rear pair, one row a second.

The library shares no line with `limit` or with the program: poses are elements of SE(2), relinearised where
they are estimated; the radii are logarithms and walk. Like `limit` it is given the variances and memories of
this very receiver, and hears positions, Doppler speed and course; the drive has no gyro. A node is a second,
as the factors are Python functions that the library calls back. A node's heading is that of the wheels'
readings, so that errors of the counts do not add up; within a second they are noise across the way.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.campaigns.onboard.estimators.limit import PRIOR_RADIUS_M, WALK
from bench.worlds.paper_drive import FIX_S, QUANTUM_RAD, RADIUS_M, RL, ROUGHNESS_M, TICK_S, Driven
from bench.worlds.paper_route import TRACK_M

Array = NDArray[np.float64]
SECOND = round(1.0 / TICK_S)
"""Ticks of a node."""
LAG_S = 60.0
"""The fixed lag: the memory of a slow position error is 20 to 100 s."""
UNIT = 1e-3
"""Logarithms of radii are in thousandths, so that all variables are of like size."""
STEP = 0.01
"""Of numeric derivatives by the logarithms, thousandths."""
STEPS = STEP * np.eye(2)
LEAST = np.array([1e-3, 1e-3, 1e-4])
"""Least standard deviations of a second's motion, m and rad: at a standstill."""
MIN_WALK = 1e-4
"""Least random walk of a logarithm, thousandths: where the scenario has none."""


@dataclass(frozen=True)
class Smoothed:
    """Estimates (seconds, 2) of radius minus nominal, m."""

    causal_m: Array
    """By the fixed lag, at the end of each second."""
    lagged_m: Array
    """By the fixed lag, each as the variable leaves the window."""
    batch_m: Array
    """By all of the drive."""
    ms_per_node: float
    """Processor time of the fixed lag per node."""


class Node:
    """Measurements of a second."""

    def __init__(self, turned: Array, at: list[int], fix: Array, doppler: Array | None) -> None:
        """`turned`: (ticks, 2) angles; `at`: ticks at whose ends the fixes are; `fix`: their mean, (2,) m;
        `doppler`: (2,) way by Doppler, m, None where one of its readings has no course."""
        self._turned, self._at = turned, at
        self.fix, self.doppler = fix, doppler
        distances = turned.mean(axis=1) * RADIUS_M
        rough = ROUGHNESS_M * math.sqrt(abs(distances.sum()))
        across = QUANTUM_RAD / math.sqrt(6.0) * RADIUS_M / TRACK_M * math.sqrt(float(distances @ distances))
        std = [rough / math.sqrt(2.0), across, rough * math.sqrt(2.0) / TRACK_M]
        self.noise = np.maximum(LEAST, std)
        """(3,) standard deviations of forward, left, turn."""
        self._cached: tuple[bytes, Array] = b"", np.zeros((5, 3))

    def motion(self, logs: Array) -> Array:
        """(5, 3): rows forward, left, turn of the second, mean forward and left of the instants of the fixes;
        columns at these logarithms, and derivatives by each."""
        name = logs.tobytes()
        if name != self._cached[0]:
            found = [self._rows(logs + step) for step in (np.zeros(2), *STEPS)]
            self._cached = name, np.column_stack([found[0], *[(one - found[0]) / STEP for one in found[1:]]])
        return self._cached[1]

    def _rows(self, logs: Array) -> Array:
        distances = self._turned * (RADIUS_M * np.exp(UNIT * logs))
        heading = np.cumsum((distances[:, 1] - distances[:, 0]) / TRACK_M)
        distance, middle = distances.mean(axis=1), heading - (distances[:, 1] - distances[:, 0]) / TRACK_M / 2
        east, north = np.cumsum(distance * np.cos(middle)), np.cumsum(distance * np.sin(middle))
        return np.array([east[-1], north[-1], heading[-1], east[self._at].mean(), north[self._at].mean()])


def _rotation(heading: float) -> Array:
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([[cos, -sin], [sin, cos]])


def nodes(driven: Driven) -> list[Node]:
    """Measurements of all whole seconds."""
    out = []
    last: Array | None = None
    for begin in range(0, len(driven.ticks) // SECOND * SECOND, SECOND):
        ticks = driven.ticks[begin : begin + SECOND]
        turned = np.array([tick.rotation_rad[RL:] for tick in ticks])
        outcome = [(k, tick.fixes[0]) for k, tick in enumerate(ticks) if tick.fixes]
        at = [k for k, _ in outcome]
        velocity = np.array(
            [
                [f.speed_mps * math.cos(f.heading_rad), f.speed_mps * math.sin(f.heading_rad)]
                for _, f in outcome
            ]
        )
        samples = velocity if last is None else np.vstack([last, velocity])
        last = velocity[-1]
        whole = len(samples) == len(outcome) + 1 and bool(np.isfinite(samples).all())
        fix = np.mean([[f.east_m, f.north_m] for _, f in outcome], axis=0)
        doppler = FIX_S * (samples[1:] + samples[:-1]).sum(axis=0) / 2 if whole else None
        out.append(Node(turned, at, fix, doppler))
    return out


def averaged(std: float, tau_s: float) -> tuple[float, float]:
    """Standard deviation and memory from second to second of the mean of a Gauss-Markov error over a second,
    by the trapezoidal rule: variance and spectral density at zero are those of the mean."""
    keep = math.exp(-FIX_S / tau_s) if tau_s > 0.0 else 0.0
    weights = FIX_S * np.array([0.5, *[1.0] * (round(1.0 / FIX_S) - 1), 0.5])
    apart = np.abs(np.subtract.outer(np.arange(weights.size), np.arange(weights.size)))
    variance = float(weights @ np.where(apart == 0, 1.0, keep**apart) @ weights)
    density = FIX_S * (1.0 + keep) / (1.0 - keep)
    return std * math.sqrt(variance), max((density - variance) / (density + variance), 0.0)


class Graph:
    """Factors and first values of one drive, node by node."""

    def __init__(self, driven: Driven, walk: float) -> None:
        """`walk`: of each radius, m per sqrt(s)."""
        import gtsam

        self._g, self._errors = gtsam, driven.errors
        self._walk = self._sigmas(np.full(2, max(walk / RADIUS_M / UNIT, MIN_WALK)))
        doppler, keep = averaged(driven.errors.doppler_mps, driven.errors.doppler_tau_s)
        keep_slow = math.exp(-1.0 / driven.errors.slow_tau_s)
        self._keep = np.diag([keep_slow, keep_slow, keep, keep])
        slow = max(driven.errors.slow_m, LEAST[0])
        self._slow = np.array([slow, slow, doppler, doppler])
        per_second = round(1.0 / FIX_S)
        # the pose of the readings is off by what the counts are rounded to
        rounded = RADIUS_M * QUANTUM_RAD / math.sqrt(24.0)
        self._white = self._sigmas(
            np.full(2, math.hypot(driven.errors.white_m / math.sqrt(per_second), rounded))
        )
        self._rounded = self._sigmas(np.full(2, math.sqrt(2.0) * rounded))
        self._start = driven.pose[0]

    def _sigmas(self, std: Array) -> Any:
        return self._g.noiseModel.Diagonal.Sigmas(std)

    def key(self, letter: str, number: int) -> int:
        """Key of a pose `x`, of radii `m`, or of receiver errors `s`."""
        return int(self._g.symbol(letter, number))

    def first(self, graph: Any, values: Any) -> None:
        """Add what is known before the drive: the prior of `limit`."""
        g, pose = self._g, self._g.Pose2(*self._start)
        graph.add(g.PriorFactorPose2(self.key("x", 0), pose, self._sigmas(np.sqrt([100.0, 100.0, 0.1]))))
        values.insert(self.key("x", 0), pose)
        radii = self._sigmas(np.full(2, PRIOR_RADIUS_M / RADIUS_M / UNIT))
        graph.add(g.PriorFactorVector(self.key("m", 0), np.zeros(2), radii))
        values.insert(self.key("m", 0), np.zeros(2))
        graph.add(g.PriorFactorVector(self.key("s", 0), np.zeros(4), self._sigmas(self._slow)))
        values.insert(self.key("s", 0), np.zeros(4))

    def add(self, graph: Any, values: Any, number: int, node: Node, at: tuple[Any, Array, Array]) -> None:
        """Add the factors of second `number`, and first values; `at`: pose, logarithms and errors before."""
        g = self._g
        x, m, s = (self.key(letter, number) for letter in "xms")
        x0, m0, s0 = (self.key(letter, number - 1) for letter in "xms")
        pose, logs, errors = at
        moved = node.motion(logs)[:3, 0]
        values.insert(x, pose.compose(g.Pose2(*moved)))
        values.insert(m, logs)
        values.insert(s, self._keep @ errors)
        graph.add(g.CustomFactor(self._sigmas(node.noise), [x0, x, m], _wheels(node)))
        graph.add(g.CustomFactor(self._white, [x0, m, s], _position(node)))
        if node.doppler is not None:
            graph.add(g.CustomFactor(self._rounded, [x0, x, s], _doppler(node.doppler)))
        graph.add(g.BetweenFactorVector(m0, m, np.zeros(2), self._walk))
        new = self._sigmas(self._slow * np.sqrt(1.0 - np.diag(self._keep) ** 2))
        graph.add(g.CustomFactor(new, [s0, s], _memory(self._keep)))


def _wheels(node: Node) -> Any:
    """Factor of the motion of a second, in the frame of its begin."""

    def error(this: Any, values: Any, H: Any) -> Array:
        before, after = (values.atPose2(key) for key in this.keys()[:2])
        motion = node.motion(values.atVector(this.keys()[2]))[:3]
        between = before.between(after)
        forward, left, turn = between.x(), between.y(), between.theta()
        if H is not None:
            H[0] = np.array([[-1.0, 0.0, left], [0.0, -1.0, -forward], [0.0, 0.0, -1.0]])
            H[1] = np.eye(3)
            H[1][:2, :2] = _rotation(turn)
            H[2] = -motion[:, 1:]
        out = np.array([forward, left, turn]) - motion[:, 0]
        out[2] = math.remainder(out[2], 2.0 * math.pi)
        return out

    return error


def _position(node: Node) -> Any:
    """Factor of the mean of a second's fixes."""

    def error(this: Any, values: Any, H: Any) -> Array:
        pose = values.atPose2(this.keys()[0])
        middle = node.motion(values.atVector(this.keys()[1]))[3:]
        local = middle[:, 0]
        turned = _rotation(pose.theta())
        if H is not None:
            H[0] = turned @ np.array([[1.0, 0.0, -local[1]], [0.0, 1.0, local[0]]])
            H[1] = turned @ middle[:, 1:]
            H[2] = np.eye(2, 4)
        return np.asarray(
            [pose.x(), pose.y()] + turned @ local + values.atVector(this.keys()[2])[:2] - node.fix
        )

    return error


def _doppler(distance: Array) -> Any:
    """Factor of the way of a second by Doppler."""

    def error(this: Any, values: Any, H: Any) -> Array:
        before, after = (values.atPose2(key) for key in this.keys()[:2])
        if H is not None:
            H[0] = np.column_stack([-_rotation(before.theta()), np.zeros(2)])
            H[1] = np.column_stack([_rotation(after.theta()), np.zeros(2)])
            H[2] = np.eye(2, 4, 2)
        step = np.array([after.x() - before.x(), after.y() - before.y()])
        return np.asarray(step + values.atVector(this.keys()[2])[2:] - distance)

    return error


def _memory(keep: Array) -> Any:
    """Factor of the receiver's errors from second to second."""

    def error(this: Any, values: Any, H: Any) -> Array:
        before, after = (values.atVector(key) for key in list(this.keys()))
        if H is not None:
            H[0], H[1] = -keep, np.eye(4)
        return np.asarray(after - keep @ before)

    return error


def _offsets(logs: Array) -> Array:
    """Radius minus nominal, m."""
    return RADIUS_M * np.expm1(UNIT * logs)


def smooth(
    driven: Driven, lag_s: float = LAG_S, seconds: int | None = None, walk: float | None = None
) -> Smoothed:
    """Play a drive, or so many seconds of it, through the fixed lag, and solve all of it from there."""
    import gtsam

    build = Graph(driven, WALK[driven.scenario.name] if walk is None else walk)
    params = gtsam.ISAM2Params()
    params.setRelinearizeThreshold(0.01)
    params.relinearizeSkip = 1
    window = gtsam.IncrementalFixedLagSmoother(lag_s, params)
    whole, first = gtsam.NonlinearFactorGraph(), gtsam.Values()
    causal, lagged = [], []
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    build.first(graph, values)
    build.first(whole, first)
    at = gtsam.Pose2(*driven.pose[0]), np.zeros(2), np.zeros(4)
    stamps: Any = {build.key(letter, 0): 0.0 for letter in "xms"}
    measured = nodes(driven)[:seconds]
    begun = time.process_time()
    for number, node in enumerate(measured, start=1):
        build.add(graph, values, number, node, at)
        build.add(whole, first, number, node, at)
        stamps |= {build.key(letter, number): float(number) for letter in "xms"}
        window.update(graph, values, stamps)
        graph, values, stamps = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}
        now = window.calculateEstimate()
        x, m, s = (build.key(letter, number) for letter in "xms")
        at = now.atPose2(x), now.atVector(m), now.atVector(s)
        causal.append(at[1])
        if number > lag_s:
            lagged.append(now.atVector(build.key("m", number - int(lag_s))))
    left = [now.atVector(build.key("m", n)) for n in range(len(lagged) + 1, len(measured) + 1)]
    spent = time.process_time() - begun
    solved = gtsam.LevenbergMarquardtOptimizer(whole, first).optimize()
    batch = [solved.atVector(build.key("m", n)) for n in range(1, len(measured) + 1)]
    rows = causal, [*lagged, *left], batch
    now_m, lagged_m, batch_m = (_offsets(np.array(each)) for each in rows)
    return Smoothed(now_m, lagged_m, batch_m, 1e3 * spent / len(measured))
