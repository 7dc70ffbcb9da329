"""Kinds of states of a drive, as blocks that add up to a `Layout`.

In: `Linearised` windows, a `Noise`. Out: per block its names, what the channels see of it (rows of H), how it
fades and what comes in, and the parameters of the noise that rule it. Errors of the wheels' readings and of
the motion come first in every layout; the others are first-order Gauss-Markov processes or random walks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from tpmsd.foundation.wheels import WHEELS, FloatArray
from tpmsd.offline.inference.noise import Noise
from tpmsd.offline.inference.trajectory import WINDOW_S
from tpmsd.offline.inference.windows import CHANNELS, COURSE, EAST, NORTH, Linearised

Q, QOLD, V, W, PSI, PE, PN = 0, 4, 8, 9, 10, 11, 12
"""Places of the first two blocks' states in every layout: reading errors of the wheels' angles at a window's
end and start, errors of speed, yaw rate, heading and position."""
HEADING_STD_RAD, POSITION_STD_M = 0.5, 300.0
"""Standard deviations of the reference's heading and position at the drive's start."""
HEADING_GAP_RAD, POSITION_GAP_M = 0.1, 20.0
"""Standard deviations that heading and position gain in a gap between windows."""


@dataclass(frozen=True)
class Steps:
    """Quantities of a drive that blocks need beside the noise; arrays over w windows."""

    gap: np.ndarray
    """(w,) windows since the one before."""
    jump: FloatArray
    """(w,) factor by which a far-off position widens the receiver's slow error; 1 elsewhere."""
    read: FloatArray
    """(w, 4) variance of a wheel's distance at an instant."""

    @property
    def broken(self) -> np.ndarray:
        """Return (w,) whether windows are missing before each."""
        return np.asarray(self.gap > 1)


class StateBlock(Protocol):
    """Some n states that belong together."""

    @property
    def names(self) -> tuple[str, ...]:
        """Return the (n,) names of the states."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of the noise parameters that this block depends on."""

    @property
    def turning(self) -> tuple[int, ...]:
        """Return the indices of the states that turn the heading, and so move the position."""

    def observation_matrix(self, windows: Linearised) -> FloatArray:
        """Return the (w, 9, n) observation matrix H of each window: the channels' response to the block's
        states."""

    def steps(self, noise: Noise, steps: Steps) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return decay factors (w, n), process-noise variances (w, n) and variances before the first window
        (n,)."""


@dataclass(frozen=True)
class Readings:
    """Errors of the wheels' angles at the window's end and start: a count's error at an edge enters two
    windows, with opposite signs."""

    names = (*(f"reading_{wheel}" for wheel in WHEELS), *(f"reading_before_{wheel}" for wheel in WHEELS))
    parameters = ("stamp_s",)
    turning = ()

    def observation_matrix(self, windows: Linearised) -> FloatArray:
        """Return the observation matrix, as `StateBlock` says."""
        out = np.zeros((len(windows), CHANNELS, 8))
        wheels = np.arange(4)
        out[:, wheels, wheels] = 1.0
        out[:, wheels, 4 + wheels] = -1.0
        return out

    def steps(self, noise: Noise, steps: Steps) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what `StateBlock.steps` returns."""
        broken = steps.broken[:, None]
        read = steps.read
        decay = np.concatenate([np.zeros_like(read), np.where(broken, 0.0, np.ones_like(read))], axis=1)
        fresh = np.concatenate([read, np.where(broken, read, 0.0)], axis=1)
        return decay, fresh, np.concatenate([read[0], np.zeros(4)])


