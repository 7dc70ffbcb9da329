"""Effects: an effect is a piece of physics that the pure rolling model leaves out.

In: nothing. Out: the base class `Effect`. An effect says everything that others know about it: what kind of
thing it is, its parameters with one prior each, and four records (`effect_records`): its words, where it
shows, its confounders, what enters nonlinearly. It overrides the one or two hooks through which it acts.
Hooks are pure and vectorised over time, so that simulator, estimator and diagnosis share them. A concrete
effect is a frozen dataclass in `tpmsd.car.physics.effects` whose fields are its parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

import numpy as np

from tpmsd.car.physics.effect_records import (
    Beside,
    Confounding,
    Grid,
    Identification,
    NoiseResemblance,
    Nonlinear,
    Rivals,
    SecondParameter,
    Wording,
    fold_attributes_into_records,
)
from tpmsd.car.physics.motion import Car, Motion
from tpmsd.car.physics.parameters import (
    MAX_ENTRIES,
    AnyParameter,
    GroupParameter,
    Parameter,
    Prior,
    Std,
    TextParameter,
    Value,
    VectorParameter,
    WheelParameter,
)
from tpmsd.foundation.errors import ConfigError
from tpmsd.foundation.wheels import WHEELS, FloatArray

__all__ = [
    "MAX_ENTRIES",
    "AnyParameter",
    "Beside",
    "Confounding",
    "Effect",
    "Grid",
    "GroupParameter",
    "Identification",
    "Kind",
    "NoiseResemblance",
    "Nonlinear",
    "Parameter",
    "Prior",
    "Rivals",
    "SecondParameter",
    "Std",
    "TextParameter",
    "Value",
    "VectorParameter",
    "WheelParameter",
    "Wording",
]


class Kind(Enum):
    """Kinds of effects."""

    PHYSICS = "physics"
    """Physics of tyres, car and road: the same on every drive."""
    INSTRUMENT = "instrument"
    """Instruments: receiver, gyro, counters and bus."""
    FAULT = "fault"
    """A tyre that changes: what the daemon watches, never compensated."""
    EVENT = "event"
    """Events of a span of time."""
    NONPARAMETRIC = "free"
    """A description without a formula."""
    NUISANCE = "nuisance"
    """Fitted along and never a finding: calibration, and what instruments always do."""


IMPOSSIBLE_SIGN = 4.0
"""Nats against a physically impossible sign, which a wrong configuration may show: odds of fifty."""
RARE = 4.0
"""Nats against what few drives show: odds of fifty."""


@dataclass(frozen=True)
class Effect:
    """One effect with its values. Sub-classes are frozen dataclasses with one field per parameter."""

    name: ClassVar[str]
    parameters: ClassVar[tuple[AnyParameter, ...]] = ()
    kind: ClassVar[Kind] = Kind.PHYSICS
    wording: ClassVar[Wording] = Wording()
    """The words for it."""
    identification: ClassVar[Identification] = Identification()
    """Channel and covariate in which it shows, and how it is looked for."""
    confounding: ClassVar[Confounding] = Confounding()
    """Effects and noise that it may be confounded with."""
    nonlinear: ClassVar[Nonlinear] = Nonlinear()
    """Parts of it that enter nonlinearly."""
    one_sign: ClassVar[bool] = False
    """True if only one sign is physically possible (positive) of its first parameter."""
    own_per_drive: ClassVar[bool] = False
    """True if each drive has a value of its own, and none is common to all."""
    common_to_all_drives: ClassVar[bool] = False
    """True if all drives have one value: none can have its own, as with the geometry of slopes."""
    in_calibration: ClassVar[tuple[tuple[str, str, str], ...]] = ()
    """Rows: its name in a joint calibration, what the number there is, and its unit."""
    stays: ClassVar[str] = ""
    """Reason why `--model` leaves it in the ticks, whatever the bus has; empty: it is taken out."""
    shortens: ClassVar[bool] = False
    """True if it is the geometry by which slopes shorten the horizontal: in every world there is."""

    def __post_init__(self) -> None:
        for parameter in self.parameters:
            value = getattr(self, parameter.name)
            if value is None:  # an optional parameter that was not given
                continue
            try:
                object.__setattr__(self, parameter.name, parameter.check(value))
            except ValueError as error:
                raise ConfigError(f"effect {self.name}: {error}") from None

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        fold_attributes_into_records(cls)

    @classmethod
    def observable(cls, motion: Motion, car: Car) -> bool:
        """Return whether this motion can show the effect; else it is no hypothesis on the drive."""
        return True

    @classmethod
    def limits(cls, car: Car) -> Mapping[str, tuple[float, float]]:
        """Return, by parameter, the least and greatest difference from neutral that a fit may find on this
        car.
        """
        numbers = (p for p in cls.parameters if isinstance(p, Parameter))
        return {p.name: (p.limits[0] - p.neutral, p.limits[1] - p.neutral) for p in numbers}

    @classmethod
    def summed_with(cls, car: Car) -> Mapping[str, str]:
        """Return, by parameter, the parameter of other effects that adds to it on the same wheels of this
        car; `limits` hold for the sum.
        """
        return {}

    @classmethod
    def acting_wheels(cls, car: Car, fitted: tuple[str, ...]) -> tuple[str, ...]:
        """Return the wheels on which it acts through these fitted parameters."""
        return WHEELS

    @classmethod
    def penalty(cls, value: float) -> float:
        """Return the penalty in nats on a first value (difference from neutral): rare values cost more."""
        of_sign = IMPOSSIBLE_SIGN if cls.one_sign and value < 0.0 else 0.0
        return of_sign + (RARE if cls.confounding.rare else 0.0)

    @classmethod
    def goes_before(cls, value: float) -> bool:
        """Return whether with this first value it is preferred, as the simpler one, to effects that contain
        it as their limit.
        """
        return True

    @classmethod
    def tolerance_note(cls, value: float, std: float, speeds: bool) -> str:
        """Return the note on a value within the tolerance of such instruments, which is no finding; empty
        where the value is beyond it.

        `speeds` says that the bus has wheel speeds and no counts.
        """
        return ""

    @classmethod
    def largest(cls, on: str) -> float:
        """Return, for a nonparametric term, the largest plausible value on wheels or a reading."""
        return 0.0

    @classmethod
    def fits_span(cls, slip: float, duration_s: float, driven: bool, axle: bool) -> bool:
        """Return, for an event, whether wheels that turn faster by this fraction for so long may show it.

        `driven` says whether all of the wheels are driven, `axle` whether they are both of an axle.
        """
        return False

    against, usual, completed_by = penalty, tolerance_note, summed_with
    """Former names: effects of users may call them of their base."""

    def not_compensated(self, signals: frozenset[str]) -> str | None:
        """Return why it stays in the ticks on a bus with these roles; None if it is taken out."""
        return self.stays or None

    def left_in(self) -> str | None:
        """Return what of it stays in the ticks although the rest is taken out; None if nothing."""
        return None

    def values(self) -> dict[str, Value]:
        """Parameters by name, without those that are optional and not given."""
        pairs = ((p.name, getattr(self, p.name)) for p in self.parameters)
        return {name: value for name, value in pairs if value is not None}

    def unit_of(self, parameter: str) -> str:
        """Return the unit of one of its parameters; empty where it has none."""
        return next(p.unit for p in self.parameters if p.name == parameter)

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) change of the effective rolling radii in metres."""
        return np.zeros((len(motion), 4))

    def wheel_slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) s in omega * r = v * (1 + s)."""
        return np.zeros((len(motion), 4))

    def axle_course_rad(self, motion: Motion) -> FloatArray:
        """(n,) course of the rear axle's middle minus the body's heading, counter-clockwise."""
        return np.zeros(len(motion))

    def horizontal_factor(self, motion: Motion) -> FloatArray:
        """(n,) horizontal distance per distance along the road."""
        return np.ones(len(motion))

    def fix_age_s(self) -> float:
        """Return the age of a fix on arrival beyond the configured one, s."""
        return 0.0

    def velocity_age_s(self) -> float:
        """Return how much older a fix's speed and course are than its position, s."""
        return 0.0

    def grade_factor(self) -> float:
        """Return the slopes that the wheels feel over those that the reference shows, a ratio."""
        return 1.0

    def wheels_time_constant_s(self) -> float:
        """Time constant of the low-pass behind which all wheels' speeds are shown; 0 where there is none."""
        return 0.0

    def antenna_offset_m(self) -> tuple[float, float]:
        """Return (forward, left), m: true minus configured position of the antenna."""
        return 0.0, 0.0

    def track_error_m(self) -> tuple[float, float]:
        """Return (front, rear), m: true minus configured track."""
        return 0.0, 0.0

    def read_yaw_rate(self, true_radps: FloatArray) -> FloatArray:
        """Return what the gyro reads when the car turns at `true_radps`; same shape."""
        return true_radps

    def yaw_rate_error_radps(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) error of the gyro that depends on the motion, on top of `read_yaw_rate`."""
        return np.zeros(len(motion))

    def accel_error_mps2(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 2) error of the accelerometers (forward, left): reading less specific force on a level road."""
        return np.zeros((len(motion), 2))

    def steering_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """Return (n,) the steering sensor's reading less ratio * atan(wheelbase * curvature), rad."""
        return np.zeros(len(motion))

    def clock_error_s(self, time_s: FloatArray) -> FloatArray:
        """(n,) host's clock minus UTC, beyond a constant, by the time since the drive's start."""
        return np.zeros_like(time_s)

    def gnss_speed_error_mps(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) speed that the receiver reports minus that of its antenna."""
        return np.zeros(len(motion))

    def gnss_course_error_rad(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) course that the receiver reports minus that of its antenna, counter-clockwise."""
        return np.zeros(len(motion))

    def tooth_angle_error_rad(self, angle_rad: FloatArray, wheel: int) -> FloatArray:
        """Angle that the counter shows minus the angle turned, by the wheel's own angle; same shape."""
        return np.zeros_like(angle_rad)

    def true_teeth_per_rev(self, wheel: int) -> float | None:
        """Return the wheel's true counts per revolution; None where they are as configured."""
        return None
