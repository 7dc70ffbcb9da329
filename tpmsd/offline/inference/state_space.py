"""The linear system that a drive's channels obey: unknown motion, correlated noise.

In: `Linearised`, a `Layout` (the sum of its `StateBlock`s), a `Noise`. Out: `StateSpace`, the matrices of

    x_k = F_k x_(k-1) + w_k,  w_k ~ N(0, Q_k),      y_k = H_k x_k + e_k,  e_k ~ N(0, diag R_k).

Within a window states change in two steps: x_k = J_k (D_k x_(k-1) + u_k). Old errors fade by D and what is
new comes in as u, each state by itself but for the motion's; then J moves the position by the angles that
turn the direction of motion (heading, side slip). So F = J D, Q = J cov(u) J'.

Only diagonals depend on the noise: `Geometry` holds the rest and is made once.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.blocks import PE, PN, PSI, QOLD, WHITE, Layout, Q, Steps, V, W
from tpmsd.offline.inference.layouts import DRIFTING_RADII
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.trajectory import WINDOW_S
from tpmsd.offline.inference.windows import CHANNELS, COURSE, EAST, GYRO, NORTH, SPEED, Linearised

SPEED_STD_MPS, YAW_STD_RADPS = 1.0, 0.1
"""Standard deviations of the reference motion's errors in a window: so wide that the reference has no
weight.
"""
LARGEST_JUMP = 100.0
"""Most by which a far-off position widens the receiver's slow error."""


@dataclass(frozen=True)
class Diagonals:
    """All that a noise decides."""

    variance: FloatArray
    """(w, 9) diagonal of R."""
    decay: FloatArray
    """(w, s) factors by which the states fade into each window."""
    fresh: FloatArray
    """(w, s) variances that come in, those of the motion aside."""
    start: FloatArray
    """(s,) variances before the first window."""


@dataclass(frozen=True)
class Geometry:
    """All that no noise decides; arrays over w windows and s states."""

    layout: Layout
    here: np.ndarray
    """(w, 9) what was measured."""
    rows: FloatArray
    """(w, 9, s) H; zero where not measured."""
    turn: FloatArray
    """(w, 2) growth of the position's error east and north by an angle that turns the direction of motion."""
    motion: FloatArray
    """(w, 5, 5) covariance of the new errors of speed, yaw rate, heading, east and north, before the heading
    has moved the position."""
    speed_mps: FloatArray
    """(w,) no less than 1."""
    gap: np.ndarray
    """(w,) windows since the one before."""
    fixes: FloatArray
    """(w, 3) how many fixes gave a speed, a course and a position; no less than 1."""
    repeated_rounding_m2: FloatArray
    """(w, 4) variance of the wheels' ways by rounding that stays the same."""

    @cached_property
    def joint(self) -> FloatArray:
        """Return the (w, c + 9, s) observation matrix of the c carried states and the channels, applied to D
        x + u."""
        carried = self.layout.carried
        out = np.zeros((len(self.here), len(carried) + CHANNELS, self.layout.states))
        out[:, np.arange(len(carried)), carried] = 1.0
        out[:, len(carried) :] = self.rows
        moved = out[:, :, PE : PN + 1] @ self.turn[:, :, None]
        out[:, :, self.layout.turning] += moved
        return out

    @cached_property
    def joint_of_carried(self) -> FloatArray:
        """Return the (w, c + 9, c) part of `joint` for the carried states before, without their decay."""
        came_to = self.layout.carried.copy()
        came_to[Q : Q + 4] = np.arange(QOLD, QOLD + 4)
        return np.ascontiguousarray(self.joint[:, :, came_to])

    @cached_property
    def motion_covariance(self) -> FloatArray:
        """Return the (w, c + 9, c + 9) covariance of carried states and channels by each window's motion
        errors."""
        seen = self.joint[:, :, V : PN + 1]
        return np.asarray(seen @ self.motion @ seen.transpose(0, 2, 1))

    def part(self, at: np.ndarray, gap: np.ndarray) -> Geometry:
        """Return the geometry of the windows `at`, with the gaps between them."""
        cut = {
            field.name: getattr(self, field.name)[at]
            for field in dataclasses.fields(self)
            if field.name not in ("layout", "gap")
        }
        return Geometry(layout=self.layout, gap=gap, **cut)


