"""The age of the counts of each wheel, read in a rhythm of its own, taken out of a recording.

In: a `Recording`. Out: the same one less a sawtooth per wheel, or the very same where there is none, or one
clock for all wheels.

A wheel's module that latches its counter every P seconds gives a count that is up to P old. Seen at the
ticks' edges t, dt apart, the age is a sawtooth of one frequency f, the beat of the rhythm against the ticks:

    a(t) = A (frac(f t + p) - 1/2) = A sum_k i / (2 pi k) exp(2 pi i k (f t + p)) + its conjugate,

and the distance that the wheel shows is v a(t) too short. Where the beat takes seconds, each wheel turns
slower by A f while its age grows, and jumps ahead by v A when it falls back: at 20 m/s, of 20 ms and a beat
of 3.2 s, that is a speed of 0.12 m/s, and between two wheels with rhythms of their own a yaw rate of up to
0.08 rad/s. Nothing that is white holds it, and a smoother holds only the jumps.

The third differences z of the distance hold little of the car's motion. Their products with the speed,
Fourier transformed, are lines at the multiples of f (folded at 1 / dt) on a background of level S, so that by
Whittle's likelihood (Journal of the Royal Statistical Society B 15, 1953) a sawtooth of amplitude A and
phase p gains, with B_k what one of amplitude 1 makes of line k,

    (sum_k Re(conj(B_k) exp(-2 pi i k p) Z_k) / S_k)^2 / sum_k |B_k|^2 / S_k    nats

at its best A. It is found where this exceeds its penalty (amplitude, phase, frequency by
BIC, and the number of frequencies), and where that still holds without its strongest line: a line alone is
an uneven ring at constant speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.offline.inference.count_age import FAST_MPS, FEWEST, LONGEST_S, smooth
from tpmsd.offline.inference.recording import Recording

LINES, SOUGHT = 8, 4
"""Lines of a sawtooth by which it is fitted, and by which it is looked for."""
PADDED = 4
"""Frequencies per resolved one: of the highest line that is looked for, half of a resolved one at most."""
BLOCK = 64
"""Resolved frequencies over whose median the background's level is taken."""
PHASES = 64
BEST = 64
"""Frequencies whose phases are asked for, by the most that their lines could gain."""
ZOOMS = 4
"""Refinements of the frequency, each within the neighbours of the best before."""
STRETCH_S = 1200.0
"""Longest part of a drive over which the clocks are taken to keep their ratio: by 1e-6 of a rhythm of 10 ms
the phase moves by an eighth of a cycle meanwhile."""
TUNED_TICKS = 16
"""Shortest sweep whose falls are placed one by one."""
REACH, STEPS = 3, 3
"""Ticks by which a fall is moved at most, and places per tick: readings between two frames hold a part."""
AROUND = 7
"""Edges on either side by which a fall is placed."""
AMPLITUDE_ERROR = 0.1
"""Relative error of an amplitude, by the lines that are left out and by falls that come late."""
TINY = 1e-12
"""Keeps a division by the power of lines at frequency 0 finite."""

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Rhythm:
    """Sawtooth of a wheel's age."""

    hz: float
    """Frequency f at the ticks' edges, from 0 to 1 / dt; beyond half of it the age falls slowly."""
    phase: float
    """Cycles at the drive's start."""
    amplitude_s: float
    gain_nats: float

    def phase_cycles(self, edges_s: FloatArray, dt_s: float) -> FloatArray:
        """Return the (n,) phase of the sawtooth in cycles, its frequency aliased into half the rate of the
        ticks."""
        hz = self.hz - 1.0 / dt_s if self.hz > 0.5 / dt_s else self.hz
        return hz * edges_s + self.phase


