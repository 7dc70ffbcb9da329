"""Many Monte-Carlo runs of MPF-PN or AUG-PF as one array: what makes a hundred runs of 100 particles cheap.

In: one drive's wheels and the fixes of many receivers. Out: a row per batch of runs. M runs of N
particles are M N particles moved and taught together; only weights and resampling are per run. That pays
while a tick's fixed cost is more than its particles', so for few particles.

All runs of a batch share the counts, hence which ticks are informative (a run's own receiver would move the
limits of that by a tick here or there). The rest of the program's filters is left out: no fix is refused
and no pose found again, so a filter that has lost its way stays lost, as in the paper.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.campaigns.onboard.estimators.methods import POSITIONS, TEXTBOOK, config_of
from bench.campaigns.onboard.estimators.play import Played, score
from bench.worlds.paper_drive import RADIUS_M, RL, SCENARIOS, TICK_S, drive
from bench.worlds.paper_route import TRACK_M
from tpmsd.foundation.wheels import FloatArray
from tpmsd.onboard.estimators.gates.motion_gate import MotionGate
from tpmsd.onboard.estimators.published.gnss_likelihood import PositionLog, gaussian_log, student_t_log
from tpmsd.onboard.estimators.published.niw import NormalInverseWishart
from tpmsd.onboard.estimators.published.radius_models import NiwRadii, RadiusModel, WalkingRadii
from tpmsd.onboard.estimators.resampling import systematic
from tpmsd.onboard.estimators.settings import SETTINGS
from tpmsd.onboard.timeline.tick import Tick

Array = NDArray[np.float64]
START_HEADING_STD_RAD = 0.1
SCENARIO = "puncture"


class Radii:
    """What a method holds of the radii, for all K particles of all runs: the program's own radius model."""

    def __init__(self, model: RadiusModel, count: int, rng: np.random.Generator) -> None:
        self._model, self._rng = model, rng
        self._state = model.begin(count, np.full(2, RADIUS_M), rng)

    def draw(self, informative: bool) -> Array:
        """Radius errors (K, 2) of this tick, learned from if it is informative: Table I, lines 9, 10 and
        13."""
        if informative:
            self._state = self._model.forget(self._state, TICK_S, self._rng)
        noise = self._model.draw(self._state, self._rng)
        if informative:
            self._state = self._model.learn(self._state, noise)
        return noise.T

    def select(self, index: NDArray[np.intp]) -> None:
        """Resample."""
        self._state = self._model.select(self._state, index)

    def moments(self) -> tuple[Array, Array]:
        """Mean (K, 2) of each particle, and what each adds to the covariance (K, 2, 2)."""
        state = self._state
        if isinstance(state, NormalInverseWishart):  # eq. (24a) before the sum, and gamma E[Sigma]
            return state.mean, state.scale * (state.gamma / (state.nu - 3.0))
        return state.mu.T, np.zeros((1, 2, 2))


@dataclass(frozen=True)
class Batch:
    """Many runs at once."""

    method: str
    receiver: str
    particles: int
    runs: int

    @property
    def label(self) -> str:
        """For the progress line."""
        return f"{self.runs} runs of {self.method} N={self.particles} at once: {self.receiver}"


def plan(full: bool) -> list[Batch]:
    """Many runs where few particles make that cheap; more with --full."""
    sizes = {100: 100 if full else 40} | ({500: 100} if full else {})
    return [
        Batch(method, receiver, count, runs)
        for receiver in ("white", "correlated")
        for method in (TEXTBOOK, "aug-pf")
        for count, runs in sizes.items()
    ]


