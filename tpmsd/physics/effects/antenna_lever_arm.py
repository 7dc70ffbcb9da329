"""The antenna is not where the configuration says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from tpmsd.physics.effect import Effect, Parameter


@dataclass(frozen=True)
class AntennaLeverArm(Effect):
    """Antenna at (forward, left) of its configured place; true minus configured, in the body's frame.

    Its velocity is the rear axle's plus yaw rate x arm: a forward arm turns the course into the bend, a left
    arm slows the antenna down in a left turn. Source: rigid-body kinematics.
    """

    name: ClassVar[str] = "antenna_lever_arm"
    sentence: ClassVar[str] = "the antenna is not where the configuration says"
    telling_drive: ClassVar[str] = "drive full circles at walking pace, to both sides, then bends at speed"
    shows_in: ClassVar[tuple[str, str]] = ("gnss_course", "yaw_rate")
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("forward_m", "m", 1.0, -20.0, 20.0, "true minus configured, along the body", probe=0.5),
        Parameter("left_m", "m", 0.3, -5.0, 5.0, "true minus configured, to the left", probe=0.2),
    )
    forward_m: float = 0.0
    left_m: float = 0.0

    def antenna_offset_m(self) -> tuple[float, float]:
        """(forward, left)."""
        return self.forward_m, self.left_m
