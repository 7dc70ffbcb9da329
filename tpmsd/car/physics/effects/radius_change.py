"""One wheel's radius steps or ramps: the fault that tpmsd exists for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import (
    Effect,
    Kind,
    NoiseResemblance,
    Parameter,
    Prior,
    TextParameter,
    WheelParameter,
)
from tpmsd.car.physics.effect_records import Confounding, Identification, Nonlinear, Wording
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.spans import wheel_mask
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import FloatArray

RAMP, EXPONENTIAL = "ramp", "exponential"


@dataclass(frozen=True)
class RadiusChange(Effect):
    """A soft (or freshly inflated) tyre: 0 until the onset, then a ramp to `deviation_m`. Several wheels may
    change alike.

    delta_r(t) = deviation_m * clip((t - onset_s) / duration_s, 0, 1); a step where duration_s = 0. With the
    course `exponential` deviation_m * (1 - exp(-(t - onset_s) / duration_s)): through a hole air leaves in
    proportion to what is left. Source: the artificial slow puncture of [Lundquist 2013], eqs (39)-(41) (2.5
    mm over ten minutes); -20 % pressure is about -1.4 mm (`tpmsd.car.physics.tyre`); blow-down of a vessel
    through an orifice, exponential while the flow is choked (Anderson, Modern Compressible Flow, 2003,
    chapter 5).
    """

    name = "radius_change"
    kind = Kind.FAULT
    wording = Wording(
        formula="delta_r = deviation_m * clip((t - onset_s) / duration_s, 0, 1) on one or several wheels; "
        "exponential: deviation_m * (1 - exp(-(t - onset_s) / duration_s))",
        sentence="the radius of a tyre changed during the drive: the fault itself",
        noun="a radius that changes",
        answers=(
            "the radius of {wheel} changed by {deviation_m:mm} during the drive: the fault itself",
            "the radius of {wheels} changed by {deviation_m:mm} during the drive: the fault itself",
        ),
        distinguished_by="repeat the drive: a tyre that lost air stays small, warm-up starts again",
    )
    identification = Identification(shows_in=("wheel_ratio", "time"))
    confounding = Confounding(resembles=NoiseResemblance.WHEEL)
    nonlinear = Nonlinear(ramp=True, courses=(RAMP, EXPONENTIAL))
    own_per_drive = True
    parameters = (
        WheelParameter(description="which wheel, or wheels that change alike", several=True),
        Parameter(
            "deviation_m",
            "m",
            -2e-3,
            -0.05,
            0.05,
            "final change of the effective radius",
            prior=Prior(0.0, 2e-3, "-20 % of pressure is -1.4 mm on a 205/60R15 (Magic Formula 6.1)"),
        ),
        Parameter("onset_s", "s", 300.0, -1e6, 1e6, "when it begins, from the drive's start"),
        Parameter(
            "duration_s",
            "s",
            30.0,
            0.0,
            1e7,
            "how long it takes, 0 for a step; time constant of an exponential",
        ),
        TextParameter("course", RAMP, "ramp or exponential"),
    )
    wheel: str
    deviation_m: float
    onset_s: float = 0.0
    duration_s: float = 0.0
    course: str = RAMP

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.course not in self.nonlinear.courses:
            raise ConfigError(
                f"effect {self.name}: course = {self.course!r} is not one of {RAMP} {EXPONENTIAL}"
            )

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) the course on its wheel or wheels, zero elsewhere."""
        since = motion.time_s - self.onset_s
        if self.duration_s > 0 and self.course == EXPONENTIAL:
            share = -np.expm1(-np.maximum(since, 0.0) / self.duration_s)
        elif self.duration_s > 0:
            share = np.clip(since / self.duration_s, 0.0, 1.0)
        else:
            share = (since >= 0).astype(np.float64)
        return np.asarray(self.deviation_m * share[:, None] * wheel_mask(self.wheel))

    @property
    def wheels(self) -> str:
        """Return the names of the wheels, under the key that reports use for several."""
        return self.wheel

    def not_compensated(self, signals: frozenset[str]) -> str | None:
        """Return the reason: this change is the fault that is watched."""
        return f"the radius of {self.wheel} is what is watched, and its change the fault itself"
