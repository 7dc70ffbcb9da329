"""What an effect is: a piece of physics that the pure rolling model leaves out.

In: nothing. Out: `Parameter` and its kin, and the base class `Effect` with its hooks. An effect
overrides the one or two hooks through which it acts; the others are neutral. Hooks are pure and vectorised
over time, so that simulator, estimator and diagnosis share them. A concrete effect is a frozen dataclass in
`tpmsd.physics.effects` whose fields are its parameters.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tpmsd.errors import ConfigError
from tpmsd.physics.motion import Car, Motion
from tpmsd.wheels import WHEELS, FloatArray

Value = float | str | tuple[float, ...]
Std = float | tuple[float, ...]
"""Standard deviation of a number, or of each entry of a vector."""


MAX_ENTRIES = 200
"""Of a vector."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number that belongs to an effect."""

    name: str
    unit: str
    typical: float
    """A size met on ordinary cars: a start for a fit, an example for a user."""
    lower: float
    upper: float
    """Both inclusive: what is physically thinkable, with room."""
    description: str = ""
    probe: float = 0.0
    """A difference from neutral in which the effect is linear, so that the diagnosis fits it; 0: it does not,
    and takes the typical value."""
    neutral: float = 0.0
    """The value with which the effect does nothing."""

    def check(self, value: object) -> Value:
        """The value as it is stored; ValueError with the reason if it cannot be one."""
        number = _number(self.name, value, finite=False)
        if not math.isfinite(number) or not self.lower <= number <= self.upper:
            raise ValueError(
                f"{self.name} = {number:g} is outside {self.lower:g} to {self.upper:g} {self.unit}".rstrip()
            )
        return number


@dataclass(frozen=True, slots=True)
class WheelParameter:
    """The wheel an effect sits on: one of `fl fr rl rr`."""

    name: str = "wheel"
    unit: str = ""
    description: str = "which wheel"

    def check(self, value: object) -> Value:
        """The wheel's name; ValueError with the reason if there is no such wheel."""
        if value not in WHEELS:
            raise ValueError(f"{self.name} = {value!r} is not one of {' '.join(WHEELS)}")
        return str(value)


@dataclass(frozen=True, slots=True)
class TextParameter:
    """A word or a list of words; the effect itself checks which."""

    name: str
    typical: str
    description: str = ""
    unit: str = ""

    def check(self, value: object) -> Value:
        """The text, blanks put in order; ValueError if it is none."""
        if not isinstance(value, str) or not value.strip():
            raise ValueError(f"{self.name} = {value!r} is not a name")
        return " ".join(value.split())


@dataclass(frozen=True, slots=True)
class VectorParameter:
    """Several numbers in a row."""

    name: str
    typical: tuple[float, ...]
    description: str = ""
    unit: str = ""
    """Empty where it depends on the effect's other parameters."""

    def check(self, value: object) -> Value:
        """The numbers; from text, they stand between blanks. ValueError with the reason if they are none."""
        entries: Sequence[object]
        if isinstance(value, str):
            entries = value.split()
        elif isinstance(value, (list, tuple, np.ndarray)):
            entries = list(value)
        else:
            raise ValueError(f"{self.name} = {value!r} is not a list of numbers")
        if not 2 <= len(entries) <= MAX_ENTRIES:
            raise ValueError(f"{self.name} has {len(entries)} entries, 2 to {MAX_ENTRIES} are wanted")
        return tuple(_number(f"{self.name}[{k}]", entry) for k, entry in enumerate(entries))


AnyParameter = Parameter | WheelParameter | TextParameter | VectorParameter


def _number(name: str, value: object, finite: bool = True) -> float:
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            raise ValueError(f"{name} = {value!r} is not a number") from None
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        raise ValueError(f"{name} = {value!r} is not a number")
    if finite and not math.isfinite(value):
        raise ValueError(f"{name} = {float(value)} is not a finite number")
    return float(value)


@dataclass(frozen=True)
class Effect:
    """One effect with its values. Sub-classes are frozen dataclasses with one field per parameter."""

    name: ClassVar[str]
    parameters: ClassVar[tuple[AnyParameter, ...]] = ()
    sentence: ClassVar[str] = ""
    """What it is, as a clause for reports; the docstring's first line where it is empty."""
    telling_drive: ClassVar[str] = ""
    """What to drive so that it shows beside what resembles it."""
    shows_in: ClassVar[tuple[str, str]] = ("wheel", "speed")
    """Channel and covariate over which it shows: wheel, wheel_ratio, gnss_speed, gnss_course, yaw_rate."""
    one_sign: ClassVar[bool] = False
    """Whether nature knows but one sign (positive) of its first parameter."""
    ratio_limits: ClassVar[tuple[float, float] | None] = None
    """Of its second parameter to its first, the least and the greatest that nature knows, if it has such."""

    def __post_init__(self) -> None:
        for parameter in self.parameters:
            value = getattr(self, parameter.name)
            if value is None:  # an optional parameter that was not given
                continue
            try:
                object.__setattr__(self, parameter.name, parameter.check(value))
            except ValueError as error:
                raise ConfigError(f"effect {self.name}: {error}") from None

    def values(self) -> dict[str, Value]:
        """Parameters by name, without those that are optional and not given."""
        pairs = ((p.name, getattr(self, p.name)) for p in self.parameters)
        return {name: value for name, value in pairs if value is not None}

    def unit_of(self, parameter: str) -> str:
        """The unit of one of its parameters; empty where it has none."""
        return next(p.unit for p in self.parameters if p.name == parameter)

    def radius_change_m(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) change of the effective rolling radii in metres."""
        return np.zeros((len(motion), 4))

    def slip(self, motion: Motion, car: Car) -> FloatArray:
        """(n, 4) s in omega * r = v * (1 + s)."""
        return np.zeros((len(motion), 4))

    def axle_course_rad(self, motion: Motion) -> FloatArray:
        """(n,) course of the rear axle's middle minus the body's heading, counter-clockwise."""
        return np.zeros(len(motion))

    def horizontal_factor(self, motion: Motion) -> FloatArray:
        """(n,) horizontal distance per distance along the road."""
        return np.ones(len(motion))

    def fix_age_s(self) -> float:
        """Age of a fix on arrival beyond the configured one."""
        return 0.0

    def antenna_offset_m(self) -> tuple[float, float]:
        """(forward, left): where the antenna is minus where the configuration says."""
        return 0.0, 0.0

    def track_error_m(self) -> tuple[float, float]:
        """(front, rear): true track minus configured one."""
        return 0.0, 0.0

    def read_yaw_rate(self, true_radps: FloatArray) -> FloatArray:
        """What the gyro reads when the car turns at `true_radps`; same shape."""
        return true_radps

    def yaw_rate_error_radps(self, motion: Motion, car: Car) -> FloatArray:
        """(n,) what the gyro reads more than `read_yaw_rate` says, by the motion."""
        return np.zeros(len(motion))

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
        """The wheel's true counts per revolution; None where they are as configured."""
        return None
