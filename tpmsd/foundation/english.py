"""Numbers with their noun and lists of words in English.

In: counts and words. Out: short strings.
"""

from __future__ import annotations

from collections.abc import Sequence


def counted(number: int, noun: str) -> str:
    """Return a number with its regular noun: `1 drive`, `2 drives`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def listed(words: Sequence[str], last: str = "and") -> str:
    """Return words in a row, `a`, `a and b`, `a, b and c`; `last` stands before the last; empty for none."""
    return "".join(words) if len(words) < 2 else f"{', '.join(words[:-1])} {last} {words[-1]}"
