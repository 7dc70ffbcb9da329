"""The nearest right spelling of a wrong word.

In: the word and the right ones. Out: the nearest, or None where nothing is near.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_CUTOFF = 0.6


def nearest(word: str, choices: Iterable[str]) -> str | None:
    """Return the choice that looks most like `word`, upper and lower case being the same; None if none
    does."""
    by_folded: dict[str, str] = {}
    for choice in choices:
        by_folded.setdefault(choice.casefold(), choice)
    # The comparison is quadratic in the word's length, and no name is that long.
    matches = difflib.get_close_matches(word.casefold()[:100], by_folded, n=1, cutoff=_CUTOFF)
    return by_folded[matches[0]] if matches else None
