"""The linear system that a drive's channels obey: unknown motion, correlated noise.

In: `Windows`, a `Noise`. Out: `StateSpace`, the matrices of

    x_k = F_k x_(k-1) + w_k,  w_k ~ N(0, Q_k),      y_k = H_k x_k + e_k,  e_k ~ N(0, diag R_k).

State: reading errors of the wheels' angles at the window's end and start (a count's error at an edge enters
two windows, with opposite signs), errors of the reference's speed and yaw rate (new in every window),
heading, position, the receiver's slow position error, its speed and cross-speed error, the error of its
clock, each radius' slow drift (all first-order Gauss-Markov), the gyro's bias (a random walk).

Only diagonals depend on the noise: `Geometry` holds the rest and is made once.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tpmsd.inference.noise import Noise
from tpmsd.inference.trajectory import WINDOW_S
from tpmsd.inference.windows import CHANNELS, COURSE, EAST, GYRO, NORTH, SPEED, Windows
from tpmsd.wheels import FloatArray

Q, QOLD, V, W, PSI, PE, PN, BE, BN = 0, 4, 8, 9, 10, 11, 12, 13, 14
DS, DC, GB, CK, R, STATES = 15, 16, 17, 18, 19, 23
CARRIED = np.array([*range(Q, Q + 4), *range(PSI, STATES)])
"""States that one window hands to the next; the others are new in each and forgotten with it."""
SPEED_STD_MPS, YAW_STD_RADPS = 1.0, 0.1
"""Of the reference motion's errors in a window: so wide that the reference is believed nothing."""
HEADING_STD_RAD, PLACE_STD_M = 0.5, 300.0
"""Of its heading and place at the drive's start."""
HEADING_GAP_RAD, PLACE_GAP_M = 0.1, 20.0
"""Of what heading and place gain in a gap between windows."""
LARGEST_JUMP = 100.0
"""Most by which a far-off position widens the receiver's slow error."""
_GAUSS_MARKOV = (
    ([BE, BN], "slow_m", "slow_tau_s"),
    ([DS], "speed_mps", "speed_memory"),
    ([DC], "cross_mps", "speed_memory"),
    ([CK], "clock_s", "clock_tau_s"),
    (list(range(R, R + 4)), "wander", "wander_tau_s"),
)
"""States, and the parameters of their standard deviation and memory."""


@dataclass(frozen=True)
class Diagonals:
    """All that a noise decides."""

    variance: FloatArray
    """(w, 9) diagonal of R."""
    decay: FloatArray
    """(w, STATES) factors by which the states fade into each window."""
    fresh: FloatArray
    """(w, STATES) variances that come in, those of the motion aside."""
    start: FloatArray
    """(STATES,) variances before the first window."""


@dataclass(frozen=True)
class Geometry:
    """All that no noise decides; arrays over w windows."""

    here: np.ndarray
    """(w, 9) what was measured."""
    rows: FloatArray
    """(w, 9, STATES) H; zero where not measured."""
    turn: FloatArray
    """(w, 2) growth of the position's error east and north by an error of the heading before."""
    motion: FloatArray
    """(w, 5, 5) covariance of the new errors of speed, yaw rate, heading, east and north."""
    speed_mps: FloatArray
    """(w,) no less than 1."""
    gap: np.ndarray
    """(w,) windows since the one before."""
    fixes: FloatArray
    """(w, 3) how many fixes gave a speed, a course and a position; no less than 1."""

    @cached_property
    def joint(self) -> FloatArray:
        """(w, c + 9, STATES): the carried states and the channels as functions of a window's states."""
        out = np.zeros((len(self.here), len(CARRIED) + CHANNELS, STATES))
        out[:, np.arange(len(CARRIED)), CARRIED] = 1.0
        out[:, len(CARRIED) :] = self.rows
        return out

    @cached_property
    def from_motion(self) -> FloatArray:
        """(w, c + 9, c + 9) covariance that the new errors of the motion give these."""
        seen = self.joint[:, :, V : PN + 1]
        return np.asarray(seen @ self.motion @ seen.transpose(0, 2, 1))

    def part(self, at: np.ndarray, gap: np.ndarray) -> Geometry:
        """Some of the windows, with the gaps between them."""
        cut = {
            field.name: getattr(self, field.name)[at]
            for field in dataclasses.fields(self)
            if field.name != "gap"
        }
        return Geometry(gap=gap, **cut)


