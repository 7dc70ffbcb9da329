"""Records and arrays in the types of JSON.

In: any object of the program. Out: dicts, lists, texts, numbers and None; NaN and infinities become None.
"""

from __future__ import annotations

import dataclasses
import enum
import math
from pathlib import Path
from typing import Any, TypeVar

MAX_REPR_CHARS = 800
"""Length of a record's `repr`: a screen of text at most."""
_FEW = 4
"""A collection of so few numbers or short texts is shown whole."""
_SHORT_CHARS = 60
Record = TypeVar("Record", bound=type)


def with_unit(number: str, unit: str) -> str:
    """Return a number's text with its unit; the unit of a pure number, `1`, is not printed."""
    return f"{number} {unit}" if unit not in ("", "1") else number


def brief(record: Record) -> Record:
    """Set the `repr` of a dataclass to one line with the sizes of arrays and collections; return the
    class."""

    def line(self: Any) -> str:
        shown = [f"{f.name}={_short_repr(getattr(self, f.name))}" for f in dataclasses.fields(self) if f.repr]
        text = f"{type(self).__name__}({', '.join(shown)})"
        return text if len(text) <= MAX_REPR_CHARS else f"{text[: MAX_REPR_CHARS - 4]}...)"

    record.__repr__ = line  # type: ignore[method-assign, assignment]
    return record


def _short_repr(value: Any) -> str:
    if isinstance(value, str | bool | int | float | Path | enum.Enum) or value is None:
        text = repr(value)
        return text if len(text) <= _SHORT_CHARS else f"{text[: _SHORT_CHARS - 3]}..."
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"<array {value.shape}>"
    if isinstance(value, list | tuple | dict | set | frozenset):
        whole = repr(value) if len(value) <= _FEW and not isinstance(value, dict) else ""
        simple = all(isinstance(one, str | bool | int | float) for one in value)
        return whole if whole and simple and len(whole) <= _SHORT_CHARS else f"<{len(value)} items>"
    return f"<{type(value).__name__}>"


def plain(obj: Any) -> Any:
    """Return `obj` in the types of JSON: records become objects, arrays lists, NaN and infinities None.

    TypeError for what JSON has no form for.
    """
    if isinstance(obj, enum.Enum):
        return plain(obj.value)
    if obj is None or isinstance(obj, bool | str):
        return obj
    if isinstance(obj, int):
        return int(obj)
    if isinstance(obj, float):
        return float(obj) if math.isfinite(obj) else None
    if dataclasses.is_dataclass(obj) and not isinstance(obj, type):
        return {f.name: plain(getattr(obj, f.name)) for f in dataclasses.fields(obj)}
    if isinstance(obj, dict):
        return {str(key): plain(value) for key, value in obj.items()}
    if isinstance(obj, list | tuple | set | frozenset):
        return [plain(value) for value in obj]
    if isinstance(obj, Path):
        return str(obj)
    if hasattr(obj, "tolist"):  # numpy arrays and scalars, without importing numpy here
        return plain(obj.tolist())
    raise TypeError(f"cannot be written as JSON: {type(obj).__name__}")


def finite(value: float) -> float | None:
    """Return `value`, or None where JSON has no number for it (NaN, infinity)."""
    return float(value) if math.isfinite(value) else None


def number(value: object) -> float | None:
    """Return a finite number that came as JSON; None for anything else, truth values and text too."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return finite(value)
    except OverflowError:  # an integer of 400 digits has no float
        return None


def millimetres(length_m: float) -> float | None:
    """Return `length_m` in mm, rounded to a nanometre; None where it is not finite."""
    return round(1e3 * float(length_m), 6) if math.isfinite(length_m) else None
