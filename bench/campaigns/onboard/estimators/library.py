"""An augmented particle filter the way a user of the library `particles` writes it.

In: ticks. Out: one step at a time, and the estimate of mu3 - mu4.

The model is Lundquist et al.'s (2013), eqs (25)-(29): state east, north, heading, mu3, mu4, Sigma3, Sigma4;
variances move by an inverse gamma whose mean is kept and whose standard deviation is 5 % (27), (28); means
by a random walk. The library's own distributions draw and weigh, its `SMC` runs the bootstrap filter and
resamples.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import particles  # type: ignore[import-untyped]
from numpy.typing import NDArray
from particles import distributions as dists
from particles import state_space_models

from bench.worlds.paper_drive import RADIUS_M, RL, RR
from bench.worlds.paper_route import TRACK_M
from tpmsd.onboard.timeline.tick import Fix, Tick

Array = NDArray[np.float64]
WALK_M = 2e-5
"""Random walk of a mean per tick."""
NOISE_STD_M = 5e-3
PRIOR_STD_M = 0.01 * RADIUS_M
SHAPE = 2.0 + 1.0 / 0.05**2
"""alpha of (27): an inverse gamma of this shape has a standard deviation of 5 % of its mean."""


class Start(dists.ProbDist):  # type: ignore[misc]
    """Particles about the first fix."""

    dim = 7

    def __init__(self, fix: Fix) -> None:
        self._fix = fix

    def rvs(self, size: int | None = None) -> Array:
        """Draw (size, 7)."""
        fix = self._fix
        place = (fix.east_m, fix.north_m, fix.heading_rad)
        spread = (fix.position_std_m, fix.position_std_m, 0.05)
        parts = [dists.Normal(loc=a, scale=b) for a, b in zip(place, spread, strict=True)]
        parts += [dists.Normal(scale=PRIOR_STD_M)] * 2
        parts += [dists.InvGamma(a=SHAPE, b=(SHAPE - 1.0) * NOISE_STD_M**2)] * 2
        return np.stack([part.rvs(size=size) for part in parts], axis=1)


class Move(dists.ProbDist):  # type: ignore[misc]
    """p(x_k | x_k-1), eqs (26)-(28)."""

    dim = 7

    def __init__(self, before: Array, tick: Tick) -> None:
        self._before, self._tick = before, tick

    def rvs(self, size: int | None = None) -> Array:
        """Draw (size, 7)."""
        x = self._before
        sigma = dists.InvGamma(a=SHAPE, b=(SHAPE - 1.0) * x[:, 5:]).rvs(size=(x.shape[0], 2))
        mu = dists.Normal(loc=x[:, 3:5], scale=WALK_M).rvs(size=None)
        delta = dists.Normal(loc=mu, scale=np.sqrt(sigma)).rvs(size=None)
        roll = self._tick.rotation_rad[[RL, RR]] * (RADIUS_M + delta)
        distance, turn = roll.mean(axis=1), (roll[:, 1] - roll[:, 0]) / TRACK_M
        out = np.empty_like(x)
        middle = x[:, 2] + turn / 2
        out[:, 0] = x[:, 0] + distance * np.cos(middle)
        out[:, 1] = x[:, 1] + distance * np.sin(middle)
        out[:, 2] = x[:, 2] + turn
        out[:, 3:5], out[:, 5:] = mu, sigma
        return out


class Silence(dists.ProbDist):  # type: ignore[misc]
    """A tick without a fix says nothing."""

    def __init__(self, count: int) -> None:
        self._count = count

    def logpdf(self, x: Any) -> Array:
        """Zero for every particle."""
        return np.zeros(self._count)


class Model(state_space_models.StateSpaceModel):  # type: ignore[misc]
    """The state-space model in the library's terms; datum k is tick k."""

    default_params: dict[str, Any] = {"ticks": (), "start": None}  # noqa: RUF012  (the library's own way)

    def PX0(self) -> Start:  # noqa: N802
        """p(x_0)."""
        return Start(self.start)

    def PX(self, t: int, xp: Array) -> Move:  # noqa: N802
        """p(x_t | x_t-1)."""
        return Move(xp, self.ticks[t])

    def PY(self, t: int, xp: Array, x: Array) -> Any:  # noqa: N802
        """p(y_t | x_t), eq. (29)."""
        if not self.ticks[t].fixes:
            return Silence(x.shape[0])
        std = self.ticks[t].fixes[-1].position_std_m
        return dists.IndepProd(dists.Normal(loc=x[:, 0], scale=std), dists.Normal(loc=x[:, 1], scale=std))


class LibraryAugPf:
    """The library's bootstrap filter over the given ticks, begun at the first fix with a course."""

    def __init__(self, ticks: list[Tick], count: int, seed: int) -> None:
        np.random.seed(seed)  # the library draws from numpy's global generator
        first = next(k for k, t in enumerate(ticks) if t.fixes and math.isfinite(t.fixes[-1].heading_rad))
        ticks = ticks[first:]
        data = [np.array([f.east_m, f.north_m]) for t in ticks for f in (t.fixes or (ticks[0].fixes[-1],))]
        model = Model(ticks=ticks, start=ticks[0].fixes[-1])
        bootstrap = state_space_models.Bootstrap(ssm=model, data=data)
        self.first = first
        self._smc = particles.SMC(fk=bootstrap, N=count, resampling="systematic", ESSrmin=0.5)

    def step(self) -> tuple[float, float]:
        """One tick on; posterior mean and standard deviation of mu3 - mu4."""
        next(self._smc)
        weights, x = self._smc.W, self._smc.X
        off = x[:, 3] - x[:, 4]
        mean = float(weights @ off)
        return mean, math.sqrt(max(float(weights @ off**2) - mean**2, 0.0))