def play_batch(
    radii: Radii,
    ticks: list[list[Tick]],
    count: int,
    rng: np.random.Generator,
    likelihood: PositionLog = student_t_log,
    gated: bool = True,
) -> list[Played]:
    """Play the wheels of ticks[0] with the fixes of every ticks[m]; not `gated`: as printed, with heading
    psi_k and without a floor of the position error."""
    runs = len(ticks)
    total = runs * count
    pose = np.zeros((3, total))
    log_weights = np.zeros((runs, count))
    weights = np.full((runs, count), 1.0 / count)
    gate = MotionGate(config_of(TEXTBOOK).filter) if gated else None
    heading_after, floor_m = 0.5 * gated, SETTINGS.position_floor_m * gated
    located = False
    length = len(ticks[0])
    rear, place = np.empty((runs, length, 2)), np.full((runs, length, 2), math.nan)
    covariance = np.empty((runs, length, 2, 2))
    begun = time.process_time()
    for k, tick in enumerate(ticks[0]):
        turned = tick.rotation_rad[RL:]
        rolled = turned * RADIUS_M
        informative = gate is None or gate.update(
            tick, float(rolled.mean()) / TICK_S, float(rolled[1] - rolled[0]) / TRACK_M / TICK_S
        )
        moving = bool(rolled.any())
        if moving:
            _roll(pose, turned * (RADIUS_M + radii.draw(informative)), heading_after)
        if tick.fixes and moving:
            fixes = [some[k].fixes[-1] for some in ticks]
            east, north, std, course = (
                np.array([getattr(fix, name) for fix in fixes])[:, None]
                for name in ("east_m", "north_m", "position_std_m", "heading_rad")
            )
            std = np.maximum(std, floor_m)
            shape = (runs, count)
            if located:
                squared = (
                    (east - pose[0].reshape(shape)) ** 2 + (north - pose[1].reshape(shape)) ** 2
                ) / std**2
                log_weights += likelihood(squared, 2)
                log_weights -= log_weights.max(axis=1, keepdims=True)
                weights = np.exp(log_weights)
                weights /= weights.sum(axis=1, keepdims=True)
                _resample(radii, pose, log_weights, weights, rng)
            elif np.isfinite(course).all() and float(rolled.mean()) / TICK_S > 3.0:
                pose[0] = (east + std * rng.standard_normal(shape)).ravel()
                pose[1] = (north + std * rng.standard_normal(shape)).ravel()
                pose[2] = (course + START_HEADING_STD_RAD * rng.standard_normal(shape)).ravel()
                located = True
        mean, own = radii.moments()
        mean = mean.reshape(runs, count, 2)
        rear[:, k] = np.einsum("mn,mnd->md", weights, mean)
        away = mean - rear[:, k][:, None]
        covariance[:, k] = np.matmul((away * weights[..., None]).swapaxes(1, 2), away)
        if own.shape[0] == total:
            covariance[:, k] += np.einsum("mn,mnij->mij", weights, own.reshape(runs, count, 2, 2))
        if located:
            place[:, k, 0] = (weights * pose[0].reshape(runs, count)).sum(axis=1)
            place[:, k, 1] = (weights * pose[1].reshape(runs, count)).sum(axis=1)
    cpu_s = (time.process_time() - begun) / runs
    return [Played(rear[m], covariance[m], place[m], 0, cpu_s) for m in range(runs)]


def _roll(pose: FloatArray, roll: FloatArray, heading_after: float) -> None:
    """Move the poses (3, n) by the rolled distances (n, 2) of both rear wheels, in m; the heading is that
    after this share of the turn."""
    distance, turn = (roll[:, 0] + roll[:, 1]) / 2, (roll[:, 1] - roll[:, 0]) / TRACK_M
    middle = pose[2] + turn * heading_after
    pose[0] += distance * np.cos(middle)
    pose[1] += distance * np.sin(middle)
    pose[2] += turn


def _resample(
    radii: Radii, pose: Array, log_weights: Array, weights: Array, rng: np.random.Generator
) -> None:
    """Systematic resampling of the runs whose effective number has fallen below half; in place."""
    runs, count = weights.shape
    few = np.flatnonzero(1.0 / np.einsum("mn,mn->m", weights, weights) <= 0.5 * count)
    if few.size == 0:
        return
    index = np.arange(runs * count).reshape(runs, count)
    for run in few:
        index[run] = run * count + systematic(weights[run], rng)
    chosen = index.ravel()
    pose[:] = pose[:, chosen]
    radii.select(chosen)
    log_weights[few] = 0.0
    weights[few] = 1.0 / count


def perform(batch: Batch) -> list[dict[str, Any]]:
    """A row per run."""
    rng = np.random.default_rng([batch.particles, 13])
    settings = config_of(batch.method).filter
    drives = [drive(SCENARIOS[SCENARIO], batch.receiver, seed) for seed in range(1000, 1000 + batch.runs)]
    total = batch.runs * batch.particles
    model: RadiusModel
    if batch.method == TEXTBOOK:
        model = NiwRadii(1.0 - TICK_S / settings.window_s, floors=None)
    else:
        model = WalkingRadii()
    paper = batch.method == TEXTBOOK
    likelihood = gaussian_log if paper else student_t_log
    ticks = [d.ticks for d in drives]
    played = play_batch(Radii(model, total, rng), ticks, batch.particles, rng, likelihood, gated=not paper)
    first = drives[0]
    truth, place = first.offsets_m[:, RL:], first.pose[1:, :2]
    what = {"scenario": SCENARIO, "receiver": batch.receiver, "method": batch.method, "front": False}
    what |= {"inputs": POSITIONS}
    return [
        what | {"particles": batch.particles, "seed": 1000 + m} | score(run, truth, place, TICK_S).row()
        for m, run in enumerate(played)
    ]
