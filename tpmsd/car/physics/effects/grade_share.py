"""Slopes by the receiver's heights are larger or smaller than the wheels feel."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Identification, Wording


@dataclass(frozen=True)
class GradeShare(Effect):
    """The wheels feel `share` of the slopes that the receiver's heights show.

    Heights drift by metres: on a flat road that looks like slopes, and slip or load transfer by the pull of
    these slopes would be missing. Source: errors in variables attenuate a slope (Fuller, Measurement Error
    Models, 1987, section 1.1).
    """

    name = "grade_share"
    kind = Kind.NUISANCE
    wording = Wording(
        formula="grade = share * grade by heights",
        sentence="slopes by the receiver's heights are not those that the wheels feel",
    )
    identification = Identification(shows_in=("wheel_ratio", "grade"), needs=("heights",))
    parameters = (
        Parameter(
            "share",
            "1",
            0.8,
            -0.5,
            2.0,
            "slope felt over slope shown",
            probe=0.1,
            neutral=1.0,
            prior=Prior(1.0, 0.3, "attenuation by heights of 3 m over 12 s"),
        ),
    )
    share: float

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on the share: it is the receiver's error, never a finding."""
        return (
            f"the wheels feel {1.0 + value:.2f} +- {std:.2f} of the slopes that the receiver's heights show;"
            " taken into account"
        )

    def grade_factor(self) -> float:
        """Return the share."""
        return self.share