@dataclass(frozen=True)
class MotionErrors:
    """Errors of the reference's speed and yaw rate (new in every window), heading and position."""

    names = ("speed", "yaw_rate", "heading", "east", "north")
    parameters = ()
    turning = (PSI - V,)

    def observation_matrix(self, windows: Linearised) -> FloatArray:
        """Return the observation matrix, as `StateBlock` says."""
        out = np.zeros((len(windows), CHANNELS, 5))
        out[:, :, :3] = windows.design
        late = windows.after_fixes
        out[:, COURSE, W - V] -= WINDOW_S * late[:, 1]  # fixes lie before the window's end
        for axis, channel in enumerate((EAST, NORTH)):
            out[:, channel, PE - V + axis] = 1.0
            out[:, channel, V - V] -= late[:, 2] * windows.to_east_north[:, axis, 0]
            out[:, channel, PSI - V] -= late[:, 2] * windows.to_east_north[:, axis, 2]
        return out

    def steps(self, noise: Noise, steps: Steps) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what `StateBlock.steps` returns."""
        count = len(steps.gap)
        decay = np.tile([0.0, 0.0, 1.0, 1.0, 1.0], (count, 1))
        gained = np.array([0.0, 0.0, HEADING_GAP_RAD**2, POSITION_GAP_M**2, POSITION_GAP_M**2])
        start = np.array([0.0, 0.0, HEADING_STD_RAD**2, POSITION_STD_M**2, POSITION_STD_M**2])
        return decay, steps.broken[:, None] * gained, start


WHITE = frozenset(
    {
        *("rough_m", "floor_m", "gyro_radps", "speed_white_mps", "cross_white_mps"),
        *("course_floor_rad", "white_m"),
    }
)
"""Parameters of what is new in every window."""
Rows = Callable[[Linearised], FloatArray]
"""Function of what the channels see (w, 9, n)."""


@dataclass(frozen=True)
class GaussMarkov:
    """First-order Gauss-Markov states of one standard deviation and one memory."""

    names: tuple[str, ...]
    size: str
    """The noise's parameter of the standard deviation."""
    memory: str
    """The one of the time constant (s), or of the correlation from window to window."""
    seen: Rows
    turns: bool = False
    """True if it turns the path."""
    jumps: bool = False
    """True if it may jump where a position is far off."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of standard deviation and memory."""
        return self.size, self.memory

    @property
    def turning(self) -> tuple[int, ...]:
        """Return the indices of all states if they turn the heading with the distance, else none."""
        return tuple(range(len(self.names))) if self.turns else ()

    def observation_matrix(self, windows: Linearised) -> FloatArray:
        """Return the observation matrix, as `StateBlock` says."""
        return self.seen(windows)

    def steps(self, noise: Noise, steps: Steps) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what `StateBlock.steps` returns."""
        value, std = float(getattr(noise, self.memory)), float(getattr(noise, self.size))
        kept = math.exp(-WINDOW_S / value) if self.memory.endswith("_s") else value
        faded = np.full(len(steps.gap), kept)
        faded[steps.broken] **= steps.gap[steps.broken]
        fresh = std**2 * (1.0 - faded**2)
        if self.jumps:
            fresh = fresh + np.where(steps.jump > 1.0, std**2 * steps.jump, 0.0)
        width = (1, len(self.names))
        start = np.full(len(self.names), std**2)
        return np.tile(faded[:, None], width), np.tile(fresh[:, None], width), start


@dataclass(frozen=True)
class RandomWalk:
    """One state that walks at random."""

    name: str
    size: str
    """The noise's parameter of its growth per square root of a second."""
    start_std: float
    seen: Rows
    turning: tuple[int, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the name of the one state."""
        return (self.name,)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the name of the growth per window."""
        return (self.size,)

    def observation_matrix(self, windows: Linearised) -> FloatArray:
        """Return the observation matrix, as `StateBlock` says."""
        return self.seen(windows)

    def steps(self, noise: Noise, steps: Steps) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what `StateBlock.steps` returns."""
        fresh = float(getattr(noise, self.size)) ** 2 * steps.gap[:, None]
        return np.ones((len(steps.gap), 1)), fresh, np.array([self.start_std**2])


@dataclass(frozen=True)
class Layout:
    """The sum of some blocks: all s states of a drive."""

    blocks: tuple[StateBlock, ...]
    """Readings and errors of the motion first."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the (s,) names of all states."""
        return tuple(name for block in self.blocks for name in block.names)

    @property
    def states(self) -> int:
        """Return the number of states, s."""
        return len(self.names)

    @cached_property
    def carried(self) -> np.ndarray:
        """Return the (c,) indices of the states carried from window to window; the others are new in each."""
        return np.array([*range(Q, Q + 4), *range(PSI, self.states)])

    @cached_property
    def turning(self) -> list[int]:
        """Return the indices of the states that turn the heading."""
        out, first = [], 0
        for block in self.blocks:
            out += [first + state for state in block.turning]
            first += len(block.names)
        return out

    @cached_property
    def parameters(self) -> frozenset[str]:
        """Return the names of the noise parameters on which any block or channel depends."""
        return frozenset(name for block in self.blocks for name in block.parameters) | WHITE

    def observation_matrix(self, windows: Linearised) -> FloatArray:
        """Return the (w, 9, s) observation matrix H of all blocks together."""
        return np.concatenate([block.observation_matrix(windows) for block in self.blocks], axis=2)

    def steps(self, noise: Noise, steps: Steps) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return decay factors (w, s), process-noise variances (w, s) and variances before the first window
        (s,)."""
        every = [block.steps(noise, steps) for block in self.blocks]
        decay, fresh, start = zip(*every, strict=True)
        return np.concatenate(decay, axis=1), np.concatenate(fresh, axis=1), np.concatenate(start)
