"""The catalogue of effects by name.

In: an effect's name and its parameters. Out: the `Effect`. To add one: write its file in
`tpmsd/physics/effects` and list its class here; simulator, model files and diagnosis then know it.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from tpmsd.errors import ConfigError
from tpmsd.physics.effect import AnyParameter, Effect, Value
from tpmsd.physics.effects.antenna_lever_arm import AntennaLeverArm
from tpmsd.physics.effects.centrifugal_growth import CentrifugalGrowth
from tpmsd.physics.effects.gnss_latency import GnssLatency
from tpmsd.physics.effects.lateral_slip import LateralSlip
from tpmsd.physics.effects.load_transfer_lateral import LoadTransferLateral
from tpmsd.physics.effects.load_transfer_longitudinal import LoadTransferLongitudinal
from tpmsd.physics.effects.longitudinal_slip import LongitudinalSlip
from tpmsd.physics.effects.radius_change import RadiusChange
from tpmsd.physics.effects.road_grade import RoadGrade
from tpmsd.physics.effects.thermal_growth import ThermalGrowth
from tpmsd.physics.effects.tone_ring_error import ToneRingError
from tpmsd.physics.effects.track_width_error import TrackWidthError
from tpmsd.physics.effects.unknown import Unknown
from tpmsd.physics.effects.yaw_rate_bias import YawRateBias
from tpmsd.physics.effects.yaw_rate_scale import YawRateScale

_CLASSES: tuple[type[Effect], ...] = (
    RadiusChange,
    CentrifugalGrowth,
    ThermalGrowth,
    LoadTransferLongitudinal,
    LoadTransferLateral,
    LongitudinalSlip,
    LateralSlip,
    RoadGrade,
    GnssLatency,
    AntennaLeverArm,
    TrackWidthError,
    ToneRingError,
    YawRateBias,
    YawRateScale,
    Unknown,
)

EFFECTS: dict[str, type[Effect]] = {cls.name: cls for cls in _CLASSES}


def parameters_of(name: str) -> dict[str, AnyParameter]:
    """The parameters of an effect by name; ConfigError if there is no such effect."""
    if name not in EFFECTS:
        raise ConfigError(f"unknown effect {name!r}{_did_you_mean(name, EFFECTS)}")
    return {parameter.name: parameter for parameter in EFFECTS[name].parameters}


def make_effect(name: str, **params: object) -> Effect:
    """Build an effect; numbers may come as text. One-line ConfigError on what is unknown or out of bounds."""
    known = parameters_of(name)
    for key in params:
        if key not in known:
            listed = " ".join(known) or "it has none"
            raise ConfigError(
                f"effect {name}: unknown parameter {key!r}{_did_you_mean(key, known)} (parameters: {listed})"
            )
    try:
        return EFFECTS[name](**params)
    except TypeError:
        missing = " ".join(sorted(key for key in known if key not in params))
        raise ConfigError(f"effect {name}: a required parameter is missing (not given: {missing})") from None


def parse_effect(text: str) -> Effect:
    """Build an effect from `name:param=value,param=value`, as on the command line; else ConfigError."""
    name, _, rest = text.strip().partition(":")
    params: dict[str, Value] = {}
    for part in filter(None, (piece.strip() for piece in rest.split(","))):
        key, equals, value = part.partition("=")
        if not equals:
            raise ConfigError(f"effect {name}: {part!r} is not of the form parameter=value")
        params[key.strip()] = value.strip()
    return make_effect(name.strip(), **params)


def _did_you_mean(word: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, list(known), n=1)
    return f", did you mean {close[0]!r}?" if close else ""
