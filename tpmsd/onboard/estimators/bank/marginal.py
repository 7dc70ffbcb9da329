"""Representation by particles that are Kalman filters: MPF-PN, the program's.

In: movements and fixes. Out: a `Belief` of all wheels. The model, the measurements and the arithmetic are
those of the Gaussian-sum filter (`mixture`); the hypotheses are drawn instead of enumerated
(`particle_bank`). Per block of odometry, about once a second:

    theta walks, changes are proposed        p(theta, changes), weights by prior over proposal
    the Kalman filters take the block        weights by p(block | particle), pose and radii marginalised
    resampling, copies moved apart           where N_eff <= N / 2
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tpmsd.onboard.estimators.bank.error_state import MU, E, N
from tpmsd.onboard.estimators.bank.kernel import HALF_KERNEL
from tpmsd.onboard.estimators.bank.mixture import MixtureBelief, MixturePieces
from tpmsd.onboard.estimators.bank.particle_bank import ParticleBank, SampledHypotheses
from tpmsd.onboard.estimators.belief import FilterCar, FixMeasurement, GatedTick, Moments
from tpmsd.onboard.estimators.odometry_block import Block
from tpmsd.onboard.estimators.resampling import Lineage, between_std
from tpmsd.onboard.estimators.settings import SETTINGS


@dataclass(frozen=True, slots=True)
class MarginalPieces:
    """Pieces of the belief."""

    hypotheses: SampledHypotheses = field(default_factory=SampledHypotheses)
    mixture: MixturePieces = field(default_factory=lambda: MixturePieces(kernel=HALF_KERNEL))
    """The Kalman filters' measurements and arithmetic; its change model is not used."""


class MarginalBelief(MixtureBelief):
    """A `Belief`; draws from the generator it was given."""

    bank: ParticleBank

    def __init__(self, car: FilterCar, pieces: MarginalPieces, count: int, rng: np.random.Generator) -> None:
        self._hypotheses, self._rng = pieces.hypotheses, rng
        super().__init__(car, pieces.mixture, count, pieces.hypotheses.begin(count, car.nominal_m, rng))
        self._lineage = Lineage(count)
        self._effective = math.nan
        """Effective particles of the last tick."""
        self._unwalked_s = 0.0
        self._between_m = math.nan
        """Spread between particles of the last informative block; NaN: to be computed."""

    def _propose_changes(self, block: Block, gyro_trusted: bool) -> None:
        """Move theta, and propose changes where the block can judge them: others would only spread the
        radii."""
        self._unwalked_s += block.duration_s
        self._between_m = math.nan
        if self._unwalked_s >= SETTINGS.level_step_s:
            self._hypotheses.walk(self.bank, self._unwalked_s, self._rng)
            self._unwalked_s = 0.0
        by_gyro = gyro_trusted and math.isfinite(block.gyro_heading_change_rad)
        if (
            by_gyro
            or math.isfinite(block.doppler_distance_m)
            or any(front is not None for front in block.front)
        ):
            self._hypotheses.propose(
                self.bank, self._lineage, block.duration_s, self._car.nominal_m, self._rng
            )
        self._drift = self._process.drift_at(self.bank.level)

    def finish_tick(self, gated: GatedTick) -> None:
        """Resample where the fixes before this tick have made the effective number small; then as the
        mixture."""
        self._lineage.elapse(gated.tick.dt_s)
        if self._hypotheses.resample(self.bank, self._lineage, self._effective, self._rng):
            self._drift = self._process.drift_at(self.bank.level)
        super().finish_tick(gated)

    def distance(self, measurement: FixMeasurement) -> tuple[float, float]:
        """Return the distance from the particles' mean; the variance has the spread between them."""
        residual_m, variance_m2 = super().distance(measurement)
        weights, position = self.bank.weights(), self.bank.state[[E, N]]
        away = position - (position @ weights)[:, None]
        return residual_m, variance_m2 + float(np.square(away).sum(axis=0) @ weights)

    def snapshot(self) -> dict[str, Any]:
        """Return what the mixture's snapshot holds."""
        self._kernel.complete(self.bank)
        return super().snapshot()

    def forget_pose(self) -> None:
        """Drop blocks and grade; the radii keep their joint evidence, and half of the particles assume that
        one of them has changed: the receiver may have left the wheels for that."""
        super().forget_pose()
        half = np.flatnonzero(self._rng.random(self.bank.log_weights.size) < 0.5)
        self._hypotheses.assume_changes(self.bank, half, self._car.nominal_m, self._rng)

    def moments(self) -> Moments:
        """Return the moments of all particles together."""
        said = super().moments()
        self._effective = said.effective
        if self._between_m != self._between_m:
            self._between_m = between_std(self.bank.state[MU:], self.bank.weights())
        return said._replace(ancestors=float(self._lineage.ancestors), between_std_m=self._between_m)