def without_rhythms(recording: Recording) -> Recording:
    """Return the recording without each wheel's own sawtooth of the age; unchanged if none is found."""
    counted = [wheel for wheel in recording.wheels if recording.quantum_rad[wheel] > 0.0]
    if not counted:
        return recording
    radius_m, dt_s = recording.car.radius_m, recording.dt_s
    distance_m = recording.rotation_rad * radius_m
    speed = smooth(distance_m[:, counted].mean(axis=1)) / dt_s
    v = np.nan_to_num(np.concatenate([speed[:1], 0.5 * (speed[1:] + speed[:-1]), speed[-1:]]))
    late = np.zeros((recording.ticks, 4))
    for part in _equal_parts(recording.ticks, dt_s):
        edges = slice(part.start, part.stop + 1)
        for wheel, rhythm in own_rhythms(distance_m[part][:, counted], speed[part], dt_s).items():
            age_s = _age_at_edges(rhythm, distance_m[part, counted[wheel]], v[edges], dt_s)
            late[part, counted[wheel]] = np.diff(v[edges] * age_s)
    return (
        replace(recording, rotation_rad=recording.rotation_rad + late / radius_m) if late.any() else recording
    )


def own_rhythms(distance_m: FloatArray, speed: FloatArray, dt_s: float) -> dict[int, Rhythm]:
    """Return wheel -> sawtooth in the distances per tick (n, wheels); empty where one clock explains all.

    One clock is what the frequency and phase of the clearest sawtooth are for every wheel that has one, if
    their gain with these is at least that with frequencies and phases of their own, less the penalty of these
    (BIC, and the number of them). An age that all wheels share is left to `count_age`, which asks for no form
    of it.
    """
    lines = {k: _Lines.of(each, speed, dt_s) for k, each in enumerate(distance_m.T)}
    found = {k: (each, each.best()) for k, each in lines.items() if each is not None}
    rhythms = {k: rhythm for k, (_, rhythm) in found.items() if rhythm is not None}
    if len(rhythms) < 2:
        return rhythms
    clearest = max(rhythms.values(), key=lambda one: one.gain_nats)
    joint = sum(found[k][0].gain_of(clearest) for k in rhythms)
    apart = sum(one.gain_nats for one in rhythms.values())
    penalty = math.log(len(speed)) + math.log(len(speed) * PHASES)
    return {} if joint >= apart - (len(rhythms) - 1) * penalty else rhythms


def rhythm_of(distance_m: FloatArray, speed: FloatArray, dt_s: float) -> Rhythm | None:
    """Return the sawtooth in a wheel's distance per tick (n,) at a speed (n,); None where none is found."""
    lines = _Lines.of(distance_m, speed, dt_s)
    return None if lines is None else lines.best()


def _equal_parts(ticks: int, dt_s: float) -> list[slice]:
    """Return the slices of a drive's ticks, of equal length and at most `STRETCH_S` each."""
    number = math.ceil(ticks * dt_s / STRETCH_S)
    bounds = np.linspace(0, ticks, number + 1).astype(int).tolist()
    return [slice(start, stop) for start, stop in pairwise(bounds)]


@dataclass(frozen=True)
class _Fitted:
    """Sawtooth of a frequency at its best phase and amplitude."""

    cycles: float
    """Per tick."""
    phase: float
    amplitude_s: float
    gain_nats: float
    rest_nats: float
    """Gain without the strongest line."""