@dataclass(frozen=True)
class StateSpace:
    """F, Q, H, R of every window, in full."""

    geometry: Geometry
    diagonals: Diagonals

    @property
    def transition(self) -> FloatArray:
        """(w, STATES, STATES): a reading at a window's end is one at the next one's start, old errors fade,
        and an error of the heading moves the position."""
        decay = self.diagonals.decay
        out = np.zeros((len(decay), STATES, STATES))
        came_from = np.arange(STATES)
        came_from[QOLD : QOLD + 4] = np.arange(Q, Q + 4)
        out[:, np.arange(STATES), came_from] = decay
        out[:, [PE, PN], PSI] = self.geometry.turn * decay[:, PSI : PSI + 1]
        return out

    @property
    def fresh(self) -> FloatArray:
        """(w, STATES, STATES) Q."""
        out = np.zeros((*self.diagonals.fresh.shape, STATES))
        out[:, np.arange(STATES), np.arange(STATES)] = self.diagonals.fresh
        out[:, V : PN + 1, V : PN + 1] += self.geometry.motion
        return out


def geometry(windows: Windows, here: np.ndarray) -> Geometry:
    """Of a drive; `here` (w, 9) says what was measured."""
    v = np.maximum(windows.covariates["speed"], 1.0)
    return Geometry(
        here=here,
        rows=_measurement_rows(windows, v) * here[:, :, None],
        turn=windows.to_east_north[:, :, 2],
        motion=_motion_variances(windows),
        speed_mps=v,
        gap=np.diff(windows.index, prepend=windows.index[:1] - 1),
        fixes=np.maximum(windows.fixes, 1.0),
    )


def diagonals(space: Geometry, noise: Noise, inflate: FloatArray | None = None) -> Diagonals:
    """What a noise decides; `inflate` (w, 9) multiplies the variances of single readings."""
    v = space.speed_mps
    variance = _variances(space, noise)
    jump = np.ones(len(v))
    if inflate is not None:
        variance = variance * inflate
        # A position that is far off may be the first of many: the slow error has jumped.
        jump = np.minimum(inflate[:, EAST:].max(axis=1), LARGEST_JUMP)
    read = np.square(noise.reading_m)[None, :] + (noise.stamp_s * v[:, None]) ** 2
    decay, fresh = _steps(noise, space.gap, jump, read)
    return Diagonals(variance, decay, fresh, _start(noise, read[0]))


def state_space(windows: Windows, noise: Noise, here: np.ndarray, inflate: FloatArray | None) -> StateSpace:
    """The system of a drive under a noise."""
    space = geometry(windows, here)
    return StateSpace(space, diagonals(space, noise, inflate))


def _steps(
    noise: Noise, gap: np.ndarray, jump: FloatArray, read: FloatArray
) -> tuple[FloatArray, FloatArray]:
    decay = np.zeros((len(gap), STATES))
    fresh = np.zeros((len(gap), STATES))
    broken = gap > 1
    decay[:, QOLD : QOLD + 4] = ~broken[:, None]
    decay[:, [PSI, PE, PN, GB]] = 1.0
    fresh[:, Q : Q + 4] = read
    fresh[:, QOLD : QOLD + 4] = np.where(broken[:, None], read, 0.0)
    fresh[:, PSI] = np.where(broken, HEADING_GAP_RAD**2, 0.0)
    fresh[:, [PE, PN]] = np.where(broken, PLACE_GAP_M**2, 0.0)[:, None]
    for states, size, memory in _GAUSS_MARKOV:
        faded = np.full(len(gap), _per_window(noise, memory))
        faded[broken] **= gap[broken]
        decay[:, states] = faded[:, None]
        fresh[:, states] = (getattr(noise, size) ** 2 * (1.0 - faded**2))[:, None]
    fresh[:, [BE, BN]] += np.where(jump > 1.0, noise.slow_m**2 * jump, 0.0)[:, None]
    fresh[:, GB] = noise.gyro_drift_radps**2 * gap
    return decay, fresh


