"""Drift of the radii drawn from the prior that a filter of the product states of it.

In: a filter's name, the ticks in which the car rolls, a generator. Out: metres that each wheel's radius has
drifted by at the ends of the ticks. An interval of a Bayesian filter covers what it says only on average over
its own prior: radii that never drift are covered too often, and such as drift more than the prior allows too
seldom. The numbers are the product's own (`JumpHypotheses`, `SampledHypotheses`, `ProcessModel.drift_at`).

    gaussian-sum  one of the levels for the whole drive, by their prior probabilities
    mpf-pn        log-levels that walk about their prior (Ornstein-Uhlenbeck), a common one and each wheel's
    changes       of each wheel at a Poisson rate, Gaussian in size; the same of both
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bench.worlds.paper_drive import FL, FR, RADIUS_M, RL, RR, TICK_S
from bench.worlds.paper_route import TRACK_M
from tpmsd.onboard.estimators.bank.error_state import ProcessModel
from tpmsd.onboard.estimators.bank.jump_hypotheses import JUMPS
from tpmsd.onboard.estimators.bank.particle_bank import SampledHypotheses
from tpmsd.onboard.estimators.settings import SETTINGS

Array = NDArray[np.float64]
ORDER = (RL, RR, FL, FR)
"""The filters' order of the wheels; of a pair the first two."""
NONE, DRIFT, CHANGES = "none", "drift", "drift and changes"
KINDS = (NONE, DRIFT, CHANGES)
"""Radii do not drift; drift as the prior has it; and change at once as well."""


def levels(method: str, wheels: int, ticks: int, rng: np.random.Generator) -> Array:
    """(ticks, wheels) process-noise levels, relative to the usual one, as the filter's prior has them."""
    if method == "mpf-pn":
        return _walking(wheels, ticks, rng)
    kinds = JUMPS.kinds(wheels)
    chances = np.array([chance for _, chance in kinds])
    level, _ = kinds[int(rng.choice(len(kinds), p=chances / chances.sum()))]
    return np.broadcast_to(level, (ticks, wheels))


def _walking(wheels: int, ticks: int, rng: np.random.Generator) -> Array:
    """As of `levels`: theta keeps its prior at every instant, and is forgotten within `level_tau_s`."""
    prior = SampledHypotheses()
    every = round(SETTINGS.level_step_s / TICK_S)
    steps = -(-ticks // every)
    keep = math.exp(-SETTINGS.level_step_s / prior.tau_s)
    std = np.array([prior.level_std] + [prior.contrast_std] * wheels)
    theta = np.empty((steps, 1 + wheels))
    theta[0] = std * rng.standard_normal(1 + wheels)
    for k in range(1, steps):
        kick = std * rng.standard_normal(1 + wheels)
        theta[k] = keep * theta[k - 1] + math.sqrt(1.0 - keep * keep) * kick
    own = np.exp(prior.level_mean + theta[:, :1] + theta[:, 1:])
    return np.repeat(own, every, axis=0)[:ticks]


def drawn(method: str, wheels: int, rolling: NDArray[np.bool_], kind: str, rng: np.random.Generator) -> Array:
    """(n + 1, 4) m by which the radii have drifted, zero at the start and for wheels that are not estimated;
    rolling (n,): whether the car moves in a tick, since the filters' radii drift in such ticks alone."""
    out = np.zeros((rolling.size + 1, 4))
    if kind == NONE:
        return out
    process = ProcessModel(np.full(wheels, RADIUS_M), TRACK_M, False)
    per_s = process.drift_at(levels(method, wheels, rolling.size, rng))
    kicks = np.einsum("kij,kj->ki", np.linalg.cholesky(per_s), rng.standard_normal((rolling.size, wheels)))
    kicks *= math.sqrt(TICK_S) * rolling[:, None]
    if kind == CHANGES:
        chance = JUMPS.rate_per_s * TICK_S
        jumps = rolling[:, None] & (rng.random(kicks.shape) < chance)
        kicks += jumps * JUMPS.std * RADIUS_M * rng.standard_normal(kicks.shape)
    out[1:, list(ORDER[:wheels])] = np.cumsum(kicks, axis=0)
    return out
