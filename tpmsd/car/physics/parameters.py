"""Parameters of effects: numbers, wheels, words and lists of numbers, each with what it may be.

In: values as numbers or text. Out: checked values, or a ValueError with the reason.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tpmsd.car.physics.spans import wheel_mask
from tpmsd.foundation.wheels import WHEELS

Value = float | str | tuple[float, ...]
Std = float | tuple[float, ...]
"""Standard deviation of a number, or of each entry of a vector."""


MAX_ENTRIES = 200
"""Index of a vector's component."""


@dataclass(frozen=True, slots=True)
class Prior:
    """Prior of a parameter: that of cars in good order, with its source."""

    mean: float
    std: float
    source: str


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number that belongs to an effect."""

    name: str
    unit: str
    typical: float
    """A size met on ordinary cars: a start for a fit, an example for a user."""
    lower: float
    upper: float
    """Both inclusive: what is physically possible, with room."""
    description: str = ""
    probe: float = 0.0
    """A difference from neutral in which the effect is linear, so that the diagnosis fits it; 0: it does not,
    and takes the typical value."""
    neutral: float = 0.0
    """The value with which the effect does nothing."""
    prior: Prior | None = None
    """None of what has no usual size: an onset, a duration."""
    fitted: tuple[float, float] | None = None
    """Least and greatest value that a fit may find, where that is less than the parameter takes."""

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest value that is physically possible."""
        return (self.lower, self.upper) if self.fitted is None else self.fitted

    def check(self, value: object) -> Value:
        """Return the value as it is stored; ValueError with the reason if it cannot be one."""
        number = _read_number(self.name, value, finite=False)
        if not math.isfinite(number) or not self.lower <= number <= self.upper:
            raise ValueError(
                f"{self.name} = {number:g} is outside {self.lower:g} to {self.upper:g} {self.unit}".rstrip()
            )
        return number


@dataclass(frozen=True, slots=True)
class WheelParameter:
    """The wheel an effect sits on: one of `fl fr rl rr`, or several of them."""

    name: str = "wheel"
    unit: str = ""
    description: str = "which wheel"
    several: bool = False
    """True if it may name several, with blanks between."""

    def check(self, value: object) -> Value:
        """Return the wheel's name or names, in order; ValueError with the reason if there is no
        such wheel.
        """
        words = str(value).split() if self.several else [value]
        if not words or not set(words) <= set(WHEELS):
            raise ValueError(f"{self.name} = {value!r} is not one of {' '.join(WHEELS)}")
        return " ".join(wheel for wheel in WHEELS if wheel in words)


@dataclass(frozen=True, slots=True)
class TextParameter:
    """A word or a list of words; the effect itself checks which."""

    name: str
    typical: str
    description: str = ""
    unit: str = ""

    def check(self, value: object) -> Value:
        """Return the text, blanks put in order; ValueError if it is none."""
        if not isinstance(value, str) or not value.strip():
            raise ValueError(f"{self.name} = {value!r} is not a name")
        return " ".join(value.split())


@dataclass(frozen=True, slots=True)
class GroupParameter(TextParameter):
    """Wheels by name or group: `rl rr`, `rear`, `all`."""

    def check(self, value: object) -> Value:
        """Return the names, blanks put in order; ValueError with the reason if there is no such wheel or
        group.
        """
        names = str(TextParameter.check(self, value))
        wheel_mask(names)
        return names


@dataclass(frozen=True, slots=True)
class VectorParameter:
    """Several numbers in a row."""

    name: str
    typical: tuple[float, ...]
    description: str = ""
    unit: str = ""
    """Empty where it depends on the effect's other parameters."""

    def check(self, value: object) -> Value:
        """Return the numbers; from text, they stand between blanks. ValueError with the reason if they are
        none.
        """
        entries: Sequence[object]
        if isinstance(value, str):
            entries = value.split()
        elif isinstance(value, (list, tuple, np.ndarray)):
            entries = list(value)
        else:
            raise ValueError(f"{self.name} = {value!r} is not a list of numbers")
        if not 2 <= len(entries) <= MAX_ENTRIES:
            raise ValueError(f"{self.name} has {len(entries)} entries, 2 to {MAX_ENTRIES} are wanted")
        return tuple(_read_number(f"{self.name}[{k}]", entry) for k, entry in enumerate(entries))


AnyParameter = Parameter | WheelParameter | TextParameter | VectorParameter


def _read_number(name: str, value: object, finite: bool = True) -> float:
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
