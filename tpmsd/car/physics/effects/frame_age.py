"""The frames of one axle's wheels are a little older than those of the other."""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Kind, Parameter, Prior
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording
from tpmsd.car.physics.effects.message_delay import MessageDelay

USUAL_S = 5e-3
"""Up to this age it is usual: wheels that a control unit reads at once, every 5 to 20 ms, are sent in two
frames that are stamped one after the other (0.25 ms at 500 kbit/s, more behind frames of higher priority)."""
OWN = 6.0
"""Nats by which it goes before an effect that explains as much, as the usual lag of receivers does: slip of
less than a tenth of the usual one is rarer than frames of two ages."""


@dataclass(frozen=True)
class FrameAge(MessageDelay):
    """The front wheels' counts were read `front_s` earlier, seen from their stamps, than the rear ones'.

    It needs no accelerometer: within its limits it is far below what slip does. Without it, slip of 1e-5 s2/m
    is found, which follows the car's acceleration and not the pull of slopes, so that slopes seem unfelt.
    Source: two frames of 125 bits at 500 kbit/s, tasks of control units.
    """

    name = "frame_age"
    kind = Kind.NUISANCE
    wording = Wording(
        formula="front wheels show v(t - front_s)",
        sentence="the front wheels' frames are not as old as the rear ones'",
        noun="frames of unequal age",
        answers=(
            "the front wheels' frames are {front_s:size ms} {front_s:older|younger} than the rear ones'",
        ),
    )
    identification = Identification(
        shows_in=("wheel_ratio", "accel_long"), needs=("both_axles",), contrast=True
    )
    # The same column, which counts once where the noise is estimated beside everything.
    confounding = Confounding(mirror_of="message_delay")
    parameters = (
        Parameter(
            "front_s",
            "s",
            1e-3,
            -USUAL_S,
            USUAL_S,
            "age of the front wheels' frames beyond that of the rear ones'",
            probe=0.001,
            prior=Prior(0.0, 1e-3, "two frames of one reading"),
        ),
    )
    front_s: float

    @classmethod
    def penalty(cls, value: float) -> float:
        """Return `OWN` in its favour, whatever its age within the limits."""
        return -OWN

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note: it is always the bus's own making."""
        return (
            f"the front wheels' frames are {value * 1e3:.2f} +- {std * 1e3:.2f} ms older than the rear ones';"
            " taken into account"
        )