def _per_window(noise: Noise, memory: str) -> float:
    """Correlation of a Gauss-Markov state from window to window."""
    value = float(getattr(noise, memory))
    return math.exp(-WINDOW_S / value) if memory.endswith("_s") else value


def _start(noise: Noise, reading: FloatArray) -> FloatArray:
    out = np.zeros(STATES)
    out[Q : Q + 4] = reading
    out[PSI] = HEADING_STD_RAD**2
    out[PE] = out[PN] = PLACE_STD_M**2
    for states, size, _ in _GAUSS_MARKOV:
        out[states] = getattr(noise, size) ** 2
    return out


def _motion_variances(windows: Windows) -> FloatArray:
    g = np.zeros((len(windows), 5, 2))
    g[:, V - V, 0] = SPEED_STD_MPS
    g[:, W - V, 1] = YAW_STD_RADPS
    g[:, PSI - V, 1] = WINDOW_S * YAW_STD_RADPS
    g[:, PE - V :] = windows.to_east_north[:, :, :2] * (SPEED_STD_MPS, YAW_STD_RADPS)
    return np.asarray(g @ g.transpose(0, 2, 1))


def _measurement_rows(windows: Windows, v: FloatArray) -> FloatArray:
    """(w, 9, STATES) what the channels see of the state."""
    rows = np.zeros((len(windows), CHANNELS, STATES))
    rows[:, :, [V, W, PSI]] = windows.design
    for wheel in range(4):
        rows[:, wheel, Q + wheel] = 1.0
        rows[:, wheel, QOLD + wheel] = -1.0
        rows[:, wheel, R + wheel] = -v * WINDOW_S
    rows[:, GYRO, GB] = 1.0
    rows[:, SPEED, DS] = 1.0
    rows[:, COURSE, W] -= WINDOW_S / 2  # the window's mean heading lies half a turn behind its end
    rows[:, COURSE, DC] = 1.0 / v
    for axis, (channel, place, slow) in enumerate(((EAST, PE, BE), (NORTH, PN, BN))):
        rows[:, channel, place] = rows[:, channel, slow] = 1.0
        rows[:, channel, V] = -0.5 * windows.to_east_north[:, axis, 0]
        rows[:, channel, PSI] = -0.5 * windows.to_east_north[:, axis, 2]
        rows[:, channel, CK] = -windows.to_east_north[:, axis, 0] / WINDOW_S * v
    rows[:, SPEED, CK] = -windows.covariates["accel_kinematic"]
    rows[:, COURSE, CK] = -windows.covariates["yaw_rate"]
    return rows


def _variances(space: Geometry, noise: Noise) -> FloatArray:
    """(w, 9) of what is new in every window."""
    v, number = space.speed_mps, space.fixes
    out = np.empty((len(v), CHANNELS))
    out[:, :4] = (noise.rough_m**2 * v * WINDOW_S + noise.floor_m**2)[:, None]
    out[:, GYRO] = noise.gyro_radps**2
    out[:, SPEED] = noise.speed_white_mps**2 / number[:, 0]
    out[:, COURSE] = noise.cross_white_mps**2 / v**2 / number[:, 1] + noise.course_floor_rad**2
    out[:, EAST] = out[:, NORTH] = noise.white_m**2 / number[:, 2]
    return out