@dataclass(frozen=True)
class StateSpace:
    """F, Q, H, R of every window, in full."""

    geometry: Geometry
    diagonals: Diagonals

    @property
    def transition(self) -> FloatArray:
        """Return (w, s, s) F: a reading at a window's end is one at the next one's start, old errors fade,
        and an error of the heading moves the position."""
        decay = self.diagonals.decay
        states = decay.shape[1]
        out = np.zeros((len(decay), states, states))
        came_from = np.arange(states)
        came_from[QOLD : QOLD + 4] = np.arange(Q, Q + 4)
        out[:, np.arange(states), came_from] = decay
        return self._heading_to_position @ out

    @property
    def fresh(self) -> FloatArray:
        """Return (w, s, s) Q, the covariance of the process noise."""
        states = self.diagonals.fresh.shape[1]
        out = np.zeros((*self.diagonals.fresh.shape, states))
        out[:, np.arange(states), np.arange(states)] = self.diagonals.fresh
        out[:, V : PN + 1, V : PN + 1] += self.geometry.motion
        return np.asarray(self._heading_to_position @ out @ self._heading_to_position.transpose(0, 2, 1))

    @property
    def _heading_to_position(self) -> FloatArray:
        """Return (w, s, s) J, which adds the effect of a turned heading to the position."""
        turn = self.geometry.turn
        out = np.tile(np.eye(self.diagonals.decay.shape[1]), (len(turn), 1, 1))
        for state in self.geometry.layout.turning:
            out[:, [PE, PN], state] = turn
        return out


def geometry(windows: Linearised, here: np.ndarray, layout: Layout = DRIFTING_RADII) -> Geometry:
    """Return the geometry of a drive; `here` (w, 9) says what was measured."""
    v = np.maximum(windows.covariates["speed"], 1.0)
    return Geometry(
        layout=layout,
        here=here,
        rows=layout.observation_matrix(windows) * here[:, :, None],
        turn=windows.to_east_north[:, :, 2],
        motion=_motion_variances(windows),
        speed_mps=v,
        gap=np.diff(windows.index, prepend=windows.index[:1] - 1),
        fixes=np.maximum(windows.fixes, 1.0),
        repeated_rounding_m2=np.broadcast_to(windows.repeated_rounding_m2, (len(v), 4)),
    )


def diagonals(space: Geometry, noise: Noise, inflate: FloatArray | None = None) -> Diagonals:
    """Return the variances and decays of a noise; `inflate` (w, 9) multiplies the variances of single
    readings."""
    return Diagonals(
        _variances(space, noise, inflate), *space.layout.steps(noise, _steps(space, noise, inflate))
    )


def changed_diagonals(
    space: Geometry, noise: Noise, name: str, inflate: FloatArray | None = None
) -> Iterator[tuple[str, slice, FloatArray]]:
    """Yield the parts of `diagonals` that depend on one parameter of the noise: field, columns and new
    values."""
    if name in WHITE:
        yield "variance", slice(None), _variances(space, noise, inflate)
    steps, first = _steps(space, noise, inflate), 0
    for block in space.layout.blocks:
        at = slice(first, first + len(block.names))
        first = at.stop
        if name in block.parameters:
            yield from zip(("decay", "fresh", "start"), (at,) * 3, block.steps(noise, steps), strict=True)


def _steps(space: Geometry, noise: Noise, inflate: FloatArray | None) -> Steps:
    """Return gaps, jumps and reading variances of the windows, which the state blocks need."""
    v = space.speed_mps
    jump = np.ones(len(v))
    if inflate is not None:
        # A position that is far off may be the first of many: the slow error has jumped.
        jump = np.minimum(inflate[:, EAST:].max(axis=1), LARGEST_JUMP)
    read = np.square(noise.reading_m)[None, :] + (noise.stamp_s * v[:, None]) ** 2
    return Steps(gap=space.gap, jump=jump, read=read)


def state_space(
    windows: Linearised, noise: Noise, here: np.ndarray, inflate: FloatArray | None
) -> StateSpace:
    """Return the matrices F, Q, H, R of a drive under a noise."""
    space = geometry(windows, here)
    return StateSpace(space, diagonals(space, noise, inflate))


def _motion_variances(windows: Linearised) -> FloatArray:
    """Return the (w, 5, 5) covariance of a window's errors of speed, yaw rate, heading and position."""
    g = np.zeros((len(windows), 5, 2))
    g[:, V - V, 0] = SPEED_STD_MPS
    g[:, W - V, 1] = YAW_STD_RADPS
    g[:, PSI - V, 1] = WINDOW_S * YAW_STD_RADPS
    by_v, by_w, by_heading = np.moveaxis(windows.to_east_north, 2, 0)
    g[:, PE - V :, 0] = SPEED_STD_MPS * by_v
    g[:, PE - V :, 1] = YAW_STD_RADPS * (by_w - WINDOW_S * by_heading)
    return np.asarray(g @ g.transpose(0, 2, 1))


def _variances(space: Geometry, noise: Noise, inflate: FloatArray | None) -> FloatArray:
    """Return the (w, 9) variances of the measurement noise that is new in every window."""
    v, number = space.speed_mps, space.fixes
    out = np.empty((len(v), CHANNELS))
    out[:, :4] = (noise.rough_m**2 * v * WINDOW_S + noise.floor_m**2)[:, None] + space.repeated_rounding_m2
    out[:, GYRO] = noise.gyro_radps**2
    out[:, SPEED] = noise.speed_white_mps**2 / number[:, 0]
    out[:, COURSE] = noise.cross_white_mps**2 / v**2 / number[:, 1] + noise.course_floor_rad**2
    out[:, EAST] = out[:, NORTH] = noise.white_m**2 / number[:, 2]
    return out if inflate is None else out * inflate
