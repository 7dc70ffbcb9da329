"""Change models of sampled beliefs: radii that change at once.

In: particles. Out: some of them changed. A bootstrap proposal explores a mean only as fast as the forgetting
lets it; a puncture is faster. With this mixture in the prior, p(mu_k | mu_k-1) = (1 - e) delta +
e N(mu_k-1, change), the weights decide. (The Gaussian mixture enumerates its changes: `jump_hypotheses`.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tpmsd.onboard.estimators.belief import FilterCar, RolledTick
from tpmsd.onboard.estimators.published.radius_models import RadiusModel
from tpmsd.onboard.estimators.published.sampled_motion import Particles
from tpmsd.onboard.estimators.settings import SETTINGS


class ChangeModel(Protocol):
    """Assumes changes in some particles."""

    def propose_changes(
        self,
        particles: Particles,
        radii: RadiusModel,
        rolling: RolledTick,
        car: FilterCar,
        rng: np.random.Generator,
    ) -> None:
        """Change radii and headings of some particles, in place."""
        ...


@dataclass(frozen=True, slots=True)
class PoissonChanges:
    """Each particle assumes a change of one rear radius at a constant rate."""

    rate_per_s: float = SETTINGS.change_rate_per_s
    std: float = SETTINGS.change_std
    """Relative to the radius."""

    def propose_changes(
        self,
        particles: Particles,
        radii: RadiusModel,
        rolling: RolledTick,
        car: FilterCar,
        rng: np.random.Generator,
    ) -> None:
        """Shift one rear radius in a Poisson number of particles, each with a wheel and a size drawn for
        it."""
        number = int(rng.poisson(self.rate_per_s * rolling.gated.tick.dt_s * particles.count))
        if number == 0:
            return
        who = rng.integers(particles.count, size=number)
        wheel = rng.integers(2, size=number)
        radii.shift(
            particles.radii, wheel, who, rng.standard_normal(number) * self.std * car.nominal_m[wheel]
        )
        particles.pose[2, who] += rng.standard_normal(number) * SETTINGS.change_heading_rad
