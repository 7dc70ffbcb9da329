"""Common part of errors of the bus's own wheel speeds.

In: nothing. Out: the base class of such effects.
"""

from __future__ import annotations

from dataclasses import dataclass

from tpmsd.car.physics.effect import Effect, Kind, NoiseResemblance
from tpmsd.car.physics.effect_records import Confounding, Identification, Wording


@dataclass(frozen=True)
class SpeedSignalFault(Effect):
    """All wheels are read alike, so that only the receiver shows it, and only on a bus without counts."""

    kind = Kind.INSTRUMENT
    wording = Wording(distinguished_by="hold several speeds from 5 to 35 m/s for a minute each")
    identification = Identification(shows_in=("wheel", "speed"), needs=("speeds", "gnss"))
    confounding = Confounding(resembles=NoiseResemblance.COMMON)
