"""A brake does not let go of its wheel, which slips a little, grows warm and grows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.effect import Effect, Grid, NoiseResemblance, Parameter, Prior, WheelParameter
from tpmsd.car.physics.effect_records import Confounding, Identification, Nonlinear, Wording
from tpmsd.car.physics.first_order import accumulated
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.spans import wheel_mask
from tpmsd.foundation.wheels import FloatArray

SPEED_MPS = 20.0
"""At which the warmth that a cold brake's drag keeps up is the unit."""


@dataclass(frozen=True)
class BrakeDrag(Effect):
    """omega * r = v * (1 - slip * (1 + h)) and delta_r = growth_m * slip * h on one wheel, cooling_s * dh/dt
    = v / 20 m/s - h, h = 0 at the start: the drag grows with the warmth that it makes, and the tyre with it.

    Both turn the wheel slower. A drag that stays the same is calibration: what is estimated is how it follows
    the speed of the last minutes. Source: linear slip stiffness, F = C * s (Gustafsson, Automatica 33(6),
    1997): 100 N on 1e5 N are 1e-3; at 20 m/s they are 2 kW, at a cooling of 20 W/K a disc 100 K warmer
    (Limpert, Brake Design and Safety, 2011, chapter 3), a rim 20 K and a radius 0.5 mm more: growth_m of 0.5
    m. A hot disc is thicker and drags up to twice as much. Brakes drag on one car in fifty.
    """

    name = "brake_drag"
    wording = Wording(
        formula="omega * r = v * (1 - slip * (1 + h)), delta_r = growth_m * slip * h on one wheel, "
        "cooling_s * dh/dt = v / 20 m/s - h",
        sentence="a brake drags on one wheel, which grows as it warms up",
        noun="a dragging brake",
        answers=("the brake of {wheel} drags, by a slip of {slip:size %}",),
        distinguished_by="roll fast for ten minutes and slowly for ten, without braking, twice",
    )
    identification = Identification(shows_in=("wheel_ratio", "time"), wheel_patterns=("fl", "fr", "rl", "rr"))
    confounding = Confounding(rare=True, resembles=NoiseResemblance.WHEEL)
    nonlinear = Nonlinear(
        # Discs and rims take two to ten minutes.
        grid=Grid(
            "cooling_s",
            values=(120.0, 360.0),
            middle=360.0,
            range=(40.0, 1500.0),
            penalty=lambda tau: 0.7 + 0.5 * (math.log(tau / 240.0) / 0.7) ** 2,
            step=1.7,
        )
    )
    one_sign = True
    own_per_drive = True
    stays = "it belongs to the drive on which it was found"
    parameters = (
        WheelParameter(),
        Parameter(
            "slip",
            "1",
            1e-3,
            -0.05,
            0.05,
            "of the cold brake's drag at the tyre",
            probe=1e-5,
            prior=Prior(0.0, 1e-3, "100 N on a tyre of 1e5 N"),
            fitted=(0.0, 0.02),
        ),
        Parameter(
            "cooling_s",
            "s",
            240.0,
            1.0,
            1e5,
            "time constant of cooling",
            prior=Prior(240.0, 150.0, "2 to 10 minutes: Limpert 2011, ch. 3"),
        ),
        Parameter(
            "growth_m",
            "m",
            0.5,
            0.0,
            10.0,
            "growth of the radius per slip and warmth; not fitted",
            prior=Prior(0.5, 0.3, "0.5 mm per 100 N at 20 m/s"),
        ),
    )
    wheel: str
    slip: float
    cooling_s: float = 240.0
    growth_m: float = 0.5

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) -slip * (1 + h) on its wheel."""
        return np.asarray(-self.slip * (1.0 + self._relative_heat(motion))[:, None] * wheel_mask(self.wheel))

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) growth_m * slip * h on its wheel."""
        return np.asarray(
            self.growth_m * self.slip * self._relative_heat(motion)[:, None] * wheel_mask(self.wheel)
        )

    def _relative_heat(self, motion: Motion) -> FloatArray:
        """Return the (n,) heat h of the brake, 1 in equilibrium at `SPEED_MPS`."""
        step = float(motion.time_s[1] - motion.time_s[0]) if len(motion) > 1 else 1.0
        kept = math.exp(-step / self.cooling_s)
        return accumulated((1.0 - kept) * motion.speed_mps / SPEED_MPS, kept)
