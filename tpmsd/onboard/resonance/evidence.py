"""Likelihood of 'soft' against 'not soft' from the resonances.

In: for each wheel the resonance's likelihood now and when the tyre was known to be in order. Out: a
`ResonanceEvidence`: log likelihood ratios per wheel and per set of wheels, to be added to those of the radii.

    L_i(x)  = sum over f, z of L_then(f, z) L_now(f e^x, z)    x: change of ln f of wheel i, z: damping
    x_i     = c + u_i + s_i                                    c, u: nuisance, common and own; s: of a soft
    tyre L(S)    = average over c of  prod over S of E[L_i | s soft] * prod over the others of L_i(c + u)

c is what warmth does to all tyres alike, so four frequencies that fall together say little, and one that
falls alone says much. Nothing is taken to be Gaussian: a wheel whose resonance was not found has a flat L_i
and says nothing. With probability 1 - TRUST the evidence is worth nothing, which bounds all ratios.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.resonance.peak_fit import LOG_STEP
from tpmsd.onboard.resonance.torsion import soft_shifts

MIN_SHIFT, MAX_SHIFT = -0.40, 0.20
SHIFTS = LOG_STEP * np.arange(round(MIN_SHIFT / LOG_STEP), round(MAX_SHIFT / LOG_STEP) + 1)
"""Changes of ln f that are considered."""
COMMON_STD, OWN_STD = 0.02, 0.006
"""Standard deviations of nuisance changes of ln f: temperature and load of all tyres; those of each wheel
alone."""
TRUST = 0.9
"""Probability that the evidence is valid; else every set of wheels is as likely as any other."""
_COMMON = LOG_STEP * np.arange(-12, 13)
_COMMON_LOG = -0.5 * (_COMMON / COMMON_STD) ** 2


def shift_log_likelihood(then: FloatArray, now: FloatArray) -> FloatArray:
    """Return the (len(SHIFTS),) log-likelihood of each change of ln f of one wheel; its mean likelihood is 1.

    `then`, `now`: (frequencies, dampings) log-likelihoods, 0 where a resonance cannot be detected. Damping is
    the road contact's, the same at the same speed, so an error of it is in both and cancels."""
    size = then.shape[0]
    # Off the grid a resonance is not seen either: 0.
    padded = np.zeros((size + 2 * SHIFTS.size, then.shape[1]))
    padded[SHIFTS.size : SHIFTS.size + size] = now
    offset = SHIFTS.size + np.round(SHIFTS / LOG_STEP).astype(int)
    joint = then + np.stack([padded[start : start + size] for start in offset])
    logs = _log_sum(joint.reshape(SHIFTS.size, -1), axis=1)
    return np.asarray(logs - _log_sum(logs, axis=0) + math.log(SHIFTS.size))


@dataclass(frozen=True, slots=True)
class ResonanceEvidence:
    """Joint evidence of the resonances of a car's wheels."""

    wheels: tuple[int, ...]
    """The wheels it speaks of, as indices of `tpmsd.foundation.wheels.WHEELS`."""
    subsets: Mapping[tuple[int, ...], float]
    """Log-likelihood ratio for every set of these wheels: just they are soft, against none is."""

    @classmethod
    def silent(cls) -> ResonanceEvidence:
        """Return the evidence of no wheel: all its log-likelihood ratios are 0."""
        return cls((), {(): 0.0})

    @classmethod
    def from_shifts(cls, shifts: Mapping[int, FloatArray]) -> ResonanceEvidence:
        """Return the joint evidence from the `shift_log_likelihood` of each wheel that has one."""
        wheels = tuple(sorted(shifts))
        if not wheels:
            return cls.silent()
        sound, soft = {}, {}
        for wheel in wheels:
            own = _log_smoothed(shifts[wheel], OWN_STD)
            sound[wheel] = np.interp(_COMMON, SHIFTS, own)
            shifted = np.interp(_COMMON[:, None] + soft_shifts(), SHIFTS, own)
            soft[wheel] = _log_sum(shifted, axis=1) - math.log(shifted.shape[1])
        logs: dict[tuple[int, ...], float] = {}
        for size in range(len(wheels) + 1):
            for subset in itertools.combinations(wheels, size):
                terms = (soft[wheel] if wheel in subset else sound[wheel] for wheel in wheels)
                logs[subset] = float(_log_sum(_COMMON_LOG + sum(terms), axis=0))
        total = float(_log_sum(np.array(list(logs.values())), 0))
        uniform = math.log1p(-TRUST) - math.log(len(logs))
        mixed = {s: float(np.logaddexp(math.log(TRUST) + log - total, uniform)) for s, log in logs.items()}
        return cls(wheels, {subset: log - mixed[()] for subset, log in mixed.items()})

    def log_ratio(self, subset: Sequence[int]) -> float:
        """Return the log-likelihood ratio of just these wheels soft against none; wheels without a resonance
        are left out of the set."""
        return self.subsets[tuple(sorted(wheel for wheel in subset if wheel in self.wheels))]

    def wheel_llr(self, wheel: int) -> float:
        """Return the log-likelihood ratio of just this wheel soft against none."""
        return self.log_ratio((wheel,))


def _log_smoothed(log_values: FloatArray, std: float) -> FloatArray:
    """Return the (n,) log of exp(`log_values`) convolved over `SHIFTS` with a normal error of this `std`."""
    reach = math.ceil(3.0 * std / LOG_STEP)
    error = LOG_STEP * np.arange(-reach, reach + 1)
    kernel = -0.5 * (error / std) ** 2
    kernel -= _log_sum(kernel, 0)
    padded = np.pad(log_values, reach, mode="edge")
    pieces = np.stack([padded[start : start + log_values.size] for start in range(2 * reach + 1)])
    return _log_sum(pieces + kernel[:, None], axis=0)


def _log_sum(logs: NDArray[np.floating[Any]], axis: int) -> FloatArray:
    """Return log(sum(exp(logs))) along an axis."""
    top = logs.max(axis=axis, keepdims=True)
    return np.asarray(np.log(np.exp(logs - top).sum(axis=axis)) + np.squeeze(top, axis))
