"""TOML as users write it, bounded before it is parsed.

In: the text of a file. Out: its data, or a ValueError with a reason of one line. `tomllib` takes time and
memory with the square of the parts of a key, and reads integers of any length, which no float holds.
"""

from __future__ import annotations

import re
import tomllib
from typing import Any

MAX_KEY_PARTS = 32
"""Parts that a dotted key may have; a configuration needs four."""
LARGEST_INTEGER = 2**63 - 1
"""TOML itself asks for no more than 64 bits."""

_PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{MAX_KEY_PARTS}}}")


def parse_toml(text: str) -> dict[str, Any]:
    """Return the data of a TOML file. `tomllib.TOMLDecodeError` where it is none; another ValueError where it
    is beyond bounds. Integers may be of any size: see `check_integers`."""
    if (deep := _DEEP_KEY.search(text)) is not None:
        line = text.count("\n", 0, deep.start()) + 1
        raise ValueError(f"line {line}: a key of more than {MAX_KEY_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("arrays or tables are nested too deeply") from None
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # more digits than Python reads
        raise ValueError("a number of thousands of digits") from None


def check_integers(data: dict[str, Any]) -> None:
    """Check that integers are within TOML's own bounds; ValueError otherwise."""
    waiting: list[Any] = [data]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
        elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
            raise ValueError(f"an integer of {len(str(abs(value)))} digits, beyond TOML's 64 bits")
