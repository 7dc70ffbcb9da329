"""Rules for single values of the configuration: a number in a range, a choice, a path, ...

In: a value as `tomllib` gives it. Out: the value in the type of `tpmsd.car.config.model`, or `BadValueError`
with what was found and what is allowed. A rule knows neither file nor key.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Protocol

from tpmsd.car.config.problems import STEERS, BadValueError, show
from tpmsd.car.config.suggest import nearest

# Values that are right in another unit: what they must be multiplied by, and the confusion's name.
_OTHER_UNITS = {
    "m": ((1e-3, "m, not mm"), (1e-2, "m, not cm")),
    "s": ((1e-3, "s, not ms"),),
    "share": ((1e-2, "a share, not per cent"),),
}
_UNIX_SOCKET_BYTES = 107  # sun_path of Linux without its closing zero


TYRE_SIZE = re.compile(r"(?:P|LT)?(\d{3})/(\d{2,3})\s?Z?RF?(\d{2}(?:\.5)?)C?\b", re.IGNORECASE)
"""Width in mm, height in per cent of it, rim in inches; load index and speed symbol may follow."""
_SIZE_ALLOWED = "a size as on the side wall, such as '205/60R15'"


class Rule(Protocol):
    """Rule that a value must meet."""

    def read(self, value: object) -> object:
        """Return the value in its final type; raises `BadValueError`."""


@dataclass(frozen=True, slots=True)
class Number:
    """A finite number from `low` to `high`; a bound that is `open` is not itself allowed."""

    low: float
    high: float
    unit: str = ""
    open: bool = False

    def read(self, value: object) -> float:
        """Return the value as float; BadValueError if it is no finite number in the range."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            suggestion = None
            if isinstance(value, str) and self._holds(_number_in(value)):
                suggestion = f"{_number_in(value):g} without quotes"
            raise BadValueError("not a number", show(value), self.allowed, suggestion)
        if isinstance(value, float) and not math.isfinite(value):
            raise BadValueError("not a finite number", show(value), self.allowed)
        if not self._holds(value):
            raise BadValueError("out of range", show(value), self.allowed, self._in_other_unit(value))
        return float(value)

    @property
    def allowed(self) -> str:
        """Return the range in words."""
        unit = f" {self.unit}" if self.unit and self.unit != "share" else ""
        if self.open:
            return f"above {self.low:.10g} and below {self.high:.10g}{unit}"
        return f"{self.low:.10g} to {self.high:.10g}{unit}"

    def _holds(self, value: float) -> bool:
        return self.low < value < self.high if self.open else self.low <= value <= self.high

    def _in_other_unit(self, value: float) -> str | None:
        """Return the value in the unit that it was probably given in, as a suggestion; None if no unit
        fits."""
        for factor, confusion in _OTHER_UNITS.get(self.unit, ()):
            if 1.5 < abs(value) < 1e9 and self._holds(value * factor):
                return f"{value * factor:g} ({confusion})"
        return None


