"""MPF-PN: tyre radii and trajectory with a marginalized particle filter, after paper 000.

Table I with eqs (1)-(24) and (36)-(38).

In: `Tick`s (rotation angles of the wheels, fixes). Out: `RadiusEstimate`s. Vectorised over particles, seeded.

State of each particle: pose (east, north, heading) of the middle of the rear axle, and Normal-inverse-Wishart
statistics of the radius errors w = (rl, rr). Per tick

    w ~ Student-t predictive (21)                                    Table I, line 10
    the pose moves by it (`position_filter`)                         (6), (7)
    statistics take the realised w                                   (19), (20)
    weights are multiplied by p(fix | particle) when a fix comes     (22)

What was added for real cars, beside what `position_filter` adds to all methods: while fixes come that can
judge it, a small share of particles supposes a sudden change of a radius, without which a bootstrap proposal
follows a puncture too late; and the noise of left against right has a floor, so that a supposed change is
never the only way to follow the fixes (`change_rate_per_s=0` is the paper's filter, without either).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tpmsd.config.model import FilterConfig, GnssConfig, VehicleConfig
from tpmsd.estimators.gnss_likelihood import PositionLog, student_t_log
from tpmsd.estimators.niw import NormalInverseWishart
from tpmsd.estimators.pose_particles import PoseParticles
from tpmsd.estimators.position_filter import NOISE_FLOOR_M, NOISE_STD_M, PRIOR_RADIUS_STD
from tpmsd.timeline.tick import Tick
from tpmsd.wheels import FloatArray

CHANGE_RATE_PER_S = 0.003
"""How often a particle supposes that a radius has just changed."""
CHANGE_STD = 0.01
"""Size of the supposed change, relative to the radius."""
JUDGED_S = 2.0
"""Changes are supposed while the last fix is no older than this: later ones would only spread the radii."""


def prior_statistics(count: int, nominal_m: FloatArray, rng: np.random.Generator) -> NormalInverseWishart:
    """Statistics of N particles before the first tick; nominal_m (2,).

    The prior spread of a radius sits in the particles' means, not in gamma: a wide gamma would make the first
    ticks' noise as large as the prior and lose the heading.
    """
    return NormalInverseWishart(
        gamma=0.2,
        mean=rng.standard_normal((count, 2)) * PRIOR_RADIUS_STD * nominal_m,
        nu=5.0,
        scale=np.tile(np.eye(2) * NOISE_STD_M**2 * 2.0, (count, 1, 1)),
    )


def keep_noise(stats: NormalInverseWishart) -> None:
    """Hold the noise above its floor."""
    floor = NOISE_FLOOR_M**2 * (stats.nu - 3.0)
    for k in range(2):
        np.maximum(stats.scale[:, k, k], floor, out=stats.scale[:, k, k])


def keep_turn_noise(stats: NormalInverseWishart) -> None:
    """Hold the noise of left against right above that of two wheels at their floor that err apart.

    The floor of the variances alone does not. A receiver's slow errors along the way are learned as an error
    that both wheels share, 10 mm and more, and under it that of the difference falls to 0.2 mm in two hours.
    The headings are then too stiff to follow the receiver's slow errors sideways, and the few particles that
    suppose a change of radius, whose paths bend, win by default.
    """
    floor = NOISE_FLOOR_M**2 * (stats.nu - 3.0)
    # var(left - right) >= 2 floor; the off-diagonals only ever come nearer to 0, so the matrix stays positive
    most = (stats.scale[:, 0, 0] + stats.scale[:, 1, 1]) / 2 - floor
    shared = np.minimum(stats.scale[:, 0, 1], most)
    stats.scale[:, 0, 1] = stats.scale[:, 1, 0] = shared


class RadiusParticles(PoseParticles):
    """Base of the filters whose particles each carry the statistics of the radii (8-12)."""

    _stats: NormalInverseWishart

    def _select(self, index: NDArray[np.intp]) -> None:
        self._stats.select(index)

    def _rear_moments(self) -> tuple[FloatArray, FloatArray]:
        return self._stats.mean_moments(self._weights)

    def _rear_noise(self) -> FloatArray:
        return np.diag(self._stats.noise_covariance(self._weights))

    def _take_radii(self, mean_m: FloatArray, covariance_m2: FloatArray, noise_m2: FloatArray) -> None:
        spread = covariance_m2 + np.eye(2) * 1e-10
        self._stats.mean = self._rng.multivariate_normal(mean_m, spread, self._count)
        self._stats.scale = np.tile(np.diag(noise_m2) * (self._stats.nu - 3.0), (self._count, 1, 1))


class MpfPn(RadiusParticles):
    """The estimator; `step` takes one tick and gives one estimate."""

    def __init__(
        self,
        vehicle: VehicleConfig,
        gnss: GnssConfig,
        settings: FilterConfig,
        rng: np.random.Generator,
        front: bool,
        change_rate_per_s: float = CHANGE_RATE_PER_S,
        position_log: PositionLog = student_t_log,
        statistics: NormalInverseWishart | None = None,
    ) -> None:
        """`front`: whether the bus has the front wheels; `change_rate_per_s`: of supposed sudden changes;
        `position_log`: how probable a position is; `statistics` before the first tick; None: a wide prior."""
        super().__init__(vehicle, gnss, settings, rng, front, position_log)
        self._change_rate = change_rate_per_s
        self._stats = statistics or prior_statistics(self._count, self._nominal[:2], rng)

    def _advance(self, tick: Tick, rear_rad: FloatArray, teaches: bool) -> tuple[float, float]:
        if teaches:
            self._stats.forget(self._forgetting)
            if self._located and tick.time_s - self._last_fix_s < JUDGED_S:
                self._suppose_changes(tick.dt_s)
        noise = self._stats.sample(self._rng, 2)
        way, turn = self._roll(rear_rad, noise.T)
        if teaches:
            self._stats.learn(noise)
            keep_noise(self._stats)
            if self._change_rate > 0.0:
                keep_turn_noise(self._stats)
        elif (curvature := self._steered_curvature(tick)) is not None:
            turn = way * curvature
        return self._go(way, turn)

    def _suppose_changes(self, dt_s: float) -> None:
        """Let a few particles suppose that one rear radius has just changed.

        The bootstrap proposal explores a mean only as fast as the forgetting lets it; a puncture is faster.
        With this mixture in the prior, p(mu_k | mu_k-1) = (1 - e) delta + e N(mu_k-1, change), the weights
        decide.
        """
        number = int(self._rng.poisson(self._change_rate * dt_s * self._count))
        if number == 0:
            return
        who = self._rng.integers(self._count, size=number)
        wheel = self._rng.integers(2, size=number)
        self._stats.mean[who, wheel] += self._rng.standard_normal(number) * CHANGE_STD * self._nominal[wheel]
        self._pose[2, who] += self._rng.standard_normal(number) * 0.03
