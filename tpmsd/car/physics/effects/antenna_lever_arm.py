"""The antenna is not where the configuration says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.motion import Car
from tpmsd.car.physics.priors import ANTENNA_FORWARD_M

BEHIND_M, SIDEWAYS_M = 1.5, 1.2
"""Reach of a car's roof behind the rear axle, before the front one and off the middle, m."""


@dataclass(frozen=True)
class AntennaLeverArm(Effect):
    """Antenna at (forward, left) of its configured place; true minus configured, in the body's frame.

    Its velocity is the rear axle's plus yaw rate x arm: a forward arm turns the course into the bend, a left
    arm slows the antenna down in a left turn. Source: rigid-body kinematics.
    """

    name = "antenna_lever_arm"
    kind = Kind.INSTRUMENT
    wording = Wording(
        formula="antenna at (forward_m, left_m) from its configured place",
        sentence="the antenna is not where the configuration says",
        noun="an antenna out of place",
        answers=(
            "the antenna is {forward_m:size m} further {forward_m:ahead|back} than configured",
            "the antenna is {left_m:size m} further to the {left_m:left|right} than configured",
        ),
        distinguished_by="drive full circles at walking pace, to both sides, then bends at speed",
    )
    identification = Identification(shows_in=("gnss_course", "yaw_rate"), needs=("gnss",))
    confounding = Confounding(estimated_jointly_with=("lateral_slip", "gnss_latency"))
    in_calibration = (
        ("antenna_forward", "forward_m", "m"),
        ("antenna_left", "left_m", "m"),
    )
    parameters = (
        Parameter(
            "forward_m",
            "m",
            1.0,
            -20.0,
            20.0,
            "true minus configured, along the body",
            probe=0.5,
            prior=ANTENNA_FORWARD_M,
        ),
        Parameter(
            "left_m",
            "m",
            0.3,
            -5.0,
            5.0,
            "true minus configured, to the left",
            probe=0.2,
            prior=Prior(0.0, 0.2, "a tape measure across a roof"),
        ),
    )
    forward_m: float = 0.0
    left_m: float = 0.0

    def antenna_offset_m(self) -> tuple[float, float]:
        """(forward, left)."""
        return self.forward_m, self.left_m

    @classmethod
    def limits(cls, car: Car) -> Mapping[str, tuple[float, float]]:
        """Return the bounds within which the antenna lies on the car's roof."""
        ahead, left = car.antenna_forward_m, car.antenna_left_m
        longest = car.geometry.wheelbase_m + BEHIND_M
        return {
            "forward_m": (-BEHIND_M - ahead, longest - ahead),
            "left_m": (-SIDEWAYS_M - left, SIDEWAYS_M - left),
        }