@dataclass(frozen=True, slots=True)
class WholeNumber:
    """A whole number from `low` to `high`; `base` 16 or 8 shows the range as such files write it."""

    low: int
    high: int
    base: int = 10

    def read(self, value: object) -> int:
        """Return the value as int, also of 115200.0; BadValueError if it is no whole number in the range."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BadValueError("not a whole number", show(value), self.allowed)
        if isinstance(value, float) and not value.is_integer():  # NaN and the infinities are none either
            raise BadValueError("not a whole number", show(value), self.allowed)
        if not self.low <= value <= self.high:
            raise BadValueError("out of range", show(value), self.allowed, self._octal_meant(value))
        return int(value)

    @property
    def allowed(self) -> str:
        """Return the range in words."""
        form = {10: "d", 16: "#X", 8: "#o"}[self.base]
        return f"{self.low:{form}} to {self.high:{form}}".replace("0X", "0x")

    def _octal_meant(self, value: float) -> str | None:
        """Return the digits as an octal number, as a suggestion; None if they are none."""
        digits = str(int(value)) if self.base == 8 and 0 <= value < 10_000 else ""
        return (
            f"0o{digits}"
            if digits and set(digits) <= set("01234567") and int(digits, 8) <= self.high
            else None
        )


@dataclass(frozen=True, slots=True)
class Flag:
    """True or false."""

    def read(self, value: object) -> bool:
        """Return the value; BadValueError if it is neither true nor false."""
        if not isinstance(value, bool):
            raise BadValueError("not a flag", show(value), "true or false")
        return value


@dataclass(frozen=True, slots=True)
class Choice:
    """One of a few words."""

    words: tuple[str, ...]

    def read(self, value: object) -> str:
        """Return the value; BadValueError if it is none of `words`."""
        if value not in self.words:
            suggestion = nearest(value, self.words) if isinstance(value, str) else None
            raise BadValueError("not one of the choices", show(value), " | ".join(self.words), suggestion)
        return str(value)


@dataclass(frozen=True, slots=True)
class Text:
    """A text that is not empty."""

    def read(self, value: object) -> str:
        """Return the text without blanks around it."""
        return _nonempty_text(value, "a text in quotes").strip()


@dataclass(frozen=True, slots=True)
class IncreasingNumbers:
    """List of at least two numbers, each greater than the one before."""

    each: Number

    def read(self, value: object) -> tuple[float, ...]:
        """Return the numbers; BadValueError if the value is no list of 2 to 50 that rise."""
        allowed = f"a list of 2 to 50 rising numbers, {self.each.allowed}"
        if not isinstance(value, list):
            raise BadValueError("not a list", show(value), allowed)
        numbers = tuple(self.each.read(one) for one in value)
        if not 2 <= len(numbers) <= 50:
            raise BadValueError("too short" if len(numbers) < 2 else "too long", show(value), allowed)
        if any(later <= earlier for earlier, later in pairwise(numbers)):
            raise BadValueError("not rising", show(value), allowed)
        return numbers


@dataclass(frozen=True, slots=True)
class Words:
    """A list of texts; `choices`: what they may be, anything where there are none."""

    most: int
    choices: tuple[str, ...] = ()

    def read(self, value: object) -> tuple[str, ...]:
        """Return the texts; BadValueError if the value is no list of them, or one is no choice."""
        allowed = f"a list of up to {self.most} texts" + (
            f" of {' '.join(self.choices)}" if self.choices else ""
        )
        if not isinstance(value, list) or len(value) > self.most:
            raise BadValueError("not a list", show(value), allowed)
        for one in value:
            if not isinstance(one, str) or "\0" in one or (self.choices and one not in self.choices):
                raise BadValueError("not one of the texts that may stand here", show(one), allowed)
        if value and not value[0]:
            raise BadValueError("empty", show(value), allowed)
        return tuple(value)


@dataclass(frozen=True, slots=True)
class TyreSize:
    """A tyre's size as on its side wall."""

    def read(self, value: object) -> str:
        """Return the size without blanks around it; BadValueError if it is none."""
        text = _nonempty_text(value, _SIZE_ALLOWED).strip()
        if TYRE_SIZE.match(text) is None:
            raise BadValueError("not a tyre's size", show(text), _SIZE_ALLOWED)
        return text


@dataclass(frozen=True, slots=True)
class ChannelName:
    """A CAN channel: a name such as can0, or a number as some interfaces have it."""

    def read(self, value: object) -> str:
        """Return the channel's name; BadValueError if the value is none."""
        if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 256:
            return str(value)
        return _nonempty_text(value, "a text in quotes such as 'can0', or a number from 0 to 255").strip()


@dataclass(frozen=True, slots=True)
class FilePath:
    """A path; relative ones are relative to `folder`, '~' is the home."""

    folder: Path
    may_be_empty: bool = False
    """An empty text stands for 'no file' and becomes None."""
    socket: bool = False

    def read(self, value: object) -> Path | None:
        """Return the path, relative to the folder of the configuration if it is not absolute."""
        if self.may_be_empty and value == "":
            return None
        text = _nonempty_text(value, "a path in quotes" + (", or '' for none" if self.may_be_empty else ""))
        if "\0" in text:
            raise BadValueError("not a path", show(text), "a path without a zero byte")
        try:
            path = self.folder / Path(text).expanduser()
        except RuntimeError as error:
            raise BadValueError(f"not a path ({error})", show(text)) from None
        length = len(str(path).encode(errors="surrogateescape"))
        if self.socket and length > _UNIX_SOCKET_BYTES:
            raise BadValueError(
                "too long for a socket", f"{length} bytes", f"at most {_UNIX_SOCKET_BYTES} bytes"
            )
        return path


@dataclass(frozen=True, slots=True)
class SignalName:
    """'Message.Signal' as the DBC names them."""

    def read(self, value: object) -> str:
        """Return the name without blanks around it."""
        text = _nonempty_text(value, "'Message.Signal' as in the DBC").strip()
        parts = text.split(".")
        if len(parts) != 2 or not all(part and not any(c.isspace() for c in part) for part in parts):
            raise BadValueError("not a signal's name", show(text), "'Message.Signal' as in the DBC")
        return text


def _nonempty_text(value: object, allowed: str) -> str:
    if not isinstance(value, str):
        raise BadValueError("not a text", show(value), allowed)
    if not value.strip():
        raise BadValueError("empty", show(value), allowed)
    if STEERS.search(value):
        raise BadValueError("it holds control characters", show(value), allowed)
    return value


def _number_in(text: str) -> float:
    """Return the number that a text states, with comma or point; NaN if none."""
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return math.nan