@dataclass(frozen=True)
class _Lines:
    """Third differences of a wheel's distance times its speed (n instants), and their spectrum (m)."""

    weighted: FloatArray
    """(n,)"""
    power: float
    """Sum of the squared speeds."""
    dt_s: float
    transform: Complex
    """(m,)"""
    level: FloatArray
    """(m,) expectation of the squared transform without a line."""

    @classmethod
    def of(cls, distance_m: FloatArray, speed: FloatArray, dt_s: float) -> _Lines | None:
        """Return the lines of a distance per tick (n + 2,) and a speed; None where too little is driven."""
        third, v = np.convolve(distance_m, [1.0, -2.0, 1.0], mode="valid"), speed[1:-1]
        fast = np.isfinite(third) & (v > FAST_MPS)
        if fast.sum() < FEWEST:
            return None
        v = np.where(fast, v, 0.0)
        most = math.sqrt(20.0) * LONGEST_S * v  # beyond, a count was lost or a wheel slipped
        weighted = v * np.clip(np.where(fast, third, 0.0), -most, most)
        size = 1 << math.ceil(math.log2(PADDED * len(weighted)))
        transform = np.fft.fft(weighted, size)
        half = np.square(np.abs(transform[: size // 2]))
        wide = BLOCK * size // len(weighted)
        blocks = half[: len(half) // wide * wide].reshape(-1, wide)
        # Of an exponential distribution the median is log 2 of the mean; lines are few.
        middle = np.median(blocks, axis=1) / math.log(2.0)
        level = np.interp(np.arange(size // 2 + 1), (np.arange(len(middle)) + 0.5) * wide, middle)
        level = np.concatenate([level, level[-2:0:-1]])
        return cls(weighted, float(v @ v), dt_s, transform, level)

    def best(self) -> Rhythm | None:
        """Return the sawtooth of greatest gain; None where it does not exceed its penalty."""
        size, count = len(self.transform), len(self.weighted)
        penalty = 1.5 * math.log(count) + math.log(count * PHASES)
        lines = np.arange(1, SOUGHT + 1)
        at = np.outer(np.arange(size), lines) % size
        made, level = np.abs(self._lines_of_differenced_sawtooth(at / size, lines)), self.level[at]
        most = np.square((made * np.abs(self.transform[at]) / level).sum(axis=1))
        most /= np.maximum((np.square(made) / level).sum(axis=1), TINY)
        if most.max() <= penalty:
            return None
        promising = np.argpartition(-most, BEST)[:BEST]
        best = max((self._best_at(k / size) for k in promising.tolist()), key=lambda one: one.gain_nats)
        signed = best.cycles - 1.0 if best.cycles > 0.5 else best.cycles
        # Of the lines of a slow sweep every second or third alone may be the clearest.
        found = max((self._best_near(signed / part) for part in (1, 2, 3)), key=lambda one: one.gain_nats)
        clear = min(found.gain_nats, found.rest_nats) > penalty
        if not clear or not 0.0 < found.amplitude_s < LONGEST_S * (1.0 + AMPLITUDE_ERROR):
            return None
        return Rhythm(found.cycles % 1.0 / self.dt_s, found.phase, found.amplitude_s, found.gain_nats)

    def gain_of(self, rhythm: Rhythm) -> float:
        """Return the gain (nats) of a sawtooth of this frequency and phase at its best amplitude."""
        like, norm = self._matched_filter(rhythm.hz * self.dt_s)
        parts = (like * np.exp(-2j * np.pi * np.arange(1, LINES + 1) * rhythm.phase)).real
        return max(float(parts.sum()), 0.0) ** 2 / max(float(norm.sum()), TINY)

    def _lines_of_differenced_sawtooth(self, cycles: FloatArray, lines: NDArray[np.int64]) -> Complex:
        """Return what third differences leave of each spectral line of a sawtooth of amplitude 1, (..., k).

        B_k of the module's text, with the ticks' weights; phase 0, cycles per tick (..., k).
        """
        third = (np.exp(2j * np.pi * cycles) - 1.0) ** 3
        return np.asarray(-self.power * third * 1j / (2.0 * np.pi * lines))

    def _best_near(self, cycles: float) -> _Fitted:
        """Return the best sawtooth at a frequency near `cycles` per tick."""
        found, width = self._best_at(cycles), 1.0 / len(self.transform)
        for _ in range(ZOOMS):
            around = found.cycles + width * np.linspace(-1.0, 1.0, 9)
            found = max((self._best_at(each) for each in around.tolist()), key=lambda one: one.gain_nats)
            width /= 4.0
        return found

    def _matched_filter(self, cycles: float) -> tuple[Complex, FloatArray]:
        """Return (k,) each, of the lines at `cycles` per tick: conj(B) Z / S, and |B|^2 / S."""
        size, lines = len(self.transform), np.arange(1, LINES + 1)
        # The nearest of the transform, turned about the middle, is that of the frequency but for a tenth.
        exact = cycles * size * lines
        at = np.round(exact).astype(int)
        middle = 0.5 * (len(self.weighted) - 1)
        seen = self.transform[at % size] * np.exp(2j * np.pi * (at - exact) / size * middle)
        made = self._lines_of_differenced_sawtooth(np.asarray(cycles * lines, dtype=np.float64), lines)
        level = self.level[at % size]
        return np.conj(made) * seen / level, np.square(np.abs(made)) / level

    def _best_at(self, cycles: float) -> _Fitted:
        """Return the sawtooth of best phase and amplitude at `cycles` per tick."""
        lines = np.arange(1, LINES + 1)
        like, norm = self._matched_filter(cycles)
        phases = np.arange(PHASES) / PHASES
        turned = (like @ np.exp(-2j * np.pi * np.outer(lines, phases))).real
        k = int(np.argmax(turned))
        # A parabola through three values of a smooth function of the phase.
        left, top, right = turned[k - 1], turned[k], turned[(k + 1) % PHASES]
        bend = left - 2.0 * top + right
        phase = (k + (0.5 * (left - right) / bend if bend < 0.0 else 0.0)) / PHASES
        parts = (like * np.exp(-2j * np.pi * lines * phase)).real
        rest = np.arange(LINES) != int(np.argmax(np.abs(parts)))
        total, power = float(parts.sum()), max(float(norm.sum()), TINY)  # of frequency 0 no line is seen
        other = max(float(parts[rest].sum()), 0.0) ** 2 / max(float(norm[rest].sum()), TINY)
        return _Fitted(cycles, phase % 1.0, total / power, max(total, 0.0) ** 2 / power, other)


def _age_at_edges(rhythm: Rhythm, distance_m: FloatArray, speed: FloatArray, dt_s: float) -> FloatArray:
    """Return the (n + 1,) age at the ticks' edges, each fall moved to where third differences are least.

    A reading that came late, or a clock that drifts, moves a fall by a tick or two: an edge on its wrong side
    is off by the whole of v A.
    """
    cycles = rhythm.phase_cycles(dt_s * np.arange(len(speed), dtype=np.float64), dt_s)
    age = rhythm.amplitude_s * (np.mod(cycles, 1.0) - 0.5)
    per_tick = abs(cycles[1] - cycles[0])
    if per_tick * TUNED_TICKS > 1.0:
        return np.asarray(age)
    step = np.diff(np.floor(cycles))
    falls = np.flatnonzero(step) + 1
    span = np.arange(-AROUND, AROUND + 1)
    falls = falls[(falls > AROUND + REACH) & (falls < len(speed) - AROUND - REACH - 1)]
    at = falls[:, None] + span
    known = np.isfinite(distance_m[at[:, :-1]]).all(axis=1) & (speed[at].min(axis=1) > FAST_MPS)
    falls, at = falls[known], at[known]
    shown = np.concatenate([np.zeros((len(at), 1)), np.cumsum(distance_m[at[:, :-1]], axis=1)], axis=1)
    sign = step[falls - 1][:, None]  # the age falls by A where the cycles grow
    moves = np.arange(-REACH * STEPS, REACH * STEPS + 1) / STEPS
    # Edge m holds the share of the fall that came before it: 1 from the fall's place on.
    usual = (span >= 0).astype(float)
    shares = np.clip(span[None, :] + 1.0 - moves[:, None], 0.0, 1.0) - usual
    change = -rhythm.amplitude_s * sign[:, :, None] * shares[None]  # (falls, moves, edges)
    corrected = shown[:, None, :] + speed[at][:, None, :] * (age[at][:, None, :] + change)
    left = np.square(np.diff(corrected, 3, axis=2)).sum(axis=2)
    best = np.argmin(left, axis=1)
    np.add.at(age, at, change[np.arange(len(at)), best])
    return np.asarray(age)
