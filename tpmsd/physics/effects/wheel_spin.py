"""Driven wheels spin for a while: too much drive for ice, gravel or a lifted wheel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tpmsd.errors import ConfigError
from tpmsd.physics.effect import Effect, Kind, Parameter, Prior, TextParameter
from tpmsd.physics.motion import Car, Motion
from tpmsd.physics.spans import wheel_mask, within
from tpmsd.wheels import FloatArray

LEAST = 0.003
"""Slip below which a tyre creeps on a dry road under ordinary force (F_x/F_z of 0.05 is 0.0023)."""
SHORTEST_S, LONGEST_S = 2.0, 120.0
"""Two windows, and a long stretch of ice: what lasts longer is a changed tyre or a warm brake."""


@dataclass(frozen=True)
class WheelSpin(Effect):
    """Driven wheels turn faster than they roll, by a constant share, from the onset on for so long.

    Source: beyond the peak of the tyre's force (at a slip of 0.02 to 0.05 on ice, 0.1 on a dry road) the slip
    is held by driver or traction control (Pacejka, Tyre and Vehicle Dynamics, 2012, chapter 1).
    """

    name: ClassVar[str] = "wheel_spin"
    kind: ClassVar[Kind] = Kind.EVENT
    formula: ClassVar[str] = "omega * r = v * (1 + slip) on its wheels, onset_s <= t < onset_s + duration_s"
    sentence: ClassVar[str] = "driven wheels spin for a while"
    telling_drive: ClassVar[str] = "drive the stretch again with less drive"
    shows_in: ClassVar[tuple[str, str]] = ("wheel_ratio", "time")
    own_per_drive: ClassVar[bool] = True
    span: ClassVar[bool] = True
    parameters: ClassVar[tuple[TextParameter | Parameter, ...]] = (
        TextParameter("wheels", "front", "wheels that slip, by name, or front, rear"),
        Parameter(
            "slip",
            "1",
            0.02,
            0.0,
            50.0,
            "share by which the wheels turn faster than they roll",
            prior=Prior(0.0, 0.05, "peak of the force on ice at 0.02 to 0.05: Pacejka 2012, ch. 1"),
        ),
        Parameter("onset_s", "s", 300.0, -1e6, 1e6, "when it begins, from the drive's start"),
        Parameter("duration_s", "s", 20.0, 0.0, 1e7, "how long it lasts"),
    )
    wheels: str
    slip: float
    onset_s: float
    duration_s: float

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            wheel_mask(self.wheels)
        except ValueError as error:
            raise ConfigError(f"effect {self.name}: {error}") from None

    @classmethod
    def fits_span(cls, slip: float, duration_s: float, driven: bool) -> bool:
        """Driven wheels that turn faster, by more than ordinary force makes them."""
        return driven and slip >= LEAST and SHORTEST_S <= duration_s <= LONGEST_S

    def not_compensated(self, signals: frozenset[str]) -> str | None:
        """It belongs to its drive."""
        return "it belongs to the drive on which it was found"

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) the slip on its wheels within its span, zero elsewhere."""
        share = within(motion.time_s, self.onset_s, self.duration_s)
        return self.slip * share[:, None] * wheel_mask(self.wheels)
